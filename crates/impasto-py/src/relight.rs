//! From maps to light.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3,
    PyReadwriteArray2, PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::geometry::{Grid, Light};
use impasto::math::Vec3;
use impasto::pixels::zeros;
use impasto::relight::curve::Curve;
use impasto::relight::show::{Codes, Display, codes_from_planes, linear_from_planes};
use impasto::relight::{self, Canvas, Relief};

use crate::arrays::{Size, contiguous};
use crate::errors::to_python;
use crate::plan::Plan;
use crate::run;
use crate::scene::{SceneArguments, slice};
use crate::surface::SurfaceArguments;

/// Light `(3, y, x)` and coverage `(y, x)`.
pub(crate) type Seen<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<f32>>);

/// Light of a scene as planned: (3, y, x) and coverage (y, x).
#[pyfunction]
pub(crate) fn render<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    height: Option<PyReadonlyArray2<'py, f32>>,
    scene: SceneArguments<'py>,
    plan: PyRef<'py, Plan>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Seen<'py>> {
    let refuse = |error: Error| to_python(py, &error);
    let grid = scene.grid(&surface).map_err(refuse)?;
    let height = height.as_ref().map(|map| slice("height", map)).transpose().map_err(refuse)?;
    let (maps, relief) = (surface.surface().map_err(refuse)?, Relief { grid, height });
    let (lit, background) = (scene.scene(grid).map_err(refuse)?, scene.background);
    let plan = &plan.0;
    let picture = run::call(py, threads, progress.as_ref(), |run| {
        relight::render(&maps, relief, &lit, plan, background, run)
    })?;
    let size = Size { height: picture.grid.height, width: picture.grid.width };
    Ok((size.planes(py, picture.light, 3)?, size.map(py, picture.coverage)?))
}

/// The tone curve of a display, with the tables that codes are looked up in.
#[pyclass(module = "impasto._core", frozen)]
pub(crate) struct ToneCurve(pub(crate) Curve);

#[pymethods]
impl ToneCurve {
    /// A curve through codes `(1 or 3, 2049)` at equal steps of the square root of light.
    #[new]
    fn new(py: Python<'_>, codes: PyReadonlyArray2<'_, f32>) -> PyResult<Self> {
        let curve = slice("codes", &codes).and_then(Curve::new);
        curve.map(Self).map_err(|error| to_python(py, &error))
    }
}

/// Writes display codes `(y, x, 3)` of a scene as planned and coverage `(y, x)`; returns how many
/// pixels lay below 0 and above 1 per channel. `matrix` holds columns from light to linear display
/// light.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "what render takes, and a display")]
pub(crate) fn paint<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    height: Option<PyReadonlyArray2<'py, f32>>,
    scene: SceneArguments<'py>,
    plan: PyRef<'py, Plan>,
    matrix: PyReadonlyArray2<'py, f64>,
    curve: PyRef<'py, ToneCurve>,
    mut codes: PyReadwriteArray3<'py, u8>,
    mut coverage: PyReadwriteArray2<'py, f32>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Vec<u64>, Vec<u64>)> {
    let refuse = |error: Error| to_python(py, &error);
    let grid = scene.grid(&surface).map_err(refuse)?;
    let height = height.as_ref().map(|map| slice("height", map)).transpose().map_err(refuse)?;
    let (maps, relief) = (surface.surface().map_err(refuse)?, Relief { grid, height });
    let (lit, background) = (scene.scene(grid).map_err(refuse)?, scene.background);
    let (plan, matrix) = (&plan.0, columns(&matrix));
    let display = Display { matrix: &matrix, curve: &curve.0 };
    let codes = contiguous("codes", codes.as_slice_mut()).map_err(refuse)?;
    let coverage = contiguous("coverage", coverage.as_slice_mut()).map_err(refuse)?;
    let canvas = Canvas { codes, coverage, display };
    let clipped = run::call(py, threads, progress.as_ref(), |run| {
        relight::paint(&maps, relief, &lit, plan, background, canvas, run)
    })?;
    Ok((clipped.below.to_vec(), clipped.above.to_vec()))
}

/// `(3, y, x)` linear light from `(k, y, x)` planes and `(k, 3)` matrix columns.
#[pyfunction]
pub(crate) fn linear_from_bands<'py>(
    py: Python<'py>,
    planes: PyReadonlyArray3<'py, f32>,
    matrix: PyReadonlyArray2<'py, f64>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let columns = columns(&matrix);
    let values = slice("planes", &planes).map_err(|error| to_python(py, &error))?;
    let [height, width] = [planes.shape()[1], planes.shape()[2]];
    let out = run::call(py, threads, None, |run| {
        let mut out = zeros(3 * height * width)?;
        linear_from_planes(values, &columns, &mut out, run)?;
        Ok(out)
    })?;
    out.into_pyarray(py).reshape([3, height, width])
}

type Shown<'py> = (Bound<'py, PyAny>, Vec<u64>, Vec<u64>);

/// Codes `(y, x, 3)` of 8, 16 or 32 bits, and how many lay below 0 and above 1 per channel.
#[pyfunction]
pub(crate) fn display_from_bands<'py>(
    py: Python<'py>,
    planes: PyReadonlyArray3<'py, f32>,
    matrix: PyReadonlyArray2<'py, f64>,
    curve: PyRef<'py, ToneCurve>,
    bits: u32,
    threads: usize,
) -> PyResult<Shown<'py>> {
    let columns = columns(&matrix);
    let refused = |error: Error| to_python(py, &error);
    let values = slice("planes", &planes).map_err(refused)?;
    let curve = &curve.0;
    let [height, width] = [planes.shape()[1], planes.shape()[2]];
    let count = 3 * height * width;
    macro_rules! shown {
        ($type:ty, $variant:ident) => {{
            let (codes, clipped) = run::call(py, threads, None, |run| {
                let mut codes: Vec<$type> = zeros(count)?;
                let clipped =
                    codes_from_planes(values, &columns, curve, Codes::$variant(&mut codes), run)?;
                Ok((codes, clipped))
            })?;
            let codes: Bound<'py, PyArray1<$type>> = codes.into_pyarray(py);
            (codes.reshape([height, width, 3])?.into_any(), clipped)
        }};
    }
    let (codes, clipped) = match bits {
        8 => shown!(u8, Eight),
        16 => shown!(u16, Sixteen),
        _ => shown!(f32, Float),
    };
    Ok((codes, clipped.below.to_vec(), clipped.above.to_vec()))
}

/// Rows of an array as columns of a matrix.
pub(crate) fn columns(matrix: &PyReadonlyArray2<'_, f64>) -> Vec<[f64; 3]> {
    matrix.as_array().rows().into_iter().map(|c| [c[0], c[1], c[2]]).collect()
}

/// Height `(y, x)` in mm from normals `(3, y, x)`.
#[pyfunction]
pub(crate) fn integrate_normals<'py>(
    py: Python<'py>,
    normal: PyReadonlyArray3<'py, f32>,
    pitch_mm: f64,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let values = slice("normal", &normal).map_err(|error| to_python(py, &error))?;
    let [height, width] = [normal.shape()[1], normal.shape()[2]];
    let out = run::call(py, threads, progress.as_ref(), |run| {
        impasto::height::integrate(values, width, height, pitch_mm, run)
    })?;
    out.into_pyarray(py).reshape([height, width])
}

/// A light from its position or direction.
fn light_of([x, y, z]: [f64; 3], point: bool) -> Light {
    let position = Vec3::new(x, y, z);
    if point { Light::Point { position, falloff: true } } else { Light::Distant(position) }
}

/// Visibility `(y, x)`, 1 or 0, of a light over heights in mm.
#[pyfunction]
#[pyo3(signature = (height, pitch_mm, light, point=false, threads=1))]
pub(crate) fn cast_shadows<'py>(
    py: Python<'py>,
    height: PyReadonlyArray2<'py, f32>,
    pitch_mm: f64,
    light: [f64; 3],
    point: bool,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let values = slice("height", &height).map_err(|error| to_python(py, &error))?;
    let grid = Grid::whole(height.shape()[1], height.shape()[0], pitch_mm);
    let light = light_of(light, point);
    // A ray towards a near lamp crosses the picture; of a small square one it takes as long as a sample.
    let rays = if point { grid.width.max(grid.height).div_ceil(64) } else { 1 };
    let out = run::call_on(py, values.len() * rays, threads, None, |run| {
        relight::shadow::cast_shadows(values, grid, &light, run)
    })?;
    out.into_pyarray(py).reshape([grid.height, grid.width])
}

/// Visible share `(y, x)` of a lamp with an angular radius, or near, a radius in mm.
#[pyfunction]
#[pyo3(signature = (height, pitch_mm, light, radius, point=false, threads=1))]
pub(crate) fn soft_shadows<'py>(
    py: Python<'py>,
    height: PyReadonlyArray2<'py, f32>,
    pitch_mm: f64,
    light: [f64; 3],
    radius: f64,
    point: bool,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let values = slice("height", &height).map_err(|error| to_python(py, &error))?;
    let grid = Grid::whole(height.shape()[1], height.shape()[0], pitch_mm);
    let light = light_of(light, point);
    let out = run::call(py, threads, None, |run| {
        relight::shadow::horizon::soft_shadows(values, grid, &light, radius, run)
    })?;
    out.into_pyarray(py).reshape([grid.height, grid.width])
}

/// Share `(y, x)` of an even sky's irradiance, with one bounce from surroundings of an albedo.
#[pyfunction]
pub(crate) fn sky_visibility<'py>(
    py: Python<'py>,
    height: PyReadonlyArray2<'py, f32>,
    pitch_mm: f64,
    azimuths: usize,
    albedo: f64,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let values = slice("height", &height).map_err(|error| to_python(py, &error))?;
    let grid = Grid::whole(height.shape()[1], height.shape()[0], pitch_mm);
    let out = run::call(py, threads, None, |run| {
        relight::occlusion::sky(values, grid, azimuths, albedo, run)
    })?;
    out.into_pyarray(py).reshape([grid.height, grid.width])
}
