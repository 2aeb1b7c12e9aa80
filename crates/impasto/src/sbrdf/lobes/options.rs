//! Options of the fit of every pixel's own lobes.

use crate::brdf::coated_diffuse::CoatedDiffuse;

/// Options of [`fit_lobes`](super::fit_lobes).
#[derive(Clone, Copy, Debug)]
#[allow(clippy::struct_excessive_bools, reason = "each switches one thing")]
pub struct LobeOptions {
    /// Lobes per pixel at most, up to [`MOST_LOBES`](super::MOST_LOBES).
    pub lobes: usize,
    /// Whether every band also has a constant: ambient and inter-reflected light.
    pub ambient: bool,
    /// The smooth interface that diffuse light crosses; `None`: there is none.
    pub coated: Option<CoatedDiffuse>,
    /// Whether the normal is fitted; otherwise it stays at its start.
    pub normal: bool,
    /// Whether lobes have the width of a highlight at most while the normal is free; learned: off
    /// where the painting has broader ones.
    pub bounded: bool,
    /// Rounds in which all bands are fitted together and samples are reweighted by their residuals.
    pub rounds: usize,
    /// Whether shapes are drawn towards the painting's typical ones (empirical Bayes).
    pub typical: bool,
    /// Whether a lobe must lower BIC; otherwise it need only lower the cost.
    pub sparing: bool,
    /// Most steps of a search on the mean of the bands.
    pub iterations: usize,
    /// Most steps of a search on all bands, in each round. 1, in single precision: a step in the pass
    /// that renews the weights.
    pub colour_iterations: usize,
    /// Where searches start.
    pub start: Origin,
    /// What searches compute in.
    pub precision: Precision,
}

/// Where the searches for a pixel's lobes start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// From all starting shapes of the model; the best end is kept.
    Multistart,
    /// From the fits of neighbouring pixels on a grid, the seeds.
    Neighbours,
    /// The same; pixels have at most as many lobes as a seed beside them, and one.
    NeighboursOnly,
}

/// Precision of the searches for shapes and normals. Weights, and the colours once the shapes are
/// known, are always in single precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Single precision.
    Single,
    /// Single precision; the last round continues in double precision from its end, by up to as
    /// many steps again.
    Polished,
    /// Double precision.
    Double,
}
