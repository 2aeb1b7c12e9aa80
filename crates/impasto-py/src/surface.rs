//! A painting's maps, and the model of its lobes by name.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use impasto::geometry::Grid;
use impasto::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface, reduced};
use impasto::{Error, Result};

use crate::arrays::{Size, contiguous};
use crate::errors::to_python;
use crate::run;

/// The fields of `impasto.Surface` that the numerics read: every array C-contiguous.
#[derive(FromPyObject)]
pub(crate) struct SurfaceArguments<'py> {
    /// (3, y, x).
    normal: PyReadonlyArray3<'py, f32>,
    /// (k, y, x).
    diffuse: PyReadonlyArray3<'py, f32>,
    /// Its name.
    model: String,
    /// Index of refraction, where the model has one.
    index: f64,
    lobes: Vec<LobeArguments<'py>>,
    /// Whether diffuse light crosses an interface of this `index`.
    coated: bool,
    /// (k, y, x).
    ambient: Option<PyReadonlyArray3<'py, f32>>,
    /// Pixels that the middle of a part lies right of and above the middle of the painting.
    origin: [f64; 2],
}

/// One of `impasto.Surface.lobes`.
#[derive(FromPyObject)]
struct LobeArguments<'py> {
    /// (k, y, x) where the lobe has a colour of its own.
    strength: NumberArray<'py>,
    shape: Vec<NumberArray<'py>>,
}

#[derive(FromPyObject)]
enum NumberArray<'py> {
    #[pyo3(transparent)]
    Map(PyReadonlyArray2<'py, f32>),
    #[pyo3(transparent)]
    Planes(PyReadonlyArray3<'py, f32>),
    #[pyo3(transparent)]
    Everywhere(f32),
}

impl SurfaceArguments<'_> {
    /// Bands, rows and columns.
    pub(crate) fn shape(&self) -> [usize; 3] {
        [0, 1, 2].map(|axis| self.diffuse.shape()[axis])
    }

    /// Where its pixels lie in the painting.
    pub(crate) fn grid(&self, pitch: f64) -> Result<Grid> {
        self.grid_of(self.size(), pitch)
    }

    /// Rows and columns.
    pub(crate) fn size(&self) -> [usize; 2] {
        let [_, height, width] = self.shape();
        [height, width]
    }

    /// Where so many rows and columns about its middle lie in the painting.
    pub(crate) fn grid_of(&self, [height, width]: [usize; 2], pitch: f64) -> Result<Grid> {
        Grid::part(width, height, pitch, self.origin)
    }

    /// The numerics' view of the maps.
    pub(crate) fn surface(&self) -> Result<Surface<'_>> {
        let planes = |map| self::planes("ambient", map);
        Ok(Surface {
            normal: self::planes("normal", &self.normal)?,
            diffuse: self::planes("diffuse", &self.diffuse)?,
            model: Model::from_name(&self.model, self.index)?,
            lobes: self.lobes.iter().map(LobeArguments::lobe).collect::<Result<_>>()?,
            coated: self.coated.then(|| CoatedDiffuse::new(self.index)),
            ambient: self.ambient.as_ref().map(planes).transpose()?,
        })
    }
}

impl LobeArguments<'_> {
    fn lobe(&self) -> Result<Lobe<'_>> {
        let strength = match &self.strength {
            NumberArray::Planes(map) => Strength::Tinted(planes("strength", map)?),
            number => Strength::Neutral(number.parameter("strength")?),
        };
        let shape = self.shape.iter().map(|number| number.parameter("shape"));
        Ok(Lobe { strength, shape: shape.collect::<Result<_>>()? })
    }
}

impl NumberArray<'_> {
    fn parameter(&self, name: &'static str) -> Result<Parameter<'_>> {
        match self {
            Self::Everywhere(value) => Ok(Parameter::Everywhere(*value)),
            Self::Map(map) => Ok(Parameter::Map(contiguous(name, map.as_slice())?)),
            Self::Planes(_) => Err(Error::argument(name, "expected a number or (y, x)")),
        }
    }
}

fn planes<'a>(name: &'static str, map: &'a PyReadonlyArray3<'_, f32>) -> Result<&'a [f32]> {
    contiguous(name, map.as_slice())
}

type Lobes<'py> = Vec<(Bound<'py, PyAny>, Vec<Bound<'py, PyArray2<f32>>>)>;
type Small<'py> = (
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray3<f32>>,
    Option<Bound<'py, PyArray3<f32>>>,
    Lobes<'py>,
    Option<Bound<'py, PyArray2<f32>>>,
);

/// Every `factor` x `factor` pixels as one: normal, diffuse, ambient, strength and shape of each lobe,
/// height.
#[pyfunction]
pub(crate) fn reduced_surface<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    height: Option<PyReadonlyArray2<'py, f32>>,
    factor: usize,
    threads: usize,
) -> PyResult<Small<'py>> {
    let refuse = |error: Error| to_python(py, &error);
    let [bands, _, width] = surface.shape();
    let map = |map| contiguous("height", PyReadonlyArray2::as_slice(map)).map_err(refuse);
    let height = height.as_ref().map(map).transpose()?;
    let maps = surface.surface().map_err(refuse)?;
    let small = run::call(py, threads, None, |run| reduced(&maps, height, width, factor, run))?;
    let size = Size { height: small.height, width: small.width };
    let planes = |map| size.planes(py, map, bands);
    let lobes = small.lobes.into_iter().zip(&maps.lobes).map(|(small, lobe)| {
        let strength = match lobe.strength {
            Strength::Tinted(_) => planes(small.strength)?.into_any(),
            Strength::Neutral(_) => size.map(py, small.strength)?.into_any(),
        };
        let shape = small.shape.into_iter().map(|map| size.map(py, map));
        Ok((strength, shape.collect::<PyResult<_>>()?))
    });
    Ok((
        size.planes(py, small.normal, 3)?,
        planes(small.diffuse)?,
        small.ambient.map(planes).transpose()?,
        lobes.collect::<PyResult<_>>()?,
        small.relief.map(|map| size.map(py, map)).transpose()?,
    ))
}
