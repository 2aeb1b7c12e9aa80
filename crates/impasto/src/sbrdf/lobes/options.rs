//! What a fit of pixels' own lobes is told.

/// How the fit goes about it.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::struct_excessive_bools, reason = "each switches one thing")]
pub struct LobeOptions {
    /// Lobes per pixel at most, up to [`MOST_LOBES`](super::MOST_LOBES).
    pub lobes: usize,
    /// Whether every band has a constant besides: ambient and inter-reflected light.
    pub ambient: bool,
    /// Whether the normal is free; else it stays where it starts.
    pub normal: bool,
    /// Rounds in which all bands settle and samples are weighed anew by their residuals.
    pub rounds: usize,
    /// Whether shapes are drawn towards what is typical of the painting.
    pub typical: bool,
    /// Whether a lobe must be worth its unknowns (BIC); else it need only lower the cost.
    pub sparing: bool,
    /// Steps of a search at most.
    pub iterations: usize,
    /// Where searches start.
    pub start: Origin,
    /// What searches compute in.
    pub precision: Precision,
}

/// Where the searches for a pixel's lobes start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// From all shapes of the model's table.
    Table,
    /// From what the pixels of a coarse grid found, which start from the table.
    Pyramid,
}

/// What the searches for shapes and normals compute in. Weights, and colours once the shapes are
/// known, are in single precision in any case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Single precision.
    Single,
    /// Single precision; the last round goes on in double precision from where it ended, by as many
    /// steps again.
    Polished,
    /// Double precision.
    Double,
}
