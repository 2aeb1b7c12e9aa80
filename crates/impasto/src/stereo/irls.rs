//! Iteratively reweighted least squares [@holland1977robust] for one register of pixels.

use core::marker::PhantomData;

use crate::math::real::Part;
use crate::math::{Mask, Real, Vec3};

use super::lights::Lights;
use super::m_estimators::WeightFunction;
use super::rows::{MAX_LANES, PlaneRows, lanes};
use super::solve::{ENOUGH, Symmetric};
use super::sorting_network::SortingNetwork;
use super::sums::residual;

pub(super) struct StereoIrls<R> {
    network: SortingNetwork,
    /// Weights of the last step, and of the one before.
    weights: Vec<R>,
    previous: Vec<R>,
    sorted: Vec<R>,
}

/// All steps for one register of pixels; one copy serves pixels with and without invalid samples.
struct Reweighting<'a, R: Real, L, W> {
    irls: &'a mut StereoIrls<R>,
    lights: &'a L,
    kept: &'a [R::Mask],
    signal: PlaneRows<'a>,
    steps: usize,
    b: Vec3<R>,
    loss: PhantomData<W>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>, W: WeightFunction> Part<R> for Reweighting<'_, R, L, W> {
    type Output = (Vec3<R>, R::Mask);

    #[inline(always)]
    fn compute(self) -> Self::Output {
        let Self { irls, lights, kept, signal, steps, b, .. } = self;
        irls.improve::<W, L>(lights, kept, signal, steps, b)
    }
}

impl<R: Real<Scalar = f32>> StereoIrls<R> {
    pub(super) fn new(observations: usize) -> Self {
        Self {
            network: SortingNetwork::new(observations),
            weights: vec![R::zero(); observations],
            previous: vec![R::zero(); observations],
            sorted: vec![R::zero(); observations],
        }
    }

    /// Weights that the last step solved with.
    pub(super) fn weights(&self) -> &Vec<R> {
        &self.weights
    }

    /// Improves `b` in place.
    ///
    /// Returns which pixels took all steps; the others stopped before a step that would have dropped too
    /// many samples, or left single precision no determinant.
    #[inline(always)]
    pub(super) fn run<W: WeightFunction, L: Lights<R>>(
        &mut self,
        lights: &L,
        kept: &[R::Mask],
        signal: PlaneRows<'_>,
        steps: usize,
        b: &mut Vec3<R>,
    ) -> R::Mask {
        let loss = PhantomData::<W>;
        let followed;
        (*b, followed) =
            R::apart(Reweighting { irls: self, lights, kept, signal, steps, b: *b, loss });
        followed
    }

    /// Each step solves for a correction of `b` from its residuals, so that what rounding leaves
    /// behind is found by the next step.
    #[inline(always)]
    fn improve<W: WeightFunction, L: Lights<R>>(
        &mut self,
        lights: &L,
        kept: &[R::Mask],
        signal: PlaneRows<'_>,
        steps: usize,
        mut b: Vec3<R>,
    ) -> (Vec3<R>, R::Mask) {
        let (zero, one) = (R::zero(), R::one());
        let (mut sum, mut count) = (zero, zero);
        for (k, &kept) in kept.iter().enumerate() {
            let size = residual(signal.at(k), lights.at(k), b).abs();
            sum = sum + R::keep(kept, size);
            self.weights[k] = R::keep(kept, one);
            count = count + self.weights[k];
        }
        let per_count = count.recip();
        let mut followed = zero.le(zero);
        for _ in 0..steps {
            let size = if W::MEDIAN {
                self.median(lights, kept, signal, b, count)
            } else {
                sum * per_count
            };
            let tuned = W::tune(size, b.length());
            let mut matrix = Symmetric::zero();
            let mut right = Vec3::new(zero, zero, zero);
            let mut left = zero;
            sum = zero;
            core::mem::swap(&mut self.weights, &mut self.previous);
            for (k, &kept) in kept.iter().enumerate() {
                let residual = residual(signal.at(k), lights.at(k), b);
                let weight = R::keep(kept, W::weight(residual, tuned));
                self.weights[k] = weight;
                let light = lights.at(k);
                let weighted = light.scale(weight);
                matrix.add(light, weighted);
                right = weighted.mul_add(residual, right);
                if W::DROPS {
                    left = left + R::keep(weight.gt(zero), one);
                }
                if !W::MEDIAN {
                    sum = sum + R::keep(kept, residual.abs());
                }
            }
            let step = matrix.inverse().times(right);
            if W::DROPS {
                followed = followed & (left.ge(R::of(ENOUGH as f64)) | left.ge(count));
            }
            followed = followed & matrix.solvable();
            if !followed.all() {
                for (weight, &previous) in self.weights.iter_mut().zip(&self.previous) {
                    *weight = R::select(followed, *weight, previous);
                }
            }
            b = Vec3::new(
                b.x + R::keep(followed, step.x),
                b.y + R::keep(followed, step.y),
                b.z + R::keep(followed, step.z),
            );
        }
        (b, followed)
    }

    /// Median of the kept samples' absolute residuals.
    #[inline(always)]
    fn median<L: Lights<R>>(
        &mut self,
        lights: &L,
        kept: &[R::Mask],
        signal: PlaneRows<'_>,
        b: Vec3<R>,
        count: R,
    ) -> R {
        let infinity = R::splat(f32::INFINITY);
        for (k, &kept) in kept.iter().enumerate() {
            let size = residual(signal.at(k), lights.at(k), b).abs();
            self.sorted[k] = R::select(kept, size, infinity);
        }
        self.network.sort(&mut self.sorted);
        let n = self.sorted.len();
        let last = n - 1;
        if count.ge(R::of(n as f64)).all() {
            return (self.sorted[(n - 1) / 2] + self.sorted[n / 2]) * R::of(0.5);
        }
        // Every lane has its own number of kept samples.
        let mut median = [0.0; MAX_LANES];
        for (lane, count) in lanes(count).into_iter().enumerate().take(R::WIDTH) {
            let n = count as usize;
            let low = lanes(self.sorted[n.saturating_sub(1) / 2])[lane];
            median[lane] = 0.5 * (low + lanes(self.sorted[(n / 2).min(last)])[lane]);
        }
        R::load(&median)
    }
}
