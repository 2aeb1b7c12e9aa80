//! The normal equations of one pass over the samples, and variable projection of an amplitude
//! [@golub1973varpro; @kaufman1975varpro].

use core::array::from_fn;

use crate::math::{Mask, Real, Scalar};

/// Cost, gradient and Gauss-Newton matrix at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normal<R, const N: usize> {
    /// Sum of squared residuals `r = y - f`.
    pub cost: R,
    /// `J' r`, minus half the derivative of the cost: it points downhill.
    pub descent: [R; N],
    /// `J' J`; the lower triangle is read.
    pub matrix: [[R; N]; N],
}

/// Samples whose derivatives wait for [`Normal::add_rows`]: as many as keep a tile of the matrix
/// in registers busy while their rows stay in the first-level cache.
pub const ROWS: usize = 8;

/// Rows and columns of the matrix that are summed up together: 16 sums; where there are 16
/// registers some of what feeds them comes from memory.
const TILE: usize = 4;

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
        let rest = const { N % TILE };
        for top in (0..N - rest).step_by(TILE) {
            self.add_tiles::<TILE>(top, slopes);
        }
        // A constant, so that only one of these is compiled.
        match const { N % TILE } {
            1 => self.add_tiles::<1>(N - rest, slopes),
            2 => self.add_tiles::<2>(N - rest, slopes),
            3 => self.add_tiles::<3>(N - rest, slopes),
            _ => {}
        }
    }

    /// [`add_rows`](Self::add_rows) for `H` rows of the matrix from `top` on, tile by tile. All of a
    /// tile's bounds are constants: compilers unroll it, and 8 loads feed 16 products.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn add_tiles<const H: usize>(&mut self, top: usize, slopes: &[[R; N]; ROWS]) {
        for left in (0..top).step_by(TILE) {
            let mut tile: [[R; TILE]; H] = from_fn(|i| *window(&self.matrix[top + i], left));
            for slope in slopes {
                let (own, other): (&[R; H], &[R; TILE]) = (window(slope, top), window(slope, left));
                for i in 0..H {
                    for j in 0..TILE {
                        tile[i][j] = own[i].mul_add(other[j], tile[i][j]);
                    }
                }
            }
            for (i, sums) in tile.iter().enumerate() {
                self.matrix[top + i][left..left + TILE].copy_from_slice(sums);
            }
        }
        let mut tile: [[R; H]; H] = from_fn(|i| *window(&self.matrix[top + i], top));
        for slope in slopes {
            let own: &[R; H] = window(slope, top);
            for i in 0..H {
                for j in 0..=i {
                    tile[i][j] = own[i].mul_add(own[j], tile[i][j]);
                }
            }
        }
        for (i, sums) in tile.iter().enumerate() {
            self.matrix[top + i][top..=top + i].copy_from_slice(&sums[..=i]);
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
    pub(crate) fn replace(&mut self, mask: R::Mask, yes: &Self) {
        self.cost = R::select(mask, yes.cost, self.cost);
        for i in 0..N {
            self.descent[i] = R::select(mask, yes.descent[i], self.descent[i]);
            for j in 0..=i {
                self.matrix[i][j] = R::select(mask, yes.matrix[i][j], self.matrix[i][j]);
            }
        }
    }
}

/// Some numbers in a row, from a place on.
#[inline(always)]
fn window<R, const N: usize, const W: usize>(row: &[R; N], from: usize) -> &[R; W] {
    row[from..from + W].try_into().expect("a slice as long as it was cut")
}
