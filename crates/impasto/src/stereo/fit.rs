//! The kernel: a register of pixels at a time, from stored samples to all maps.

use crate::maps::{Rejection, Status};
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real, Vec3};

use super::loss::{Loss, SIGMA_PER_MEAN, SIGMA_PER_MEDIAN};
use super::rule::{Selection, Verdict};
use super::solve::{Inverse, Symmetric};
use super::sort::Network;
use super::tile::{Tile, lanes, store, store_codes, store_counts};
use super::{ENOUGH, Problem, shade};

/// Pixels that are decoded at a time: 16 photographs of them fill the first-level cache.
const BLOCK: usize = 512;

/// Decoded samples `(obs, band, pixel of the block)` and coordinates in mm; one per worker.
pub(super) struct Scratch {
    samples: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
}

impl Scratch {
    pub(super) fn new(problem: &Problem<'_>) -> Self {
        let shape = problem.stack.shape();
        Self {
            samples: vec![0.0; shape.observations * shape.bands * BLOCK],
            x: vec![0.0; BLOCK],
            y: vec![0.0; BLOCK],
        }
    }
}

pub(super) struct Fit<'a, 'b, 'c> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) scratch: &'c mut Scratch,
    pub(super) tile: &'c mut Tile<'b>,
}

impl Kernel for Fit<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { problem, scratch, tile } = self;
        let shape = problem.stack.shape();
        let distant = problem.rig.is_distant();
        let mut pixels = Pixels::<I::F32>::new(problem);
        if distant {
            pixels.aim(problem, I::F32::zero(), I::F32::zero());
        }
        let mut start = 0;
        while start < tile.count {
            for (plane, out) in scratch.samples.chunks_exact_mut(BLOCK).enumerate() {
                let (observation, band) = (plane / shape.bands, plane % shape.bands);
                problem.stack.read(observation, band, tile.start + start, out);
            }
            problem.rig.grid().coordinates(tile.start + start, &mut scratch.x, &mut scratch.y);
            let end = BLOCK.min(tile.count - start);
            let mut at = 0;
            while at < end {
                if !distant {
                    let (x, y) = (I::F32::load(&scratch.x[at..]), I::F32::load(&scratch.y[at..]));
                    pixels.aim(problem, x, y);
                }
                pixels.gather(problem, &scratch.samples, at);
                pixels.fit(problem, &scratch.samples, at, tile, start + at);
                at += I::F32::WIDTH;
            }
            start += BLOCK;
        }
        for pixel in 0..tile.count {
            if !problem.stack.covers(tile.start + pixel) {
                blank(tile, pixel);
            }
        }
    }
}

/// What a pixel outside the mask shows.
fn blank(tile: &mut Tile<'_>, pixel: usize) {
    for plane in tile.normal.iter_mut().chain(&mut tile.albedo) {
        plane[pixel] = f32::NAN;
    }
    for plane in &mut tile.rejected {
        plane[pixel] = 0;
    }
    tile.used[pixel] = 0;
    tile.residual[pixel] = f32::NAN;
    tile.condition[pixel] = f32::NAN;
    tile.sigma[pixel] = f32::NAN;
    tile.status[pixel] = Status::Masked.code();
}

/// One register of pixels on its way through the fit.
struct Pixels<R> {
    bands: usize,
    selection: Selection<R>,
    network: Network,
    /// Direction to each light times its irradiance.
    lights: Vec<Vec3<R>>,
    per_irradiance: Vec<R>,
    /// The mean of the bands, relative to the light's irradiance; NaN where invalid.
    relative: Vec<R>,
    /// What normals are solved from; 0 where invalid.
    signal: Vec<R>,
    /// 1 where a rule kept the sample, else 0.
    kept: Vec<R>,
    /// The loss's weights of the kept samples.
    weights: Vec<R>,
    residuals: Vec<R>,
    sums: Vec<R>,
    valid: R,
    saturated: R,
}

impl<R: Real<Scalar = f32>> Pixels<R> {
    #[inline(always)]
    fn new(problem: &Problem<'_>) -> Self {
        let shape = problem.stack.shape();
        let (zero, count) = (R::zero(), shape.observations);
        Self {
            bands: shape.bands,
            selection: Selection::new(problem.rule, count),
            network: Network::new(if problem.loss.needs_median() { count } else { 0 }),
            lights: vec![Vec3::new(zero, zero, zero); count],
            per_irradiance: vec![zero; count],
            relative: vec![zero; count],
            signal: vec![zero; count],
            kept: vec![zero; count],
            weights: vec![zero; count],
            residuals: vec![zero; count],
            sums: vec![zero; shape.bands],
            valid: zero,
            saturated: zero,
        }
    }

    /// Directions and irradiances at the points `(x, y)`.
    #[inline(always)]
    fn aim(&mut self, problem: &Problem<'_>, x: R, y: R) {
        for (k, light) in problem.rig.lights().iter().enumerate() {
            let (towards, irradiance) = light.at(x, y);
            self.lights[k] = towards.scale(irradiance);
            self.per_irradiance[k] = irradiance.recip();
        }
    }

    /// Samples of all lights, and which of them are valid.
    #[inline(always)]
    fn gather(&mut self, problem: &Problem<'_>, samples: &[f32], at: usize) {
        let (zero, one, nan) = (R::zero(), R::one(), R::splat(f32::NAN));
        let largest = R::splat(f32::MAX);
        let share = R::of(1.0 / self.bands as f64);
        (self.valid, self.saturated) = (zero, zero);
        for k in 0..self.signal.len() {
            let first = k * self.bands;
            let mut mean = R::load(&samples[first * BLOCK + at..]);
            for band in first + 1..first + self.bands {
                mean = mean + R::load(&samples[band * BLOCK + at..]);
            }
            let mean = mean * share;
            let signal = match problem.options.selection {
                Some(band) => R::load(&samples[(first + band) * BLOCK + at..]),
                None => mean,
            };
            // One clipped band makes the mean infinite, one missing band makes it NaN.
            let valid = mean.is_finite();
            let weight = R::keep(valid, one);
            self.valid = self.valid + weight;
            self.saturated = self.saturated + R::keep(mean.gt(largest), one);
            self.signal[k] = R::keep(valid, signal);
            self.kept[k] = weight;
            self.relative[k] = R::select(valid, mean * self.per_irradiance[k], nan);
        }
    }

    #[inline(always)]
    fn fit(
        &mut self,
        problem: &Problem<'_>,
        samples: &[f32],
        at: usize,
        tile: &mut Tile<'_>,
        pixel: usize,
    ) {
        let zero = R::zero();
        let verdict = self.selection.apply(&self.relative, &mut self.kept, self.valid);
        let (inverse, mut b) = self.solve();
        self.weights.copy_from_slice(&self.kept);
        let mut relaxed = verdict.relaxed;
        if problem.loss != Loss::Squares {
            for _ in 0..problem.options.steps {
                relaxed = self.reweigh(problem.loss, &mut b, relaxed);
            }
        }
        let length = b.length();
        let normal = b.scale(length.recip());
        let (mut squares, mut total) = (zero, zero);
        for k in 0..self.signal.len() {
            let residual = self.signal[k] - shade(b, self.lights[k]);
            squares = (residual * self.kept[k]).mul_add(residual, squares);
            total = total + self.signal[k];
        }
        let freedom = verdict.kept - R::of(3.0);
        let noise = (squares / freedom).sqrt();
        let sigma = noise * inverse.worst_tangent_variance(normal).sqrt() / length
            * spread(problem.loss, freedom);
        let found = Found {
            residual: (squares / verdict.kept).sqrt(),
            condition: inverse.condition(),
            status: self.status(&verdict, &inverse, relaxed, total, length),
            normal,
            sigma,
        };
        self.albedo(samples, at, normal, length);
        self.write(&found, &verdict, tile, pixel);
    }

    /// Least squares over the kept samples.
    #[inline(always)]
    fn solve(&self) -> (Inverse<R>, Vec3<R>) {
        let zero = R::zero();
        let mut matrix = Symmetric::zero();
        let mut right = Vec3::new(zero, zero, zero);
        for k in 0..self.signal.len() {
            matrix.add(self.lights[k], self.kept[k]);
            right = self.lights[k].mul_add(self.signal[k] * self.kept[k], right);
        }
        let inverse = matrix.inverse();
        (inverse, inverse.times(right))
    }

    /// One step of reweighted least squares, as a correction of `b` from its residuals: what
    /// rounding left behind is found by the next step. Returns which pixels are relaxed: those
    /// whose loss would have dropped too many samples stay where they are.
    #[inline(always)]
    fn reweigh(&mut self, loss: Loss, b: &mut Vec3<R>, relaxed: R::Mask) -> R::Mask {
        let zero = R::zero();
        let (mut sum, mut count) = (zero, zero);
        for k in 0..self.signal.len() {
            let residual = self.signal[k] - shade(*b, self.lights[k]);
            self.residuals[k] = residual;
            sum = residual.abs().mul_add(self.kept[k], sum);
            count = count + self.kept[k];
        }
        let sigma = if loss.needs_median() {
            self.median(count) * R::of(SIGMA_PER_MEDIAN)
        } else {
            sum / count * R::of(SIGMA_PER_MEAN)
        };
        let scale = loss.scale(sigma, b.length());
        let mut matrix = Symmetric::zero();
        let mut right = Vec3::new(zero, zero, zero);
        let mut left = zero;
        for k in 0..self.signal.len() {
            let weight = loss.weight(self.residuals[k].abs(), scale) * self.kept[k];
            left = left + R::keep(weight.gt(zero), R::one());
            matrix.add(self.lights[k], weight);
            right = self.lights[k].mul_add(self.residuals[k] * weight, right);
        }
        let inverse = matrix.inverse();
        let step = inverse.times(right);
        let enough = left.ge(R::of(ENOUGH as f64)) | left.ge(count);
        let moves = enough & inverse.determined();
        for k in 0..self.signal.len() {
            let weight = loss.weight(self.residuals[k].abs(), scale) * self.kept[k];
            self.weights[k] = R::select(moves, weight, self.weights[k]);
        }
        let next = *b + step;
        *b = Vec3::new(
            R::select(moves, next.x, b.x),
            R::select(moves, next.y, b.y),
            R::select(moves, next.z, b.z),
        );
        relaxed | !enough
    }

    /// Median of the kept samples' absolute residuals.
    #[inline(always)]
    fn median(&mut self, count: R) -> R {
        let infinity = R::splat(f32::INFINITY);
        let sorted = &mut self.relative;
        for (k, sorted) in sorted.iter_mut().enumerate() {
            let kept = self.kept[k].gt(R::zero());
            *sorted = R::select(kept, self.residuals[k].abs(), infinity);
        }
        self.network.sort(sorted);
        let counts = lanes(count);
        let mut median = [0.0_f32; 16];
        for lane in 0..R::WIDTH {
            let n = counts[lane] as usize;
            let low = lanes(sorted[n.saturating_sub(1) / 2])[lane];
            let high = lanes(sorted[(n / 2).min(sorted.len() - 1)])[lane];
            median[lane] = 0.5 * (low + high);
        }
        R::load(&median)
    }

    /// Every band's albedo along the normal, into `sums`.
    #[inline(always)]
    fn albedo(&mut self, samples: &[f32], at: usize, normal: Vec3<R>, length: R) {
        let zero = R::zero();
        if self.bands == 1 {
            // The same number: the normal is the direction of the least-squares solution.
            self.sums[0] = length;
            return;
        }
        self.sums.fill(zero);
        let mut squares = zero;
        for k in 0..self.signal.len() {
            let cosine = shade(normal, self.lights[k]);
            let weighted = cosine * self.weights[k];
            squares = weighted.mul_add(cosine, squares);
            let used = self.weights[k].gt(zero);
            for (band, sum) in self.sums.iter_mut().enumerate() {
                let sample = R::load(&samples[(k * self.bands + band) * BLOCK + at..]);
                *sum = weighted.mul_add(R::keep(used, sample), *sum);
            }
        }
        let per_square = squares.recip();
        for sum in &mut self.sums {
            *sum = *sum * per_square;
        }
    }

    #[inline(always)]
    fn status(
        &self,
        verdict: &Verdict<R>,
        inverse: &Inverse<R>,
        relaxed: R::Mask,
        total: R,
        length: R,
    ) -> R {
        let zero = R::zero();
        let code = |status: Status| R::of(f64::from(status.code()));
        let three = R::of(3.0);
        let mut status = R::select(relaxed, code(Status::Relaxed), code(Status::Fitted));
        status = R::select(inverse.well(), status, code(Status::IllConditioned));
        status = R::select(verdict.kept.le(three), code(Status::Exact), status);
        // Squares of samples beyond 1e19 are infinite in single precision.
        status = R::select(length.is_finite(), status, code(Status::InvalidInput));
        status = R::select(inverse.determined(), status, code(Status::RankDeficient));
        let lit = total.gt(zero) & (length.gt(zero) | !inverse.determined());
        status = R::select(lit, status, code(Status::Dark));
        let few = R::select(
            (self.saturated + self.valid).ge(three) & self.saturated.gt(zero),
            code(Status::Saturated),
            code(Status::TooFewSamples),
        );
        let none = (self.saturated + self.valid).le(zero);
        let few = R::select(none, code(Status::InvalidInput), few);
        R::select(self.valid.ge(three), status, few)
    }

    #[inline(always)]
    fn write(&self, found: &Found<R>, verdict: &Verdict<R>, tile: &mut Tile<'_>, pixel: usize) {
        let nan = R::splat(f32::NAN);
        let code = |status: Status| R::of(f64::from(status.code()));
        let estimated = found.status.lt(code(Status::Dark));
        let dark = found.status.le(code(Status::Dark)) & found.status.ge(code(Status::Dark));
        let freedom = estimated & verdict.kept.gt(R::of(3.0));
        let normal = found.normal;
        for (plane, value) in tile.normal.iter_mut().zip([normal.x, normal.y, normal.z]) {
            store(R::select(estimated, value, nan), plane, pixel);
        }
        for (plane, &value) in tile.albedo.iter_mut().zip(&self.sums) {
            let value = R::select(estimated, value, nan);
            store(R::select(dark, R::zero(), value), plane, pixel);
        }
        store(R::select(freedom, found.residual, nan), tile.residual, pixel);
        store(R::select(estimated, found.condition, nan), tile.condition, pixel);
        store(R::select(freedom, found.sigma, nan), tile.sigma, pixel);
        store_codes(found.status, tile.status, pixel);
        store_counts(verdict.kept, tile.used, pixel);
        let invalid = R::of(self.signal.len() as f64) - self.valid - self.saturated;
        for (reason, count) in [
            (Rejection::Saturated, self.saturated),
            (Rejection::Invalid, invalid),
            (Rejection::Shadow, verdict.shadow),
            (Rejection::Highlight, verdict.highlight),
        ] {
            store_counts(count, tile.rejected[reason as usize], pixel);
        }
    }
}

struct Found<R> {
    normal: Vec3<R>,
    residual: R,
    condition: R,
    sigma: R,
    status: R,
}

/// Half-width of the interval that holds 68.3 % of Student's distribution with so many degrees of
/// freedom, where the standard deviation itself is estimated: within 0.3 % of the quantile. Times
/// what the loss loses against least squares.
#[inline(always)]
fn spread<R: Real>(loss: Loss, freedom: R) -> R {
    let student = R::of(0.521) / (freedom - R::of(0.377)) + R::one();
    student * R::of(loss.inefficiency())
}
