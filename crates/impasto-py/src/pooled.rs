//! The pooled fit: learn, apply, or both at once.

use numpy::{PyReadonlyArray1, PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use impasto::Error;
use impasto::sbrdf::pooled::{
    self, Extraction, LearnedLobe, PooledLobe, PooledMapsMut, PooledOptions,
};

use crate::arrays::{StackArguments, StartArguments};
use crate::{errors, run};

/// The maps of an `impasto.fit.pooled.PooledMaps`, to be filled.
#[derive(FromPyObject)]
pub(crate) struct PooledMapArrays<'py> {
    normal: PyReadwriteArray3<'py, f32>,
    diffuse: PyReadwriteArray3<'py, f32>,
    residual: PyReadwriteArray2<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    misfit: PyReadwriteArray2<'py, f32>,
    status: PyReadwriteArray2<'py, u8>,
}

impl PooledMapArrays<'_> {
    fn maps(&mut self) -> PyResult<PooledMapsMut<'_>> {
        Ok(PooledMapsMut {
            normal: self.normal.as_slice_mut()?,
            diffuse: self.diffuse.as_slice_mut()?,
            residual: self.residual.as_slice_mut()?,
            sigma: self.sigma.as_slice_mut()?,
            misfit: self.misfit.as_slice_mut()?,
            status: self.status.as_slice_mut()?,
        })
    }
}

/// What an `impasto.fit.pooled.LearnedLobe` holds for a tile.
#[derive(FromPyObject)]
pub(crate) struct LobeArguments<'py> {
    beta: f64,
    log_sharpness: f64,
    index: f64,
    refined: bool,
    coated: bool,
    brightness: f64,
    noise: PyReadonlyArray1<'py, f32>,
    noise_floor: f64,
}

/// The numbers of an `impasto.fit.pooled.LearnedLobe`.
#[derive(IntoPyObject)]
pub(crate) struct Learned {
    beta: f64,
    gamma: f64,
    log_sharpness: f64,
    index: f64,
    refined: bool,
    coated: bool,
    brightness: f64,
    noise: Vec<f32>,
    noise_floor: f64,
    covariance: [[f64; 2]; 2],
    verdict: &'static str,
    describes: f64,
    converged: bool,
    curve: Vec<[f64; 3]>,
    path: Vec<[f64; 2]>,
}

impl From<LearnedLobe> for Learned {
    fn from(learned: LearnedLobe) -> Self {
        let gamma = learned.lobe.gamma();
        let PooledLobe {
            beta,
            log_sharpness,
            index,
            refined,
            coated,
            brightness,
            noise,
            noise_floor,
        } = learned.lobe;
        Self {
            beta,
            gamma,
            log_sharpness,
            index,
            refined,
            coated,
            brightness,
            noise,
            noise_floor,
            covariance: learned.covariance,
            verdict: learned.verdict.name(),
            describes: learned.describes,
            converged: learned.converged,
            curve: learned.curve,
            path: learned.path,
        }
    }
}

/// One lobe for the whole painting, from the maps of photometric stereo; `maps` are filled if given.
#[pyfunction]
#[pyo3(signature = (
    stack, start, maps, extraction, peak, joint, coated, index, pixels, threads, progress
))]
#[allow(clippy::too_many_arguments, reason = "named by their one caller, impasto.fit.pooled")]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn learn_pooled(
    py: Python<'_>,
    stack: StackArguments<'_>,
    start: StartArguments<'_>,
    mut maps: Option<PooledMapArrays<'_>>,
    extraction: &str,
    peak: bool,
    joint: bool,
    coated: bool,
    index: f64,
    pixels: usize,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Learned> {
    let refuse = |error| errors::to_python(py, &error);
    let extraction = match extraction {
        "residual" => Extraction::Residual,
        "maximum" => Extraction::Maximum,
        "papers" => Extraction::Papers,
        "printed" => Extraction::Printed,
        _ => {
            let problem = format!("there is none called {extraction:?}");
            return Err(refuse(Error::argument("extraction", problem)));
        }
    };
    let options = PooledOptions { extraction, peak, joint, coated, index, pixels };
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let rig = stack.rig.rig(samples.shape().height, samples.shape().width).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let maps = maps.as_mut().map(PooledMapArrays::maps).transpose()?;
    let learned = run::call(py, threads, progress.as_ref(), |run| match maps {
        Some(mut maps) => pooled::fit(&samples, &rig, &start, &options, &mut maps, run),
        None => pooled::learn(&samples, &rig, &start, &options, run),
    })?;
    Ok(learned.into())
}

/// Fills the maps of a tile under a lobe that was learned.
#[pyfunction]
#[pyo3(signature = (learned, stack, start, maps, threads, progress))]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn apply_pooled(
    py: Python<'_>,
    learned: LobeArguments<'_>,
    stack: StackArguments<'_>,
    start: StartArguments<'_>,
    mut maps: PooledMapArrays<'_>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let refuse = |error| errors::to_python(py, &error);
    let lobe = PooledLobe {
        beta: learned.beta,
        log_sharpness: learned.log_sharpness,
        index: learned.index,
        refined: learned.refined,
        coated: learned.coated,
        brightness: learned.brightness,
        noise: learned.noise.as_slice()?.to_vec(),
        noise_floor: learned.noise_floor,
    };
    let decoding = stack.decoding().map_err(refuse)?;
    let samples = stack.stack(&decoding).map_err(refuse)?;
    let rig = stack.rig.rig(samples.shape().height, samples.shape().width).map_err(refuse)?;
    let start = start.start().map_err(refuse)?;
    let mut maps = maps.maps()?;
    run::call(py, threads, progress.as_ref(), |run| {
        pooled::apply(&lobe, &samples, &rig, &start, &mut maps, run)
    })
}
