//! What a scene calls for.

#![allow(clippy::needless_pass_by_value, reason = "pyo3 hands arguments over by value")]

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use impasto::Error;
use impasto::relight::plan::{self, Decision, Effect, Options, Shown};
use impasto::relight::statistics::{Pieces, SIDE, Statistics};
use impasto::relight::tolerance::Tolerance;

use crate::errors::to_python;
use crate::run;
use crate::scene::{SceneArguments, slice};
use crate::surface::SurfaceArguments;

/// What is known of every 256 x 256 pixels of a surface.
#[pyclass(frozen, name = "SurfaceStatistics")]
pub(crate) struct SurfaceStatistics(Statistics);

#[pymethods]
impl SurfaceStatistics {
    /// Columns and rows of a tile.
    #[classattr]
    const SIDE: usize = SIDE;

    /// Statistics of a surface and, where given, of its height in mm.
    #[new]
    #[pyo3(signature = (surface, height=None, threads=1))]
    fn new(
        py: Python<'_>,
        surface: SurfaceArguments<'_>,
        height: Option<PyReadonlyArray2<'_, f32>>,
        threads: usize,
    ) -> PyResult<Self> {
        let refuse = |error: Error| to_python(py, &error);
        let [_, _, width] = surface.shape();
        let height = height.as_ref().map(|map| slice("height", map)).transpose().map_err(refuse)?;
        let maps = surface.surface().map_err(refuse)?;
        run::call(py, threads, None, |run| Statistics::new(&maps, width, height, run)).map(Self)
    }

    /// Tiles, and whether they have a relief.
    #[getter]
    fn tiles(&self) -> (usize, bool) {
        (self.0.tiles.len(), self.0.tiles.iter().all(|tile| tile.relief.is_some()))
    }

    /// All but the relief as numbers (number, tile), the tiles row by row, to be kept.
    fn table<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.0.table())
    }

    /// The statistics of a painting of a `shape` from the tables of its tiles; `surface` is any part.
    #[staticmethod]
    fn from_table(
        py: Python<'_>,
        table: PyReadonlyArray1<'_, f64>,
        surface: SurfaceArguments<'_>,
        shape: [usize; 2],
        tile: usize,
    ) -> PyResult<Self> {
        let refuse = |error: Error| to_python(py, &error);
        let numbers = slice("table", &table).map_err(refuse)?;
        let maps = surface.surface().map_err(refuse)?;
        let [height, width] = shape;
        let pieces = Pieces { width, height, tile };
        Statistics::from_table(numbers, &maps, pieces).map(Self).map_err(refuse)
    }
}

/// What is simulated where.
#[pyclass(frozen, name = "Plan")]
pub(crate) struct Plan(pub(crate) plan::Plan);

/// Limit, rows of the display's matrix and codes per unit of light; or limit and white.
#[derive(FromPyObject)]
pub(crate) enum ToleranceArguments {
    #[pyo3(transparent)]
    Codes((f64, [[f64; 3]; 3], [f64; 3])),
    #[pyo3(transparent)]
    DeltaE((f64, [f64; 3])),
}

impl From<ToleranceArguments> for Tolerance {
    fn from(arguments: ToleranceArguments) -> Self {
        match arguments {
            ToleranceArguments::Codes((limit, display, slope)) => {
                Self::Codes { limit, slope, display }
            }
            ToleranceArguments::DeltaE((limit, white)) => Self::DeltaE { limit, white },
        }
    }
}

/// One row of a plan.
#[derive(IntoPyObject)]
struct Row {
    effect: String,
    decision: &'static str,
    tiles: usize,
    error: f64,
    reason: String,
}

fn name(effect: Effect) -> String {
    let name = match effect {
        Effect::Diffuse => "diffuse",
        Effect::CoatedDiffuse => "coated diffuse",
        Effect::Ambient => "ambient",
        Effect::Lobe(lobe) => return format!("lobe {}", lobe + 1),
        Effect::CastShadows => "cast shadows",
        Effect::NearLight => "near light",
        Effect::NearView => "near view",
        Effect::SlantedView => "slanted view",
        Effect::Parallax => "parallax",
        Effect::Environment => "environment",
        Effect::SkyOcclusion => "sky occlusion",
        Effect::OneBounce => "one bounce",
        Effect::Clipping => "clipping",
        Effect::GamutClipping => "gamut clipping",
    };
    name.to_owned()
}

#[pymethods]
impl Plan {
    /// Everything that is there is simulated.
    #[staticmethod]
    fn forced(
        py: Python<'_>,
        surface: SurfaceArguments<'_>,
        scene: SceneArguments<'_>,
    ) -> PyResult<Self> {
        let refuse = |error: Error| to_python(py, &error);
        let (grid, over) = (scene.grid(&surface).map_err(refuse)?, scene.over());
        let (maps, scene) =
            (surface.surface().map_err(refuse)?, scene.scene(grid).map_err(refuse)?);
        plan::Plan::forced(&maps, grid, &scene, over).map(Self).map_err(refuse)
    }

    /// What a scene calls for; without a `tolerance` no bit may change. `display` holds columns from
    /// light to linear display light, where that is known before the picture. `shape` is that of the
    /// painting where `surface` is a part that stands for it.
    #[new]
    #[pyo3(signature = (surface, statistics, scene, *, tolerance, display=None, more_light, threads, shape=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords")]
    fn new(
        py: Python<'_>,
        surface: SurfaceArguments<'_>,
        statistics: PyRef<'_, SurfaceStatistics>,
        scene: SceneArguments<'_>,
        tolerance: Option<ToleranceArguments>,
        display: Option<[[f64; 3]; 3]>,
        more_light: bool,
        threads: usize,
        shape: Option<[usize; 2]>,
    ) -> PyResult<Self> {
        let refuse = |error: Error| to_python(py, &error);
        let shape = shape.unwrap_or_else(|| surface.size());
        let grid = surface.grid_of(shape, scene.pitch()).map_err(refuse)?;
        let (over, background) = (scene.over(), scene.background);
        let (maps, scene) =
            (surface.surface().map_err(refuse)?, scene.scene(grid).map_err(refuse)?);
        let tolerance = tolerance.map_or(Tolerance::Exact, Tolerance::from);
        let display = display.map(|matrix| Shown { matrix, background });
        let options = Options { tolerance, over, more_light, display };
        let statistics = &statistics.0;
        run::call(py, threads, None, |run| {
            plan::Plan::new(&maps, statistics, grid, &scene, options, run)
        })
        .map(Self)
    }

    /// Effect, decision, tiles, error and reason of each row.
    #[getter]
    fn rows(&self) -> Vec<Row> {
        let row = |row: &plan::Row| Row {
            effect: name(row.effect),
            decision: match row.decision {
                Decision::Absent => "absent",
                Decision::NoOp => "no-op",
                Decision::Bounded => "bounded",
                Decision::On => "on",
            },
            tiles: row.tiles,
            error: row.error,
            reason: row.reason.clone(),
        };
        self.0.rows().iter().map(row).collect()
    }

    /// The plan without the effect of a row, to see what the effect takes.
    fn without(&self, effect: &str) -> Self {
        let rows = self.0.rows().iter().find(|row| name(row.effect) == effect);
        let plan = self.0.clone();
        Self(rows.map_or(plan.clone(), |row| plan.without(row.effect)))
    }

    /// How many tiles are clipped whole, so that their display codes need no light.
    #[getter]
    fn clipped_whole(&self) -> usize {
        self.0.clipped_whole()
    }

    /// The plan with what another one for the same picture knows of clipping.
    fn clipped_as(&self, other: PyRef<'_, Self>) -> Self {
        Self(self.0.clone().clipped_as(&other.0))
    }

    /// The largest sum of bounds of what a tile does without.
    #[getter]
    fn error(&self) -> f64 {
        self.0.error()
    }

    /// All tiles.
    #[getter]
    fn tiles(&self) -> usize {
        self.0.tiles()
    }

    /// Whether the picture is projected along its view.
    #[getter]
    fn projected(&self) -> bool {
        self.0.projected()
    }
}
