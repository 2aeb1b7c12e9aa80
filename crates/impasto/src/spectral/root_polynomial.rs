//! Root-polynomial regression [@finlayson2015rootpoly]: ridge regression on the responses and the roots
//! of their products.
//!
//! Root-polynomials keep colour correction independent of exposure (three channels in the paper);
//! here they estimate spectra from any number of bands.

use nalgebra::{DMatrix, DVector};

use super::features::Features;
use super::fitted_map::FittedMap;
use super::problem::SpectralProblem;
use super::random::Source;
use super::ridge::{FOLDS, RidgeEquations, best, cross_validated, folds};

use crate::error::{Error, Result};

/// Noisy copies of the training responses.
const REPLICAS: usize = 3;

/// Ridge weights: half decades from 1e-9 to 1e-1, in units of squared responses.
const RIDGES: [f64; 17] = [
    1e-9, 3e-9, 1e-8, 3e-8, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2,
    1e-1,
];

/// The regression's sums: the operator of any subset of bands is a part of them.
#[derive(Clone, Debug)]
pub struct Regression {
    normal: RidgeEquations,
    ridge: f64,
    bands: usize,
}

impl Regression {
    /// `(n, features)` of the responses of some bands.
    #[must_use]
    pub fn of_bands(&self, present: &[usize]) -> DMatrix<f64> {
        let picked = places(self.bands, present);
        let part = RidgeEquations {
            gram: self.normal.gram.select_rows(&picked).select_columns(&picked),
            cross: self.normal.cross.select_rows(&picked),
        };
        part.solve(self.ridge)
    }
}

/// Where the features of some bands stand among those of all.
fn places(bands: usize, present: &[usize]) -> Vec<usize> {
    let mut picked = present.to_vec();
    let mut place = bands;
    for i in 0..bands {
        for j in i + 1..bands {
            if present.contains(&i) && present.contains(&j) {
                picked.push(place);
            }
            place += 1;
        }
    }
    picked
}

/// Fits the regression; its sums come too, for pixels with missing bands.
///
/// # Errors
/// If there are fewer training spectra than folds.
pub fn fit(problem: &SpectralProblem, seed: u64) -> Result<(FittedMap, Regression)> {
    let count = problem.training.nrows();
    if count < FOLDS {
        let problem = format!("a regression needs at least {FOLDS} spectra, found {count}");
        return Err(Error::argument("training", problem));
    }
    let mut source = Source::new(seed);
    let part = folds(&source.permutation(count));
    let features = Features::RootPolynomial { bands: problem.bands() };
    let responses = stacked(&problem.responses(), REPLICAS);
    let samples = features.of_rows(&source.noisy(&responses, problem.noise));
    let targets = stacked(&problem.training, REPLICAS);
    let part: Vec<usize> = part.iter().copied().cycle().take(count * REPLICAS).collect();
    let weights = DVector::repeat(samples.nrows(), 1.0);
    let (normal, errors) = cross_validated(&samples, &targets, &weights, &part, &RIDGES);
    let ridge = RIDGES[best(&errors)];
    let map = normal.solve(ridge);
    let regression = Regression { normal, ridge, bands: problem.bands() };
    Ok((FittedMap { features, map, samples, targets, lossless: false, ridge }, regression))
}

/// The matrix, several times below itself.
fn stacked(matrix: &DMatrix<f64>, times: usize) -> DMatrix<f64> {
    let rows = matrix.nrows();
    DMatrix::from_fn(rows * times, matrix.ncols(), |row, column| matrix[(row % rows, column)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_the_features_is_found_by_its_bands() {
        // Features of four bands: 0 1 2 3, then 01 02 03 12 13 23.
        assert_eq!(places(4, &[0, 2, 3]), [0, 2, 3, 5, 6, 9]);
        assert_eq!(places(4, &[1]), [1]);
    }
}
