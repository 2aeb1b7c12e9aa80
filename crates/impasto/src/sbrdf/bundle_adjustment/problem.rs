//! A rig and surfaces that are adjusted together, and the samples that say how.

use crate::geometry::Rig;
use crate::surface::Surface;

/// By what the lobe of the model is multiplied, over the angle between normal and half vector:
/// between knots linear, beyond them constant.
#[derive(Clone, Copy, Debug)]
pub struct LobeProfile<'a> {
    /// Angles in radians, rising.
    pub knots: &'a [f64],
    /// A factor for each.
    pub factors: &'a [f64],
}

/// A rig and surfaces that are adjusted together.
#[derive(Clone, Copy, Debug)]
pub struct Adjustment<'a> {
    /// Surfaces with one Torrance-Sparrow lobe. What is 0 (a reflectance, a strength, ambient light)
    /// is at its bound and stays there.
    pub surface: &'a Surface<'a>,
    /// The shape of all lobes, if it is not that of the model.
    pub profile: Option<LobeProfile<'a>>,
    /// Lights and views.
    pub rig: &'a Rig,
    /// Strengths of the lights.
    pub intensities: &'a [f64],
    /// For each inverse distance that is free: the rig with that larger by [`step`](Self::step).
    pub moved: &'a [Rig],
    /// By how much.
    pub step: f64,
    /// Whether strengths are free.
    pub strengths: bool,
    /// `(obs, band, y, x)`: measured minus predicted sample in codes, 0 of samples that do not count.
    pub errors: &'a [f64],
    /// `(obs, band, y, x)`: codes per light, 0 of samples that do not count.
    pub slopes: &'a [f64],
    /// Photographs whose errors are to be small. Surfaces follow the others, or all if all are held.
    pub held: &'a [bool],
}
