//! Reflection models: samples that a surface shows, and the pooled fit.

use numpy::{PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use impasto::Error;
use impasto::geometry::Rig;
use impasto::sbrdf::{Extraction, LobeModel, PooledOptions};

use crate::arrays::{RigArguments, Size, StackArguments, StartArguments};
use crate::surface::{SurfaceArguments, with_model};
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
    let samples = PyArray4::zeros(py, [rig.observations(), bands, height, width], false);
    let mut out = samples.readwrite();
    let shown = Shown {
        surface: &surface,
        rig: &rig,
        intensities: intensities.as_slice()?,
        out: out.as_slice_mut()?,
        threads,
        progress: progress.as_ref(),
    };
    with_model!(surface.model.as_str(), surface.index, |model| shown.predict(py, model)?)
        .map_err(refuse)?;
    drop(out);
    Ok(samples)
}

/// A call of [`predict`] before its model is known.
struct Shown<'a, 'py> {
    surface: &'a SurfaceArguments<'py>,
    rig: &'a Rig,
    intensities: &'a [f64],
    out: &'a mut [f32],
    threads: usize,
    progress: Option<&'a Py<PyAny>>,
}

impl Shown<'_, '_> {
    fn predict<M: LobeModel>(self, py: Python<'_>, model: M) -> PyResult<()> {
        let surface = self.surface.surface(model).map_err(|error| errors::to_python(py, &error))?;
        run::call(py, self.threads, self.progress, |run| {
            impasto::sbrdf::predict(&surface, self.rig, self.intensities, self.out, run)
        })
    }
}

/// Points of the measured lobe that go to Python.
const CURVE_POINTS: usize = 200;

/// The painting's lobe and its maps; meanings stand in `impasto.PooledSbrdf`.
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
    stack, start, extraction, joint, index, pixels, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.sbrdf")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_pooled<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    extraction: &str,
    joint: bool,
    index: f64,
    pixels: usize,
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
    let options = PooledOptions { extraction, joint, index, pixels };
    let decode = stack.decode();
    let samples = stack.stack(&decode).map_err(refuse)?;
    let (size, bands) = (Size::of(samples.shape()), samples.shape().bands);
    let rig = stack.rig.rig(size.height, size.width).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let pooled = run::call(py, threads, progress.as_ref(), |run| {
        impasto::sbrdf::fit_pooled(&samples, &rig, &start, &options, run)
    })?;
    Ok(Pooled {
        beta: pooled.beta,
        gamma: pooled.gamma,
        covariance: pooled.covariance,
        verdict: pooled.verdict.name(),
        describes: pooled.describes,
        converged: pooled.converged,
        curve: pooled.histogram.curve(CURVE_POINTS),
        path: pooled.path,
        normal: size.planes(py, pooled.normal, 3)?,
        diffuse: size.planes(py, pooled.diffuse, bands)?,
        residual: size.map(py, pooled.residual)?,
        sigma: size.map(py, pooled.sigma)?,
        misfit: size.map(py, pooled.misfit)?,
        status: size.map(py, pooled.status)?,
    })
}
