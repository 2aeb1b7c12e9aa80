//! A scene as arrays.

use std::sync::Arc;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use impasto::Error;
use impasto::geometry::Grid;
use impasto::relight::plan::Over;
use impasto::relight::scene::{Colour, Lamp, Scene, Surroundings};

use crate::arrays::RigArguments;
use crate::environment::Environment;
use crate::surface::SurfaceArguments;

/// What `impasto.lighting.SceneArguments` holds.
#[derive(FromPyObject)]
#[allow(clippy::struct_excessive_bools, reason = "they are read by name from a Python object")]
pub(crate) struct SceneArguments<'py> {
    pub(crate) rig: RigArguments<'py>,
    /// (light,).
    intensity: PyReadonlyArray1<'py, f64>,
    /// (light,): radians of a distant one, mm of a near one.
    radius: PyReadonlyArray1<'py, f64>,
    /// (light,): which illuminant.
    colour: PyReadonlyArray1<'py, u32>,
    /// (illuminant, k, 3): columns of the matrices.
    diffuse: PyReadonlyArray3<'py, f64>,
    /// (illuminant, 3).
    interface: PyReadonlyArray2<'py, f64>,
    /// (3,).
    pub(crate) background: [f32; 3],
    /// With the illuminants of its channels and the mean reflectance around a pixel: then the rig's
    /// light, if its intensity is none, only says where the eye is.
    environment: Option<(Py<Environment>, [usize; 3], f64)>,
    /// Whether a near eye sees the painting in perspective.
    perspective: bool,
    /// Whether the picture stays on the painting's own grid wherever the eye is.
    rectified: bool,
    /// What a relief does.
    shadows: bool,
    parallax: bool,
}

impl SceneArguments<'_> {
    /// Where the pixels of a surface lie.
    pub(crate) fn grid(&self, surface: &SurfaceArguments<'_>) -> impasto::Result<Grid> {
        surface.grid(self.rig.pitch_mm)
    }

    /// Width of a pixel on the painting, mm.
    pub(crate) fn pitch(&self) -> f64 {
        self.rig.pitch_mm
    }

    pub(crate) fn over(&self) -> Over {
        Over { shadows: self.shadows, parallax: self.parallax }
    }

    pub(crate) fn scene(&self, grid: Grid) -> impasto::Result<Scene> {
        let rig = self.rig.over(grid)?;
        let (intensity, colour) = (self.intensity.as_array(), self.colour.as_array());
        let lamps = rig.lights().iter().zip(intensity).zip(self.radius.as_array()).zip(colour);
        let lamps = lamps.map(|(((&light, &intensity), &radius), &colour)| Lamp {
            light,
            intensity,
            radius,
            colour: colour as usize,
        });
        let (diffuse, interface) = (self.diffuse.as_array(), self.interface.as_array());
        let colours = diffuse.outer_iter().zip(interface.rows()).map(|(matrix, vector)| Colour {
            diffuse: matrix.rows().into_iter().map(|c| [c[0], c[1], c[2]]).collect(),
            interface: [vector[0], vector[1], vector[2]],
        });
        let environment = self.environment.as_ref().map(|(around, colours, albedo)| Surroundings {
            environment: Arc::clone(&around.get().inner),
            colours: *colours,
            albedo: *albedo,
        });
        Scene::surrounded(lamps.collect(), colours.collect(), rig.views()[0], environment)
            .map(|scene| scene.in_perspective(self.perspective).rectified(self.rectified))
    }
}

/// The values of a C-contiguous array.
pub(crate) fn slice<'a, T: numpy::Element, D: numpy::ndarray::Dimension>(
    name: &'static str,
    array: &'a numpy::PyReadonlyArray<'_, T, D>,
) -> impasto::Result<&'a [T]> {
    array.as_slice().map_err(|error| Error::argument(name, error.to_string()))
}
