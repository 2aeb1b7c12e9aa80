//! Estimation of the gloss: from samples and normals to reflection parameters.
//!
//! [`pooled`] finds one Torrance-Sparrow lobe for the whole painting, `lobes` finds lobes of every
//! pixel, [`lafortune`] fits Lafortune lobes in three passes. [`fit_highlight`] fits one lobe per pixel
//! through samples of known angle. [`Adjustment`] is a rig and surfaces that are adjusted together.
//! What they estimate is a [`Surface`](crate::surface::Surface).

mod bundle_adjustment;
mod coherence;
mod highlight;
pub mod lafortune;
mod lobes;
mod neighbouring_lights;
pub mod pooled;
mod start;
#[cfg(test)]
mod tests;

pub use bundle_adjustment::{Adjustment, LobeProfile, RigEquations};
pub use highlight::{HighlightMaps, Highlights, fit_highlight};
pub use lobes::{
    HALO, LearnedLobes, LobeEstimation, LobeMapsMut, LobeOptions, MAX_SHAPES, MOST_LOBES, Origin,
    Precision, PriorNumbers, Slope, TYPICAL_PIXELS, Visit, apply_lobes, fit_lobes, learn_lobes,
};
pub use start::Start;
