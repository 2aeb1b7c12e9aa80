//! Photographs of a painting in; a relightable, colour-true surface out.
//!
//! This crate turns samples into maps and maps into light. It knows no files, no Python, no
//! screens and no colour spaces: colour enters as a matrix.
//!
//! The tour, in the order of the data:
//!
//! 1. [`stack`] borrows the photographs, [`geometry`] says who lit and who looked;
//! 2. [`stereo`] estimates each pixel's normal and albedo, robust to highlight and shadow;
//! 3. [`spectral`] builds estimators of reflectance from camera bands and applies them;
//! 4. [`sbrdf`] separates the specular part and fits reflection models ([`brdf`]) to it by
//!    Levenberg-Marquardt ([`lm`]);
//! 5. [`height`] integrates normals, [`scene`] says what to light, [`relight`] lights it.
//!
//! [`maps::Status`] says of every pixel why its result is what it is, [`pixels`] spreads the work
//! over tiles and threads, and [`math`] holds the numbers that all of it is written in.

#![deny(unsafe_code)]

pub mod brdf;
pub mod effects;
pub mod error;
pub mod geometry;
pub mod height;
pub mod lm;
pub mod maps;
pub mod math;
pub mod pixels;
pub mod relight;
pub mod sbrdf;
pub mod scene;
pub mod spectral;
pub mod stack;
pub mod stereo;

pub use error::{Error, Result};
