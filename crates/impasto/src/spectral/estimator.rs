//! Building reflectance estimators of every kind, and their operators for pixels with missing bands.

use nalgebra::DMatrix;

use super::diagnostics::Diagnostics;
use super::factor::Factorisation;
use super::features::Features;
use super::fitted_map::FittedMap;
use super::linear::{self, Root};
use super::operator::Operator;
use super::problem::SpectralProblem;
use super::{ensemble, radial_basis, root_polynomial};
use crate::error::{Error, Result};

/// Which estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Minimum mean-square error among linear ones, given the noise.
    Wiener,
    /// The reflectance of a few principal components that reproduces the responses.
    LinearModel,
    /// Ridge regression on the responses and the roots of their products.
    RootPolynomial,
    /// A linear estimate of the direction plus Gaussians around training responses.
    RadialBasis,
    /// The mean of the last two.
    Ensemble,
}

impl Kind {
    /// Every kind and its public name.
    pub const NAMES: [(&'static str, Self); 5] = [
        ("wiener", Self::Wiener),
        ("linear-model", Self::LinearModel),
        ("root-polynomial", Self::RootPolynomial),
        ("radial-basis", Self::RadialBasis),
        ("ensemble", Self::Ensemble),
    ];
}

/// A reflectance estimator, ready to be applied.
#[derive(Clone, Debug)]
pub struct Estimator {
    basis: DMatrix<f64>,
    complete: Operator,
    incomplete: Incomplete,
    /// How well the problem is posed.
    pub diagnostics: Diagnostics,
}

/// How operators for pixels with missing bands are made.
#[derive(Clone, Debug)]
enum Incomplete {
    Linear { problem: SpectralProblem, root: Root, terms: Option<usize> },
    RootPolynomial(root_polynomial::Regression),
}

impl Estimator {
    /// Builds an estimator.
    ///
    /// `rank` is the number of coefficients per pixel: for the linear model the number of
    /// principal components (default: as many as bands), else an upper limit on what is stored
    /// (default: all that matter). `seed` fixes the noise replicas, folds and
    /// centres of the regressions.
    ///
    /// # Errors
    /// If `rank` is zero or the training set is too small for a regression.
    pub fn build(
        kind: Kind,
        problem: &SpectralProblem,
        rank: Option<usize>,
        seed: u64,
    ) -> Result<Self> {
        if rank == Some(0) {
            return Err(Error::argument("rank", "expected at least 1, found 0"));
        }
        let root = Root::of(&problem.training);
        let whitened = root.whiten(&problem.response);
        let linear =
            |terms| Incomplete::Linear { problem: problem.clone(), root: root.clone(), terms };
        let mut diagnostics = whitened.diagnostics(problem.noise);
        let mut regression = None;
        let fit = match kind {
            Kind::Wiener => {
                FittedMap::linear(problem, linear::wiener(&root, &whitened, problem.noise))
            }
            Kind::LinearModel => {
                let terms = rank.unwrap_or(problem.bands()).min(problem.training.ncols());
                FittedMap::linear(problem, linear::linear_model(&root, &problem.response, terms))
            }
            Kind::RootPolynomial => {
                let (fit, sums) = root_polynomial::fit(problem, seed)?;
                regression = Some(sums);
                fit
            }
            Kind::RadialBasis => radial_basis::fit(problem, seed)?,
            Kind::Ensemble => {
                let (fit, sums) = ensemble::fit(problem, seed)?;
                regression = Some(sums);
                fit
            }
        };
        let factor = Factorisation::of(&fit, rank);
        diagnostics.noise_gain = fit.noise_gain(problem, seed);
        diagnostics.training_rmse = factor.training_rmse;
        diagnostics.truncation = factor.truncation;
        diagnostics.ridge = fit.ridge;
        let incomplete = match (kind, regression) {
            (_, Some(regression)) => Incomplete::RootPolynomial(regression),
            (Kind::LinearModel, None) => linear(Some(rank.unwrap_or(problem.bands()))),
            _ => linear(None),
        };
        if let Features::RadialBasis(centres) | Features::Ensemble(centres) = &fit.features {
            diagnostics.gamma = centres.gamma();
        }
        let complete = Operator::new(fit.features, &factor.coefficients);
        Ok(Self { basis: factor.basis, complete, incomplete, diagnostics })
    }

    /// `(n, k)` row by row, orthonormal columns: spectrum = basis * coefficients.
    #[must_use]
    pub fn basis(&self) -> Vec<f64> {
        self.basis.transpose().as_slice().to_vec()
    }

    /// Camera bands.
    #[must_use]
    pub fn bands(&self) -> usize {
        self.complete.bands()
    }

    /// Coefficients per pixel, `k`.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.basis.ncols()
    }

    /// From complete responses to coefficients.
    #[must_use]
    pub fn operator(&self) -> &Operator {
        &self.complete
    }

    /// From the responses of some bands to coefficients of the same basis.
    ///
    /// Wiener and the root-polynomial are built anew for these bands; the linear model uses no
    /// more components than there are bands; the radial basis falls back to Wiener, the ensemble to
    /// the root-polynomial.
    ///
    /// # Panics
    /// If no band is present.
    #[must_use]
    pub fn operator_of(&self, present: &[usize]) -> Operator {
        assert!(!present.is_empty(), "a pixel without any band has nothing to estimate from");
        let (features, map) = match &self.incomplete {
            Incomplete::Linear { problem, root, terms } => {
                let response = problem.response.select_rows(present);
                let map = match terms {
                    Some(terms) => {
                        linear::linear_model(root, &response, (*terms).min(present.len()))
                    }
                    None => linear::wiener(root, &root.whiten(&response), problem.noise),
                };
                (Features::Linear { bands: present.len() }, map)
            }
            Incomplete::RootPolynomial(regression) => {
                (Features::RootPolynomial { bands: present.len() }, regression.of_bands(present))
            }
        };
        Operator::new(features, &(self.basis.transpose() * map))
    }
}
