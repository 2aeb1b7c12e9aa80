//! Cholesky's factor of a small matrix scaled to unit diagonal, with a floor under its pivots.

use crate::math::{Mask, Real, Scalar};

/// Pivots below this share of the (unit) diagonal name a parameter that the data do not tell apart
/// from those before it: hard cases 5 and 14. In single precision 8 units of rounding are the
/// floor.
const DEFICIENT: f64 = 1e-12;

/// `A = L L'` scaled by the roots of the diagonal.
#[derive(Clone, Copy, Debug)]
pub struct Factor<R: Real, const N: usize> {
    lower: [[R; N]; N],
    /// Reciprocals of the pivots' roots.
    inverse: [R; N],
    /// Reciprocals of the roots of the diagonal; 0 for parameters left out.
    scale: [R; N],
    /// Parameters whose pivot is lost in rounding, or whose column is zero.
    pub deficient: [R::Mask; N],
}

/// Factors the matrix with `damping` times its diagonal added, leaving out the `frozen` rows.
#[must_use]
#[inline(always)]
pub fn factor<R: Real, const N: usize>(
    matrix: &[[R; N]; N],
    damping: R,
    frozen: &[R::Mask; N],
) -> Factor<R, N> {
    let mut diagonal = [R::zero(); N];
    for (i, diagonal) in diagonal.iter_mut().enumerate() {
        *diagonal = matrix[i][i];
    }
    factor_scaled(matrix, &diagonal, damping, frozen)
}

/// The same with `damping` times some other positive diagonal added.
///
/// A pivot that rounding has eaten is lifted to 4 units of rounding: the step along it stays
/// finite, and damping shortens it.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
pub(super) fn factor_scaled<R: Real, const N: usize>(
    matrix: &[[R; N]; N],
    diagonal: &[R; N],
    damping: R,
    frozen: &[R::Mask; N],
) -> Factor<R, N> {
    let (zero, one) = (R::zero(), R::one());
    let floor = R::splat(R::Scalar::EPSILON) * R::of(4.0);
    let lost = R::of(DEFICIENT).max(R::splat(R::Scalar::EPSILON) * R::of(8.0));
    let mut scale = [zero; N];
    for i in 0..N {
        let used = diagonal[i].gt(zero) & !frozen[i];
        scale[i] = R::keep(used, diagonal[i].sqrt().recip());
    }
    let mut lower = [[zero; N]; N];
    let mut inverse = [one; N];
    let mut deficient = [R::Mask::splat(false); N];
    for i in 0..N {
        for j in 0..i {
            let mut sum = matrix[i][j] * scale[i] * scale[j];
            for k in 0..j {
                sum = (-lower[i][k]).mul_add(lower[j][k], sum);
            }
            // What is left out must not bring its infinities along (0 times Inf).
            let active = scale[i].gt(zero) & scale[j].gt(zero);
            lower[i][j] = R::keep(active, sum * inverse[j]);
        }
        // What is left out has a unit pivot.
        let own = R::select(scale[i].gt(zero), matrix[i][i] * scale[i] * scale[i], one);
        let mut pivot = own + damping;
        for k in 0..i {
            pivot = (-lower[i][k]).mul_add(lower[i][k], pivot);
        }
        deficient[i] = !(scale[i].gt(zero) & pivot.gt(lost));
        inverse[i] = pivot.max(floor).sqrt().recip();
    }
    Factor { lower, inverse, scale, deficient }
}

impl<R: Real, const N: usize> Factor<R, N> {
    /// Solves `A x = b`; 0 for parameters that are frozen or that nothing depends on.
    #[must_use]
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub fn solve(&self, right: &[R; N]) -> [R; N] {
        let mut x = [R::zero(); N];
        for i in 0..N {
            let mut sum = R::keep(self.scale[i].gt(R::zero()), right[i] * self.scale[i]);
            for k in 0..i {
                sum = (-self.lower[i][k]).mul_add(x[k], sum);
            }
            x[i] = sum * self.inverse[i];
        }
        for i in (0..N).rev() {
            let mut sum = x[i];
            for k in i + 1..N {
                sum = (-self.lower[k][i]).mul_add(x[k], sum);
            }
            x[i] = sum * self.inverse[i];
        }
        for i in 0..N {
            x[i] = x[i] * self.scale[i];
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
