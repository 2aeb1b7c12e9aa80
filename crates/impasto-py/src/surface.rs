//! A painting's maps, and the model of its lobes by name.

use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use impasto::geometry::Grid;
use impasto::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface};
use impasto::{Error, Result};

use crate::arrays::contiguous;

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

    pub(crate) fn grid(&self, pitch: f64) -> Grid {
        let [_, height, width] = self.shape();
        Grid::whole(width, height, pitch)
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
