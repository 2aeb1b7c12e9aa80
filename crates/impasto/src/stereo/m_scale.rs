//! M-scale of residuals [@rousseeuw1984s], the step from S-estimation to MM-estimation, for one register of pixels.

use crate::math::real::Part;
use crate::math::{Mask, Real, Vec3};

use super::lights::Lights;
use super::m_estimators::{LEAST_RESIDUAL, SIGMA_PER_MEDIAN};
use super::rows::{MAX_LANES, PlaneRows, lanes};
use super::sorting_network::SortingNetwork;
use super::sums::residual;

/// Tuning of the biweight's loss for which half of the samples may be outliers, and the scale is the
/// standard deviation of normal noise.
const TUNING: f64 = 1.547;

/// Mean loss that defines the scale.
const MEAN_LOSS: f64 = 0.5;

pub(super) struct ResidualScale<R> {
    network: SortingNetwork,
    sorted: Vec<R>,
}

/// One copy serves pixels with and without invalid samples.
struct Scale<'a, R: Real, L> {
    memory: &'a mut ResidualScale<R>,
    lights: &'a L,
    kept: &'a [R::Mask],
    signal: PlaneRows<'a>,
    valid: R,
    b: Vec3<R>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Part<R> for Scale<'_, R, L> {
    type Output = R;

    #[inline(always)]
    fn compute(self) -> R {
        let Self { memory, lights, kept, signal, valid, b } = self;
        let infinity = R::splat(f32::INFINITY);
        for (k, &kept) in kept.iter().enumerate() {
            let size = residual(signal.at(k), lights.at(k), b).abs();
            memory.sorted[k] = R::select(kept, size, infinity);
        }
        memory.network.sort(&mut memory.sorted);
        let middle = quantile(&memory.sorted, valid);
        let start = middle.mul_add(R::of(SIGMA_PER_MEDIAN), b.length() * R::of(LEAST_RESIDUAL));
        // One step of the fixed-point iteration of the scale whose mean loss is a half.
        let per_scale = (start * R::of(TUNING)).recip();
        let mut sum = R::zero();
        for &size in &memory.sorted {
            let u = size * per_scale;
            let inside = (-u).mul_add(u, R::one()).max(R::zero());
            let loss = (-(inside * inside)).mul_add(inside, R::one());
            sum = sum + R::keep(size.is_finite(), loss);
        }
        let freedom = valid - R::of(3.0);
        start * (sum / (freedom * R::of(MEAN_LOSS))).sqrt()
    }
}

/// The `(n + 4) / 2`-th smallest of `n`: least quantile of squares' quantile for three unknowns.
#[inline(always)]
fn quantile<R: Real<Scalar = f32>>(sorted: &[R], valid: R) -> R {
    let index = |count: usize| (count.midpoint(4) - 1).min(sorted.len() - 1);
    if valid.ge(R::of(sorted.len() as f64)).all() {
        return sorted[index(sorted.len())];
    }
    // Every lane has its own number of valid samples.
    let mut found = [0.0; MAX_LANES];
    for (lane, count) in lanes(valid).into_iter().enumerate().take(R::WIDTH) {
        found[lane] = lanes(sorted[index(count as usize)])[lane];
    }
    R::load(&found)
}

impl<R: Real<Scalar = f32>> ResidualScale<R> {
    pub(super) fn new(observations: usize) -> Self {
        Self { network: SortingNetwork::new(observations), sorted: vec![R::zero(); observations] }
    }

    /// Scale of the residuals that `b` leaves of the `valid` samples that are `kept`.
    #[inline(always)]
    pub(super) fn of<L: Lights<R>>(
        &mut self,
        lights: &L,
        kept: &[R::Mask],
        signal: PlaneRows<'_>,
        valid: R,
        b: Vec3<R>,
    ) -> R {
        R::apart(Scale { memory: self, lights, kept, signal, valid, b })
    }
}
