//! Pictures by a graphics card. No driver is loaded before the first call.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use std::sync::{Mutex, PoisonError, TryLockError};

use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use impasto::geometry::Grid;
use impasto::pixels::Run;
use impasto::relight::show::Display;
use impasto::relight::{Picture, Relief};
use impasto_gpu::{Adapter, Choice, Error, Gpu, Renderer};

use crate::arrays::Size;
use crate::errors::{named, to_python};
use crate::plan::Plan;
use crate::relight::{Seen, ToneCurve, columns};
use crate::run;
use crate::scene::{SceneArguments, slice};
use crate::surface::SurfaceArguments;

/// One of `impasto.gpu.adapters()`.
#[derive(IntoPyObject)]
pub(crate) struct GpuAdapter {
    name: String,
    kind: &'static str,
    backend: &'static str,
    driver: String,
}

impl From<&Adapter> for GpuAdapter {
    fn from(adapter: &Adapter) -> Self {
        Self {
            name: adapter.name.clone(),
            kind: adapter.kind.name(),
            backend: adapter.backend,
            driver: adapter.driver.clone(),
        }
    }
}

/// The graphics cards of this computer, the best first.
#[pyfunction]
pub(crate) fn gpu_adapters(py: Python<'_>) -> Vec<GpuAdapter> {
    py.detach(impasto_gpu::adapters).iter().map(Into::into).collect()
}

/// Light of a scene by a graphics card: (3, y, x) and coverage (y, x), as `render` gives them.
///
/// `adapter` is "auto" (no driver that computes on the CPU), "any", or a part of a name.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "what render takes, and a card")]
pub(crate) fn gpu_render<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    height: Option<PyReadonlyArray2<'py, f32>>,
    scene: SceneArguments<'py>,
    plan: PyRef<'py, Plan>,
    threads: usize,
    progress: Option<Py<PyAny>>,
    adapter: &str,
) -> PyResult<Seen<'py>> {
    let refuse = |error: impasto::Error| to_python(py, &error);
    let grid = scene.grid(&surface).map_err(refuse)?;
    let height = height.as_ref().map(|map| slice("height", map)).transpose().map_err(refuse)?;
    let (maps, relief) = (surface.surface().map_err(refuse)?, Relief { grid, height });
    let (lit, background) = (scene.scene(grid).map_err(refuse)?, scene.background);
    let plan = &plan.0;
    let picture = called(py, threads, progress.as_ref(), |run| {
        impasto_gpu::render(&opened(adapter)?, &maps, relief, &lit, plan, background, run)
    })?;
    arrays(py, picture)
}

/// A surface on a graphics card.
#[pyclass(module = "impasto._core", frozen)]
pub(crate) struct GpuRenderer {
    renderer: Mutex<Renderer>,
    grid: Grid,
}

#[pymethods]
impl GpuRenderer {
    #[new]
    fn new(
        py: Python<'_>,
        surface: SurfaceArguments<'_>,
        height: Option<PyReadonlyArray2<'_, f32>>,
        pitch_mm: f64,
        adapter: &str,
    ) -> PyResult<Self> {
        let refuse = |error: impasto::Error| to_python(py, &error);
        let grid = surface.grid(pitch_mm).map_err(refuse)?;
        let height = height.as_ref().map(|map| slice("height", map)).transpose().map_err(refuse)?;
        let (maps, relief) = (surface.surface().map_err(refuse)?, Relief { grid, height });
        let renderer = called(py, 1, None, |_| Renderer::new(&opened(adapter)?, &maps, relief))?;
        Ok(Self { renderer: Mutex::new(renderer), grid })
    }

    /// The card that it is on.
    #[getter]
    fn adapter(&self, py: Python<'_>) -> GpuAdapter {
        py.detach(|| self.with(|renderer| renderer.gpu().adapter().into()))
    }

    /// Light (3, y, x) and coverage (y, x).
    fn light<'py>(
        &self,
        py: Python<'py>,
        scene: SceneArguments<'py>,
        threads: usize,
    ) -> PyResult<Seen<'py>> {
        let lit = scene.scene(self.grid).map_err(|error| to_python(py, &error))?;
        let (background, over) = (scene.background, scene.over());
        let picture = called(py, threads, None, |run| {
            self.with(|renderer| {
                renderer.set_over(over);
                renderer.light(&lit, background, run)
            })
        })?;
        arrays(py, picture)
    }

    /// Codes (y, x, 4) of a display: red, green, blue and coverage. `matrix` holds columns from light
    /// to linear display light.
    fn codes<'py>(
        &self,
        py: Python<'py>,
        scene: SceneArguments<'py>,
        matrix: PyReadonlyArray2<'py, f64>,
        curve: PyRef<'py, ToneCurve>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let refuse = |error: impasto::Error| to_python(py, &error);
        let lit = scene.scene(self.grid).map_err(refuse)?;
        let matrix = columns(&matrix);
        let display = Display { matrix: &matrix, curve: &curve.0 };
        let (background, over) = (scene.background, scene.over());
        let screen = called(py, threads, None, |run| {
            self.with(|renderer| {
                renderer.set_over(over);
                renderer.codes(&lit, background, &display, run)
            })
        })?;
        screen.codes.into_pyarray(py).reshape([screen.height, screen.width, 4])
    }
}

impl GpuRenderer {
    /// One picture at a time.
    fn with<A>(&self, work: impl FnOnce(&mut Renderer) -> A) -> A {
        work(&mut self.renderer.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn arrays(py: Python<'_>, picture: Picture) -> PyResult<Seen<'_>> {
    let size = Size { height: picture.grid.height, width: picture.grid.width };
    Ok((size.planes(py, picture.light, 3)?, size.map(py, picture.coverage)?))
}

/// Off the interpreter; what the card cannot do is an `impasto.GpuUnavailableError`.
fn called<A: Send>(
    py: Python<'_>,
    threads: usize,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Run<'_>) -> impasto_gpu::Result<A> + Send,
) -> PyResult<A> {
    let outcome = run::call(py, threads, progress, |run| match work(run) {
        Ok(answer) => Ok(Ok(answer)),
        Err(Error::Refused(error)) => Err(error),
        Err(error) => Ok(Err(error)),
    })?;
    outcome.map_err(|error| named(py, "GpuUnavailableError", error.to_string()))
}

/// The card of the last call if it is the one that is asked for and still works, else a new one.
///
/// A forked child cannot use its parent's connection to the driver: it opens its own, and leaks the
/// parent's.
fn opened(adapter: &str) -> impasto_gpu::Result<Gpu> {
    struct Kept {
        process: u32,
        wanted: String,
        gpu: Gpu,
    }
    static LAST: Mutex<Option<Kept>> = Mutex::new(None);
    let last = || match LAST.try_lock() {
        Ok(last) => Some(last),
        Err(TryLockError::Poisoned(last)) => Some(last.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    };

    let process = std::process::id();
    if let Some(last) = last()
        && let Some(kept) = last.as_ref()
        && kept.process == process
        && kept.wanted == adapter
        && kept.gpu.is_usable()
    {
        return Ok(kept.gpu.clone());
    }
    let choice = match adapter {
        "auto" => Choice::Hardware,
        "any" => Choice::Any,
        name => Choice::Named(name),
    };
    let gpu = Gpu::open(choice)?;
    let kept = Kept { process, wanted: adapter.to_owned(), gpu: gpu.clone() };
    let previous = last().and_then(|mut last| last.replace(kept));
    if let Some(previous) = previous
        && previous.process != process
    {
        std::mem::forget(previous);
    }
    Ok(gpu)
}
