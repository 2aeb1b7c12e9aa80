//! Reweighting: a step of iteratively reweighted least squares [@holland1977robust].
//!
//! With shapes and normals fixed, the colours of every band follow by non-negative least squares
//! [@lawson1974nnls]; the residuals then give every sample its new weight.

use core::ops::Range;

use crate::math::elementary::{exp, ln};
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Real};

use super::bounds::{self, BandColumns, BandSamples, light_of, weight_at};
use super::maps::MOST_LOBES;
use super::model::{LobeEstimation, Visit};
use super::neutral::{NeutralTest, ResidualSum};
use super::photographs::Photographs;
use super::tile::{
    Estimate, ROUNDING, TILE, TileSamples, gather, gather_lobes, gather_normal, runs_by_lobes,
};
use super::weights::Shown;
use crate::lm::nnls::Sums;

/// Columns of [`Solution::colours`]: diffuse, lobes, ambient.
pub(super) const COLUMNS: usize = MOST_LOBES + 2;

/// The linear unknowns of a tile's pixels, and the residuals that they leave.
pub(super) struct Solution {
    /// `(band, column, pixel)`.
    pub(super) colours: Vec<f32>,
    /// Root mean square of the residuals, linear light.
    pub(super) residual: Vec<f32>,
    /// Mean square of the residuals, by the weights at the end of the step.
    pub(super) variance: Vec<f32>,
    /// `(lobe, pixel)`: 1 where the lobe has one strength in all bands.
    pub(super) neutral: Vec<f32>,
}

impl Solution {
    pub(super) fn new(bands: usize) -> Self {
        Self {
            colours: vec![0.0; bands * COLUMNS * TILE],
            residual: vec![0.0; TILE],
            variance: vec![0.0; TILE],
            neutral: vec![0.0; MOST_LOBES * TILE],
        }
    }
}

/// One step for a tile's pixels.
pub(super) struct Reweight<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) estimates: &'a [Estimate],
    pub(super) ambient: bool,
    /// Whether weights are renewed by the residuals; if not, this is the last step, which tests
    /// whether lobes are neutral, and after which bounds are samples or do not count.
    pub(super) renew: bool,
    pub(super) samples: &'a mut TileSamples,
    pub(super) solution: &'a mut Solution,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Reweight<'_, M> {
    pub(super) fn run(mut self) {
        for (lobes, range) in runs_by_lobes(self.estimates) {
            M::dispatch(lobes, Part { step: &mut self, range });
        }
    }
}

/// The step for some of the pixels, with at most so many lobes.
struct Part<'a, 'b, M: LobeEstimation> {
    step: &'a mut Reweight<'b, M>,
    range: Range<usize>,
}

impl<M: LobeEstimation> Visit for Part<'_, '_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.step.level;
        level.run(ReweightPass::<M, J, K>(self));
    }
}

struct ReweightPass<'a, 'b, M: LobeEstimation, const J: usize, const K: usize>(Part<'a, 'b, M>);

impl<M: LobeEstimation, const J: usize, const K: usize> Kernel for ReweightPass<'_, '_, M, J, K> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn run<I: Isa>(self) {
        let Part { step, range } = self.0;
        let Reweight { photographs, x, y, estimates, ambient, renew, .. } = *step;
        let (samples, solution) = (&mut *step.samples, &mut *step.solution);
        let (zero, one) = (I::F32::zero(), I::F32::one());
        let everywhere = zero.lt(one);
        let bands = samples.bands;
        let barred = core::array::from_fn(|column| column == K - 1 && !ambient);
        let mut columns = vec![[zero; K]; photographs.len()];
        let mut shown = Shown::new(samples.planes());
        let mut sums = vec![Sums::<I::F32, K>::zero(); bands];
        let mut colours = vec![[zero; K]; bands];
        let mut trial = vec![[zero; K]; bands];
        let mut bounded = Vec::new();
        for at in range.step_by(I::F32::WIDTH) {
            let normal = gather_normal(estimates, at);
            let count: I::F32 = gather(estimates, at, |p| p.lobes as f32);
            let lobes = gather_lobes::<I::F32, M, J>(&photographs.model, estimates, at);
            let (px, py) = (I::F32::load(&x[at..]), I::F32::load(&y[at..]));
            for photograph in 0..photographs.len() {
                let (towards, irradiance, pair) = photographs.at(photograph, px, py);
                let cosine = normal.dot(towards);
                let diffuse = photographs.diffuse(normal, towards, &pair).value;
                let mut own = [one; K];
                own[0] = I::F32::keep(cosine.gt(zero), diffuse * irradiance);
                for j in 0..J {
                    let value = photographs.model.value(&lobes[j], &pair, normal) * irradiance;
                    // A pixel without this lobe has a column of zeros.
                    own[1 + j] = I::F32::keep(count.gt(I::F32::of(j as f64)), value);
                }
                columns[photograph] = own;
            }
            shown.clear();
            let mut squares = zero;
            for band in 0..bands {
                let seen = BandColumns { samples: &*samples, columns: &columns, band, at };
                let (solution, counted) = bounds::solve(&seen, &barred, &mut bounded);
                squares = squares + counted.square();
                sums[band] = counted;
                colours[band] = solution.values;
                for photograph in 0..columns.len() {
                    let (columns, weight, sample) = seen.at(photograph);
                    let light = light_of(&columns, &solution.values);
                    shown.count(sample, weight_at(weight, sample, light));
                }
            }
            if !renew && bands > 1 {
                // BIC with one strength instead of one per band.
                let used = shown.used();
                let fewer = I::F32::of((bands - 1) as f64) * ln(used) / used;
                let cost = Cost { samples: &*samples, columns: &columns, at };
                let rounding = I::F32::splat(ROUNDING) * squares;
                let test = NeutralTest { price: exp(fewer), rounding };
                let memory = (&mut colours[..], &mut trial[..]);
                let neutral = test.constrain::<J, K>(&mut sums, &barred, memory, &cost);
                for j in 0..J {
                    I::F32::keep(neutral[j], one).store(&mut solution.neutral[j * TILE + at..]);
                }
            }
            for band in 0..bands {
                let own = colours[band];
                for i in 0..K {
                    let column = if i == K - 1 { COLUMNS - 1 } else { i };
                    own[i].store(&mut solution.colours[(band * COLUMNS + column) * TILE + at..]);
                }
                for photograph in 0..columns.len() {
                    let columns = &columns[photograph];
                    let parts = [light_of(columns, &own), columns[0] * own[0]];
                    shown.set(photograph * bands + band, parts);
                }
            }
            let left = shown.left(samples, at);
            shown.deviation(&left).store(&mut solution.residual[at..]);
            let variance = if renew {
                shown.renew(&left, everywhere, samples, at)
            } else {
                shown.fix_bounds(samples, at);
                shown.variance(&left)
            };
            variance.store(&mut solution.variance[at..]);
        }
    }
}

/// The cost of colours for some pixels.
struct Cost<'a, R, const K: usize> {
    samples: &'a TileSamples,
    columns: &'a [[R; K]],
    at: usize,
}

impl<R: Real<Scalar = f32>, const K: usize> ResidualSum<R, K> for Cost<'_, R, K> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn of(&self, colours: &[[R; K]]) -> R {
        let Self { samples, columns, at } = self;
        let mut cost = R::zero();
        for photograph in 0..columns.len() {
            for band in 0..colours.len() {
                let (sample, weight) = samples.at::<R>(photograph * samples.bands + band, *at);
                let shown = light_of(&columns[photograph], &colours[band]);
                let weight = weight_at(weight, sample, shown);
                let residual = R::keep(weight.gt(R::zero()), sample - shown);
                cost = (weight * residual).mul_add(residual, cost);
            }
        }
        cost
    }
}
