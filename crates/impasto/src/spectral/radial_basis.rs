//! Gaussian radial basis functions around training responses, added to a linear estimate, on
//! directions.
//!
//! `f(rho) = |rho| g(rho / |rho|)`: the estimator `g` of Gaussian ridge regression sees only the
//! direction of the response vector, so that `f` is homogeneous of degree one.

use nalgebra::{DMatrix, DVector, RowDVector};

use super::features::{Centres, Features};
use super::fitted_map::FittedMap;
use super::problem::SpectralProblem;
use super::random::Source;
use super::ridge::{FOLDS, RidgeEquations, best, cross_validated, folds};

use crate::error::{Error, Result};

/// Gaussians, drawn from the training spectra.
const CENTRES: usize = 128;

/// Training spectra whose responses are shorter than this (relative to a perfect white in one
/// band) say more about the noise than about a direction.
const FLOOR: f64 = 0.15;

/// Directions that differ by less than this are one direction: a single band, or equal bands.
/// Their rounding must not be taken for a spread.
const SAME: f64 = 1e-7;

/// Widths, in units of the spread of the directions.
const GAMMAS: [f64; 6] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0];

/// Ridge weights, decades. Below 1e-8 the Gaussians' weights grow so large that single precision
/// shows in the estimate.
const RIDGES: [f64; 6] = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3];

/// Fits the regression.
///
/// # Errors
/// If there are fewer training spectra than folds, or none is bright enough to have a direction.
pub fn fit(problem: &SpectralProblem, seed: u64) -> Result<FittedMap> {
    let mut source = Source::new(seed);
    let directions = Directions::of(problem, &mut source)?;
    let count = directions.lengths.len();
    let order = source.permutation(count);
    let part = folds(&source.permutation(count));
    let chosen = &order[..CENTRES.min(count)];
    let residual = directions.residual();
    let candidates = GAMMAS.map(|gamma| {
        let centres = directions.centres(chosen, gamma);
        let gaussians = directions.gaussians(&centres);
        let (normal, errors) =
            cross_validated(&gaussians, &residual, &directions.weights, &part, &RIDGES);
        let at = best(&errors);
        (errors[at], RIDGES[at], normal, centres)
    });
    let errors = candidates.each_ref().map(|&(error, ..)| error);
    let (_, ridge, normal, centres) = &candidates[best(&errors)];
    let map = directions.map(&normal.solve(*ridge));
    let features = Features::RadialBasis(centres.clone());
    let samples = features.of_rows(&directions.responses);
    let targets = directions.spectra;
    Ok(FittedMap { features, map, samples, targets, lossless: false, ridge: *ridge })
}

/// Training responses and spectra divided by the length of the response.
struct Directions {
    /// `(N, band)`, with noise, not divided.
    responses: DMatrix<f64>,
    /// `(N, n)`, not divided.
    spectra: DMatrix<f64>,
    /// `(N,)` of the responses without noise.
    lengths: DVector<f64>,
    /// `(N, band)`.
    units: DMatrix<f64>,
    /// `(N, n)`.
    divided: DMatrix<f64>,
    /// `(N,)`, mean 1: proportional to the length, because the relative noise of a dark surface
    /// is larger and its error counts less.
    weights: DVector<f64>,
    /// `(band,)` and `(n,)`.
    mean: (RowDVector<f64>, RowDVector<f64>),
    /// `(band, n)`: the centred linear estimate.
    slope: DMatrix<f64>,
    spread: f64,
}

impl Directions {
    fn of(problem: &SpectralProblem, source: &mut Source) -> Result<Self> {
        let clean = problem.responses();
        let bright: Vec<usize> =
            (0..clean.nrows()).filter(|&row| clean.row(row).norm() >= FLOOR).collect();
        if bright.len() < FOLDS {
            let problem = format!(
                "a regression needs at least {FOLDS} spectra brighter than {FLOOR}, found {}",
                bright.len()
            );
            return Err(Error::argument("training", problem));
        }
        let (clean, spectra) = (clean.select_rows(&bright), problem.training.select_rows(&bright));
        let lengths = DVector::from_iterator(bright.len(), clean.row_iter().map(|row| row.norm()));
        let mut ordered: Vec<f64> = lengths.iter().copied().collect();
        ordered.sort_by(f64::total_cmp);
        let noise = problem.noise / ordered[ordered.len() / 2];
        let (mut directions, mut divided) = (clean.clone(), spectra.clone());
        for (row, &length) in lengths.iter().enumerate() {
            directions.row_mut(row).unscale_mut(length);
            divided.row_mut(row).unscale_mut(length);
        }
        // The linear part takes the noise as a number: a noisy copy would make signal of what
        // duplicate bands differ by.
        let weights = &lengths / lengths.mean();
        let mean = (weighted_mean(&directions, &weights), weighted_mean(&divided, &weights));
        let centred = minus(&directions, &mean.0);
        let slope = linear(&centred, &minus(&divided, &mean.1), &weights, noise);
        let spread = centred.norm() / (centred.len() as f64).sqrt();
        let directions = source.noisy(&directions, noise);
        let mut responses = directions.clone();
        for (mut row, &length) in responses.row_iter_mut().zip(&lengths) {
            row *= length;
        }
        // One direction only: any spread will do.
        let spread = if spread > SAME { spread } else { 1.0 };
        Ok(Self {
            responses,
            spectra,
            lengths,
            units: directions,
            divided,
            weights,
            mean,
            slope,
            spread,
        })
    }

    /// What the linear estimate leaves.
    fn residual(&self) -> DMatrix<f64> {
        minus(&self.divided, &self.mean.1) - minus(&self.units, &self.mean.0) * &self.slope
    }

    fn centres(&self, chosen: &[usize], gamma: f64) -> Centres {
        let scale = gamma.sqrt() / self.spread;
        let centres = minus(&self.units.select_rows(chosen), &self.mean.0) * scale;
        Centres {
            offset: self.mean.0.iter().map(|mean| mean * scale).collect(),
            scale,
            places: centres.transpose().as_slice().to_vec(),
            gamma,
        }
    }

    /// `(N, centre)` for directions of unit length, up to the noise.
    fn gaussians(&self, centres: &Centres) -> DMatrix<f64> {
        let features = Features::RadialBasis(centres.clone());
        let mut values = features.of_rows(&self.units);
        for mut row in values.row_iter_mut() {
            let length = row[0];
            row.unscale_mut(length);
        }
        let first = 1 + features.bands();
        values.columns(first, values.ncols() - first).into_owned()
    }

    /// `(n, 1 + band + centre)`: `|rho| (mean - slope^T mean direction)`, `slope^T rho`, Gaussians.
    fn map(&self, gaussians: &DMatrix<f64>) -> DMatrix<f64> {
        let bands = self.slope.nrows();
        let constant = &self.mean.1 - &self.mean.0 * &self.slope;
        let mut map = DMatrix::zeros(gaussians.nrows(), 1 + bands + gaussians.ncols());
        map.column_mut(0).copy_from(&constant.transpose());
        map.columns_mut(1, bands).copy_from(&self.slope.transpose());
        map.columns_mut(1 + bands, gaussians.ncols()).copy_from(gaussians);
        map
    }
}

fn weighted_mean(matrix: &DMatrix<f64>, weights: &DVector<f64>) -> RowDVector<f64> {
    (weights.transpose() * matrix) / weights.sum()
}

fn minus(matrix: &DMatrix<f64>, mean: &RowDVector<f64>) -> DMatrix<f64> {
    let mut centred = matrix.clone();
    for mut row in centred.row_iter_mut() {
        row -= mean;
    }
    centred
}

/// `(band, n)`: linear minimum mean-square error estimate of the targets, with the noise as ridge.
fn linear(
    centred: &DMatrix<f64>,
    targets: &DMatrix<f64>,
    weights: &DVector<f64>,
    noise: f64,
) -> DMatrix<f64> {
    let normal = RidgeEquations::of(centred, targets, weights).divided(centred.nrows() as f64);
    normal.solve(noise.max(SAME).powi(2)).transpose()
}
