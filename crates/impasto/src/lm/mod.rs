//! Levenberg-Marquardt for small problems; knows nothing of light.
//!
//! A problem hands over its cost, gradient and Gauss-Newton matrix in one go ([`Problem`]);
//! [`minimise`] steps with Nielsen's damping, scaled by the matrix's diagonal, within bounds. Every
//! test is relative: scaling data or a parameter by a power of two changes no bit of the path.
//!
//! An exponential decay `a exp(-b t)` through four points:
//!
//! ```
//! use impasto::lm::{Bounds, Normal, Options, Problem, minimise};
//!
//! struct Decay([(f64, f64); 4]);
//! impl Problem<f64, 2> for Decay {
//!     fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
//!         let mut normal = Normal::zero();
//!         for (t, y) in self.0 {
//!             let decay = (-b * t).exp();
//!             normal.add([decay, -t * a * decay], y - a * decay);
//!         }
//!         normal
//!     }
//! }
//!
//! let points = [0.0, 1.0, 2.0, 3.0].map(|t: f64| (t, 5.0 * (-0.7 * t).exp()));
//! let outcome = minimise(&Decay(points), [1.0, 0.1], &Bounds::none(), &Options::default());
//! assert!(outcome.reason.converged());
//! assert!((outcome.parameters[0] - 5.0).abs() < 1e-6 && (outcome.parameters[1] - 0.7).abs() < 1e-6);
//! ```

mod cholesky;
mod minimise;

pub use cholesky::{Factor, factor};
pub use minimise::{Bounds, Options, Outcome, Reason, minimise};

#[cfg(test)]
mod tests;

use crate::math::Scalar;

/// A sum of squares to be minimised over N parameters.
pub trait Problem<S: Scalar, const N: usize> {
    /// Cost and its first derivatives at some parameters.
    fn normal(&self, parameters: [S; N]) -> Normal<S, N>;
}

/// Cost, gradient and Gauss-Newton matrix at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normal<S, const N: usize> {
    /// Sum of squared residuals `r = y - f`.
    pub cost: S,
    /// `J' r`: downhill.
    pub descent: [S; N],
    /// `J' J`; the lower triangle is read.
    pub matrix: [[S; N]; N],
}

impl<S: Scalar, const N: usize> Normal<S, N> {
    /// No residuals yet.
    #[must_use]
    pub fn zero() -> Self {
        let o = S::zero();
        Self { cost: o, descent: [o; N], matrix: [[o; N]; N] }
    }

    /// Adds one residual with the model's derivatives there.
    pub fn add(&mut self, slope: [S; N], residual: S) {
        self.cost = residual.mul_add(residual, self.cost);
        for i in 0..N {
            self.descent[i] = slope[i].mul_add(residual, self.descent[i]);
            for j in 0..=i {
                self.matrix[i][j] = slope[i].mul_add(slope[j], self.matrix[i][j]);
            }
        }
    }
}
