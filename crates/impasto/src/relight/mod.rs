//! From maps to light.

pub mod curve;
pub mod shadow;
pub mod show;
