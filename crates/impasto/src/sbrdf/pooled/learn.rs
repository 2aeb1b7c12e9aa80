//! One (beta, gamma) for the whole painting, and the normals and colours that go with it.

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm::{self, Outcome};
use crate::maps::Status;
use crate::pixels::{Run, TILE, tiles};
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::extract::Extraction;
use super::histogram::Histogram;
use super::irls::{LobeEquations, ScaleReference};
use super::joint::{FIRST_STEPS, Found, find_lobe};
use super::outliers::Counts;
use super::passes::Fit;
use super::pixel::Lobe;
use super::samples::{Photographs, State};
use super::scale::Gaussian;
use super::subset::Subset;
use super::verdict::{Agreement, DESCRIBES, Strengths, Verdict};

/// How the pooled fit goes about it.
#[derive(Clone, Copy, Debug)]
pub struct PooledOptions {
    /// Which samples carry the first estimate.
    pub extraction: Extraction,
    /// Whether normals, colours and the lobe settle together; else the papers' separate fit.
    pub joint: bool,
    /// Index of refraction.
    pub index: f64,
    /// Pixels that the joint search looks at, at most, about.
    pub pixels: usize,
}

/// The painting's lobe and the maps that go with it.
#[derive(Clone, Debug)]
pub struct Pooled {
    /// Strength.
    pub beta: f64,
    /// Half-width of the facets, rad.
    pub gamma: f64,
    /// Covariance of (log beta, log gamma); infinite where there is no highlight.
    pub covariance: [[f64; 2]; 2],
    /// Why it is what it is.
    pub verdict: Verdict,
    /// Share of the pixels which know their own strength that agree with the painting's; NaN if
    /// there are none.
    pub describes: f64,
    /// What remains of the samples beside the final diffuse part, against phi.
    pub histogram: Histogram,
    /// Whether the search ended by its own tests, not by its number of steps.
    pub converged: bool,
    /// (beta, gamma) as they got better, the separate fit first.
    pub path: Vec<[f64; 2]>,
    /// `(3, y, x)`.
    pub normal: Vec<f32>,
    /// `(band, y, x)`.
    pub diffuse: Vec<f32>,
    /// `(y, x)` root mean square of the weighted residuals, linear light.
    pub residual: Vec<f32>,
    /// `(y, x)` standard deviation of the normal along its worst axis, rad.
    pub sigma: Vec<f32>,
    /// `(y, x)` by how much of the painting's strength the pixel's own differs, beyond its error.
    pub misfit: Vec<f32>,
    /// `(y, x)` [`Status`] codes: [`Status::Pooled`] where the lobe does not improve on the
    /// diffuse part alone, so that normal and colours are those of the start.
    pub status: Vec<u8>,
}

/// Fits the painting's (beta, gamma), with the normals and diffuse colours that go with it.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit_pooled(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    options: &PooledOptions,
    run: &Run<'_>,
) -> Result<Pooled> {
    let shape = stack.shape();
    if rig.observations() != shape.observations {
        let problem =
            format!("{} lights for {} photographs", rig.observations(), shape.observations);
        return Err(Error::geometry("lights", problem));
    }
    start.check(shape.pixels(), shape.bands)?;
    let reference = bright(start, run)?;
    let unit = unit_of(reference);
    if unit == 1.0 {
        return fit_near_one(stack, rig, start, reference, options, run);
    }
    let decode: Vec<_> = stack.decode().iter().map(|decode| decode.times(unit.recip())).collect();
    let mut diffuse = run.copied(start.diffuse)?;
    rescale(&mut diffuse, unit.recip(), run)?;
    let start = Start { diffuse: &diffuse, ..*start };
    let reference = reference / f64::from(unit);
    let stack = stack.decoded(&decode)?;
    let mut fitted = fit_near_one(&stack, rig, &start, reference, options, run)?;
    for map in [&mut fitted.diffuse, &mut fitted.residual] {
        rescale(map, unit, run)?;
    }
    let unit = f64::from(unit);
    fitted.beta *= unit;
    for [beta, _] in &mut fitted.path {
        *beta *= unit;
    }
    fitted.histogram.scale(unit);
    Ok(fitted)
}

/// Exponents of two that a painting's bright colours may have without another unit.
const NEAR_ONE: core::ops::RangeInclusive<i32> = -16..=16;

/// The unit that samples are counted in: 1 unless squares and fourth powers of bright colours come
/// near the ends of single precision; then the power of two below them, which changes no digit.
fn unit_of(bright: f64) -> f32 {
    let exponent = bright.log2().floor() as i32;
    if NEAR_ONE.contains(&exponent) { 1.0 } else { 2.0_f32.powi(exponent.clamp(-100, 100)) }
}

fn rescale(map: &mut [f32], factor: f32, run: &Run<'_>) -> Result<()> {
    run.in_turn(map.chunks_mut(TILE), |part| {
        for value in part {
            *value *= factor;
        }
    })
}

fn fit_near_one(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    reference: f64,
    options: &PooledOptions,
    run: &Run<'_>,
) -> Result<Pooled> {
    let shape = stack.shape();
    let photographs = Photographs {
        stack,
        rig,
        index: options.index,
        bands: shape.bands,
        status: start.status,
        places: None,
    };
    let fit = Fit {
        photographs: &photographs,
        run,
        scale_reference: ScaleReference { reference, noise_floor: 0.0 },
    };
    let state = State::new(start, run)?;
    let samples = fit.extract(&state, options.extraction)?;
    let first = samples.fit();
    let lobe = Lobe { beta: first.parameters[0], log_sharpness: first.parameters[1] };
    if !options.joint {
        return fit.judge_separate(state, &first, &samples);
    }
    let subset = Subset::gather(&photographs, start, options.pixels, run)?;
    if subset.len() == 0 {
        return fit.judge_separate(state, &first, &samples);
    }
    let found = {
        let stack = subset.stack()?;
        let photographs = subset.photographs(&photographs, &stack);
        let state = State::new(&subset.start(), run)?;
        find_lobe(Fit { photographs: &photographs, ..fit }, state, lobe)?
    };
    drop(subset);
    Fit { scale_reference: found.scale_reference, ..fit }.judge_joint(state, found, start)
}

/// A bright colour, whatever a tenth of the pixels show: a lamp in the frame is no colour. Scaling
/// the samples by a power of two scales it exactly.
fn bright(start: &Start<'_>, run: &Run<'_>) -> Result<f64> {
    let mut colours = Counts::new();
    run.in_turn(start.diffuse.chunks(TILE), |part| {
        for &colour in part {
            colours.add(colour);
        }
    })?;
    Ok(colours.high().map_or(1.0, f64::from))
}

/// The lobe as the search left it, before anything is said about it.
struct Estimate {
    lobe: Lobe,
    /// Of (log beta, log gamma); none where the samples do not determine it.
    covariance: Option<[[f64; 2]; 2]>,
    /// Whether the width is left open.
    open: bool,
    path: Vec<[f64; 2]>,
    converged: bool,
}

impl Fit<'_> {
    /// Judges the lobe that was fitted to `samples`.
    fn judge_separate(
        &self,
        state: State,
        first: &Outcome<f64, 2>,
        samples: &Histogram,
    ) -> Result<Pooled> {
        let lobe = Lobe { beta: first.parameters[0], log_sharpness: first.parameters[1] };
        let histogram = self.extract(&state, Extraction::Residual)?;
        let variance = first.normal.cost.max(0.0) / (histogram.count() - 2.0).max(1.0);
        let shown = samples.shows(lobe.log_sharpness);
        let covariance = (lobe.beta > 0.0 && shown && !first.deficient()[0])
            .then(|| relative(lobe, first.covariance(variance)));
        let path = vec![[lobe.beta, lobe.gamma()]];
        let estimate = Estimate {
            lobe,
            covariance,
            open: first.deficient()[1],
            path,
            converged: first.reason.converged(),
        };
        let status = self.run.copied(self.photographs.status)?;
        self.report(state, estimate, status, Some(histogram))
    }

    /// Pixels whose samples the lobe does not help to explain go back to where they started.
    fn judge_joint(&self, state: State, found: Found, start: &Start<'_>) -> Result<Pooled> {
        let Found { lobe, share, path, converged, .. } = found;
        let mut status = self.run.copied(start.status)?;
        let gaussian = Gaussian::of(self.photographs.bands);
        let factor = lm::factor(&share.information(), 0.0, &[false; 2]);
        let covariance = (lobe.beta > 0.0 && !factor.deficient[0])
            .then(|| relative(lobe, sandwich(&factor, &share.scatter, gaussian.curvature)));
        let mut estimate =
            Estimate { lobe, covariance, open: factor.deficient[1], path, converged };
        if !estimate.seen() {
            return self.report(state, estimate, status, None);
        }
        let mut settled = state.copied(self.run)?;
        let flat = Lobe { beta: 0.0, ..lobe };
        let without = self.settle(&state, &mut settled, flat, FIRST_STEPS, false)?;
        let plain = self.run.copied(&settled.scale)?;
        let with = self.settle(&state, &mut settled, lobe, FIRST_STEPS, true)?;
        let cost = |share: &LobeEquations| share.normal(self.scale_reference.reference).cost;
        if cost(&with) >= cost(&without) {
            estimate.covariance = None;
            return self.report(state, estimate, status, None);
        }
        drop(state);
        let mut state = settled;
        let pixels = status.len();
        self.run.in_turn(tiles(pixels), |(first, count)| {
            for pixel in first..first + count {
                // A thousandth is what a search that stopped early may have left.
                let helps = state.scale[pixel] <= plain[pixel] * 1.001;
                if status[pixel] >= Status::Dark.code() || helps {
                    continue;
                }
                for plane in 0..3 {
                    state.normal[plane * pixels + pixel] = start.normal[plane * pixels + pixel];
                }
                for plane in 0..self.photographs.bands {
                    state.diffuse[plane * pixels + pixel] = start.diffuse[plane * pixels + pixel];
                }
                if status[pixel] == Status::Fitted.code() {
                    status[pixel] = Status::Pooled.code();
                }
            }
        })?;
        self.report(state, estimate, status, None)
    }

    fn report(
        &self,
        mut state: State,
        estimate: Estimate,
        mut status: Vec<u8>,
        histogram: Option<Histogram>,
    ) -> Result<Pooled> {
        let seen = estimate.seen();
        let beta = if seen { estimate.lobe.beta } else { 0.0 };
        let lobe = Lobe { beta, ..estimate.lobe };
        let [mut residual, mut sigma, mut noise, apart, doubt] = self.measure(&state, lobe)?;
        self.give_up(&mut state, [&mut residual, &mut sigma, &mut noise], &mut status)?;
        let brightness = self.brightness(&state)?;
        let strengths = Strengths { brightness, noise, apart, doubt };
        let Agreement { misfit, describes } = strengths.agreement(beta as f32, self.run)?;
        let histogram = match histogram {
            Some(histogram) => histogram,
            None => self.extract(&state, Extraction::Residual)?,
        };
        let k = lobe.log_sharpness;
        let (lowest, highest) = (Lobe::bounds().lower[1], Lobe::bounds().upper[1]);
        let at_bound = estimate.open || k <= lowest || k >= highest;
        let verdict = match (seen, at_bound) {
            (false, _) => Verdict::NoHighlight,
            (true, true) => Verdict::AtBound,
            (true, false) if describes < DESCRIBES => Verdict::Mixed,
            (true, false) => Verdict::Fitted,
        };
        let unknown = [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]];
        Ok(Pooled {
            beta,
            gamma: lobe.gamma(),
            covariance: estimate.covariance.filter(|_| seen).unwrap_or(unknown),
            verdict,
            describes,
            histogram,
            converged: estimate.converged,
            path: estimate.path,
            normal: state.normal,
            diffuse: state.diffuse,
            residual,
            sigma,
            misfit,
            status,
        })
    }

    /// Leaves out pixels of which too few samples have squares that are numbers, so that nothing
    /// tells how well they fit.
    fn give_up(
        &self,
        state: &mut State,
        [residual, sigma, noise]: [&mut [f32]; 3],
        status: &mut [u8],
    ) -> Result<()> {
        let pixels = status.len();
        let judged = |code: u8| code < Status::Dark.code() && code != Status::Exact.code();
        self.run.in_turn(tiles(pixels), |(first, count)| {
            for pixel in first..first + count {
                if residual[pixel].is_finite() || !judged(status[pixel]) {
                    continue;
                }
                status[pixel] = Status::InvalidInput.code();
                let maps = [&mut state.normal[..], &mut state.diffuse, residual, sigma, noise];
                for plane in maps.into_iter().flat_map(|map| map.chunks_mut(pixels)) {
                    plane[pixel] = f32::NAN;
                }
            }
        })
    }
}

impl Estimate {
    /// Three standard deviations tell a highlight from noise.
    fn seen(&self) -> bool {
        self.covariance.is_some_and(|covariance| covariance[0][0].sqrt() < 1.0 / 3.0)
    }
}

/// From (beta, log k) to (log beta, log gamma): d log gamma = -1/2 d log k.
fn relative(lobe: Lobe, covariance: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let scale = [1.0 / lobe.beta, -0.5];
    core::array::from_fn(|i| core::array::from_fn(|j| covariance[i][j] * scale[i] * scale[j]))
}

/// Covariance of parameters that minimise a sum over pixels, from the scatter of the pixels' own
/// descents: noise that differs from pixel to pixel, and pixels that the model does not describe,
/// count for what they are.
fn sandwich(factor: &lm::Factor<f64, 2>, scatter: &[[f64; 2]; 2], curvature: f64) -> [[f64; 2]; 2] {
    let half: [[f64; 2]; 2] = core::array::from_fn(|j| {
        factor.solve(&core::array::from_fn(|i| scatter[i.max(j)][i.min(j)]))
    });
    let full: [[f64; 2]; 2] = core::array::from_fn(|i| factor.solve(&[half[0][i], half[1][i]]));
    let shrink = 1.0 / (curvature * curvature);
    full.map(|row| row.map(|v| v * shrink))
}
