//! Numpy's memory as the numerics' borrowed types, and maps back as arrays.

use half::f16;
use numpy::{
    Element, IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyReadonlyArray4,
};
use pyo3::prelude::*;

use impasto::geometry::{Grid, Light, Rig, View};
use impasto::interreflections::{Interreflections, Places};
use impasto::maps::Status;
use impasto::math::Vec3;
use impasto::sbrdf::Start;
use impasto::stack::{Decode, Samples, Shape, Stack};
use impasto::{Error, Result};

/// What `impasto._internal.border.StackArguments` holds: every array C-contiguous.
#[derive(FromPyObject)]
pub(crate) struct StackArguments<'py> {
    samples: SampleArray<'py>,
    /// (obs, band): linear light per stored unit.
    gain: PyReadonlyArray2<'py, f32>,
    /// (obs, band).
    offset: PyReadonlyArray2<'py, f32>,
    /// (obs, band), in stored units, `inf` where nothing clips.
    saturation: PyReadonlyArray2<'py, f32>,
    /// (y, x).
    mask: Option<PyReadonlyArray2<'py, bool>>,
    pub(crate) rig: RigArguments<'py>,
    interreflections: Option<InterreflectionArguments<'py>>,
}

/// What `impasto._internal.direct_light.InterreflectionArguments` holds.
#[derive(FromPyObject)]
struct InterreflectionArguments<'py> {
    /// (obs, band, `cell_y`, `cell_x`).
    irradiance: PyReadonlyArray4<'py, f32>,
    /// (band, y, x).
    albedo: PyReadonlyArray3<'py, f32>,
    rows: PlaceArguments<'py>,
    columns: PlaceArguments<'py>,
    /// (band,), like the next two.
    black: PyReadonlyArray1<'py, f32>,
    scale: PyReadonlyArray1<'py, f32>,
    saturation: PyReadonlyArray1<'py, f32>,
}

/// What `impasto._internal.direct_light.Places` holds.
#[derive(FromPyObject)]
struct PlaceArguments<'py> {
    first: PyReadonlyArray1<'py, u32>,
    share: PyReadonlyArray1<'py, f32>,
}

/// How stored numbers become samples.
pub(crate) struct Decoding<'a> {
    /// One per (observation, band).
    decode: Vec<Decode>,
    interreflections: Option<Interreflections<'a>>,
}

/// What `impasto._internal.border.RigArguments` holds.
#[derive(FromPyObject)]
pub(crate) struct RigArguments<'py> {
    /// (obs, 3): unit directions, or positions in mm.
    lights: PyReadonlyArray2<'py, f64>,
    /// (obs,): whether the row of `lights` is a position.
    point: PyReadonlyArray1<'py, bool>,
    /// (obs,): whether a point light's samples carry its fall-off.
    falloff: PyReadonlyArray1<'py, bool>,
    /// (obs, 3): unit directions, or positions in mm.
    views: PyReadonlyArray2<'py, f64>,
    /// (obs,): whether the row of `views` is a position.
    point_view: PyReadonlyArray1<'py, bool>,
    pub(crate) pitch_mm: f64,
    /// Pixels that the middle of a part lies right of and above the middle of the painting.
    origin: [f64; 2],
}

/// What `impasto.fit.start.StartArguments` holds: the maps of photometric stereo.
#[derive(FromPyObject)]
pub(crate) struct StartArguments<'py> {
    /// (3, y, x).
    normal: PyReadonlyArray3<'py, f32>,
    /// (band, y, x).
    diffuse: PyReadonlyArray3<'py, f32>,
    /// (y, x).
    status: PyReadonlyArray2<'py, u8>,
}

/// Tried in turn, and a type that does not fit makes the text of an error. Linear light is first:
/// searches fit a few pixels of it by the thousand.
#[derive(FromPyObject)]
enum SampleArray<'py> {
    #[pyo3(transparent)]
    F32(PyReadonlyArray4<'py, f32>),
    #[pyo3(transparent)]
    U8(PyReadonlyArray4<'py, u8>),
    #[pyo3(transparent)]
    U16(PyReadonlyArray4<'py, u16>),
    #[pyo3(transparent)]
    F16(PyReadonlyArray4<'py, f16>),
}

/// Says which array was not C-contiguous; `impasto._internal.border` makes them so.
pub(crate) fn contiguous<T>(
    name: &'static str,
    slice: std::result::Result<T, impl ToString>,
) -> Result<T> {
    slice.map_err(|error| Error::argument(name, error.to_string()))
}

impl StackArguments<'_> {
    /// How stored numbers become samples, which [`Self::stack`] borrows.
    pub(crate) fn decoding(&self) -> Result<Decoding<'_>> {
        let (gain, offset, saturation) =
            (self.gain.as_array(), self.offset.as_array(), self.saturation.as_array());
        let decode = gain
            .iter()
            .zip(&offset)
            .zip(&saturation)
            .map(|((&gain, &offset), &saturation)| Decode { gain, offset, saturation })
            .collect();
        let taken_off = self.interreflections.as_ref();
        let interreflections = taken_off.map(InterreflectionArguments::borrowed).transpose()?;
        Ok(Decoding { decode, interreflections })
    }

    pub(crate) fn shape(&self) -> Shape {
        use numpy::PyUntypedArrayMethods;
        let shape = match &self.samples {
            SampleArray::U8(a) => a.shape(),
            SampleArray::U16(a) => a.shape(),
            SampleArray::F16(a) => a.shape(),
            SampleArray::F32(a) => a.shape(),
        };
        Shape { observations: shape[0], bands: shape[1], height: shape[2], width: shape[3] }
    }

    /// The rig of a stack that is fitted by itself, wherever it lies.
    pub(crate) fn rig_alone(&self) -> Result<Rig> {
        let Shape { height, width, .. } = self.shape();
        self.rig_in([height, width], self.rig.origin)
    }

    /// The rig of a part of a painting with so many rows and columns, whose own middle lies right of
    /// and above the origin of the world.
    pub(crate) fn rig_in(&self, [rows, columns]: [usize; 2], middle: [f64; 2]) -> Result<Rig> {
        let (Shape { height, width, .. }, rig) = (self.shape(), &self.rig);
        let extent = [columns, rows];
        rig.over(Grid::part_of(extent, middle, width, height, rig.pitch_mm, rig.origin)?)
    }

    /// The numerics' view of the stack.
    pub(crate) fn stack<'a>(&'a self, decoding: &'a Decoding<'a>) -> Result<Stack<'a>> {
        let samples = match &self.samples {
            SampleArray::U8(a) => Samples::U8(contiguous("samples", a.as_slice())?),
            SampleArray::U16(a) => Samples::U16(contiguous("samples", a.as_slice())?),
            SampleArray::F16(a) => Samples::F16(contiguous("samples", a.as_slice())?),
            SampleArray::F32(a) => Samples::F32(contiguous("samples", a.as_slice())?),
        };
        let mask =
            self.mask.as_ref().map(|mask| contiguous("mask", mask.as_slice())).transpose()?;
        let stack = Stack::new(samples, self.shape(), &decoding.decode, mask)?;
        decoding.interreflections.as_ref().map_or(Ok(stack), |light| stack.without(light))
    }
}

impl InterreflectionArguments<'_> {
    fn borrowed(&self) -> Result<Interreflections<'_>> {
        let (.., cell_rows, cell_columns) = self.irradiance.as_array().dim();
        Ok(Interreflections {
            irradiance: contiguous("irradiance", self.irradiance.as_slice())?,
            cells: [cell_rows, cell_columns],
            albedo: contiguous("albedo", self.albedo.as_slice())?,
            rows: self.rows.borrowed()?,
            columns: self.columns.borrowed()?,
            black: contiguous("black", self.black.as_slice())?,
            scale: contiguous("scale", self.scale.as_slice())?,
            saturation: contiguous("saturation", self.saturation.as_slice())?,
        })
    }
}

impl PlaceArguments<'_> {
    fn borrowed(&self) -> Result<Places<'_>> {
        Ok(Places {
            first: contiguous("first", self.first.as_slice())?,
            share: contiguous("share", self.share.as_slice())?,
        })
    }
}

impl RigArguments<'_> {
    /// The numerics' rig over a grid of the given size.
    pub(crate) fn rig(&self, height: usize, width: usize) -> Result<Rig> {
        self.over(Grid::part(width, height, self.pitch_mm, self.origin)?)
    }

    /// The same over a grid.
    pub(crate) fn over(&self, grid: Grid) -> Result<Rig> {
        let vectors = |array: &PyReadonlyArray2<'_, f64>| -> Vec<Vec3<f64>> {
            array.as_array().rows().into_iter().map(|v| Vec3::new(v[0], v[1], v[2])).collect()
        };
        let (point, falloff) = (self.point.as_array(), self.falloff.as_array());
        let lights = vectors(&self.lights)
            .into_iter()
            .enumerate()
            .map(|(index, vector)| {
                if point[index] {
                    Light::Point { position: vector, falloff: falloff[index] }
                } else {
                    Light::Distant(vector)
                }
            })
            .collect();
        let near = self.point_view.as_array();
        let view = |(index, vector): (usize, Vec3<f64>)| {
            if near[index] { View::Point(vector) } else { View::Distant(vector) }
        };
        let views = vectors(&self.views).into_iter().enumerate().map(view);
        Rig::new(lights, views, grid)
    }
}

impl StartArguments<'_> {
    /// The numerics' view of the maps.
    pub(crate) fn start(&self) -> Result<Start<'_>> {
        Ok(Start {
            normal: contiguous("normal", self.normal.as_slice())?,
            diffuse: contiguous("diffuse", self.diffuse.as_slice())?,
            status: contiguous("status", self.status.as_slice())?,
        })
    }
}

/// The size of a painting, on which maps become arrays.
#[derive(Clone, Copy)]
pub(crate) struct Size {
    pub(crate) height: usize,
    pub(crate) width: usize,
}

impl Size {
    /// `(y, x)`.
    pub(crate) fn map<T: Element>(
        self,
        py: Python<'_>,
        values: Vec<T>,
    ) -> PyResult<Bound<'_, PyArray2<T>>> {
        values.into_pyarray(py).reshape([self.height, self.width])
    }

    /// `(planes, y, x)`.
    pub(crate) fn planes<T: Element>(
        self,
        py: Python<'_>,
        values: Vec<T>,
        planes: usize,
    ) -> PyResult<Bound<'_, PyArray3<T>>> {
        values.into_pyarray(py).reshape([planes, self.height, self.width])
    }
}

/// Numbers and names of the statuses, for the test that holds Python's enum against them.
pub(crate) fn status_names() -> Vec<(String, u8)> {
    Status::ALL.iter().map(|status| (format!("{status:?}"), status.code())).collect()
}
