//! A fitted map from features to spectra, before it is split into coefficients and a basis.

use nalgebra::DMatrix;

use super::features::Features;
use super::problem::SpectralProblem;
use super::random::Source;

/// A map from features to spectra before it is split into coefficients and basis.
#[derive(Clone, Debug)]
pub struct FittedMap {
    pub(super) features: Features,
    /// `(n, features)`.
    pub(super) map: DMatrix<f64>,
    /// `(N, features)` of the training responses, noise replicas included.
    pub(super) samples: DMatrix<f64>,
    /// `(N, n)`, the spectra that belong to `samples`.
    pub(super) targets: DMatrix<f64>,
    /// Whether every coefficient must be kept.
    pub(super) lossless: bool,
    pub(super) ridge: f64,
}

impl FittedMap {
    pub(super) fn linear(problem: &SpectralProblem, map: DMatrix<f64>) -> Self {
        Self {
            features: Features::Linear { bands: problem.bands() },
            map,
            samples: problem.responses(),
            targets: problem.training.clone(),
            lossless: true,
            ridge: 0.0,
        }
    }

    /// Root mean square over wavelengths of the estimate's change per unit of white noise: the
    /// Frobenius norm of a linear map, and a mean over the training responses otherwise.
    pub(super) fn noise_gain(&self, problem: &SpectralProblem, seed: u64) -> f64 {
        let spectra = problem.training.ncols() as f64;
        if matches!(self.features, Features::Linear { .. }) {
            return self.map.norm() / spectra.sqrt();
        }
        let responses = problem.responses();
        // Small enough to stay local, large enough to leave the rounding far below.
        let step = 1e-4 * responses.norm() / (responses.len() as f64).sqrt();
        let disturbed = Source::new(seed).noisy(&responses, step);
        let change = self.features.of_rows(&disturbed) - self.features.of_rows(&responses);
        let change = change * self.map.transpose();
        change.norm() / step / (change.len() as f64).sqrt()
    }
}
