//! Photometric stereo.

use numpy::{PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use impasto::Error;
use impasto::maps::Rejection;
use impasto::stereo::{Maps, Method, Options};

use crate::arrays::StackArguments;
use crate::{errors, run};

/// The maps of `impasto.Normals`, by their names there.
#[derive(IntoPyObject)]
pub(crate) struct Normals<'py> {
    normal: Bound<'py, PyArray3<f32>>,
    albedo: Bound<'py, PyArray3<f32>>,
    used: Bound<'py, PyArray2<u16>>,
    rejected: Bound<'py, PyArray3<u16>>,
    residual: Bound<'py, PyArray2<f32>>,
    condition: Bound<'py, PyArray2<f32>>,
    sigma: Bound<'py, PyArray2<f32>>,
    status: Bound<'py, PyArray2<u8>>,
}

/// Normals and albedo of every pixel.
#[pyfunction]
#[pyo3(signature = (stack, method, low, high, w1, w2, steps, selection, threads, progress))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.normals")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_normals<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    method: &str,
    low: f64,
    high: f64,
    w1: f64,
    w2: f64,
    steps: Option<usize>,
    selection: Option<usize>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Normals<'py>> {
    let refuse = |error| errors::to_python(py, &error);
    let method = match method {
        "robust" => Method::Robust { low, high },
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
    let options =
        Options { method, steps: steps.unwrap_or_else(|| method.usual_steps()), selection };
    let decode = stack.decode();
    let samples = stack.stack(&decode).map_err(refuse)?;
    let shape = samples.shape();
    let rig = stack.rig.rig(shape.height, shape.width).map_err(refuse)?;
    let size = [shape.height, shape.width];
    let planes = |count: usize| [count, shape.height, shape.width];
    let normals = Normals {
        normal: PyArray3::zeros(py, planes(3), false),
        albedo: PyArray3::zeros(py, planes(shape.bands), false),
        used: PyArray2::zeros(py, size, false),
        rejected: PyArray3::zeros(py, planes(Rejection::COUNT), false),
        residual: PyArray2::zeros(py, size, false),
        condition: PyArray2::zeros(py, size, false),
        sigma: PyArray2::zeros(py, size, false),
        status: PyArray2::zeros(py, size, false),
    };
    {
        let (mut normal, mut albedo) = (normals.normal.readwrite(), normals.albedo.readwrite());
        let (mut used, mut rejected) = (normals.used.readwrite(), normals.rejected.readwrite());
        let (mut residual, mut condition) =
            (normals.residual.readwrite(), normals.condition.readwrite());
        let (mut sigma, mut status) = (normals.sigma.readwrite(), normals.status.readwrite());
        let mut maps = Maps {
            normal: normal.as_slice_mut()?,
            albedo: albedo.as_slice_mut()?,
            used: used.as_slice_mut()?,
            rejected: rejected.as_slice_mut()?,
            residual: residual.as_slice_mut()?,
            condition: condition.as_slice_mut()?,
            sigma: sigma.as_slice_mut()?,
            status: status.as_slice_mut()?,
        };
        run::call(py, threads, progress.as_ref(), |run| {
            impasto::stereo::fit_normals(&samples, &rig, &options, &mut maps, run)
        })?;
    }
    Ok(normals)
}
