//! A map to spectra as coefficients and an orthonormal basis.

use nalgebra::{DMatrix, SymmetricEigen};

use super::fitted_map::FittedMap;
use super::svd::decomposed;

/// Coefficients of a nonlinear estimator are dropped, weakest first, as long as the root mean
/// square error over the training spectra rises by less than this: a fortieth of an
/// 8-bit code, and far below the estimators' own errors (0.01 to 0.03).
const RISE: f64 = 1e-4;

/// Directions whose singular value is below this fraction of the largest are rounding.
const NEGLIGIBLE: f64 = 1e-13;

/// `map = basis * coefficients`.
#[derive(Clone, Debug)]
pub struct Factorisation {
    /// `(n, k)`, orthonormal columns, strongest first.
    pub basis: DMatrix<f64>,
    /// `(k, features)`.
    pub coefficients: DMatrix<f64>,
    /// Root mean square error over training spectra and wavelengths.
    pub training_rmse: f64,
    /// By how much the dropped coefficients raised it.
    pub truncation: f64,
}

impl Factorisation {
    /// Splits a fitted map; `rank` limits the number of coefficients.
    #[must_use]
    pub fn of(fit: &FittedMap, rank: Option<usize>) -> Self {
        let (left, values, _) = decomposed(&fit.map);
        let kept = values.iter().filter(|&&s| s > NEGLIGIBLE * values[0]).count().max(1);
        let range = left.columns(0, kept).into_owned();
        // Inside the range, the axes along which the estimates vary most come first.
        let weights = &fit.samples * (range.transpose() * &fit.map).transpose();
        let eigen = SymmetricEigen::new(weights.transpose() * &weights);
        let mut order: Vec<usize> = (0..kept).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let mut basis = range * eigen.eigenvectors.select_columns(&order);
        for mut column in basis.column_iter_mut() {
            // A spectrum and its negative are the same axis: the larger lobe points up.
            if column[column.iamax()] < 0.0 {
                column.neg_mut();
            }
        }
        let errors = errors(fit, &basis);
        let full = errors[kept];
        let enough = |&k: &usize| fit.lossless || errors[k] - full > RISE;
        let needed = if fit.lossless { kept } else { (0..kept).filter(enough).count().max(1) };
        let rank = rank.unwrap_or(needed).min(needed);
        let basis = basis.columns(0, rank).into_owned();
        let coefficients = basis.transpose() * &fit.map;
        Self { basis, coefficients, training_rmse: errors[rank], truncation: errors[rank] - full }
    }
}

/// Root mean square error with the first `0 .. =k` axes of the basis.
fn errors(fit: &FittedMap, basis: &DMatrix<f64>) -> Vec<f64> {
    let estimates = &fit.samples * (basis.transpose() * &fit.map).transpose();
    let truths = &fit.targets * basis;
    let mut rest = fit.targets.norm_squared();
    let count = fit.targets.len() as f64;
    let mut errors = vec![(rest / count).sqrt()];
    for (estimate, truth) in estimates.column_iter().zip(truths.column_iter()) {
        // |t - e|^2 instead of |t|^2 along this axis.
        rest += estimate.norm_squared() - 2.0 * estimate.dot(&truth);
        errors.push((rest.max(0.0) / count).sqrt());
    }
    errors
}
