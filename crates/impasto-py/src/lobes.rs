//! Lobes of every pixel.

use numpy::{PyArray2, PyArray3, PyArray4};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::{LobeModel, LobeOptions, Origin, Precision};

use crate::arrays::{Size, StackArguments, StartArguments};
use crate::surface::with_model;
use crate::{errors, run};

/// Maps of the fit; meanings stand in `impasto.LobeSbrdf`.
#[derive(IntoPyObject)]
pub(crate) struct LobeArrays<'py> {
    normal: Bound<'py, PyArray3<f32>>,
    diffuse: Bound<'py, PyArray3<f32>>,
    ambient: Bound<'py, PyArray3<f32>>,
    /// (lobe, band, y, x).
    specular: Bound<'py, PyArray4<f32>>,
    /// (lobe, number, y, x).
    numbers: Bound<'py, PyArray4<f32>>,
    /// (lobe, y, x).
    spread: Bound<'py, PyArray3<f32>>,
    tinted: Bound<'py, PyArray3<u8>>,
    lobes: Bound<'py, PyArray2<u8>>,
    residual: Bound<'py, PyArray2<f32>>,
    sigma: Bound<'py, PyArray2<f32>>,
    converged: Bound<'py, PyArray2<u8>>,
    status: Bound<'py, PyArray2<u8>>,
}

/// Every pixel's own lobes, from the maps of photometric stereo.
#[pyfunction]
#[pyo3(signature = (
    stack, start, model, lobes, ambient, rounds, typical, sparing, iterations, origin, precision, index, threads,
    progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.lobes")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_lobes<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    model: &str,
    lobes: usize,
    ambient: bool,
    rounds: usize,
    typical: bool,
    sparing: bool,
    iterations: usize,
    origin: &str,
    precision: &str,
    index: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<LobeArrays<'py>> {
    let refuse = |argument, names, other| {
        let problem = format!("expected {names}, found {other:?}");
        errors::to_python(py, &Error::argument(argument, problem))
    };
    let origin = match origin {
        "multistart" => Origin::Multistart,
        "neighbours" => Origin::Neighbours,
        other => return Err(refuse("start", "\"multistart\" or \"neighbours\"", other)),
    };
    let precision = match precision {
        "single" => Precision::Single,
        "polished" => Precision::Polished,
        "double" => Precision::Double,
        other => {
            return Err(refuse("precision", "\"single\", \"polished\" or \"double\"", other));
        }
    };
    let options = LobeOptions {
        lobes,
        ambient,
        normal: true,
        rounds,
        typical,
        sparing,
        iterations,
        start: origin,
        precision,
    };
    let call = Call { stack: &stack, start: &start, options, threads, progress: progress.as_ref() };
    with_model!(model, index, |model| call.fit(py, model)?)
        .map_err(|error| errors::to_python(py, &error))
}

struct Call<'a, 'py> {
    stack: &'a StackArguments<'py>,
    start: &'a StartArguments<'py>,
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
        let (size, bands) = (Size::of(samples.shape()), samples.shape().bands);
        let rig = stack.rig.rig(size.height, size.width).map_err(refuse)?;
        let start = start.start().map_err(refuse)?;
        let maps = run::call(py, threads, progress, |run| {
            impasto::sbrdf::fit_lobes(&samples, &rig, &start, model, &options, run)
        })?;
        let lobes = options.lobes;
        Ok(LobeArrays {
            normal: size.planes(py, maps.normal, 3)?,
            diffuse: size.planes(py, maps.diffuse, bands)?,
            ambient: size.planes(py, maps.ambient, bands)?,
            specular: size.sets(py, maps.specular, [lobes, bands])?,
            numbers: size.sets(py, maps.numbers, [lobes, M::NAMES.len()])?,
            spread: size.planes(py, maps.spread, lobes)?,
            tinted: size.planes(py, maps.tinted, lobes)?,
            lobes: size.map(py, maps.lobes)?,
            residual: size.map(py, maps.residual)?,
            sigma: size.map(py, maps.sigma)?,
            converged: size.map(py, maps.converged)?,
            status: size.map(py, maps.status)?,
        })
    }
}
