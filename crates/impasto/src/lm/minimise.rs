//! What a search is told, what it answers, and the search on plain numbers.

use super::search::{Outcomes, Search};
use super::{Normal, factor};
use crate::math::{Mask, Real, Scalar};

/// A sum of squares to be minimised over N parameters.
pub trait Problem<S: Scalar, const N: usize> {
    /// Cost and its first derivatives at some parameters.
    fn normal(&self, parameters: [S; N]) -> Normal<S, N>;
}

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
    /// Steps tried at most.
    pub max_iterations: usize,
    /// Relative decrease of the cost, found and foretold, below which nothing is left to gain.
    pub cost: f64,
    /// Step relative to the parameters, both in the matrix's diagonal norm.
    pub step: f64,
    /// Largest cosine between residuals and any column of derivatives.
    pub gradient: f64,
    /// Damping of the first step, relative to the matrix's diagonal; from 0 to 1e10.
    pub damping: f64,
    /// How much of the largest diagonal so far the damping still holds on to: 0 is Marquardt's
    /// scaling, quick where starts are good; 1 is MINPACK's, which does not run away along a
    /// parameter that has ceased to matter.
    pub memory: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 100,
            cost: 1e-12,
            step: 1e-10,
            gradient: 1e-12,
            damping: 1e-2,
            memory: 0.0,
        }
    }
}

impl Options {
    /// For starts that may be far from anywhere: small first steps, a long memory, patience.
    #[must_use]
    pub fn cautious() -> Self {
        Self { max_iterations: 10_000, damping: 100.0, memory: 0.1, ..Self::default() }
    }

    /// What single precision can tell: cost to 1e-6, a tenth of what its sums are good for.
    #[must_use]
    pub fn single() -> Self {
        Self { cost: 1e-6, step: 1e-5, gradient: 1e-5, ..Self::default() }
    }
}

/// Why the search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[non_exhaustive]
pub enum Reason {
    /// The cost no longer falls.
    Cost = 1,
    /// The steps have become too small.
    Step = 2,
    /// The residuals are orthogonal to every column.
    Gradient = 3,
    /// All iterations are used up.
    MaxIterations = 4,
    /// No damping finds a smaller cost any more: the last place is as good as the numbers, or a kink
    /// there, allow.
    NoProgress = 5,
    /// At the start a parameter is NaN, or the cost or a derivative is not finite.
    NotFinite = 6,
    /// Damping alone made the steps too small: the slopes promise more than they have kept so far, and
    /// no step finds it. They are hardly the model's.
    Stalled = 7,
    /// There are residuals, but the numbers do not hold their squares: the cost says nothing. Scale
    /// the samples, or take double precision.
    Underflow = 8,
    /// A lower bound lies above its upper one, or is NaN: there is no place to look at.
    CrossedBounds = 9,
}

impl Reason {
    /// Every reason, in the order of its number.
    pub const ALL: [Self; 9] = [
        Self::Cost,
        Self::Step,
        Self::Gradient,
        Self::MaxIterations,
        Self::NoProgress,
        Self::NotFinite,
        Self::Stalled,
        Self::Underflow,
        Self::CrossedBounds,
    ];

    /// Whether the parameters are a minimum, as far as the numbers can tell.
    #[must_use]
    pub fn converged(self) -> bool {
        matches!(self, Self::Cost | Self::Step | Self::Gradient | Self::NoProgress)
    }

    /// The number that stands for the reason in a lane.
    #[inline(always)]
    pub(super) fn code<R: Real>(self) -> R {
        R::of(f64::from(self as u8))
    }

    pub(super) fn of_code(code: f64) -> Self {
        Self::ALL[(code as usize).clamp(1, Self::ALL.len()) - 1]
    }
}

/// Where the search ended, and why.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<S, const N: usize> {
    /// The best parameters; the start, as it was given, where there was none to begin with.
    pub parameters: [S; N],
    /// Cost, gradient and matrix there; NaN and zeros where the start had none.
    pub normal: Normal<S, N>,
    /// Why it ended.
    pub reason: Reason,
    /// Steps tried.
    pub iterations: usize,
    /// What the lanes have worked out already.
    pub(super) inverse: Option<Inverse<S, bool, N>>,
}

/// `(J'J)^-1`, and the parameters that it does not hold for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inverse<R, M, const N: usize> {
    pub(super) matrix: [[R; N]; N],
    pub(super) deficient: [M; N],
}

impl<R: Real, const N: usize> Inverse<R, R::Mask, N> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "a matrix is written with its indices")]
    pub(super) fn of(matrix: &[[R; N]; N]) -> Self {
        let factor = factor(matrix, R::zero(), &[R::Mask::splat(false); N]);
        let mut inverse = factor.inverse();
        let unknown = R::splat(R::Scalar::NAN);
        for i in 0..N {
            for j in 0..N {
                let known = matrix[i][i].gt(R::zero()) & matrix[j][j].gt(R::zero());
                inverse[i][j] = R::select(known, inverse[i][j], unknown);
            }
        }
        Self { matrix: inverse, deficient: factor.deficient }
    }
}

impl<S: Scalar, const N: usize> Outcome<S, N> {
    /// No search, for no place lies within the bounds.
    pub(super) fn nowhere(start: [S; N]) -> Self {
        Self {
            parameters: start,
            normal: Normal { cost: S::NAN, ..Normal::zero() },
            reason: Reason::CrossedBounds,
            iterations: 0,
            inverse: None,
        }
    }

    fn inverse(&self) -> Inverse<S, bool, N> {
        self.inverse.unwrap_or_else(|| Inverse::of(&self.normal.matrix))
    }

    /// Parameters that the data do not determine, given those before them.
    #[must_use]
    pub fn deficient(&self) -> [bool; N] {
        self.inverse().deficient
    }

    /// Covariance of the parameters for residuals of the given variance: `variance (J'J)^-1`.
    ///
    /// Variances that involve a [`deficient`](Self::deficient) parameter are lower limits, as
    /// large as the matrix's rounding can tell; rows and columns of a parameter that nothing
    /// depends on are NaN. Bounds do not enter: it is the covariance of an unbounded fit.
    #[must_use]
    pub fn covariance(&self, variance: S) -> [[S; N]; N] {
        let mut covariance = self.inverse().matrix;
        for entry in covariance.as_flattened_mut() {
            *entry = *entry * variance;
        }
        covariance
    }
}

/// Minimises a sum of squares from `start`, within bounds.
pub fn minimise<S: Scalar, const N: usize>(
    problem: &impl Problem<S, N>,
    start: [S; N],
    bounds: &Bounds<S, N>,
    options: &Options,
) -> Outcome<S, N> {
    if bounds.crossed() {
        return Outcome::nowhere(start);
    }
    let mut search = Search::<S, N>::idle(options);
    search.begin(Mask::splat(true), start, bounds, options);
    while search.running() {
        let next = problem.normal(search.trial);
        search.judge(search.trial, &next, options);
        search.step(bounds, options);
    }
    let mut outcomes = Outcomes::blank();
    search.write(&mut outcomes, false);
    outcomes.lane(0, bounds, options)
}
