//! Samples that a surface shows.

use numpy::{PyArray4, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use impasto::Error;

use crate::arrays::RigArguments;
use crate::surface::SurfaceArguments;
use crate::{errors, run};

/// Samples `(obs, band, y, x)` that a surface shows.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn predict<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    rig: RigArguments<'py>,
    intensities: PyReadonlyArray1<'py, f64>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let [bands, height, width] = surface.shape();
    let rig = rig.rig(height, width).map_err(refuse)?;
    impasto::pixels::check_room::<f32>(rig.observations() * bands * height * width)
        .map_err(refuse)?;
    let samples = PyArray4::zeros(py, [rig.observations(), bands, height, width], false);
    let mut out = samples.readwrite();
    let (intensities, shown) = (intensities.as_slice()?, out.as_slice_mut()?);
    let surface = surface.surface().map_err(refuse)?;
    run::call(py, threads, progress.as_ref(), |run| {
        impasto::surface::predict(&surface, &rig, intensities, shown, run)
    })?;
    drop(out);
    Ok(samples)
}
