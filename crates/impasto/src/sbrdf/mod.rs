//! The fitting passes: from samples and normals to reflection parameters, and back to samples.
//!
//! [`predict`] says what a surface would have shown.

mod lanes;
mod predict;

pub use predict::{Coats, Surface, predict};
