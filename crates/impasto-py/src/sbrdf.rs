//! Reflection models: samples that a surface shows, and the pooled fit.

use numpy::{
    PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadwriteArray2, PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::{Coats, Extraction, Maps, PooledOptions, Surface, Verdict};

use crate::arrays::{RigArguments, StackArguments};
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
        run::call(py, threads, progress.as_ref(), |run| {
            impasto::sbrdf::predict(&surface, &rig, intensities, out, run)
        })?;
    }
    Ok(samples)
}

/// Points of the measured lobe that go to Python.
const CURVE_POINTS: usize = 200;

/// The painting's lobe; meanings stand in `impasto.Sbrdf`.
#[derive(IntoPyObject)]
pub(crate) struct Pooled {
    beta: f64,
    gamma: f64,
    covariance: [[f64; 2]; 2],
    verdict: &'static str,
    curve: Vec<[f64; 3]>,
    path: Vec<[f64; 2]>,
}

/// One lobe for the whole painting; refines `normal`, `diffuse` in place and fills `residual`.
#[pyfunction]
#[pyo3(signature = (
    stack, normal, diffuse, residual, status, extraction, rounds, steps, index, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.sbrdf")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_pooled<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    mut normal: PyReadwriteArray3<'py, f32>,
    mut diffuse: PyReadwriteArray3<'py, f32>,
    mut residual: PyReadwriteArray2<'py, f32>,
    status: PyReadonlyArray2<'py, u8>,
    extraction: &str,
    rounds: usize,
    steps: usize,
    index: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Pooled> {
    let refuse = |error| errors::to_python(py, &error);
    let extraction = match extraction {
        "residual" => Extraction::Residual,
        "maximum" => Extraction::Maximum,
        _ => {
            let problem = format!("there is none called {extraction:?}");
            return Err(refuse(Error::argument("extraction", problem)));
        }
    };
    let options = PooledOptions { extraction, rounds, steps, index };
    let decode = stack.decode();
    let samples = stack.stack(&decode).map_err(refuse)?;
    let shape = samples.shape();
    let rig = stack.rig.rig(shape.height, shape.width).map_err(refuse)?;
    let mut maps = Maps {
        normal: normal.as_slice_mut()?,
        diffuse: diffuse.as_slice_mut()?,
        residual: residual.as_slice_mut()?,
        status: status.as_slice()?,
    };
    let pooled = run::call(py, threads, progress.as_ref(), |run| {
        impasto::sbrdf::fit_pooled(&samples, &rig, &mut maps, &options, run)
    })?;
    Ok(Pooled {
        beta: pooled.beta,
        gamma: pooled.gamma,
        covariance: pooled.covariance,
        verdict: match pooled.verdict {
            Verdict::NoHighlight => "no-highlight",
            Verdict::AtBound => "at-bound",
            _ => "fitted",
        },
        curve: pooled.histogram.curve(CURVE_POINTS),
        path: pooled.path,
    })
}
