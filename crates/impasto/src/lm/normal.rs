//! What one pass over the samples hands to the search.

use crate::math::{Mask, Real, Scalar};

/// Cost, gradient and Gauss-Newton matrix at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normal<R, const N: usize> {
    /// Sum of squared residuals `r = y - f`.
    pub cost: R,
    /// `J' r`: downhill.
    pub descent: [R; N],
    /// `J' J`; the lower triangle is read.
    pub matrix: [[R; N]; N],
}

/// Samples whose derivatives wait for [`Normal::add_rows`]: as many as keep a tile of the matrix
/// in registers busy while their rows stay in the first-level cache.
pub const ROWS: usize = 8;

impl<R: Real, const N: usize> Normal<R, N> {
    /// No residuals yet.
    #[must_use]
    #[inline(always)]
    pub fn zero() -> Self {
        let o = R::zero();
        Self { cost: o, descent: [o; N], matrix: [[o; N]; N] }
    }

    /// Adds one residual with the model's derivatives there.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub fn add(&mut self, slope: [R; N], residual: R) {
        self.cost = residual.mul_add(residual, self.cost);
        for i in 0..N {
            self.descent[i] = slope[i].mul_add(residual, self.descent[i]);
            for j in 0..=i {
                self.matrix[i][j] = slope[i].mul_add(slope[j], self.matrix[i][j]);
            }
        }
    }

    /// Adds [`ROWS`] residuals at once, in the order and with the bits of as many calls of
    /// [`add`](Self::add): for models whose matrix does not fit the registers (N above 5). Rows
    /// beyond the last sample hold zeros.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub fn add_rows(&mut self, slopes: &[[R; N]; ROWS], residuals: &[R; ROWS]) {
        for residual in residuals {
            self.cost = residual.mul_add(*residual, self.cost);
        }
        for i in 0..N {
            let mut sum = self.descent[i];
            for k in 0..ROWS {
                sum = slopes[k][i].mul_add(residuals[k], sum);
            }
            self.descent[i] = sum;
        }
        // Tiles of 4 x 4 accumulators: 8 loads feed 16 products.
        let mut top = 0;
        while top < N {
            let bottom = if top + 4 < N { top + 4 } else { N };
            let mut left = 0;
            while left < bottom {
                let mut tile = [[R::zero(); 4]; 4];
                for i in top..bottom {
                    for j in left..(left + 4).min(i + 1) {
                        tile[i - top][j - left] = self.matrix[i][j];
                    }
                }
                for slope in slopes {
                    for i in top..bottom {
                        for j in left..(left + 4).min(i + 1) {
                            tile[i - top][j - left] =
                                slope[i].mul_add(slope[j], tile[i - top][j - left]);
                        }
                    }
                }
                for i in top..bottom {
                    for j in left..(left + 4).min(i + 1) {
                        self.matrix[i][j] = tile[i - top][j - left];
                    }
                }
                left += 4;
            }
            top += 4;
        }
    }

    /// Moves an amplitude to its best value without another pass (variable projection: Golub &
    /// Pereyra 1973, in Kaufman's form of 1975).
    ///
    /// For models `a f(u)` whose parameter 0 is a: `self` holds residuals at the place `at`, a
    /// included, but slopes of `f`, not of `a f`. As residuals, not samples, are projected, little
    /// cancels in single precision. Returns the place with the best amplitude not below `lowest`
    /// (the search's bound; one above is not looked at), and the equations of `a f(u)` there.
    #[must_use]
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub fn project(mut self, mut at: [R; N], lowest: R) -> ([R; N], Self) {
        let own = self.matrix[0][0];
        // Nothing depends on the amplitude: it stays (and 0/0 does not arise).
        let wish = R::keep(own.gt(R::zero()), self.descent[0] / own);
        let amplitude = (at[0] + wish).max(lowest);
        let change = amplitude - at[0];
        at[0] = amplitude;
        let left = (-change).mul_add(own, self.descent[0]);
        let cost = (-change).mul_add(self.descent[0] + left, self.cost);
        self.cost = R::select(cost.lt(R::zero()), R::zero(), cost);
        self.descent[0] = left;
        for i in 1..N {
            let descent = (-change).mul_add(self.matrix[i][0], self.descent[i]);
            self.descent[i] = amplitude * descent;
            self.matrix[i][0] = amplitude * self.matrix[i][0];
            for j in 1..=i {
                self.matrix[i][j] = amplitude * amplitude * self.matrix[i][j];
            }
        }
        (at, self)
    }

    /// Where residuals lead downhill, but are too small for the numbers to hold their squares.
    ///
    /// A cost of 0 alone may be rounding of an exact fit, whose residuals' shares in the columns are
    /// as large as rounding makes them.
    #[inline(always)]
    pub(super) fn underflows(&self) -> R::Mask {
        let least = R::splat(R::Scalar::MIN_POSITIVE);
        let root = least.sqrt();
        let mut steep = R::Mask::splat(false);
        let mut tiny = self.cost.lt(least);
        for i in 0..N {
            let share = self.descent[i].abs();
            steep = steep | share.gt(R::zero());
            tiny = tiny & share.le(root * self.matrix[i][i].sqrt().max(root));
        }
        steep & tiny
    }

    /// The entry of the symmetric matrix.
    #[inline(always)]
    pub(super) fn entry(&self, i: usize, j: usize) -> R {
        if i >= j { self.matrix[i][j] } else { self.matrix[j][i] }
    }

    /// `yes` in the lanes of the mask, else `self`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub(super) fn replace(&mut self, mask: R::Mask, yes: &Self) {
        self.cost = R::select(mask, yes.cost, self.cost);
        for i in 0..N {
            self.descent[i] = R::select(mask, yes.descent[i], self.descent[i]);
            for j in 0..=i {
                self.matrix[i][j] = R::select(mask, yes.matrix[i][j], self.matrix[i][j]);
            }
        }
    }
}
