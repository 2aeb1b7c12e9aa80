//! The fitting passes: from samples and normals to reflection parameters, and back to samples.
//!
//! [`fit_pooled`] finds one Torrance-Sparrow lobe for the whole painting, as in both papers: first
//! from the specular part of all samples against phi ([`histogram`]), then by a search on a subset
//! of the pixels whose normals and diffuse colours follow the lobe. At last all pixels settle under
//! what was found. [`predict`] says what a surface would have shown.

mod highlight;
pub mod lafortune;
mod lanes;
mod lobes;
mod pooled;
mod predict;
mod start;
mod surface;
#[cfg(test)]
mod tests;

pub use highlight::{HighlightMaps, Highlights, fit_highlight};
pub use lobes::{
    Lafortune, LobeMaps, LobeModel, LobeOptions, MAX_NUMBERS, MAX_SHAPES, MOST_LOBES, Origin,
    Precision, Slope, TYPICAL_PIXELS, TorranceSparrow, Visit, fit_lobes,
};
pub use pooled::{Extraction, Pooled, PooledOptions, Verdict, fit_pooled, histogram};
pub use predict::predict;
pub use start::Start;
pub use surface::{Lobe, Parameter, Strength, Surface};
pub(crate) use surface::{scaled, unit};
