//! Samples that a surface shows.

use numpy::{PyArray4, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use impasto::Error;
use impasto::geometry::Rig;
use impasto::sbrdf::LobeModel;

use crate::arrays::RigArguments;
use crate::surface::{SurfaceArguments, with_model};
use crate::{errors, run};

/// Samples `(obs, band, y, x)` that a surface shows.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn predict<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    rig: RigArguments<'py>,
    intensities: PyReadonlyArray1<'py, f64>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let [bands, height, width] = surface.shape();
    let rig = rig.rig(height, width).map_err(refuse)?;
    let samples = PyArray4::zeros(py, [rig.observations(), bands, height, width], false);
    let mut out = samples.readwrite();
    let shown = Shown {
        surface: &surface,
        rig: &rig,
        intensities: intensities.as_slice()?,
        out: out.as_slice_mut()?,
        threads,
        progress: progress.as_ref(),
    };
    with_model!(surface.model.as_str(), surface.index, |model| shown.predict(py, model)?)
        .map_err(refuse)?;
    drop(out);
    Ok(samples)
}

/// A call of [`predict`] before its model is known.
struct Shown<'a, 'py> {
    surface: &'a SurfaceArguments<'py>,
    rig: &'a Rig,
    intensities: &'a [f64],
    out: &'a mut [f32],
    threads: usize,
    progress: Option<&'a Py<PyAny>>,
}

impl Shown<'_, '_> {
    fn predict<M: LobeModel>(self, py: Python<'_>, model: M) -> PyResult<()> {
        let surface = self.surface.surface(model).map_err(|error| errors::to_python(py, &error))?;
        run::call(py, self.threads, self.progress, |run| {
            impasto::sbrdf::predict(&surface, self.rig, self.intensities, self.out, run)
        })
    }
}
