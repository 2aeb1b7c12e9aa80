//! Wiener estimation and the finite-dimensional linear model (principal component analysis), the
//! estimators of [@tominaga-six-band-adaptation] and [@tominaga-rgb-camera], by singular values.

use nalgebra::{DMatrix, DVector};

use super::diagnostics::Diagnostics;
use super::svd::decomposed;

/// Singular values below this fraction of the largest are rounding, not signal: duplicate and
/// collinear bands leave them, and dividing by one of them destroys the estimate.
const NEGLIGIBLE: f64 = 1e-10;

/// A square root of the correlation of the training spectra: `R = T^T T / N = L L^T`.
#[derive(Clone, Debug)]
pub struct Root {
    /// `(n, r)`, orthonormal: the principal components (uncentred), strongest first.
    components: DMatrix<f64>,
    /// `(r,)`: root mean square weight of each component.
    weights: DVector<f64>,
}

impl Root {
    /// From `(N, n)` training spectra.
    #[must_use]
    pub fn of(training: &DMatrix<f64>) -> Self {
        let count = (training.nrows() as f64).sqrt();
        // The R factor has the same singular values and components as the tall matrix.
        let tall = training.nrows() > training.ncols();
        let small = if tall { training.clone().qr().r() } else { training.clone() };
        let (_, values, components) = decomposed(&small);
        Self { components, weights: values / count }
    }

    /// `L (n, r)`.
    fn matrix(&self) -> DMatrix<f64> {
        let mut root = self.components.clone();
        for (mut column, &weight) in root.column_iter_mut().zip(&self.weights) {
            column *= weight;
        }
        root
    }

    /// Singular values and vectors of `H L`: the bands as they see spectra of unit variance.
    #[must_use]
    pub fn whiten(&self, response: &DMatrix<f64>) -> Whitened {
        let (left, values, right) = decomposed(&(response * self.matrix()));
        Whitened { left, values, right }
    }
}

/// `H L = U diag(s) V^T`.
#[derive(Clone, Debug)]
pub struct Whitened {
    left: DMatrix<f64>,
    values: DVector<f64>,
    right: DMatrix<f64>,
}

impl Whitened {
    /// Condition and effective rank of the bands at a noise level.
    #[must_use]
    pub fn diagnostics(&self, noise: f64) -> Diagnostics {
        let floor = NEGLIGIBLE * self.values[0];
        let rank = |&s: &f64| if s > floor { s * s / (s * s + noise * noise) } else { 0.0 };
        let smallest = if self.left.nrows() > self.values.len() {
            0.0
        } else {
            self.values[self.values.len() - 1]
        };
        Diagnostics {
            condition: (self.values[0] / smallest).powi(2),
            effective_rank: self.values.iter().map(rank).sum(),
            ..Diagnostics::default()
        }
    }
}

/// Wiener estimation, eq. 5 of Tominaga and Tanaka (six-band paper):
/// `R H^T (H R H^T + sigma^2 I)^-1`, as `(n, band)`.
///
/// With `H L = U diag(s) V^T` this is `L V diag(s / (s^2 + sigma^2)) U^T`, which squares no
/// condition number and needs no inverse: the inverse fails on collinear bands and at sigma 0.
#[must_use]
pub fn wiener(root: &Root, whitened: &Whitened, noise: f64) -> DMatrix<f64> {
    let floor = NEGLIGIBLE * whitened.values[0];
    let mut gained = whitened.right.clone();
    for (mut column, &s) in gained.column_iter_mut().zip(&whitened.values) {
        column *= if s > floor { s / s.mul_add(s, noise * noise) } else { 0.0 };
    }
    root.matrix() * (gained * whitened.left.transpose())
}

/// The finite-dimensional linear model, eq. 4-7 of Tominaga and Tanaka (RGB paper): `B (H B)^-1`
/// with `B` the first principal components, as `(n, band)`. Not regularised, as in the paper.
///
/// With fewer components than bands the inverse is the least-squares one.
#[must_use]
pub fn linear_model(root: &Root, response: &DMatrix<f64>, terms: usize) -> DMatrix<f64> {
    // Duplicate and collinear bands determine fewer components than there are bands.
    let seen = root.whiten(response).values;
    let independent = seen.iter().filter(|&&s| s > NEGLIGIBLE * seen[0]).count();
    let terms = terms.min(independent).max(1);
    let basis = root.components.columns(0, terms).into_owned();
    let (left, values, mut right) = decomposed(&(response * &basis));
    let floor = NEGLIGIBLE * values[0];
    for (mut column, &s) in right.column_iter_mut().zip(&values) {
        column *= if s > floor { 1.0 / s } else { 0.0 };
    }
    basis * (right * left.transpose())
}
