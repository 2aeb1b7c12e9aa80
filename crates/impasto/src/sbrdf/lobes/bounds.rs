//! Linear least squares where some samples are lower bounds: the clipped ones.
//!
//! A bound counts as a sample where the model shows less, and not at all where it shows more: its
//! residual is `max(0, bound - shown)`. The cost is a convex, piecewise quadratic function of the
//! colours. Its least is found by an active set [@hintermueller2002activeset]: bounds that a solution
//! satisfies leave the sums, bounds that it violates enter them, until none changes.
//!
//! The weight of a bound is negative, and counts by its size.

use crate::lm::nnls::{Solution, Sums};
use crate::math::{Mask, Real};

use super::tile::TileSamples;

/// Solutions at most: where rounding lets two sets of bounds follow each other for ever, this ends
/// it.
const SOLUTIONS: usize = 8;

/// The samples of one band of some pixels. A trait and not a closure: the compiler turns a closure
/// with several calls into a function, without the kernel's instruction set.
pub(super) trait BandSamples<R, const K: usize> {
    /// How many photographs there are.
    fn photographs(&self) -> usize;

    /// Columns, weight and sample of a photograph; it must be `#[inline(always)]`.
    fn at(&self, photograph: usize) -> ([R; K], R, R);
}

/// The samples of a band beside the columns of their photographs.
pub(super) struct BandColumns<'a, R, const K: usize> {
    pub(super) samples: &'a TileSamples,
    pub(super) columns: &'a [[R; K]],
    pub(super) band: usize,
    pub(super) at: usize,
}

impl<R: Real<Scalar = f32>, const K: usize> BandSamples<R, K> for BandColumns<'_, R, K> {
    #[inline(always)]
    fn photographs(&self) -> usize {
        self.columns.len()
    }

    #[inline(always)]
    fn at(&self, photograph: usize) -> ([R; K], R, R) {
        let plane = photograph * self.samples.bands + self.band;
        let (sample, weight) = self.samples.at(plane, self.at);
        (self.columns[photograph], weight, sample)
    }
}

/// The predicted sample: the columns times their colours.
#[inline(always)]
pub(super) fn light_of<R: Real, const K: usize>(columns: &[R; K], colours: &[R; K]) -> R {
    let mut light = R::zero();
    // An iterator over two arrays becomes a call, without a kernel's instruction set.
    for i in 0..K {
        light = colours[i].mul_add(columns[i], light);
    }
    light
}

/// Share of a bound by which more light satisfies it. The rounding of light in single precision is a
/// tenth of it: a bound that a solution reaches because it counts would else leave the sums.
const ABOVE: f64 = 1e-5;

/// What a sample weighs where the model shows this much: nothing if it is a bound that is satisfied.
#[inline(always)]
pub(super) fn weight_at<R: Real>(weight: R, sample: R, shown: R) -> R {
    R::keep(!satisfied(weight, sample, shown), weight.abs())
}

#[inline(always)]
fn satisfied<R: Real>(weight: R, sample: R, shown: R) -> R::Mask {
    weight.lt(R::zero()) & shown.gt(R::of(1.0 + ABOVE) * sample)
}

/// The colours of one band, no strength negative, and the sums over the samples that count beside
/// them. The columns in `barred` stay 0; `bounded` is scratch memory.
#[inline(always)]
pub(super) fn solve<R: Real, const K: usize>(
    samples: &impl BandSamples<R, K>,
    barred: &[bool; K],
    bounded: &mut Vec<usize>,
) -> (Solution<R, K>, Sums<R, K>) {
    let zero = R::zero();
    bounded.clear();
    // Bounds are few: only they are looked at again.
    let mut certain = Sums::zero();
    for photograph in 0..samples.photographs() {
        let (columns, weight, sample) = samples.at(photograph);
        if weight.lt(zero).any() {
            bounded.push(photograph);
        }
        certain.add(&columns, weight.max(zero), sample);
    }
    let mut sums = certain;
    for &photograph in bounded.iter() {
        let (columns, weight, sample) = samples.at(photograph);
        sums.add(&columns, (-weight).max(zero), sample);
    }
    let mut solution = sums.solve(barred);
    if bounded.is_empty() {
        return (solution, sums);
    }
    // With this much light every bound is violated, as the first sums have it.
    let mut before = [R::of(f64::NEG_INFINITY); K];
    for _ in 1..SOLUTIONS {
        let mut next = certain;
        let mut changed = R::Mask::splat(false);
        for &photograph in bounded.iter() {
            let (columns, weight, sample) = samples.at(photograph);
            let was = satisfied(weight, sample, light_of(&columns, &before));
            let is = satisfied(weight, sample, light_of(&columns, &solution.values));
            changed = changed | (was & !is) | (is & !was);
            next.add(&columns, R::keep(!is, (-weight).max(zero)), sample);
        }
        if !changed.any() {
            break;
        }
        before = solution.values;
        sums = next;
        solution = sums.solve(barred);
    }
    (solution, sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Scene(Vec<([f64; 3], f64, f64)>);

    impl BandSamples<f64, 3> for Scene {
        fn photographs(&self) -> usize {
            self.0.len()
        }

        fn at(&self, photograph: usize) -> ([f64; 3], f64, f64) {
            self.0[photograph]
        }
    }

    impl Scene {
        fn cost(&self, colours: &[f64; 3]) -> f64 {
            let mut cost = 0.0;
            for (columns, weight, sample) in &self.0 {
                let residual = sample - light_of(columns, colours);
                let counts = *weight > 0.0 || residual > 0.0;
                cost += if counts { weight.abs() * residual * residual } else { 0.0 };
            }
            cost
        }

        /// The least cost of the best colours of every set of bounds.
        fn exhaustive(&self) -> f64 {
            let bounds: Vec<usize> = (0..self.0.len()).filter(|&i| self.0[i].1 < 0.0).collect();
            let mut least = f64::INFINITY;
            for set in 0..1 << bounds.len() {
                let mut sums = Sums::<f64, 3>::zero();
                for (i, (columns, weight, sample)) in self.0.iter().enumerate() {
                    let place = bounds.iter().position(|&bound| bound == i);
                    if place.is_none_or(|place| set >> place & 1 == 1) {
                        sums.add(columns, weight.abs(), *sample);
                    }
                }
                least = least.min(self.cost(&sums.solve(&[false; 3]).values));
            }
            least
        }
    }

    #[test]
    fn bounds_cost_what_trying_every_set_of_them_costs() {
        let mut seed = 3_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 40) as f64 / f64::from(1 << 24)
        };
        let mut satisfied = 0;
        for round in 0..300 {
            // A cosine, a lobe about the middle, a constant; what is brighter than a level is clipped.
            let [strength, level] = [4.0 * random(), 0.6 + 2.0 * random()];
            let scene = Scene(
                (0..12)
                    .map(|i| {
                        let place = f64::from(i) / 11.0 - 0.5;
                        let lobe = (-20.0 * (place + 0.1 * random()).powi(2)).exp();
                        let columns = [1.0 - place * place, lobe, 1.0];
                        let light = 0.5 * columns[0] + strength * lobe + 0.1 * random();
                        let weight = 0.5 + random();
                        (columns, if light > level { -weight } else { weight }, light.min(level))
                    })
                    .collect(),
            );
            let (solution, sums) = solve(&scene, &[false; 3], &mut Vec::new());
            let (cost, least) = (scene.cost(&solution.values), scene.exhaustive());
            // Strengths whose slope is 1e-5 of their samples stay at 0 (`nnls`): a cost of its square.
            let squares: f64 = scene.0.iter().map(|(_, w, y)| w.abs() * y * y).sum();
            assert!(cost <= least + 1e-9 * squares, "{round}: {cost} {least}");
            assert!((sums.left(&solution.values) - cost).abs() <= 1e-9 * squares, "{round}");
            let free = |(columns, weight, sample): &&([f64; 3], f64, f64)| {
                *weight < 0.0 && light_of(columns, &solution.values) > *sample
            };
            satisfied += scene.0.iter().filter(free).count();
        }
        assert!(satisfied > 100, "{satisfied}");
    }

    #[test]
    fn a_bound_without_bounds_beside_it_is_reached() {
        let scene = Scene(vec![([1.0, 0.0, 0.0], -2.0, 0.7)]);
        let (solution, _) = solve(&scene, &[false; 3], &mut Vec::new());
        assert!((solution.values[0] - 0.7).abs() < 1e-12);
    }
}
