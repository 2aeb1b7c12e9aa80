//! Lafortune lobes of every pixel.

use numpy::{PyReadwriteArray2, PyReadwriteArray3, PyReadwriteArray4};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::lafortune::{LafortuneMapsMut, LafortuneOptions};

use crate::arrays::{RigArguments, StackArguments, StartArguments};
use crate::{errors, run};

/// The maps of an `impasto.LafortuneSbrdf`, to be filled.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LafortuneArrays<'py> {
    normal: PyReadwriteArray3<'py, f32>,
    diffuse: PyReadwriteArray3<'py, f32>,
    specular: PyReadwriteArray4<'py, f32>,
    cxy: PyReadwriteArray3<'py, f32>,
    cz: PyReadwriteArray3<'py, f32>,
    exponent: PyReadwriteArray3<'py, f32>,
    specular_sigma: PyReadwriteArray3<'py, f32>,
    direction_sigma: PyReadwriteArray3<'py, f32>,
    exponent_sigma: PyReadwriteArray3<'py, f32>,
    lobes: PyReadwriteArray2<'py, u8>,
    residual: PyReadwriteArray2<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    status: PyReadwriteArray2<'py, u8>,
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
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.lafortune")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_lafortune<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    mut maps: LafortuneArrays<'py>,
    lobes: usize,
    rounds: usize,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let shape = samples.shape();
    let rig = stack.rig.rig(shape.height, shape.width).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let maps = LafortuneMapsMut {
        normal: maps.normal.as_slice_mut()?,
        diffuse: maps.diffuse.as_slice_mut()?,
        specular: maps.specular.as_slice_mut()?,
        cxy: maps.cxy.as_slice_mut()?,
        cz: maps.cz.as_slice_mut()?,
        exponent: maps.exponent.as_slice_mut()?,
        specular_sigma: maps.specular_sigma.as_slice_mut()?,
        direction_sigma: maps.direction_sigma.as_slice_mut()?,
        exponent_sigma: maps.exponent_sigma.as_slice_mut()?,
        lobes: maps.lobes.as_slice_mut()?,
        residual: maps.residual.as_slice_mut()?,
        sigma: maps.sigma.as_slice_mut()?,
        status: maps.status.as_slice_mut()?,
    };
    run::call(py, threads, progress.as_ref(), |run| {
        let options = LafortuneOptions { lobes, rounds };
        impasto::sbrdf::lafortune::fit_lafortune(&samples, &rig, &start, options, maps, run)
    })
}
