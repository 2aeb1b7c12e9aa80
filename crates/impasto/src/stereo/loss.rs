//! How much a sample weighs, by its residual.

use crate::math::Real;

/// What is minimised over the samples that a rule kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Loss {
    Squares,
    Absolute,
    Huber,
    Cauchy,
    Tukey,
}

/// Constants for 95 % efficiency on normal noise.
const HUBER: f64 = 1.345;
const CAUCHY: f64 = 2.385;
const TUKEY: f64 = 4.685;

/// Median of absolute normal deviates, inverted.
pub(super) const SIGMA_PER_MEDIAN: f64 = 1.482_602_218_505_602;

/// The mean of absolute normal deviates, inverted: as good a scale where it only guards a division.
pub(super) const SIGMA_PER_MEAN: f64 = 1.253_314_137_315_500_3;

/// Residuals below this share of the noise all weigh the same.
const FLAT: f64 = 1e-3;

/// ... and below this share of the signal, where single precision sees no residual: 2^-22.
const UNSEEN: f64 = 1.0 / 4_194_304.0;

impl Loss {
    /// Whether its scale is the median of the residuals (else their mean).
    pub(super) fn needs_median(self) -> bool {
        matches!(self, Self::Huber | Self::Cauchy | Self::Tukey)
    }

    /// The size of a residual from `sigma` (an estimate of the noise) and the `signal`; never
    /// zero unless both are.
    #[inline(always)]
    pub(super) fn scale<R: Real>(self, sigma: R, signal: R) -> R {
        let unseen = signal * R::of(UNSEEN);
        match self {
            Self::Absolute => sigma.mul_add(R::of(FLAT), unseen),
            _ => sigma + unseen,
        }
    }

    /// Weight, 1 for no residual, from `|R|` and [`Self::scale`].
    #[inline(always)]
    pub(super) fn weight<R: Real>(self, residual: R, scale: R) -> R {
        match self {
            Self::Squares => R::one(),
            Self::Absolute => scale / residual.max(scale),
            Self::Huber => {
                let bound = scale * R::of(HUBER);
                bound / residual.max(bound)
            }
            Self::Cauchy => {
                let ratio = residual / (scale * R::of(CAUCHY));
                ratio.mul_add(ratio, R::one()).recip()
            }
            Self::Tukey => {
                let ratio = residual / (scale * R::of(TUKEY));
                let inside = (-ratio).mul_add(ratio, R::one()).max(R::zero());
                inside * inside
            }
        }
    }

    /// Standard error of an estimate by this loss over that by least squares, for normal noise.
    pub(super) fn inefficiency(self) -> f64 {
        match self {
            Self::Squares => 1.0,
            // The median's.
            Self::Absolute => SIGMA_PER_MEAN,
            // 95 % efficiency, which the constants above are chosen for.
            _ => 1.025_978_352_085_154,
        }
    }
}
