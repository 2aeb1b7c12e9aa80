//! Lobes of every pixel.

use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::{LobeModel, LobeOptions, Start, TorranceSparrow};

use crate::arrays::StackArguments;
use crate::{errors, run};

/// Maps of the fit; meanings stand in `impasto.LobeSbrdf`.
#[derive(IntoPyObject)]
pub(crate) struct LobeArrays<'py> {
    normal: Bound<'py, PyArray3<f32>>,
    diffuse: Bound<'py, PyArray3<f32>>,
    ambient: Bound<'py, PyArray3<f32>>,
    /// (lobe, band, y, x).
    specular: Bound<'py, PyArray4<f32>>,
    /// What the model calls the numbers of a shape.
    names: &'static [&'static str],
    /// (lobe, number, y, x).
    numbers: Bound<'py, PyArray4<f32>>,
    /// (lobe, y, x).
    spread: Bound<'py, PyArray3<f32>>,
    lobes: Bound<'py, PyArray2<u8>>,
    residual: Bound<'py, PyArray2<f32>>,
    sigma: Bound<'py, PyArray2<f32>>,
    status: Bound<'py, PyArray2<u8>>,
}

/// Every pixel's own lobes, from the maps of photometric stereo.
#[pyfunction]
#[pyo3(signature = (
    stack, normal, diffuse, status, model, lobes, ambient, free, rounds, typical, index, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.lobes")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_lobes<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    normal: PyReadonlyArray3<'py, f32>,
    diffuse: PyReadonlyArray3<'py, f32>,
    status: PyReadonlyArray2<'py, u8>,
    model: &str,
    lobes: usize,
    ambient: bool,
    free: bool,
    rounds: usize,
    typical: bool,
    index: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<LobeArrays<'py>> {
    let start = Start {
        normal: normal.as_slice()?,
        diffuse: diffuse.as_slice()?,
        status: status.as_slice()?,
    };
    let options = LobeOptions { lobes, ambient, normal: free, rounds, typical };
    let call = Call { stack: &stack, start, options, threads, progress: progress.as_ref() };
    if model == "torrance-sparrow" {
        return call.fit(py, TorranceSparrow { index });
    }
    let problem = format!("there is none called {model:?}");
    Err(errors::to_python(py, &Error::argument("model", problem)))
}

struct Call<'a, 'py> {
    stack: &'a StackArguments<'py>,
    start: Start<'a>,
    options: LobeOptions,
    threads: usize,
    progress: Option<&'a Py<PyAny>>,
}

impl Call<'_, '_> {
    fn fit<M: LobeModel>(self, py: Python<'_>, model: M) -> PyResult<LobeArrays<'_>> {
        let Self { stack, start, options, threads, progress } = self;
        let refuse = |error| errors::to_python(py, &error);
        let decode = stack.decode();
        let samples = stack.stack(&decode).map_err(refuse)?;
        let shape = samples.shape();
        let (height, width, bands) = (shape.height, shape.width, shape.bands);
        let rig = stack.rig.rig(height, width).map_err(refuse)?;
        let maps = run::call(py, threads, progress, |run| {
            impasto::sbrdf::fit_lobes(&samples, &rig, &start, model, &options, run)
        })?;
        let lobes = options.lobes;
        let map = |values: Vec<f32>| values.into_pyarray(py).reshape([height, width]);
        let planes = |values: Vec<f32>, n| values.into_pyarray(py).reshape([n, height, width]);
        let sets = |values: Vec<f32>, n| values.into_pyarray(py).reshape([lobes, n, height, width]);
        Ok(LobeArrays {
            normal: planes(maps.normal, 3)?,
            diffuse: planes(maps.diffuse, bands)?,
            ambient: planes(maps.ambient, bands)?,
            specular: sets(maps.specular, bands)?,
            names: M::NAMES,
            numbers: sets(maps.numbers, M::NAMES.len())?,
            spread: planes(maps.spread, lobes)?,
            lobes: maps.lobes.into_pyarray(py).reshape([height, width])?,
            residual: map(maps.residual)?,
            sigma: map(maps.sigma)?,
            status: maps.status.into_pyarray(py).reshape([height, width])?,
        })
    }
}
