//! The result of a search: where it ended, why, and the covariance there.

use super::{Normal, factor};
use crate::math::{Mask, Real, Scalar};

/// Why the search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[non_exhaustive]
pub enum Reason {
    /// The cost no longer falls, or would by less than [`Options::offset`](super::Options::offset) asks for.
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
    /// There are residuals, but the numbers do not hold their squares: the cost has no meaning. Scale
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

    /// Whether the parameters are a minimum, as far as the numbers can tell, or as near to one as
    /// [`Options::offset`](super::Options::offset) asks for.
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
