//! Square-root-free Cholesky factors (`L D L'`) of a small matrix, with a floor under the pivots.

use crate::math::{Mask, Real, Scalar};

/// Pivots below this share of their diagonal belong to a parameter that the data do not separate
/// from those before it: hard cases 5 and 14. In single precision 8 units of rounding are the
/// floor.
const DEFICIENT: f64 = 1e-12;

/// `A = L D L'` with a unit diagonal in L.
///
/// No column needs scaling: every pivot is judged against its own diagonal, and no product of the
/// factorisation exceeds the larger of the two diagonals that it stands between.
#[derive(Clone, Copy, Debug)]
pub struct Factor<R: Real, const N: usize> {
    lower: [[R; N]; N],
    /// Reciprocals of D; 0 for parameters left out.
    inverse: [R; N],
    /// Parameters whose pivot is lost in rounding, or whose column is zero.
    pub deficient: [R::Mask; N],
}

/// Factors the matrix with `damping` times its diagonal added, leaving out the `frozen` rows.
#[must_use]
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
pub fn factor<R: Real, const N: usize>(
    matrix: &[[R; N]; N],
    damping: R,
    frozen: &[R::Mask; N],
) -> Factor<R, N> {
    let mut diagonal = [R::zero(); N];
    for i in 0..N {
        diagonal[i] = matrix[i][i];
    }
    factor_damped(matrix, &diagonal, damping, frozen)
}

/// The same with `damping` times some other positive diagonal added.
///
/// A pivot that rounding has eaten is lifted to 4 units of rounding: the step along it stays
/// finite, and damping shortens it.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
pub(super) fn factor_damped<R: Real, const N: usize>(
    matrix: &[[R; N]; N],
    diagonal: &[R; N],
    damping: R,
    frozen: &[R::Mask; N],
) -> Factor<R, N> {
    let zero = R::zero();
    let floor = R::splat(R::Scalar::EPSILON) * R::of(4.0);
    let lost = R::of(DEFICIENT).max(R::splat(R::Scalar::EPSILON) * R::of(8.0));
    // Reciprocals of smaller numbers are infinite.
    let smallest = R::splat(R::Scalar::MIN_POSITIVE) * R::of(4.0);
    let mut lower = [[zero; N]; N];
    let mut inverse = [zero; N];
    let mut deficient = [R::Mask::splat(false); N];
    for i in 0..N {
        let used = diagonal[i].gt(zero) & !frozen[i];
        let mut pivot = damping.mul_add(diagonal[i], matrix[i][i]);
        // L D, then L: columns left out must not bring their infinities along (0 times Inf).
        let mut row = [zero; N];
        for j in 0..i {
            let mut sum = matrix[i][j];
            for k in 0..j {
                sum = (-row[k]).mul_add(lower[j][k], sum);
            }
            row[j] = R::keep(used & inverse[j].gt(zero), sum);
            lower[i][j] = row[j] * inverse[j];
            pivot = (-row[j]).mul_add(lower[i][j], pivot);
        }
        deficient[i] = !(used & pivot.gt(lost * diagonal[i]));
        let lifted = pivot.max(floor * diagonal[i]).max(smallest);
        inverse[i] = R::keep(used, lifted.recip());
    }
    Factor { lower, inverse, deficient }
}

impl<R: Real, const N: usize> Factor<R, N> {
    /// Solves `A x = b`; 0 for parameters that are frozen or that nothing depends on.
    #[must_use]
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub fn solve(&self, right: &[R; N]) -> [R; N] {
        let mut x = [R::zero(); N];
        for i in 0..N {
            let mut sum = R::keep(self.inverse[i].gt(R::zero()), right[i]);
            for k in 0..i {
                sum = (-self.lower[i][k]).mul_add(x[k], sum);
            }
            x[i] = sum;
        }
        for i in (0..N).rev() {
            let mut sum = x[i] * self.inverse[i];
            for k in i + 1..N {
                sum = (-self.lower[k][i]).mul_add(x[k], sum);
            }
            x[i] = sum;
        }
        x
    }

    /// The inverse, column by column.
    #[must_use]
    #[inline(always)]
    pub fn inverse(&self) -> [[R; N]; N] {
        let mut columns = [[R::zero(); N]; N];
        for (i, column) in columns.iter_mut().enumerate() {
            let mut unit = [R::zero(); N];
            unit[i] = R::one();
            *column = self.solve(&unit);
        }
        columns
    }
}
