//! Reflection models: value and derivatives.
