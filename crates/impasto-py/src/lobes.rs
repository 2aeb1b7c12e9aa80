//! Lobes of every pixel.

use numpy::{
    IntoPyArray, PyArray1, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3,
    PyReadonlyArray4, PyReadwriteArray2, PyReadwriteArray3, PyReadwriteArray4,
};
use pyo3::prelude::*;

use impasto::passes::{PassCount, Passes, Purpose};
use impasto::sbrdf::{LearnedLobes, LobeMapsMut, LobeOptions, Origin, Precision, PriorNumbers};
use impasto::surface::{CoatedDiffuse, TorranceSparrow};
use impasto::{Error, Result};

use crate::arrays::{StackArguments, StartArguments, contiguous};
use crate::{errors, run};

/// What `impasto.fit.lobes.LobeMaps` holds: C-contiguous arrays to be filled.
#[derive(FromPyObject)]
pub(crate) struct LobeArrays<'py> {
    normal: PyReadwriteArray3<'py, f32>,
    diffuse: PyReadwriteArray3<'py, f32>,
    ambient: PyReadwriteArray3<'py, f32>,
    /// (lobe, band, y, x).
    specular: PyReadwriteArray4<'py, f32>,
    /// (lobe, parameter, y, x).
    parameters: PyReadwriteArray4<'py, f32>,
    /// (lobe, y, x).
    deviation: PyReadwriteArray3<'py, f32>,
    tinted: PyReadwriteArray3<'py, u8>,
    lobes: PyReadwriteArray2<'py, u8>,
    residual: PyReadwriteArray2<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    converged: PyReadwriteArray2<'py, u8>,
    status: PyReadwriteArray2<'py, u8>,
}

/// What `impasto.fit.lobes.LobeOptions` holds.
#[derive(FromPyObject)]
#[allow(clippy::struct_excessive_bools, reason = "each switches one thing")]
pub(crate) struct LobeArguments {
    lobes: usize,
    ambient: bool,
    /// Whether diffuse light crosses an interface of this `index`.
    coated: bool,
    rounds: usize,
    typical: bool,
    sparing: bool,
    bounded: bool,
    iterations: usize,
    colour_iterations: usize,
    start: String,
    precision: String,
    index: f64,
}

/// What `impasto.fit.lobes.LearnedLobes` holds.
#[derive(FromPyObject)]
pub(crate) struct LearnedArguments<'py> {
    options: LobeArguments,
    /// Rows and columns of the whole painting.
    extent: [usize; 2],
    /// Pixels that its middle lies right of and above the origin of the world.
    middle: [f64; 2],
    pixels: usize,
    prior: Option<PriorArguments<'py>>,
}

/// What `impasto.fit.lobes.Prior` holds.
#[derive(FromPyObject)]
struct PriorArguments<'py> {
    counts: PyReadonlyArray1<'py, u32>,
    /// (number of lobes, lobe, unknown, pixel).
    shapes: PyReadonlyArray4<'py, f32>,
    /// (number of lobes, lobe, pixel).
    variances: PyReadonlyArray3<'py, f32>,
}

/// What was learned, for `impasto.fit.lobes.LearnedLobes`.
#[derive(IntoPyObject)]
pub(crate) struct Learned<'py> {
    start: &'static str,
    bounded: bool,
    pixels: usize,
    prior: Option<PriorArrays<'py>>,
}

#[derive(IntoPyObject)]
struct PriorArrays<'py> {
    counts: Bound<'py, PyArray1<u32>>,
    shapes: Bound<'py, PyArray4<f32>>,
    variances: Bound<'py, PyArray3<f32>>,
}

/// Fills the maps with every pixel's own lobes, from the maps of photometric stereo; returns what
/// was learned about the painting, and where the passes went.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn fit_lobes<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    options: LobeArguments,
    mut maps: LobeArrays<'py>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Learned<'py>, Vec<Counted>)> {
    let refuse = |error| errors::to_python(py, &error);
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let rig = stack.rig_alone().map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let count = options.usual_samples(samples.shape().samples());
    let (model, options) = (options.model(), options.options().map_err(refuse)?);
    let maps = maps.maps().map_err(refuse)?;
    let (learned, passes) = run::call_on(py, count, threads, progress.as_ref(), |run| {
        impasto::sbrdf::fit_lobes(&samples, &rig, &start, model, &options, maps, run)
            .map(|learned| (learned, counted(&run.progress.passes)))
    })?;
    Ok((Learned::of(py, &learned)?, passes))
}

/// A purpose; passes of all lanes, and of those at work; seconds of all threads.
type Counted = (&'static str, u64, u64, f64);

fn counted(passes: &Passes) -> Vec<Counted> {
    let count = |purpose: Purpose| {
        let PassCount { lanes, useful, seconds } = passes.of(purpose);
        (purpose.name(), lanes, useful, seconds)
    };
    Purpose::ALL.map(count).to_vec()
}

/// What the fit of a tile needs to know about the whole painting of `extent` rows and columns about
/// a `middle`, from a sample of it.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.lobes")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn learn_lobes<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    options: LobeArguments,
    extent: [usize; 2],
    middle: [f64; 2],
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Learned<'py>> {
    let refuse = |error| errors::to_python(py, &error);
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let rig = stack.rig_in(extent, middle).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let (model, options) = (options.model(), options.options().map_err(refuse)?);
    let learned = run::call(py, threads, progress.as_ref(), |run| {
        impasto::sbrdf::learn_lobes(&samples, &rig, &start, model, &options, run)
    })?;
    Learned::of(py, &learned)
}

/// Fills the maps of a tile: `origin` is the row and column of its first pixel in the stack, `size`
/// its rows and columns.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.lobes")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn apply_lobes<'py>(
    py: Python<'py>,
    learned: LearnedArguments<'py>,
    stack: StackArguments<'py>,
    start: StartArguments<'py>,
    origin: [usize; 2],
    size: [usize; 2],
    mut maps: LobeArrays<'py>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let refuse = |error| errors::to_python(py, &error);
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let rig = stack.rig_in(learned.extent, learned.middle).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let tile = rig.grid().tile([origin[1], origin[0]], size[1], size[0]).map_err(refuse)?;
    let (model, learned) = (learned.options.model(), learned.learned().map_err(refuse)?);
    let maps = maps.maps().map_err(refuse)?;
    run::call(py, threads, progress.as_ref(), |run| {
        impasto::sbrdf::apply_lobes(&learned, &samples, &rig, &start, model, tile, maps, run)
    })
}

/// Most steps of a pixel's searches in the presets.
const USUAL_STEPS: usize = 16;

impl LobeArguments {
    /// How many samples take as long with the presets' steps as so many with these.
    fn usual_samples(&self, samples: usize) -> usize {
        let colours = self.rounds.saturating_mul(self.colour_iterations);
        let steps = self.iterations.saturating_add(colours);
        samples.saturating_mul(steps.div_ceil(USUAL_STEPS))
    }

    fn model(&self) -> TorranceSparrow {
        TorranceSparrow { index: self.index }
    }

    fn options(&self) -> Result<LobeOptions> {
        let refuse = |argument, names, other: &str| {
            Error::argument(argument, format!("expected {names}, found {other:?}"))
        };
        let start = match self.start.as_str() {
            "multistart" => Origin::Multistart,
            "neighbours" => Origin::Neighbours,
            "neighbours-only" => Origin::NeighboursOnly,
            other => {
                let names = "\"multistart\", \"neighbours\" or \"neighbours-only\"";
                return Err(refuse("start", names, other));
            }
        };
        let precision = match self.precision.as_str() {
            "single" => Precision::Single,
            "polished" => Precision::Polished,
            "double" => Precision::Double,
            other => {
                return Err(refuse("precision", "\"single\", \"polished\" or \"double\"", other));
            }
        };
        Ok(LobeOptions {
            lobes: self.lobes,
            ambient: self.ambient,
            coated: self.coated.then(|| CoatedDiffuse::new(self.index)),
            normal: true,
            bounded: self.bounded,
            rounds: self.rounds,
            typical: self.typical,
            sparing: self.sparing,
            iterations: self.iterations,
            colour_iterations: self.colour_iterations,
            start,
            precision,
        })
    }
}

impl LobeArrays<'_> {
    fn maps(&mut self) -> Result<LobeMapsMut<'_>> {
        Ok(LobeMapsMut {
            normal: contiguous("normal", self.normal.as_slice_mut())?,
            diffuse: contiguous("diffuse", self.diffuse.as_slice_mut())?,
            ambient: contiguous("ambient", self.ambient.as_slice_mut())?,
            specular: contiguous("specular", self.specular.as_slice_mut())?,
            parameters: contiguous("parameters", self.parameters.as_slice_mut())?,
            deviation: contiguous("deviation", self.deviation.as_slice_mut())?,
            tinted: contiguous("tinted", self.tinted.as_slice_mut())?,
            lobes: contiguous("lobes", self.lobes.as_slice_mut())?,
            residual: contiguous("residual", self.residual.as_slice_mut())?,
            sigma: contiguous("sigma", self.sigma.as_slice_mut())?,
            converged: contiguous("converged", self.converged.as_slice_mut())?,
            status: contiguous("status", self.status.as_slice_mut())?,
        })
    }
}

impl LearnedArguments<'_> {
    fn learned(&self) -> Result<LearnedLobes> {
        let prior = self.prior.as_ref().map(PriorArguments::numbers).transpose()?;
        LearnedLobes::new(self.options.options()?, self.pixels, prior.as_ref())
    }
}

impl PriorArguments<'_> {
    fn numbers(&self) -> Result<PriorNumbers> {
        Ok(PriorNumbers {
            counts: contiguous("counts", self.counts.as_slice())?.to_vec(),
            shapes: contiguous("shapes", self.shapes.as_slice())?.to_vec(),
            variances: contiguous("variances", self.variances.as_slice())?.to_vec(),
        })
    }
}

impl<'py> Learned<'py> {
    fn of(py: Python<'py>, learned: &LearnedLobes) -> PyResult<Self> {
        let start = match learned.options.start {
            Origin::Multistart => "multistart",
            Origin::Neighbours => "neighbours",
            Origin::NeighboursOnly => "neighbours-only",
        };
        let prior = learned.prior().map(|prior| PriorArrays::of(py, prior)).transpose()?;
        Ok(Self { start, bounded: learned.options.bounded, pixels: learned.pixels, prior })
    }
}

impl<'py> PriorArrays<'py> {
    fn of(py: Python<'py>, prior: PriorNumbers) -> PyResult<Self> {
        let PriorNumbers { counts, shapes, variances } = prior;
        let [numbers, lobes, unknowns, pixels] = PriorNumbers::SHAPE;
        Ok(Self {
            counts: counts.into_pyarray(py),
            shapes: shapes.into_pyarray(py).reshape([numbers, lobes, unknowns, pixels])?,
            variances: variances.into_pyarray(py).reshape([numbers, lobes, pixels])?,
        })
    }
}
