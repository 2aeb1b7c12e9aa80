//! Reweighting: a step of iteratively reweighted least squares [@holland1977robust].
//!
//! With shapes and normals fixed, the colours of every band follow by non-negative least squares
//! [@lawson1974nnls]; the residuals then give every sample its new weight.

use crate::math::elementary::{exp, ln};
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Real, Vec3};

use super::bounds::{self, BandColumns, BandSamples, light_of, weight_at};
use super::maps::MOST_LOBES;
use super::model::{LobeEstimation, MAX_SHAPES, Visit};
use super::neutral::{NeutralTest, ResidualSum};
use super::photographs::Photographs;
use super::tile::{Estimate, ROUNDING, TILE, TileSamples, gather};
use crate::lm::nnls::Sums;

/// Columns of [`Solution::colours`]: diffuse, lobes, ambient.
pub(super) const COLUMNS: usize = MOST_LOBES + 2;

/// Fraction of a pixel's mean sample below which the noise no longer falls with the light.
const FLOOR: f64 = 0.1;

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
    pub(super) lobes: usize,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Reweight<'_, M> {
    pub(super) fn run(self) {
        M::dispatch(self.lobes, self);
    }
}

impl<M: LobeEstimation> Visit for Reweight<'_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.level;
        level.run(ReweightPass::<M, J, K>(self));
    }
}

struct ReweightPass<'a, M: LobeEstimation, const J: usize, const K: usize>(Reweight<'a, M>);

impl<M: LobeEstimation, const J: usize, const K: usize> Kernel for ReweightPass<'_, M, J, K> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Reweight { photographs, x, y, estimates, ambient, renew, samples, solution, .. } =
            self.0;
        let (zero, one) = (I::F32::zero(), I::F32::one());
        let bands = samples.bands;
        let barred = core::array::from_fn(|column| column == K - 1 && !ambient);
        let mut columns = vec![[zero; K]; photographs.len()];
        let mut shown = vec![zero; samples.planes()];
        let mut diffuse = vec![zero; samples.planes()];
        let mut sums = vec![Sums::<I::F32, K>::zero(); bands];
        let mut colours = vec![[zero; K]; bands];
        let mut bounded = Vec::new();
        let mut at = 0;
        while at < estimates.len() {
            let normal = Vec3::new(
                gather(estimates, at, |p| p.normal[0]),
                gather(estimates, at, |p| p.normal[1]),
                gather(estimates, at, |p| p.normal[2]),
            );
            let count: I::F32 = gather(estimates, at, |p| p.lobes as f32);
            let lobes: [M::Lobe<I::F32>; J] = core::array::from_fn(|j| {
                let shape: [I::F32; MAX_SHAPES] =
                    core::array::from_fn(|s| gather(estimates, at, |p| p.shapes[j][s]));
                photographs.model.lobe_from_unknowns(shape)
            });
            let (px, py) = (I::F32::load(&x[at..]), I::F32::load(&y[at..]));
            for (photograph, columns) in columns.iter_mut().enumerate() {
                let (towards, irradiance, pair) = photographs.at(photograph, px, py);
                let cosine = normal.dot(towards);
                let diffuse = photographs.diffuse(normal, towards, &pair).value;
                columns[0] = I::F32::keep(cosine.gt(zero), diffuse * irradiance);
                for (j, lobe) in lobes.iter().enumerate() {
                    let value = photographs.model.value(lobe, &pair, normal) * irradiance;
                    // A pixel without this lobe has a column of zeros.
                    columns[1 + j] = I::F32::keep(count.gt(I::F32::of(j as f64)), value);
                }
                columns[K - 1] = one;
            }
            let (mut light, mut used) = (zero, zero);
            for (band, (sums, colours)) in sums.iter_mut().zip(&mut colours).enumerate() {
                let seen = BandColumns { samples: &*samples, columns: &columns, band, at };
                let (solution, counted) = bounds::solve(&seen, &barred, &mut bounded);
                (*sums, *colours) = (counted, solution.values);
                for photograph in 0..columns.len() {
                    let (columns, weight, sample) = seen.at(photograph);
                    let shown = light_of(&columns, colours);
                    let counts = weight_at(weight, sample, shown).gt(zero);
                    light = light + I::F32::keep(counts, sample);
                    used = used + I::F32::keep(counts, one);
                }
            }
            if !renew && bands > 1 {
                // BIC with one strength instead of one per band.
                let fewer = I::F32::of((bands - 1) as f64) * ln(used.max(one)) / used.max(one);
                let none = vec![[zero; K]; bands];
                let cost = Cost { samples: &*samples, columns: &columns, at };
                let light = cost.of(&none);
                let rounding = I::F32::splat(ROUNDING) * light;
                let test = NeutralTest { price: exp(fewer), rounding };
                let neutral = test.constrain::<J, K>(&mut sums, &barred, &mut colours, &cost);
                for (lobe, &neutral) in neutral.iter().enumerate() {
                    I::F32::keep(neutral, one).store(&mut solution.neutral[lobe * TILE + at..]);
                }
            }
            for (band, colours) in colours.iter().enumerate() {
                for (column, colour) in colours.iter().enumerate() {
                    let column = if column == K - 1 { COLUMNS - 1 } else { column };
                    colour.store(&mut solution.colours[(band * COLUMNS + column) * TILE + at..]);
                }
                for (photograph, columns) in columns.iter().enumerate() {
                    shown[photograph * bands + band] = light_of(columns, colours);
                    diffuse[photograph * bands + band] = columns[0] * colours[0];
                }
            }
            // Variances are in units of the pixel's mean sample.
            let mean = light / used.max(one);
            let unit = I::F32::keep(mean.gt(zero), mean.recip());
            let (mut sum, mut plain, mut weighted) = (zero, zero, zero);
            for (plane, &shown) in shown.iter().enumerate() {
                let (sample, weight) = samples.at::<I::F32>(plane, at);
                let weight = weight_at(weight, sample, shown);
                let residual = I::F32::keep(weight.gt(zero), sample - shown);
                plain = residual.mul_add(residual, plain);
                weighted = (weight * residual).mul_add(residual, weighted);
                sum = sum + residual.abs() / noise(shown * unit).sqrt();
            }
            (plain / used.max(one)).sqrt().store(&mut solution.residual[at..]);
            if renew {
                let scale = sum / used.max(one);
                let bend = I::F32::keep(scale.gt(zero), scale.recip());
                weighted = renewed(samples, (&shown, &diffuse), [unit, bend], at);
            } else {
                for (plane, &shown) in shown.iter().enumerate() {
                    let (sample, weight) = samples.at::<I::F32>(plane, at);
                    let weight = weight_at(weight, sample, shown);
                    weight.store(&mut samples.weights[plane * TILE + at..]);
                }
            }
            (weighted / used.max(one)).store(&mut solution.variance[at..]);
            at += I::F32::WIDTH;
        }
    }
}

/// Renews the weights of some pixels by what the model shows and its diffuse part; returns the
/// weighted sum of squared residuals.
#[inline(always)]
fn renewed<R: Real<Scalar = f32>>(
    samples: &mut TileSamples,
    (shown, diffuse): (&[R], &[R]),
    [unit, bend]: [R; 2],
    at: usize,
) -> R {
    let zero = R::zero();
    let mut squares = zero;
    for (plane, (&shown, &diffuse)) in shown.iter().zip(diffuse).enumerate() {
        let (sample, weight) = samples.at::<R>(plane, at);
        let bound = weight.lt(zero);
        let known = bound | weight.gt(zero);
        // A bound that is satisfied has no residual.
        let sample = R::select(bound, sample.max(shown), sample);
        let fresh = sample_weight(sample, [shown, diffuse], noise(shown * unit), bend);
        let fresh = R::keep(known, fresh);
        let signed = R::select(bound, -fresh, fresh);
        signed.store(&mut samples.weights[plane * TILE + at..]);
        let residual = sample - shown;
        squares = (fresh * residual).mul_add(residual, squares);
    }
    squares
}

/// Variance of a sample, both in units of the pixel's mean sample.
#[inline(always)]
fn noise<R: Real>(shown: R) -> R {
    shown.max(R::of(FLOOR))
}

/// Weight of a sample, from the predicted sample and its diffuse part: one over its variance, and
/// less for residuals beyond the mean absolute one (one over `bend`, in standard deviations).
#[inline(always)]
fn sample_weight<R: Real>(sample: R, [shown, diffuse]: [R; 2], variance: R, bend: R) -> R {
    let far = (sample - shown) / variance.sqrt() * bend;
    // Large residuals enter the cost by their size, not by its square.
    let tail = far.mul_add(far, R::one());
    let weight = (tail.sqrt() * variance).recip();
    // A sample darker than the diffuse part alone is in shadow (hard case 24).
    let lit = (sample / diffuse).max(tail.recip());
    R::select(diffuse.gt(sample), weight * lit * lit, weight)
}

/// The cost of colours for some pixels.
struct Cost<'a, R, const K: usize> {
    samples: &'a TileSamples,
    columns: &'a [[R; K]],
    at: usize,
}

impl<R: Real<Scalar = f32>, const K: usize> ResidualSum<R, K> for Cost<'_, R, K> {
    #[inline(always)]
    fn of(&self, colours: &[[R; K]]) -> R {
        let Self { samples, columns, at } = self;
        let mut cost = R::zero();
        for (photograph, columns) in columns.iter().enumerate() {
            for (band, colours) in colours.iter().enumerate() {
                let (sample, weight) = samples.at::<R>(photograph * samples.bands + band, *at);
                let shown = light_of(columns, colours);
                let weight = weight_at(weight, sample, shown);
                let residual = R::keep(weight.gt(R::zero()), sample - shown);
                cost = (weight * residual).mul_add(residual, cost);
            }
        }
        cost
    }
}
