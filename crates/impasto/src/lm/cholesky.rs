//! Cholesky's factor of a small matrix scaled to unit diagonal, with a floor under its pivots.

use crate::math::Scalar;

/// Pivots below this share of the (unit) diagonal are lifted to it: hard cases 5 and 14, parameters
/// that the data do not tell apart.
const PIVOT_FLOOR: f64 = 1e-12;

/// `A = S L L' S`, S the square roots of the diagonal.
#[derive(Clone, Copy, Debug)]
pub struct Factor<S, const N: usize> {
    lower: [[S; N]; N],
    scale: [S; N],
    /// Parameters whose pivot had to be lifted, or whose column is zero.
    pub deficient: [bool; N],
}

/// Factors the matrix with `damping` times its diagonal added, leaving out the `frozen` rows.
#[must_use]
#[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
pub fn factor<S: Scalar, const N: usize>(
    matrix: &[[S; N]; N],
    damping: S,
    frozen: &[bool; N],
) -> Factor<S, N> {
    let (zero, one) = (S::zero(), S::one());
    let scale: [S; N] = core::array::from_fn(|i| {
        let diagonal = matrix[i][i];
        if diagonal > zero && !frozen[i] { diagonal.sqrt() } else { zero }
    });
    let mut lower = [[zero; N]; N];
    let mut deficient = [false; N];
    for i in 0..N {
        for j in 0..=i {
            let active = scale[i] > zero && scale[j] > zero;
            let mut sum = match (i == j, active) {
                (true, _) => one + damping,
                (false, true) => matrix[i][j] / scale[i] / scale[j],
                (false, false) => zero,
            };
            for k in 0..j {
                sum = (-lower[i][k]).mul_add(lower[j][k], sum);
            }
            if i == j {
                let floor = S::of(PIVOT_FLOOR).max(S::EPSILON * S::of(8.0));
                let sound = sum > floor;
                deficient[i] = scale[i] <= zero || !sound;
                lower[i][i] = (if sound { sum } else { floor }).sqrt();
            } else {
                lower[i][j] = sum / lower[j][j];
            }
        }
    }
    Factor { lower, scale, deficient }
}

impl<S: Scalar, const N: usize> Factor<S, N> {
    /// Solves `A x = b`; 0 for parameters that are frozen or that nothing depends on.
    #[must_use]
    pub fn solve(&self, right: &[S; N]) -> [S; N] {
        let zero = S::zero();
        let mut x: [S; N] = core::array::from_fn(|i| {
            if self.scale[i] > zero { right[i] / self.scale[i] } else { zero }
        });
        for i in 0..N {
            for k in 0..i {
                x[i] = (-self.lower[i][k]).mul_add(x[k], x[i]);
            }
            x[i] = x[i] / self.lower[i][i];
        }
        for i in (0..N).rev() {
            for k in i + 1..N {
                x[i] = (-self.lower[k][i]).mul_add(x[k], x[i]);
            }
            x[i] = x[i] / self.lower[i][i];
        }
        core::array::from_fn(|i| if self.scale[i] > zero { x[i] / self.scale[i] } else { zero })
    }

    /// The inverse, column by column.
    #[must_use]
    pub fn inverse(&self) -> [[S; N]; N] {
        core::array::from_fn(|i| {
            let mut unit = [S::zero(); N];
            unit[i] = S::one();
            self.solve(&unit)
        })
    }
}
