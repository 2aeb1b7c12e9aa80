//! Reflectance estimators: built once, applied to maps.
#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use impasto::Error;
use impasto::spectral::apply::{ReflectanceMaps, apply};
use impasto::spectral::{Diagnostics, Estimator, Kind, SpectralProblem};

use crate::arrays::contiguous;
use crate::{errors, run};

/// An estimator of reflectance from camera bands.
#[pyclass(name = "SpectralEstimator", module = "impasto._core", frozen)]
pub(crate) struct SpectralEstimator(Estimator);

/// Builds an estimator from `response (band, n)` and `training (N, n)`.
#[pyfunction]
#[pyo3(signature = (kind, response, training, noise, rank, seed))]
pub(crate) fn spectral_estimator(
    py: Python<'_>,
    kind: &str,
    response: PyReadonlyArray2<'_, f64>,
    training: PyReadonlyArray2<'_, f64>,
    noise: f64,
    rank: Option<usize>,
    seed: u64,
) -> PyResult<SpectralEstimator> {
    let wavelengths = response.shape()[1];
    let problem = contiguous("response", response.as_slice())
        .and_then(|h| Ok((h, contiguous("training", training.as_slice())?)))
        .and_then(|(h, spectra)| SpectralProblem::new(h, spectra, wavelengths, noise))
        .map_err(|error| errors::to_python(py, &error))?;
    let kind = Kind::NAMES.into_iter().find(|(name, _)| *name == kind).map(|(_, kind)| kind);
    let kind = kind.ok_or_else(|| {
        let names = Kind::NAMES.map(|(name, _)| name).join(", ");
        errors::to_python(py, &Error::argument("estimator", format!("expected one of {names}")))
    })?;
    run::call(py, 1, None, |_| Estimator::build(kind, &problem, rank, seed)).map(SpectralEstimator)
}

/// The maps of an `impasto.Reflectance`, to be filled.
#[derive(FromPyObject)]
struct ReflectanceArrays<'py> {
    /// `(k, y, x)`.
    coefficients: PyReadwriteArray3<'py, f32>,
    /// `(y, x)`.
    status: PyReadwriteArray2<'py, u8>,
}

/// The numbers that say how well an estimator is posed.
#[derive(IntoPyObject)]
struct SpectralDiagnostics {
    condition: f64,
    effective_rank: f64,
    noise_gain: f64,
    training_rmse: f64,
    truncation: f64,
    ridge: f64,
    gamma: f64,
}

#[pymethods]
impl SpectralEstimator {
    /// `(n, k)`, orthonormal columns.
    #[getter]
    fn basis<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (basis, rank) = (self.0.basis(), self.0.rank());
        let rows = basis.len() / rank;
        basis.into_pyarray(py).reshape([rows, rank])
    }

    #[getter]
    fn diagnostics(&self) -> SpectralDiagnostics {
        let Diagnostics {
            condition,
            effective_rank,
            noise_gain,
            training_rmse,
            truncation,
            ridge,
            gamma,
        } = self.0.diagnostics;
        SpectralDiagnostics {
            condition,
            effective_rank,
            noise_gain,
            training_rmse,
            truncation,
            ridge,
            gamma,
        }
    }

    /// The features' map in double precision: coefficients `(N, k)` of responses `(N, band)`.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        responses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = responses.shape()[0];
        let values = contiguous("responses", responses.as_slice())
            .and_then(|values| self.0.operator().evaluate_rows(values))
            .map_err(|error| errors::to_python(py, &error))?;
        values.into_pyarray(py).reshape([rows, self.0.rank()])
    }

    /// Fills the maps with the estimate of responses `(band, y, x)`.
    #[pyo3(signature = (responses, status, maps, threads, progress))]
    fn apply<'py>(
        &self,
        py: Python<'py>,
        responses: PyReadonlyArray3<'py, f32>,
        status: Option<PyReadonlyArray2<'py, u8>>,
        mut maps: ReflectanceArrays<'py>,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let fail = |error| errors::to_python(py, &error);
        let values = contiguous("diffuse", responses.as_slice()).map_err(fail)?;
        let before = status
            .as_ref()
            .map(|status| contiguous("status", status.as_slice()))
            .transpose()
            .map_err(fail)?;
        let output = ReflectanceMaps {
            coefficients: maps.coefficients.as_slice_mut()?,
            status: maps.status.as_slice_mut()?,
        };
        run::call(py, threads, progress.as_ref(), |run| apply(&self.0, values, before, output, run))
    }
}
