//! The fitting passes: from samples and normals to reflection parameters, and back to samples.
//!
//! [`fit_pooled`] finds one Torrance-Sparrow lobe for the whole painting, as in both papers: the
//! specular part of all samples against phi ([`histogram`]), then rounds in which normals, diffuse
//! colours and the lobe settle together. [`predict`] says what a surface would have shown.

mod extract;
pub mod histogram;
mod lanes;
mod pooled;
mod predict;
mod refine;
mod tile;

pub use extract::Extraction;
pub use pooled::{Pooled, PooledOptions, Verdict, fit_pooled};
pub use predict::{Coats, Surface, predict};
pub use tile::Maps;
