//! From maps to light.
