//! Photographs of a painting in; a relightable, colour-true surface out.
//!
//! This crate turns samples into maps and maps into light. It knows no files, no Python, no
//! screens and no colour spaces: colour enters as a matrix.
//!
//! The tour, in the order of the data:
//!
//! 1. [`stack`] borrows the photographs, less [`interreflections`] where a relief is known, and
//!    [`geometry`] says who lit and who looked;
//! 2. [`stereo`] estimates each pixel's normal and albedo, robust to highlight and shadow;
//! 3. [`spectral`] builds estimators of reflectance from camera bands and applies them;
//! 4. [`surface`] is what a painting is, normals and lobes of reflection models ([`brdf`]), and
//!    which samples it would show;
//! 5. [`sbrdf`] estimates it: separates the specular part and fits lobes to it by
//!    Levenberg-Marquardt ([`lm`]), and [`residual_scores`] keeps what the fit
//!    leaves of the photographs;
//! 6. [`height`] integrates normals, [`radiosity`] is the light that places of a relief send each
//!    other, and [`relight`] lights a surface as a scene says.
//!
//! [`maps::Status`] states for every pixel why its result is what it is, [`pixels`] spreads the work
//! over tiles and threads, and [`math`] holds the numbers that all of it is written in.
//!
//! # Features
//!
//! | feature | modules | dependencies |
//! |---|---|---|
//! | `painting` (default) | all | half, nalgebra, rayon, rustdct, thiserror |
//! | `lm` | [`lm`], [`math`] | none |
//!
//! To fit many small problems of another kind, take the solver alone:
//! `impasto = { version = "0.1", default-features = false, features = ["lm"] }`.
//!
//! The examples are a start: `decay` fits 50,000 exponential decays on all threads with the solver
//! alone, `photographs_to_picture` goes from photographs to a relit picture.

#![deny(unsafe_code)]
#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "citations such as [@snel] look like links; they are keys of docs/references.bib"
)]

#[cfg(feature = "painting")]
pub mod brdf;
#[cfg(feature = "painting")]
pub mod error;
#[cfg(feature = "painting")]
pub mod geometry;
#[cfg(feature = "painting")]
pub mod height;
#[cfg(feature = "painting")]
pub mod interreflections;
#[cfg(feature = "lm")]
pub mod lm;
#[cfg(feature = "painting")]
pub mod maps;
pub mod math;
#[cfg(feature = "painting")]
pub mod passes;
#[cfg(feature = "painting")]
pub mod pixels;
#[cfg(feature = "painting")]
pub mod radiosity;
#[cfg(feature = "painting")]
pub mod relight;
#[cfg(feature = "painting")]
pub mod residual_scores;
#[cfg(feature = "painting")]
pub mod sbrdf;
#[cfg(feature = "painting")]
pub mod spectral;
#[cfg(feature = "painting")]
pub mod stack;
#[cfg(feature = "painting")]
pub mod stereo;
#[cfg(feature = "painting")]
pub mod surface;

#[cfg(feature = "painting")]
pub use error::{Error, Result};
