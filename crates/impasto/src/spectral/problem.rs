//! What a reflectance estimator is built from: band responses, training spectra and noise.

use nalgebra::DMatrix;

use crate::error::{Error, Result};

/// No reflectance and no row of a normalised response is larger.
const LARGEST: f64 = 1e6;

/// What an estimator is built from.
#[derive(Clone, Debug)]
pub struct SpectralProblem {
    /// `H (band, n)`: responses are `H S`, relative to a perfect white.
    pub(super) response: DMatrix<f64>,
    /// `(N, n)` spectra of surfaces like those to be estimated.
    pub(super) training: DMatrix<f64>,
    /// Standard deviation of a response's noise, relative to a perfect white.
    pub(super) noise: f64,
}

impl SpectralProblem {
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

    pub(super) fn bands(&self) -> usize {
        self.response.nrows()
    }

    /// `(N, band)`: what the bands read from the training spectra, without noise.
    pub(super) fn responses(&self) -> DMatrix<f64> {
        &self.training * self.response.transpose()
    }
}
