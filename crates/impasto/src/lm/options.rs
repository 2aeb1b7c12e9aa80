//! Bounds of the parameters, and tolerances of the search.

use crate::math::{Real, Scalar};

/// Box within which parameters stay; one whose bounds are equal is held there.
#[derive(Clone, Copy, Debug)]
pub struct Bounds<S, const N: usize> {
    /// Smallest values.
    pub lower: [S; N],
    /// Largest values.
    pub upper: [S; N],
}

impl<S: Scalar, const N: usize> Bounds<S, N> {
    /// No bounds.
    #[must_use]
    pub fn none() -> Self {
        Self { lower: [-S::MAX; N], upper: [S::MAX; N] }
    }

    /// Whether a lower bound lies above its upper one, or either is NaN.
    pub(super) fn crossed(&self) -> bool {
        !self.lower.iter().zip(&self.upper).all(|(lower, upper)| lower <= upper)
    }

    /// The nearest place within; NaN stays NaN, for a lost number is no place.
    #[inline(always)]
    pub(super) fn project<R: Real<Scalar = S>>(&self, mut p: [R; N]) -> [R; N] {
        for ((p, &lower), &upper) in p.iter_mut().zip(&self.lower).zip(&self.upper) {
            *p = R::splat(upper).min(R::splat(lower).max(*p));
        }
        p
    }
}

/// When to stop. Tolerances finer than the numbers' own rounding mean that rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Steps tried at most; default 100.
    pub max_iterations: usize,
    /// Relative decrease of the cost, actual and predicted, below which nothing is left to gain
    /// (MINPACK's `ftol`); default 1e-12, which leaves the parameters half as many digits.
    pub cost: f64,
    /// Step relative to the parameters, both in the matrix's diagonal norm (as MINPACK's `xtol`);
    /// default 1e-10.
    pub step: f64,
    /// Largest cosine between residuals and any column of derivatives (MINPACK's `gtol`): one
    /// parameter alone could lower the cost by its square, relatively. Default 1e-12.
    pub gradient: f64,
    /// The search ends where an undamped step would change the residuals by less than this share of
    /// their length (the relative offset of Bates and Watts [@bates1981offset]), without that step and
    /// the pass that would confirm the end. Of a [`Batch`](super::Batch) that counts its
    /// [samples](super::Batch::samples), in standard deviations of the parameters. 0, the default:
    /// never.
    pub offset: f64,
    /// Damping of the first step, relative to the matrix's diagonal; from 0 to 1e10. Default 1e-2: a
    /// single parameter moves by 1 / 1.01 of its undamped step.
    pub damping: f64,
    /// How much of the largest diagonal so far the damping still holds on to: 0 is Marquardt's
    /// scaling, quick where starts are good; 1 is MINPACK's, which does not run away along a
    /// parameter that has ceased to matter. Default 0.
    pub memory: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 100,
            cost: 1e-12,
            step: 1e-10,
            gradient: 1e-12,
            offset: 0.0,
            damping: 1e-2,
            memory: 0.0,
        }
    }
}

impl Options {
    /// For starts that may be far from anywhere: small first steps (a hundredth of the undamped one),
    /// a long memory, patience. From the first starts of NIST's `BoxBOD` and MGH17 the defaults end
    /// elsewhere and these do not; along MGH10's valley 5000 steps are needed (`tests/lm/nist.rs`).
    #[must_use]
    pub fn cautious() -> Self {
        Self { max_iterations: 10_000, damping: 100.0, memory: 0.1, ..Self::default() }
    }

    /// For single precision: cost to 1e-6, about ten units of its rounding, steps to five digits of
    /// the parameters, and cosines to 1e-5, with which one parameter could lower the cost by 1e-10.
    #[must_use]
    pub fn single() -> Self {
        Self { cost: 1e-6, step: 1e-5, gradient: 1e-5, ..Self::default() }
    }
}
