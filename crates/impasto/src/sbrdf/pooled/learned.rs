//! What a pooled fit learns of the whole painting: small, plain numbers that can be saved.

use super::verdict::Verdict;

/// The painting's lobe, and all that [`apply`](super::apply()) needs to know of the painting beside a
/// tile's own photographs.
#[derive(Clone, Debug, PartialEq)]
pub struct PooledLobe {
    /// Strength; 0 where no highlight was found.
    pub beta: f64,
    /// Logarithm of the sharpness `k = ln 2 / gamma^2`.
    pub log_sharpness: f64,
    /// Index of refraction.
    pub index: f64,
    /// Whether every pixel's normal and colours are fitted with the lobe; else they stay those of the
    /// start.
    pub refined: bool,
    /// Whether diffuse light crosses a smooth interface; only where pixels are refined.
    pub coated: bool,
    /// A bright colour of the painting: its power of two is the unit that samples are counted in.
    pub brightness: f64,
    /// Standard deviation of a sample by class of brightness, in that unit; infinite where unknown.
    pub noise: Vec<f32>,
    /// Squared scale of the residuals that is taken for noise, in that unit squared.
    pub noise_floor: f64,
}

impl PooledLobe {
    /// Half-width of the facets, rad.
    #[must_use]
    pub fn gamma(&self) -> f64 {
        (core::f64::consts::LN_2 / self.log_sharpness.exp()).sqrt()
    }
}

/// The lobe, and how well the photographs determine it.
#[derive(Clone, Debug)]
pub struct LearnedLobe {
    /// What is applied to every tile.
    pub lobe: PooledLobe,
    /// Covariance of (log beta, log gamma); infinite where there is no highlight.
    pub covariance: [[f64; 2]; 2],
    /// Whether there is a highlight, and whether one lobe describes it.
    pub verdict: Verdict,
    /// Share of the pixels that determine their own strength which agree with the painting's; NaN if
    /// none does.
    pub describes: f64,
    /// The specular part of the samples over its geometry factor, against phi:
    /// [`Histogram::curve`](super::histogram::Histogram::curve).
    pub curve: Vec<[f64; 3]>,
    /// Whether the search ended by its own tests, not by its number of steps.
    pub converged: bool,
    /// (beta, gamma) as they got better, the separate fit first.
    pub path: Vec<[f64; 2]>,
}
