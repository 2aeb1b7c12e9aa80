//! Reflection models: samples that a surface shows, and the pooled fit.

use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyReadonlyArray4, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::{Coats, Extraction, LobeSurface, PooledOptions, Start, Surface};

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

/// Samples `(obs, band, y, x)` that a surface of Lafortune lobes shows.
#[pyfunction]
#[pyo3(signature = (
    normal, diffuse, specular, cxy, cz, exponent, rig, intensities, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.forward")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn predict_lobes<'py>(
    py: Python<'py>,
    normal: PyReadonlyArray3<'py, f32>,
    diffuse: PyReadonlyArray3<'py, f32>,
    specular: PyReadonlyArray4<'py, f32>,
    cxy: PyReadonlyArray3<'py, f32>,
    cz: PyReadonlyArray3<'py, f32>,
    exponent: PyReadonlyArray3<'py, f32>,
    rig: RigArguments<'py>,
    intensities: PyReadonlyArray1<'py, f64>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let [bands, height, width] = [0, 1, 2].map(|axis| diffuse.shape()[axis]);
    let rig = rig.rig(height, width).map_err(|error| errors::to_python(py, &error))?;
    let samples = PyArray4::zeros(py, [rig.observations(), bands, height, width], false);
    {
        let surface = LobeSurface {
            normal: normal.as_slice()?,
            diffuse: diffuse.as_slice()?,
            specular: specular.as_slice()?,
            cxy: cxy.as_slice()?,
            cz: cz.as_slice()?,
            exponent: exponent.as_slice()?,
        };
        let intensities = intensities.as_slice()?;
        let mut out = samples.readwrite();
        let out = out.as_slice_mut()?;
        run::call(py, threads, progress.as_ref(), |run| {
            impasto::sbrdf::predict_lobes(&surface, &rig, intensities, out, run)
        })?;
    }
    Ok(samples)
}

/// Points of the measured lobe that go to Python.
const CURVE_POINTS: usize = 200;

/// The painting's lobe and its maps; meanings stand in `impasto.Sbrdf`.
#[derive(IntoPyObject)]
pub(crate) struct Pooled<'py> {
    beta: f64,
    gamma: f64,
    covariance: [[f64; 2]; 2],
    verdict: &'static str,
    describes: f64,
    converged: bool,
    curve: Vec<[f64; 3]>,
    path: Vec<[f64; 2]>,
    normal: Bound<'py, PyArray3<f32>>,
    diffuse: Bound<'py, PyArray3<f32>>,
    residual: Bound<'py, PyArray2<f32>>,
    sigma: Bound<'py, PyArray2<f32>>,
    misfit: Bound<'py, PyArray2<f32>>,
    status: Bound<'py, PyArray2<u8>>,
}

/// One lobe for the whole painting, from the maps of photometric stereo.
#[pyfunction]
#[pyo3(signature = (
    stack, normal, diffuse, status, extraction, joint, index, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.sbrdf")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_pooled<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    normal: PyReadonlyArray3<'py, f32>,
    diffuse: PyReadonlyArray3<'py, f32>,
    status: PyReadonlyArray2<'py, u8>,
    extraction: &str,
    joint: bool,
    index: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Pooled<'py>> {
    let refuse = |error| errors::to_python(py, &error);
    let extraction = match extraction {
        "residual" => Extraction::Residual,
        "maximum" => Extraction::Maximum,
        "papers" => Extraction::Papers,
        _ => {
            let problem = format!("there is none called {extraction:?}");
            return Err(refuse(Error::argument("extraction", problem)));
        }
    };
    let options = PooledOptions { extraction, joint, index };
    let decode = stack.decode();
    let samples = stack.stack(&decode).map_err(refuse)?;
    let shape = samples.shape();
    let (height, width, bands) = (shape.height, shape.width, shape.bands);
    let rig = stack.rig.rig(height, width).map_err(refuse)?;
    let start = Start {
        normal: normal.as_slice()?,
        diffuse: diffuse.as_slice()?,
        status: status.as_slice()?,
    };
    let pooled = run::call(py, threads, progress.as_ref(), |run| {
        impasto::sbrdf::fit_pooled(&samples, &rig, &start, &options, run)
    })?;
    let map = |values: Vec<f32>| values.into_pyarray(py).reshape([height, width]);
    let planes = |values: Vec<f32>, n| values.into_pyarray(py).reshape([n, height, width]);
    Ok(Pooled {
        beta: pooled.beta,
        gamma: pooled.gamma,
        covariance: pooled.covariance,
        verdict: pooled.verdict.name(),
        describes: pooled.describes,
        converged: pooled.converged,
        curve: pooled.histogram.curve(CURVE_POINTS),
        path: pooled.path,
        normal: planes(pooled.normal, 3)?,
        diffuse: planes(pooled.diffuse, bands)?,
        residual: map(pooled.residual)?,
        sigma: map(pooled.sigma)?,
        misfit: map(pooled.misfit)?,
        status: pooled.status.into_pyarray(py).reshape([height, width])?,
    })
}
