//! From camera bands to spectral reflectance: build an estimator, apply it to every pixel.
//!
//! Every estimator has the same form, [`Features`] of the band responses followed by one matrix:
//!
//! | [`Kind`] | features | matrix |
//! |---|---|---|
//! | Wiener | the responses | eq. 5 of Tominaga and Tanaka (six-band paper) ([`linear`]) |
//! | linear model | the responses | eq. 4-7 of Tominaga and Tanaka (RGB paper) ([`linear`]) |
//! | root-polynomial | responses, roots of products of two | ridge regression ([`root_polynomial`]) |
//! | radial basis | responses, Gaussians of their direction | ridge regression ([`radial_basis`]) |
//!
//! All are homogeneous of degree one: twice the light, twice the reflectance. A response carries
//! the unknown scale of shading, and an estimator that is not homogeneous changes the hue with it.
//!
//! The matrix is split into coefficients and an orthonormal basis ([`factor`]), so that a pixel
//! holds a few numbers and not a spectrum. Building is done once, in `f64`; applying ([`apply`])
//! in `f32` lanes over planes. A pixel whose bands are not all finite is estimated from those that
//! are, with an operator made for just these bands and the same basis.

pub mod apply;
pub mod factor;
pub mod features;
pub mod linear;
pub mod radial_basis;
mod random;
mod ridge;
pub mod root_polynomial;

use nalgebra::DMatrix;

pub use apply::Operator;
pub use factor::Factor;
pub use features::Features;

use crate::error::{Error, Result};
use linear::Root;

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
}

impl Kind {
    /// Every kind and its public name.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("wiener", Self::Wiener),
        ("linear-model", Self::LinearModel),
        ("root-polynomial", Self::RootPolynomial),
        ("radial-basis", Self::RadialBasis),
    ];
}

/// No reflectance and no row of a normalised response is larger.
const LARGEST: f64 = 1e6;

/// What an estimator is built from.
#[derive(Clone, Debug)]
pub struct Problem {
    /// `H (band, n)`: responses are `H S`, relative to a perfect white.
    response: DMatrix<f64>,
    /// `(N, n)` spectra of surfaces like those to be estimated.
    training: DMatrix<f64>,
    /// Standard deviation of a response's noise, relative to a perfect white.
    noise: f64,
}

impl Problem {
    /// Checks what the estimators rely on.
    ///
    /// `response` is `(band, n)` and `training` `(N, n)`, row by row; `wavelengths` is `n`.
    ///
    /// # Errors
    /// If a size is zero or disagrees, a number is not finite or the noise is negative.
    pub fn new(response: &[f64], training: &[f64], wavelengths: usize, noise: f64) -> Result<Self> {
        let matrix = |name, values: &[f64]| {
            if values.is_empty() || !values.len().is_multiple_of(wavelengths.max(1)) {
                let problem = format!(
                    "expected rows of {wavelengths} wavelengths, found {} numbers",
                    values.len()
                );
                return Err(Error::argument(name, problem));
            }
            // Also keeps every product below finite.
            if let Some(value) = values.iter().find(|value| value.is_nan() || value.abs() > LARGEST)
            {
                let problem =
                    format!("expected numbers around 1, relative to white, found {value}");
                return Err(Error::argument(name, problem));
            }
            if values.iter().all(|&value| value == 0.0) {
                return Err(Error::argument(name, "all numbers are 0"));
            }
            Ok(DMatrix::from_row_slice(values.len() / wavelengths, wavelengths, values))
        };
        if !(noise.is_finite() && noise >= 0.0) {
            return Err(Error::argument("noise", format!("expected at least 0, found {noise}")));
        }
        let response = matrix("response", response)?;
        Ok(Self { response, training: matrix("training", training)?, noise })
    }

    fn bands(&self) -> usize {
        self.response.nrows()
    }

    /// `(N, band)`: what the bands read from the training spectra, without noise.
    fn responses(&self) -> DMatrix<f64> {
        &self.training * self.response.transpose()
    }
}

/// How well the bands determine the spectrum, and what the estimator does about it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Diagnostics {
    /// Condition number of `H R H^T`.
    pub condition: f64,
    /// `sum s^2 / (s^2 + noise^2)` over the singular values of the whitened bands: how many
    /// independent numbers the bands deliver above the noise.
    pub effective_rank: f64,
    /// Root mean square over wavelengths of the estimate's change per unit of white noise.
    pub noise_gain: f64,
    /// Root mean square error over the training spectra and wavelengths, noise included.
    pub training_rmse: f64,
    /// By how much the dropped coefficients raise the training error.
    pub truncation: f64,
    /// Chosen ridge weight, 0 where there is none.
    pub ridge: f64,
    /// Chosen width parameter of the Gaussians, 0 where there are none.
    pub gamma: f64,
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
    Linear { problem: Problem, root: Root, terms: Option<usize> },
    RootPolynomial(root_polynomial::Regression),
}

impl Estimator {
    /// Builds an estimator.
    ///
    /// `rank` is the number of coefficients per pixel: for the linear model the number of
    /// principal components (default: as many as bands), else an upper limit on what is stored
    /// (default: all that matter, see [`factor`]). `seed` fixes the noise replicas, folds and
    /// centres of the regressions.
    ///
    /// # Errors
    /// If `rank` is zero or the training set is too small for a regression.
    pub fn build(kind: Kind, problem: &Problem, rank: Option<usize>, seed: u64) -> Result<Self> {
        if rank == Some(0) {
            return Err(Error::argument("rank", "expected at least 1, found 0"));
        }
        let root = Root::of(&problem.training);
        let whitened = root.whiten(&problem.response);
        let linear =
            |terms| Incomplete::Linear { problem: problem.clone(), root: root.clone(), terms };
        let mut diagnostics = whitened.diagnostics(problem.noise);
        let fit = match kind {
            Kind::Wiener => Fit::linear(problem, linear::wiener(&root, &whitened, problem.noise)),
            Kind::LinearModel => {
                let terms = rank.unwrap_or(problem.bands()).min(problem.training.ncols());
                Fit::linear(problem, linear::linear_model(&root, &problem.response, terms))
            }
            Kind::RootPolynomial => root_polynomial::fit(problem, seed)?,
            Kind::RadialBasis => radial_basis::fit(problem, seed)?,
        };
        let factor = Factor::of(&fit, rank);
        diagnostics.noise_gain = fit.noise_gain(problem, seed);
        diagnostics.training_rmse = factor.training_rmse;
        diagnostics.truncation = factor.truncation;
        diagnostics.ridge = fit.ridge;
        let incomplete = match (kind, fit.regression) {
            (Kind::RootPolynomial, Some(regression)) => Incomplete::RootPolynomial(regression),
            (Kind::LinearModel, _) => linear(Some(rank.unwrap_or(problem.bands()))),
            _ => linear(None),
        };
        if let Features::RadialBasis(centres) = &fit.features {
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
    /// more components than there are bands; the radial basis falls back to Wiener.
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

/// A map from features to spectra before it is split into coefficients and basis.
#[derive(Clone, Debug)]
pub struct Fit {
    features: Features,
    /// `(n, features)`.
    map: DMatrix<f64>,
    /// `(N, features)` of the training responses, noise replicas included.
    samples: DMatrix<f64>,
    /// `(N, n)`, the spectra that belong to `samples`.
    targets: DMatrix<f64>,
    /// Whether every coefficient must be kept.
    lossless: bool,
    ridge: f64,
    regression: Option<root_polynomial::Regression>,
}

impl Fit {
    fn linear(problem: &Problem, map: DMatrix<f64>) -> Self {
        Self {
            features: Features::Linear { bands: problem.bands() },
            map,
            samples: problem.responses(),
            targets: problem.training.clone(),
            lossless: true,
            ridge: 0.0,
            regression: None,
        }
    }

    /// Root mean square over wavelengths of the estimate's change per unit of white noise: the
    /// Frobenius norm of a linear map, and a mean over the training responses otherwise.
    fn noise_gain(&self, problem: &Problem, seed: u64) -> f64 {
        let spectra = problem.training.ncols() as f64;
        if matches!(self.features, Features::Linear { .. }) {
            return self.map.norm() / spectra.sqrt();
        }
        let responses = problem.responses();
        // Small enough to stay local, large enough to leave the rounding far below.
        let step = 1e-4 * responses.norm() / (responses.len() as f64).sqrt();
        let disturbed = random::Source::new(seed).noisy(&responses, step);
        let change = self.features.of_rows(&disturbed) - self.features.of_rows(&responses);
        let change = change * self.map.transpose();
        change.norm() / step / (change.len() as f64).sqrt()
    }
}
