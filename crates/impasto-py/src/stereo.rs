//! Photometric stereo.

use numpy::ndarray::Dimension;
use numpy::{Element, PyReadwriteArray, PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use impasto::Error;
use impasto::stereo::{Learned, Method, NormalMaps, StereoOptions};

use crate::arrays::StackArguments;
use crate::{errors, run};

/// The maps of an `impasto.Normals` or `impasto.PartialNormals`, to be filled; `rejected` and `status` hold zeros.
#[derive(FromPyObject)]
pub(crate) struct NormalArrays<'py> {
    normal: Option<PyReadwriteArray3<'py, f32>>,
    albedo: Option<PyReadwriteArray3<'py, f32>>,
    used: Option<PyReadwriteArray2<'py, u16>>,
    rejected: Option<PyReadwriteArray3<'py, u16>>,
    residual: Option<PyReadwriteArray2<'py, f32>>,
    condition: Option<PyReadwriteArray2<'py, f32>>,
    sigma: Option<PyReadwriteArray2<'py, f32>>,
    status: PyReadwriteArray2<'py, u8>,
}

/// The memory of a map, none if nobody asked for it.
fn memory<'a, T: Element, D: Dimension>(
    map: &'a mut Option<PyReadwriteArray<'_, T, D>>,
) -> PyResult<&'a mut [T]> {
    match map {
        Some(map) => Ok(map.as_slice_mut()?),
        None => Ok(&mut []),
    }
}

/// Normals and albedo of every pixel; `learned` is what [`learn_normals`] returned.
#[pyfunction]
#[pyo3(signature = (
    stack, maps, method, low, high, w1, w2, steps, selection, learned, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.normals")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_normals<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    mut maps: NormalArrays<'py>,
    method: &str,
    low: f64,
    high: f64,
    w1: f64,
    w2: f64,
    steps: Option<usize>,
    selection: Option<usize>,
    learned: (f64, f64),
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let refuse = |error| errors::to_python(py, &error);
    let method = match method {
        "robust" => Method::Robust,
        "trimmed" => Method::Trimmed { low, high },
        "least-squares" => Method::LeastSquares,
        "threshold" => Method::Threshold { w1, w2 },
        "rank" => Method::Rank { low, high },
        "l1" => Method::L1,
        "huber" => Method::Huber,
        "cauchy" => Method::Cauchy,
        "tukey" => Method::Tukey,
        _ => {
            let problem = format!("there is none called {method:?}");
            return Err(refuse(Error::argument("method", problem)));
        }
    };
    let steps = steps.unwrap_or_else(|| method.usual_steps());
    let (scale, correlation) = learned;
    let options =
        StereoOptions { method, steps, selection, learned: Learned { scale, correlation } };
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let shape = samples.shape();
    let rig = stack.rig.rig(shape.height, shape.width).map_err(refuse)?;
    let mut maps = NormalMaps {
        normal: memory(&mut maps.normal)?,
        albedo: memory(&mut maps.albedo)?,
        used: memory(&mut maps.used)?,
        rejected: memory(&mut maps.rejected)?,
        residual: memory(&mut maps.residual)?,
        condition: memory(&mut maps.condition)?,
        sigma: memory(&mut maps.sigma)?,
        status: maps.status.as_slice_mut()?,
    };
    run::call_on(py, shape.samples(), threads, progress.as_ref(), |run| {
        impasto::stereo::fit_normals(&samples, &rig, &options, &mut maps, run)
    })
}

/// What the robust method must know of a whole painting, from a sample of its pixels: the typical scale of the
/// residuals and their correlation under neighbouring lights.
#[pyfunction]
#[pyo3(signature = (stack, steps, selection, threads))]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn learn_normals<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    steps: usize,
    selection: Option<usize>,
    threads: usize,
) -> PyResult<(f64, f64)> {
    let refuse = |error| errors::to_python(py, &error);
    let learned = Learned::default();
    let options = StereoOptions { method: Method::Robust, steps, selection, learned };
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let shape = samples.shape();
    let rig = stack.rig.rig(shape.height, shape.width).map_err(refuse)?;
    let learned = run::call_on(py, shape.samples(), threads, None, |run| {
        impasto::stereo::learn_normals(&samples, &rig, &options, run)
    })?;
    Ok((learned.scale, learned.correlation))
}
