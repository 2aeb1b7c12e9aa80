//! Lafortune lobes of every pixel.

use numpy::{PyArray2, PyArray3, PyArray4};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::lafortune::LafortuneOptions;

use crate::arrays::{RigArguments, Size, StackArguments, StartArguments};
use crate::{errors, run};

/// Maps; meanings stand in `impasto.LafortuneSbrdf`.
#[derive(IntoPyObject)]
pub(crate) struct Maps<'py> {
    normal: Bound<'py, PyArray3<f32>>,
    diffuse: Bound<'py, PyArray3<f32>>,
    specular: Bound<'py, PyArray4<f32>>,
    cxy: Bound<'py, PyArray3<f32>>,
    cz: Bound<'py, PyArray3<f32>>,
    exponent: Bound<'py, PyArray3<f32>>,
    specular_sigma: Bound<'py, PyArray3<f32>>,
    direction_sigma: Bound<'py, PyArray3<f32>>,
    exponent_sigma: Bound<'py, PyArray3<f32>>,
    lobes: Bound<'py, PyArray2<u8>>,
    residual: Bound<'py, PyArray2<f32>>,
    sigma: Bound<'py, PyArray2<f32>>,
    status: Bound<'py, PyArray2<u8>>,
    views_differ: bool,
}

/// Whether a rig's photographs were taken from more than one direction.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn views_differ(py: Python<'_>, rig: RigArguments<'_>) -> PyResult<bool> {
    let rig = rig.rig(1, 1).map_err(|error| errors::to_python(py, &error))?;
    Ok(rig.views_differ())
}

/// Snel's three passes, from the maps of photometric stereo.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_lafortune<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    lobes: usize,
    rounds: usize,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Maps<'py>> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let decode = stack.decode();
    let samples = stack.stack(&decode).map_err(refuse)?;
    let (size, bands) = (Size::of(samples.shape()), samples.shape().bands);
    let rig = stack.rig.rig(size.height, size.width).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let maps = run::call(py, threads, progress.as_ref(), |run| {
        let options = LafortuneOptions { lobes, rounds };
        impasto::sbrdf::lafortune::fit_lafortune(&samples, &rig, &start, options, run)
    })?;
    Ok(Maps {
        normal: size.planes(py, maps.normal, 3)?,
        diffuse: size.planes(py, maps.diffuse, bands)?,
        specular: size.sets(py, maps.specular, [lobes, bands])?,
        cxy: size.planes(py, maps.cxy, lobes)?,
        cz: size.planes(py, maps.cz, lobes)?,
        exponent: size.planes(py, maps.exponent, lobes)?,
        specular_sigma: size.planes(py, maps.specular_sigma, lobes)?,
        direction_sigma: size.planes(py, maps.direction_sigma, lobes)?,
        exponent_sigma: size.planes(py, maps.exponent_sigma, lobes)?,
        lobes: size.map(py, maps.lobes)?,
        residual: size.map(py, maps.residual)?,
        sigma: size.map(py, maps.sigma)?,
        status: size.map(py, maps.status)?,
        views_differ: maps.views_differ,
    })
}
