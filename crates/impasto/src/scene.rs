//! What to light.
