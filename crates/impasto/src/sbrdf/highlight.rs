//! One Torrance-Sparrow lobe per pixel through samples whose angle is known.
//!
//! `y = beta exp(-k phi^2)`, `k = ln 2 / gamma^2`: what is left of eq. 9 of the RGB-camera paper
//! once its diffuse part is taken off and `F G / (N.V)` is one. The amplitude follows the width in
//! every pass ([`Normal::project`]), so that the search is one of the width alone.
//!
//! Every pixel is searched at the scale of its own largest sample, to a power of two, and scaled
//! back at the end: no square of a sample leaves the range of single precision, and samples scaled
//! by a power of two give the same lobe to the last bit.

use core::f64::consts::LN_2;

use crate::brdf::torrance_sparrow::{GAMMA_MAX, GAMMA_MIN, sharpness};
use crate::error::{Error, Result};
use crate::lm::{Batch, Bounds, Column, Normal, Occupancy, Options, Outcome, Reason, Rows, fit};
use crate::maps::Status;
use crate::math::elementary::{exp, exp_in_range, power_of_two};
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Real, Scalar};
use crate::pixels::{Run, TILE, tiles};

/// Every search starts from this half-width, rad, and the pixel's brightest sample.
const START: f64 = 0.15;

/// `phi^2` of a sample that does not count: any lobe has vanished there.
const FAR: f32 = 1e10;

/// Beyond one, the width may be anything: its standard deviation relative to itself.
const OPEN: f32 = 1.0;

/// Pixels that are made ready together: a few lines of the cache from every plane, so that what
/// the lanes then pick from stays in the first-level cache whatever the planes' distance.
const STAGE: usize = 64;

/// Samples and their angles, both `(obs, pixel)`.
#[derive(Clone, Copy, Debug)]
pub struct Highlights<'a> {
    /// Specular light; what is not finite does not count.
    pub samples: &'a [f32],
    /// Angle between normal and half vector, rad; what is not finite does not count.
    pub phi: &'a [f32],
    /// How many pixels there are.
    pub pixels: usize,
}

/// What is written, pixel by pixel; NaN where the status says that it is not known.
#[derive(Debug)]
pub struct HighlightMaps<'a> {
    /// Strength.
    pub beta: &'a mut [f32],
    /// Half-width, rad.
    pub gamma: &'a mut [f32],
    /// `(3, pixel)`: variance of beta, covariance, variance of gamma.
    pub covariance: &'a mut [f32],
    /// Root mean square of the residuals.
    pub residual: &'a mut [f32],
    /// [`Status`] codes.
    pub status: &'a mut [u8],
}

/// Fits (beta, gamma) of every pixel; returns how busy the lanes were.
///
/// Statuses: `Fitted`; `Exact` from two samples (no residual, no covariance); `IllConditioned`
/// where gamma is at its bound, its standard deviation exceeds itself or the search has not
/// converged; `Dark` where no sample is
/// positive or no lobe helps to explain them (beta 0); `RankDeficient` where the samples determine
/// no width, or all lie so far from the facet's mirror that no number holds the strength or its
/// variance; `TooFewSamples`; `InvalidInput` where no sample is finite, or where the samples are so
/// large that single precision does not hold the variance of their strength (from some 1e19 on).
/// A variance below the smallest normal number (1.2e-38) is given as that number: an upper limit.
///
/// # Errors
/// If a size does not fit, or the run is cancelled.
pub fn fit_lobe(
    highlights: &Highlights<'_>,
    maps: &mut HighlightMaps<'_>,
    run: &Run<'_>,
) -> Result<Occupancy> {
    let Highlights { samples, phi, pixels } = *highlights;
    let observations = samples.len() / pixels.max(1);
    let sizes = [
        ("samples", samples.len(), observations * pixels),
        ("phi", phi.len(), samples.len()),
        ("beta", maps.beta.len(), pixels),
        ("gamma", maps.gamma.len(), pixels),
        ("covariance", maps.covariance.len(), 3 * pixels),
        ("residual", maps.residual.len(), pixels),
        ("status", maps.status.len(), pixels),
    ];
    if let Some((name, found, expected)) = sizes.iter().find(|(_, found, fits)| found != fits) {
        return Err(Error::argument(name, format!("{found} values, expected {expected}")));
    }
    let mut covariance = maps.covariance.chunks_mut(pixels.max(1)).map(|p| p.chunks_mut(TILE));
    let mut planes = [covariance.next(), covariance.next(), covariance.next()];
    let mut next = || planes.each_mut().map(|p| p.as_mut().and_then(Iterator::next));
    let jobs: Vec<_> = tiles(pixels)
        .into_iter()
        .zip(maps.beta.chunks_mut(TILE))
        .zip(maps.gamma.chunks_mut(TILE))
        .zip(maps.residual.chunks_mut(TILE))
        .zip(maps.status.chunks_mut(TILE))
        .map(|(((((start, _), beta), gamma), residual), status)| Job {
            start,
            beta,
            gamma,
            covariance: next().map(Option::unwrap_or_default),
            residual,
            status,
        })
        .collect();
    let tile = |job| Tile::new(highlights, observations, job, run.level);
    let busy = run.map(jobs, || (), |(), job| tile(job).fit())?;
    Ok(busy.iter().fold(Occupancy::default(), |sum, tile| Occupancy {
        lanes: sum.lanes + tile.lanes,
        useful: sum.useful + tile.useful,
    }))
}

/// A tile's part of the maps.
struct Job<'a> {
    start: usize,
    beta: &'a mut [f32],
    gamma: &'a mut [f32],
    covariance: [&'a mut [f32]; 3],
    residual: &'a mut [f32],
    status: &'a mut [u8],
}

struct Tile<'a> {
    highlights: &'a Highlights<'a>,
    observations: usize,
    job: Job<'a>,
    /// Samples that count, the largest of them, and the largest of their magnitudes.
    used: Vec<u32>,
    top: Vec<f32>,
    size: Vec<f32>,
    /// Samples, then squared angles, of the pixels from `staged` on; strengths to start from.
    stage: Vec<[f32; STAGE]>,
    strengths: [f32; STAGE],
    staged: usize,
    width: f32,
    level: Level,
}

impl<'a> Tile<'a> {
    fn new(
        highlights: &'a Highlights<'a>,
        observations: usize,
        job: Job<'a>,
        level: Level,
    ) -> Self {
        let count = job.status.len();
        Self {
            highlights,
            observations,
            job,
            used: vec![0; count],
            top: vec![0.0; count],
            size: vec![0.0; count],
            stage: vec![[0.0; STAGE]; 2 * observations],
            strengths: [0.0; STAGE],
            staged: usize::MAX,
            width: sharpness(START).ln() as f32,
            level,
        }
    }

    fn fit(mut self) -> Occupancy {
        let level = self.level;
        level.run(Survey(&mut self));
        let count = self.used.len();
        let mut usable = Vec::with_capacity(count);
        for pixel in 0..count {
            let verdict = match self.used[pixel] {
                0 => Status::InvalidInput,
                1 => Status::TooFewSamples,
                _ if self.top[pixel] <= 0.0 => Status::Dark,
                _ => {
                    usable.push(pixel);
                    continue;
                }
            };
            self.give_up(pixel, verdict);
        }
        let bounds = Bounds {
            lower: [0.0, sharpness(GAMMA_MAX).ln() as f32],
            upper: [f32::MAX, sharpness(GAMMA_MIN).ln() as f32],
        };
        let busy = fit(level, &mut self, usable, &bounds, &SEARCH);
        level.run(Finish(&mut self));
        busy
    }

    fn give_up(&mut self, pixel: usize, status: Status) {
        let job = &mut self.job;
        job.beta[pixel] = if status == Status::Dark { 0.0 } else { f32::NAN };
        job.gamma[pixel] = f32::NAN;
        job.residual[pixel] = f32::NAN;
        for plane in &mut job.covariance {
            plane[pixel] = f32::NAN;
        }
        job.status[pixel] = status.code();
    }
}

/// Starts are near enough for long first steps. A cost within 1e-5 is, after a last step that
/// converges quadratically, a hundredth of a standard deviation.
const SEARCH: Options = Options {
    max_iterations: 100,
    cost: 1e-5,
    step: 1e-5,
    gradient: 1e-5,
    damping: 1e-2,
    memory: 0.0,
};

impl Batch<f32, 2> for Tile<'_> {
    const COVARIANCE: bool = true;
    const TURNS: bool = true;

    fn rows(&self) -> usize {
        2 * self.observations
    }

    #[inline(always)]
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 2] {
        let (first, lane) = (problem / STAGE * STAGE, problem % STAGE);
        if self.staged != first {
            self.staged = first;
            // A call of its own, not a part of the search's loop.
            self.level.run(Prepare(self));
        }
        column.fill(self.stage.iter().map(|line| line[lane]));
        [self.strengths[lane], self.width]
    }

    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; 2]) -> Normal<R, 2> {
        self.visit(rows, at).1
    }

    #[inline(always)]
    fn visit<R: Real<Scalar = f32>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; 2],
    ) -> ([R; 2], Normal<R, 2>) {
        let (k, floor) = (-exp(at[1]), R::splat(R::Scalar::EXP_UNDERFLOW));
        let mut normal = Normal::zero();
        for i in 0..self.observations {
            // Beyond the floor a lobe is 1e-38, which adds nothing to any sum.
            let exponent = (k * rows.get(self.observations + i)).max(floor);
            let lobe = exp_in_range(exponent);
            let residual = (-at[0]).mul_add(lobe, rows.get(i));
            normal.add([lobe, exponent * lobe], residual);
        }
        normal.project(at, R::zero())
    }

    #[inline(always)]
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 2>) {
        let [beta, log_sharpness] = outcome.parameters;
        let [strength, width] = outcome.deficient();
        let verdict = match outcome.reason {
            // Samples are finite and near one: the strength is not, for the lobe has vanished.
            Reason::NotFinite => Some(Status::RankDeficient),
            _ if beta <= 0.0 || strength => Some(Status::Dark),
            _ if width => Some(Status::RankDeficient),
            _ => None,
        };
        if let Some(verdict) = verdict {
            return self.give_up(problem, verdict);
        }
        // As the search has it; `Finish` makes maps of it for many pixels together.
        let inverse = outcome.covariance(1.0);
        let job = &mut self.job;
        job.beta[problem] = beta;
        job.gamma[problem] = log_sharpness;
        job.covariance[0][problem] = inverse[0][0];
        job.covariance[1][problem] = inverse[1][0];
        job.covariance[2][problem] = inverse[1][1];
        job.residual[problem] = outcome.normal.cost;
        let sure = outcome.reason.converged();
        job.status[problem] = if sure { Status::Fitted } else { Status::IllConditioned }.code();
    }
}

/// Makes the pixels from `staged` on ready.
struct Prepare<'t, 'a>(&'t mut Tile<'a>);

impl Kernel for Prepare<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Tile {
            highlights, observations, job, used, top, size, stage, strengths, staged, ..
        } = self.0;
        let count = STAGE.min(used.len() - *staged);
        let mut scales = [0.0; STAGE];
        for (((scale, strength), &size), &top) in
            scales.iter_mut().zip(strengths).zip(&size[*staged..]).zip(&top[*staged..])
        {
            *scale = power_of_two(size).recip();
            *strength = top * *scale;
        }
        let (samples, angles) = stage.split_at_mut(*observations);
        for (i, (sample, angle)) in samples.iter_mut().zip(angles).enumerate() {
            let from = i * highlights.pixels + job.start + *staged;
            let ys = &highlights.samples[from..from + count];
            let phis = &highlights.phi[from..from + count];
            for ((((sample, angle), &y), &phi), &scale) in
                sample.iter_mut().zip(angle).zip(ys).zip(phis).zip(&scales)
            {
                let counts = y.is_finite() & phi.is_finite();
                *sample = if counts { y * scale } else { 0.0 };
                *angle = if counts { (phi * phi).min(FAR) } else { FAR };
            }
        }
    }
}

/// Counts the samples of every pixel and finds the largest, signed and in magnitude, plane by plane
/// as they lie in memory.
struct Survey<'t, 'a>(&'t mut Tile<'a>);

impl Kernel for Survey<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Tile { highlights, observations, job, used, top, size, .. } = self.0;
        for i in 0..*observations {
            let from = i * highlights.pixels + job.start;
            let samples = &highlights.samples[from..from + used.len()];
            let angles = &highlights.phi[from..from + used.len()];
            for ((((&y, &phi), used), top), size) in samples
                .iter()
                .zip(angles)
                .zip(used.iter_mut())
                .zip(top.iter_mut())
                .zip(size.iter_mut())
            {
                let counts = y.is_finite() & phi.is_finite();
                *used += u32::from(counts);
                *top = if counts && y > *top { y } else { *top };
                *size = if counts && y.abs() > *size { y.abs() } else { *size };
            }
        }
    }
}

/// Makes maps of what the search found.
struct Finish<'t, 'a>(&'t mut Tile<'a>);

impl Kernel for Finish<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Tile { job, used, size, .. } = self.0;
        let count = used.len();
        let Job { beta, gamma, covariance, residual, status, .. } = job;
        let (betas, sizes) = (&mut beta[..count], &size[..count]);
        let [of_beta, of_both, of_gamma] = covariance.each_mut().map(|plane| &mut plane[..count]);
        let (gammas, residuals, codes) =
            (&mut gamma[..count], &mut residual[..count], &mut status[..count]);
        let doubtful = Status::IllConditioned.code();
        let too_far = Status::RankDeficient.code();
        let too_large = Status::InvalidInput.code();
        for i in 0..count {
            let samples = used[i] as f32;
            // Pixels that were given up hold NaN and their status already.
            let known = codes[i] < Status::Dark.code();
            let exact = samples <= 2.0;
            let cost = residuals[i];
            let gamma = (LN_2 as f32).sqrt() * exp(gammas[i] * -0.5);
            let variance = if exact { f32::NAN } else { cost / (samples - 2.0) };
            // d gamma / d ln k = -gamma / 2.
            let slope = -0.5 * gamma;
            let spread = of_gamma[i] * variance * slope * slope;
            let at_bound = gamma >= 0.999 * GAMMA_MAX as f32 || gamma <= 1.001 * GAMMA_MIN as f32;
            let wide = spread > OPEN * OPEN * gamma * gamma;
            let open = at_bound || wide || codes[i] == doubtful;
            let fitted = if open { Status::IllConditioned } else { Status::Fitted }.code();
            let code = if exact { Status::Exact.code() } else { fitted };
            let own = [of_beta[i] * variance, of_both[i] * variance * slope, spread];
            // One factor at a time: the square of a scale may leave the range that the variance,
            // far smaller, stays in.
            let scale = power_of_two(sizes[i]);
            let square = own[0] * scale * scale;
            let square = if own[0] > 0.0 { square.max(f32::MIN_POSITIVE) } else { square };
            let whole = [square, own[1] * scale, spread];
            let beta = betas[i] * scale;
            let sure = |[b, both, g]: [f32; 3]| exact | (b + both.abs() + g).is_finite();
            let code = if sure(whole) & beta.is_normal() { code } else { too_large };
            let code = if sure(own) & betas[i].is_finite() { code } else { too_far };
            let given = known & (code < Status::Dark.code());
            let or_nan = |value: f32| if given { value } else { f32::NAN };
            gammas[i] = or_nan(gamma);
            of_beta[i] = or_nan(if exact { f32::NAN } else { square });
            of_both[i] = or_nan(whole[1]);
            of_gamma[i] = or_nan(spread);
            residuals[i] = or_nan(if exact { f32::NAN } else { (cost / samples).sqrt() * scale });
            betas[i] = if known { or_nan(beta) } else { betas[i] };
            codes[i] = if known { code } else { codes[i] };
        }
    }
}
