//! Lafortune lobes of every pixel.

use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::Start;
use impasto::sbrdf::lafortune::LafortuneOptions;

use crate::arrays::StackArguments;
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
    lobes: Bound<'py, PyArray2<u8>>,
    residual: Bound<'py, PyArray2<f32>>,
    sigma: Bound<'py, PyArray2<f32>>,
    status: Bound<'py, PyArray2<u8>>,
    views_differ: bool,
}

/// Snel's three passes, from the maps of photometric stereo.
#[pyfunction]
#[pyo3(signature = (stack, normal, diffuse, status, lobes, threads, progress))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.lafortune")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_lafortune<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    normal: PyReadonlyArray3<'py, f32>,
    diffuse: PyReadonlyArray3<'py, f32>,
    status: PyReadonlyArray2<'py, u8>,
    lobes: usize,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Maps<'py>> {
    let refuse = |error: Error| errors::to_python(py, &error);
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
    let maps = run::call(py, threads, progress.as_ref(), |run| {
        let options = LafortuneOptions { lobes };
        impasto::sbrdf::lafortune::fit_lafortune(&samples, &rig, &start, options, run)
    })?;
    let map = |values: Vec<f32>| values.into_pyarray(py).reshape([height, width]);
    let planes = |values: Vec<f32>, n| values.into_pyarray(py).reshape([n, height, width]);
    Ok(Maps {
        normal: planes(maps.normal, 3)?,
        diffuse: planes(maps.diffuse, bands)?,
        specular: maps.specular.into_pyarray(py).reshape([lobes, bands, height, width])?,
        cxy: planes(maps.cxy, lobes)?,
        cz: planes(maps.cz, lobes)?,
        exponent: planes(maps.exponent, lobes)?,
        lobes: maps.lobes.into_pyarray(py).reshape([height, width])?,
        residual: map(maps.residual)?,
        sigma: map(maps.sigma)?,
        status: maps.status.into_pyarray(py).reshape([height, width])?,
        views_differ: maps.views_differ,
    })
}
