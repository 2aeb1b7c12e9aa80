//! What every result map shares: a status per pixel, why its result is what it is.

/// Why a pixel's result is what it is; one byte in the maps.
///
/// Below 16 the quantity was estimated; from 16 on it was not, and its maps hold NaN there and
/// nowhere else (the albedo of a [`Dark`](Status::Dark) pixel is zero: that much is known).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
#[non_exhaustive]
pub enum Status {
    /// Estimated from enough samples.
    Fitted = 0,
    /// Estimated, but the selection rule left too few samples and some were re-admitted.
    Relaxed = 1,
    /// Estimated from exactly as many samples as unknowns: no residual, no predicted error.
    Exact = 2,
    /// Estimated, but the usable lights barely determine it.
    IllConditioned = 3,
    /// Estimated, but the pixel's own samples say nothing for its specular parameters, which are the
    /// painting's. In a pooled fit its normal and colours are then those of photometric stereo.
    Pooled = 4,
    /// No signal in any observation.
    Dark = 16,
    /// Too few samples below the saturation level.
    Saturated = 17,
    /// Fewer usable samples than unknowns.
    TooFewSamples = 18,
    /// The usable lights lie in one plane or one line.
    RankDeficient = 19,
    /// No finite sample.
    InvalidInput = 20,
    /// Excluded by the mask.
    Masked = 21,
    /// Not reached.
    NotComputed = 255,
}

impl Status {
    /// Every status, in the order of its number.
    pub const ALL: [Self; 12] = [
        Self::Fitted,
        Self::Relaxed,
        Self::Exact,
        Self::IllConditioned,
        Self::Pooled,
        Self::Dark,
        Self::Saturated,
        Self::TooFewSamples,
        Self::RankDeficient,
        Self::InvalidInput,
        Self::Masked,
        Self::NotComputed,
    ];

    /// Whether the pixel's quantity was estimated.
    #[must_use]
    pub fn estimated(self) -> bool {
        (self as u8) < 16
    }

    /// The byte that stands in the maps.
    #[must_use]
    pub fn code(self) -> u8 {
        self as u8
    }
}

/// Why a sample was not used; the order of the planes of a `rejected` map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Rejection {
    /// Clipped: at or above the saturation level in some band.
    Saturated = 0,
    /// NaN, or negative beyond noise.
    Invalid = 1,
    /// Too dark for its light: shadow.
    Shadow = 2,
    /// Too bright for its light: highlight.
    Highlight = 3,
}

impl Rejection {
    /// How many reasons there are.
    pub const COUNT: usize = 4;
}
