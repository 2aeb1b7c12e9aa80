//! `fit_highlight`: one lobe per pixel through samples of known angle.

use numpy::{PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use impasto::sbrdf::{HighlightMaps, Highlights};

use crate::run;

/// The maps of an `impasto.HighlightFit`, flat, to be filled.
#[derive(FromPyObject)]
pub(crate) struct FlatMaps<'py> {
    beta: PyReadwriteArray1<'py, f32>,
    gamma: PyReadwriteArray1<'py, f32>,
    covariance: PyReadwriteArray2<'py, f32>,
    residual: PyReadwriteArray1<'py, f32>,
    status: PyReadwriteArray1<'py, u8>,
}

/// (beta, gamma) of every pixel from samples and angles `(obs, pixel)`.
#[pyfunction]
#[pyo3(signature = (samples, phi, maps, threads, progress))]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_highlight<'py>(
    py: Python<'py>,
    samples: PyReadonlyArray2<'py, f32>,
    phi: PyReadonlyArray2<'py, f32>,
    mut maps: FlatMaps<'py>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let highlights = Highlights {
        samples: samples.as_slice()?,
        phi: phi.as_slice()?,
        pixels: samples.shape()[1],
    };
    let mut maps = HighlightMaps {
        beta: maps.beta.as_slice_mut()?,
        gamma: maps.gamma.as_slice_mut()?,
        covariance: maps.covariance.as_slice_mut()?,
        residual: maps.residual.as_slice_mut()?,
        status: maps.status.as_slice_mut()?,
    };
    run::call(py, threads, progress.as_ref(), |run| {
        impasto::sbrdf::fit_highlight(&highlights, &mut maps, run).map(drop)
    })
}
