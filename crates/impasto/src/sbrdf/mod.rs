//! Estimation of the gloss: from samples and normals to reflection parameters.
//!
//! [`pooled`] finds one Torrance-Sparrow lobe for the whole painting, `lobes` finds lobes of every
//! pixel, [`lafortune`] fits Lafortune lobes in three passes. [`fit_highlight`] fits one lobe per pixel
//! through samples of known angle. [`predict`] gives the samples of a surface.

mod highlight;
pub mod lafortune;
mod lanes;
mod lobes;
pub mod pooled;
mod predict;
mod start;
mod surface;
#[cfg(test)]
mod tests;

pub use highlight::{HighlightMaps, Highlights, fit_highlight};
pub use lobes::{
    HALO, Lafortune, LearnedLobes, LobeMapsMut, LobeModel, LobeOptions, MAX_NUMBERS, MAX_SHAPES,
    MOST_LOBES, Origin, Precision, PriorNumbers, Slope, TYPICAL_PIXELS, TorranceSparrow, Visit,
    apply_lobes, fit_lobes, learn_lobes,
};
pub use predict::predict;
pub use start::Start;
pub use surface::{Lobe, Parameter, Strength, Surface};
pub(crate) use surface::{scaled, unit};
