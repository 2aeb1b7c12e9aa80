//! Environments: radiance in, prefiltered light out.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use std::sync::Arc;

use numpy::{
    IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use impasto::math::Vec3;
use impasto::relight::environment::{self, LOBES_VERSION, Map, Rotation, Scheme};
use impasto::{Error, Result};

use crate::arrays::contiguous;
use crate::errors::to_python;
use crate::run;

/// An environment that lights any number of pictures.
#[pyclass(frozen, module = "impasto._core")]
pub(crate) struct Environment {
    pub(crate) inner: Arc<environment::Environment>,
}

#[derive(FromPyObject)]
pub(crate) enum Radiance<'py> {
    /// (3, y, x), longitude and latitude.
    #[pyo3(transparent)]
    Equirectangular(PyReadonlyArray3<'py, f32>),
    /// (6, 3, n, n).
    #[pyo3(transparent)]
    Cube(PyReadonlyArray4<'py, f32>),
}

fn map(radiance: &Radiance<'_>, rotation: &PyReadonlyArray2<'_, f64>) -> Result<Map> {
    let rotation = rotation.as_array();
    if rotation.shape() != [3, 3] {
        return Err(Error::argument("rotation", "expected (3, 3)"));
    }
    let rotation: Rotation = [0, 1, 2].map(|row| [0, 1, 2].map(|column| rotation[[row, column]]));
    match radiance {
        Radiance::Equirectangular(array) => {
            let values = contiguous("environment", array.as_slice())?;
            Map::equirectangular(values, array.shape()[2], &rotation)
        }
        Radiance::Cube(array) => {
            Map::cube(contiguous("environment", array.as_slice())?, array.shape()[3], &rotation)
        }
    }
}

#[pymethods]
impl Environment {
    /// Of radiance and a rotation `(3, 3)`; irradiance is tabulated at once.
    #[new]
    fn new(
        py: Python<'_>,
        radiance: Radiance<'_>,
        rotation: PyReadonlyArray2<'_, f64>,
        scalar: bool,
        threads: usize,
    ) -> PyResult<Self> {
        let map = map(&radiance, &rotation).map_err(|error| to_python(py, &error))?;
        let scheme = if scalar { Scheme::Scalar } else { Scheme::Vector };
        let built = run::call(py, threads, None, |run| {
            Ok(environment::Environment::new(map, run)?.with_scheme(scheme))
        })?;
        Ok(Self { inner: Arc::new(built) })
    }

    /// The same with maps for Lafortune lobes: those given, or filtered now.
    fn with_lobes(
        &self,
        py: Python<'_>,
        kept: Option<PyReadonlyArray1<'_, f32>>,
        threads: usize,
    ) -> PyResult<Self> {
        let plain = environment::Environment::clone(&self.inner);
        let built = match kept {
            None => run::call(py, threads, None, |run| plain.with_lobes(run))?,
            Some(nodes) => contiguous("lobes", nodes.as_slice())
                .and_then(|nodes| plain.with_kept_lobes(nodes.to_vec()))
                .map_err(|error| to_python(py, &error))?,
        };
        Ok(Self { inner: Arc::new(built) })
    }

    /// The numbers of the maps for Lafortune lobes, to be kept.
    fn lobes<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f32>>> {
        self.inner.lobes().map(|nodes| nodes.to_vec().into_pyarray(py))
    }

    /// Irradiance per channel of a facet.
    fn irradiance(&self, py: Python<'_>, normal: [f64; 3]) -> PyResult<[f64; 3]> {
        let [x, y, z] = normal;
        run::call(py, 1, None, |run| self.inner.irradiance(Vec3::new(x, y, z), run))
    }

    /// Changes when the numbers of the maps do.
    #[classattr]
    const VERSION: u32 = LOBES_VERSION;
}
