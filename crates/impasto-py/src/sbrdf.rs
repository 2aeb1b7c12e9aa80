//! Samples that a surface shows, what they leave of photographs, and the adjustment of a rig to
//! surfaces.

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray4,
    PyReadwriteArray4,
};
use pyo3::prelude::*;

use impasto::Error;
use impasto::residual_scores::ResidualScores;
use impasto::sbrdf::{Adjustment, LobeProfile};

use crate::arrays::{RigArguments, StackArguments};
use crate::surface::SurfaceArguments;
use crate::{errors, run};

/// Fills `out (obs, band, y, x)` with the samples that a surface shows.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
pub(crate) fn predict<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    rig: RigArguments<'py>,
    intensities: PyReadonlyArray1<'py, f64>,
    mut out: PyReadwriteArray4<'py, f32>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let [_, height, width] = surface.shape();
    let rig = rig.rig(height, width).map_err(refuse)?;
    let (intensities, shown) = (intensities.as_slice()?, out.as_slice_mut()?);
    let surface = surface.surface().map_err(refuse)?;
    run::call_on(py, shown.len(), threads, progress.as_ref(), |run| {
        impasto::surface::predict(&surface, &rig, intensities, shown, run)
    })
}

/// Adds the part of the photographs from `first` on, which a fit shows as `shown`, to the scores of
/// residuals `(component, band, y, x)`; see [`ResidualScores`].
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
#[allow(clippy::too_many_arguments, reason = "photographs, a fit and a basis")]
pub(crate) fn add_residual_scores<'py>(
    py: Python<'py>,
    stack: StackArguments<'py>,
    first: usize,
    shown: PyReadonlyArray4<'py, f32>,
    intensities: PyReadonlyArray1<'py, f64>,
    top: f64,
    curve: PyReadonlyArray1<'py, f32>,
    basis: PyReadonlyArray2<'py, f64>,
    mut scores: PyReadwriteArray4<'py, f32>,
    threads: usize,
) -> PyResult<()> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let decoding = stack.decoding().map_err(refuse)?;
    let some = ResidualScores {
        stack: &stack.stack(&decoding).map_err(refuse)?,
        first,
        shown: shown.as_slice()?,
        intensities: intensities.as_slice()?,
        top,
        curve: curve.as_slice()?,
        basis: basis.as_slice()?,
    };
    let scores = scores.as_slice_mut()?;
    run::call(py, threads, None, |run| some.add_to(scores, run))
}

/// A profile of lobes: angles between normal and half vector, radians, and a factor for each.
type ProfileArguments<'py> = (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>);

/// A matrix and the right side.
type Equations<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Normal equations of a rig without the unknowns of its pixels.
///
/// `sample_errors` and `slopes` are `(obs, band, y, x)`; each of the rigs in `moved` has one of the free
/// inverse distances larger by `step`.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, reason = "arguments arrive owned")]
#[allow(clippy::too_many_arguments, reason = "those of an adjustment")]
pub(crate) fn rig_equations<'py>(
    py: Python<'py>,
    surface: SurfaceArguments<'py>,
    profile: Option<ProfileArguments<'py>>,
    rig: RigArguments<'py>,
    intensities: PyReadonlyArray1<'py, f64>,
    moved: Vec<RigArguments<'py>>,
    step: f64,
    strengths: bool,
    sample_errors: PyReadonlyArray4<'py, f64>,
    slopes: PyReadonlyArray4<'py, f64>,
    held: PyReadonlyArray1<'py, bool>,
    threads: usize,
) -> PyResult<Equations<'py>> {
    let refuse = |error: Error| errors::to_python(py, &error);
    let [_, height, width] = surface.shape();
    let rig = rig.rig(height, width).map_err(refuse)?;
    let moved: Vec<_> = (moved.iter().map(|rig| rig.rig(height, width)))
        .collect::<impasto::Result<_>>()
        .map_err(refuse)?;
    let surface = surface.surface().map_err(refuse)?;
    let profile = match &profile {
        None => None,
        Some((knots, factors)) => {
            Some(LobeProfile { knots: knots.as_slice()?, factors: factors.as_slice()? })
        }
    };
    let adjustment = Adjustment {
        surface: &surface,
        profile,
        rig: &rig,
        intensities: intensities.as_slice()?,
        moved: &moved,
        step,
        strengths,
        errors: sample_errors.as_slice()?,
        slopes: slopes.as_slice()?,
        held: held.as_slice()?,
    };
    let samples = adjustment.errors.len();
    let found = run::call_on(py, samples, threads, None, |run| adjustment.equations(run))?;
    let numbers = found.right.len();
    let matrix = PyArray1::from_vec(py, found.matrix).reshape([numbers, numbers])?;
    Ok((matrix, PyArray1::from_vec(py, found.right)))
}
