//! The weights of iteratively reweighted least squares [@holland1977robust]: of every sample, by what
//! the model shows there.

use crate::math::Real;

use super::bounds::weight_at;
use super::tile::{STRIDE, TileSamples};

/// Fraction of a pixel's mean sample below which the noise no longer falls with the light.
const FLOOR: f64 = 0.1;

/// What the model shows of some pixels, plane by plane.
pub(super) struct Shown<R> {
    all: Vec<R>,
    /// Its diffuse part.
    diffuse: Vec<R>,
    /// What [`Self::left`] found: residuals in units of the noise, 0 of bounds that are satisfied.
    far: Vec<R>,
    /// Sum of the samples that count, and their number.
    light: R,
    used: R,
}

/// Sums over the samples that count.
#[derive(Clone, Copy)]
pub(super) struct Left<R> {
    /// Of squared residuals, and of weighted ones.
    plain: R,
    weighted: R,
    /// Of absolute residuals, in units of the noise.
    absolute: R,
}

impl<R: Real<Scalar = f32>> Shown<R> {
    pub(super) fn new(planes: usize) -> Self {
        let zero = R::zero();
        let [all, diffuse, far] = [(); 3].map(|()| vec![zero; planes]);
        Self { all, diffuse, far, light: zero, used: zero }
    }

    /// Forgets which samples count.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        (self.light, self.used) = (R::zero(), R::zero());
    }

    /// Counts a sample, if it has a weight.
    #[inline(always)]
    pub(super) fn count(&mut self, sample: R, weight: R) {
        let counts = weight.gt(R::zero());
        self.light = self.light + R::keep(counts, sample);
        self.used = self.used + R::keep(counts, R::one());
    }

    /// Sets what is shown in a plane, and its diffuse part.
    #[inline(always)]
    pub(super) fn set(&mut self, plane: usize, [shown, diffuse]: [R; 2]) {
        self.all[plane] = shown;
        self.diffuse[plane] = diffuse;
    }

    /// How many samples count, at least 1.
    #[inline(always)]
    pub(super) fn used(&self) -> R {
        self.used.max(R::one())
    }

    /// One over the mean sample: variances are in its unit.
    #[inline(always)]
    fn unit(&self) -> R {
        let mean = self.light / self.used();
        R::keep(mean.gt(R::zero()), mean.recip())
    }

    /// What is left under the present weights.
    #[inline(always)]
    pub(super) fn left(&mut self, samples: &TileSamples, at: usize) -> Left<R> {
        let (zero, unit) = (R::zero(), self.unit());
        let mut left = Left { plain: zero, weighted: zero, absolute: zero };
        for plane in 0..self.all.len() {
            let shown = self.all[plane];
            let (sample, weight) = samples.at::<R>(plane, at);
            let far = (sample - shown) / noise(shown * unit).sqrt();
            self.far[plane] = R::select(weight.lt(zero), far.max(zero), far);
            let weight = weight_at(weight, sample, shown);
            let counts = weight.gt(zero);
            let residual = R::keep(counts, sample - shown);
            left.plain = residual.mul_add(residual, left.plain);
            left.weighted = (weight * residual).mul_add(residual, left.weighted);
            left.absolute = left.absolute + R::keep(counts, far.abs());
        }
        left
    }

    /// Root mean square of the residuals.
    #[inline(always)]
    pub(super) fn deviation(&self, left: &Left<R>) -> R {
        (left.plain / self.used()).sqrt()
    }

    /// Weighted mean square of the residuals.
    #[inline(always)]
    pub(super) fn variance(&self, left: &Left<R>) -> R {
        left.weighted / self.used()
    }

    /// Renews the weights of the pixels in the mask by what is `left`, the last that
    /// [`left`](Self::left) found, of these pixels; returns the weighted mean
    /// square of the residuals.
    #[inline(always)]
    pub(super) fn renew(
        &self,
        left: &Left<R>,
        chosen: R::Mask,
        samples: &mut TileSamples,
        at: usize,
    ) -> R {
        let (zero, unit) = (R::zero(), self.unit());
        let scale = left.absolute / self.used();
        let bend = R::keep(scale.gt(zero), scale.recip());
        let mut squares = zero;
        for plane in 0..self.all.len() {
            let (shown, diffuse) = (self.all[plane], self.diffuse[plane]);
            let (sample, weight) = samples.at::<R>(plane, at);
            let bound = weight.lt(zero);
            let known = bound | weight.gt(zero);
            // A bound that is satisfied has no residual.
            let sample = R::select(bound, sample.max(shown), sample);
            let far = self.far[plane] * bend;
            let fresh = sample_weight(sample, diffuse, noise(shown * unit), far);
            let fresh = R::keep(known, fresh);
            let signed = R::select(bound, -fresh, fresh);
            R::select(chosen, signed, weight).store(&mut samples.weights[plane * STRIDE + at..]);
            let residual = sample - shown;
            squares = (fresh * residual).mul_add(residual, squares);
        }
        squares / self.used()
    }

    /// Bounds become samples that weigh what they do, or nothing.
    #[inline(always)]
    pub(super) fn fix_bounds(&self, samples: &mut TileSamples, at: usize) {
        for plane in 0..self.all.len() {
            let (sample, weight) = samples.at::<R>(plane, at);
            let weight = weight_at(weight, sample, self.all[plane]);
            weight.store(&mut samples.weights[plane * STRIDE + at..]);
        }
    }
}

/// Variance of a sample, both in units of the pixel's mean sample.
#[inline(always)]
fn noise<R: Real>(shown: R) -> R {
    shown.max(R::of(FLOOR))
}

/// Weight of a sample, from the predicted diffuse part: one over its variance, and less for residuals
/// `far` beyond the mean absolute one, in its units.
#[inline(always)]
fn sample_weight<R: Real>(sample: R, diffuse: R, variance: R, far: R) -> R {
    // Large residuals enter the cost by their size, not by its square.
    let tail = far.mul_add(far, R::one());
    let weight = (tail.sqrt() * variance).recip();
    // A sample darker than the diffuse part alone is in shadow (hard case 24): the larger of
    // sample / diffuse and 1 / tail, by one division.
    let by_light = (sample * tail).gt(diffuse);
    let lit = R::select(by_light, sample, R::one()) / R::select(by_light, diffuse, tail);
    R::select(diffuse.gt(sample), weight * lit * lit, weight)
}
