//! Reflection models: samples that a surface shows, and the pooled fit.

use numpy::{PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use impasto::sbrdf::{Coats, Surface};

use crate::arrays::RigArguments;
use crate::{errors, run};

/// One number per coat, or one map per coat.
#[derive(FromPyObject)]
pub(crate) enum CoatArray<'py> {
    #[pyo3(transparent)]
    Uniform(PyReadonlyArray1<'py, f32>),
    #[pyo3(transparent)]
    Maps(PyReadonlyArray3<'py, f32>),
}

impl CoatArray<'_> {
    fn coats(&self) -> PyResult<Coats<'_>> {
        Ok(match self {
            Self::Uniform(values) => Coats::Uniform(values.as_slice()?),
            Self::Maps(values) => Coats::Maps(values.as_slice()?),
        })
    }
}

/// Samples `(obs, band, y, x)` that a surface shows.
#[pyfunction]
#[pyo3(signature = (normal, diffuse, beta, gamma, index, rig, intensities, threads, progress))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.forward")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn predict<'py>(
    py: Python<'py>,
    normal: PyReadonlyArray3<'py, f32>,
    diffuse: PyReadonlyArray3<'py, f32>,
    beta: CoatArray<'py>,
    gamma: CoatArray<'py>,
    index: f64,
    rig: RigArguments<'py>,
    intensities: PyReadonlyArray1<'py, f64>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let [bands, height, width] = [0, 1, 2].map(|axis| diffuse.shape()[axis]);
    let rig = rig.rig(height, width).map_err(|error| errors::to_python(py, &error))?;
    let samples = PyArray4::zeros(py, [rig.observations(), bands, height, width], false);
    {
        let surface = Surface {
            normal: normal.as_slice()?,
            diffuse: diffuse.as_slice()?,
            beta: beta.coats()?,
            gamma: gamma.coats()?,
            index,
        };
        let intensities = intensities.as_slice()?;
        let mut out = samples.readwrite();
        let out = out.as_slice_mut()?;
        run::call(py, threads, progress, |run| {
            impasto::sbrdf::predict(&surface, &rig, intensities, out, run)
        })?;
    }
    Ok(samples)
}
