//! Colours where the shapes are known, what they leave, and what the samples are worth after it.

use crate::math::elementary::{exp, ln};
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Real, Vec3};

use super::colours::Sums;
use super::maps::MOST_LOBES;
use super::model::{LobeModel, MAX_SHAPES, Visit};
use super::neutral::{Judge, Left};
use super::sight::Sight;
use super::tile::{Place, Plate, ROUNDING, TILE, gather};

/// Columns of [`Settled::colours`]: diffuse, lobes, ambient.
pub(super) const COLUMNS: usize = MOST_LOBES + 2;

/// Share of a pixel's mean sample below which noise does not shrink with the light.
const FLOOR: f64 = 0.1;

/// What stands beside the places of a tile.
pub(super) struct Settled {
    /// `(band, column, pixel)`.
    pub(super) colours: Vec<f32>,
    /// Root mean square of the residuals, linear light.
    pub(super) residual: Vec<f32>,
    /// Weighted mean square of the residuals, by the weights as they are left.
    pub(super) variance: Vec<f32>,
    /// `(lobe, pixel)`: 1 where the lobe has one strength in all bands.
    pub(super) neutral: Vec<f32>,
}

impl Settled {
    pub(super) fn new(bands: usize) -> Self {
        Self {
            colours: vec![0.0; bands * COLUMNS * TILE],
            residual: vec![0.0; TILE],
            variance: vec![0.0; TILE],
            neutral: vec![0.0; MOST_LOBES * TILE],
        }
    }
}

/// One pass over a tile's pixels.
pub(super) struct Settle<'a, M: LobeModel> {
    pub(super) sight: &'a Sight<'a, M>,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) places: &'a [Place],
    pub(super) ambient: bool,
    /// Weights are renewed by the residuals; else this is the end, and lobes may turn out neutral.
    pub(super) reweigh: bool,
    pub(super) plate: &'a mut Plate,
    pub(super) settled: &'a mut Settled,
    pub(super) lobes: usize,
    pub(super) level: Level,
}

impl<M: LobeModel> Settle<'_, M> {
    pub(super) fn run(self) {
        M::dispatch(self.lobes, self);
    }
}

impl<M: LobeModel> Visit for Settle<'_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.level;
        level.run(Pass::<M, J, K>(self));
    }
}

struct Pass<'a, M: LobeModel, const J: usize, const K: usize>(Settle<'a, M>);

impl<M: LobeModel, const J: usize, const K: usize> Kernel for Pass<'_, M, J, K> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Settle { sight, x, y, places, ambient, reweigh, plate, settled, .. } = self.0;
        let (zero, one) = (I::F32::zero(), I::F32::one());
        let bands = plate.bands;
        let photographs = sight.photographs();
        let barred = core::array::from_fn(|column| column == K - 1 && !ambient);
        let mut columns = vec![[zero; K]; photographs];
        let mut shown = vec![zero; plate.planes()];
        let mut matt = vec![zero; plate.planes()];
        let mut sums = vec![Sums::<I::F32, K>::zero(); bands];
        let mut colours = vec![[zero; K]; bands];
        let mut at = 0;
        while at < places.len() {
            let normal = Vec3::new(
                gather(places, at, |p| p.normal[0]),
                gather(places, at, |p| p.normal[1]),
                gather(places, at, |p| p.normal[2]),
            );
            let count: I::F32 = gather(places, at, |p| p.lobes as f32);
            let lobes: [M::Lobe<I::F32>; J] = core::array::from_fn(|j| {
                let shape: [I::F32; MAX_SHAPES] =
                    core::array::from_fn(|s| gather(places, at, |p| p.shapes[j][s]));
                sight.model.lobe(shape)
            });
            let (px, py) = (I::F32::load(&x[at..]), I::F32::load(&y[at..]));
            for (photograph, columns) in columns.iter_mut().enumerate() {
                let (towards, irradiance, pair) = sight.at(photograph, px, py);
                let cosine = normal.dot(towards);
                columns[0] = I::F32::keep(cosine.gt(zero), cosine * irradiance);
                for (j, lobe) in lobes.iter().enumerate() {
                    let value = sight.model.value(lobe, &pair, normal) * irradiance;
                    // A pixel without this lobe has a column of zeros.
                    columns[1 + j] = I::F32::keep(count.gt(I::F32::of(j as f64)), value);
                }
                columns[K - 1] = one;
            }
            let (mut light, mut used) = (zero, zero);
            for (band, sums) in sums.iter_mut().enumerate() {
                *sums = Sums::zero();
                for (photograph, columns) in columns.iter().enumerate() {
                    let (sample, weight, _) = look::<I::F32>(plate, photograph * bands + band, at);
                    sums.add(columns, weight, sample);
                    light = light + I::F32::keep(weight.gt(zero), sample);
                    used = used + I::F32::keep(weight.gt(zero), one);
                }
                colours[band] = sums.solve(&barred).values;
            }
            if !reweigh && bands > 1 {
                // BIC, for the strengths of all bands but one.
                let spared = I::F32::of((bands - 1) as f64) * ln(used.max(one)) / used.max(one);
                let none = vec![[zero; K]; bands];
                let samples = Samples { plate: &*plate, columns: &columns, at };
                let light = samples.left(&none);
                let rounding = I::F32::splat(ROUNDING) * light;
                let judge = Judge { price: exp(spared), rounding };
                let neutral = judge.settle::<J, K>(&mut sums, &barred, &mut colours, &samples);
                for (lobe, &neutral) in neutral.iter().enumerate() {
                    I::F32::keep(neutral, one).store(&mut settled.neutral[lobe * TILE + at..]);
                }
            }
            for (band, colours) in colours.iter().enumerate() {
                for (column, colour) in colours.iter().enumerate() {
                    let column = if column == K - 1 { COLUMNS - 1 } else { column };
                    colour.store(&mut settled.colours[(band * COLUMNS + column) * TILE + at..]);
                }
                for (photograph, columns) in columns.iter().enumerate() {
                    shown[photograph * bands + band] = light_of(columns, colours);
                    matt[photograph * bands + band] = columns[0] * colours[0];
                }
            }
            // Variances in units of the pixel's mean sample.
            let mean = light / used.max(one);
            let unit = I::F32::keep(mean.gt(zero), mean.recip());
            let (mut sum, mut plain, mut weighted) = (zero, zero, zero);
            for (plane, &shown) in shown.iter().enumerate() {
                let (sample, weight, _) = look::<I::F32>(plate, plane, at);
                let residual = I::F32::keep(weight.gt(zero), sample - shown);
                plain = residual.mul_add(residual, plain);
                weighted = (weight * residual).mul_add(residual, weighted);
                sum = sum + residual.abs() / noise(shown * unit).sqrt();
            }
            (plain / used.max(one)).sqrt().store(&mut settled.residual[at..]);
            if reweigh {
                let scale = sum / used.max(one);
                let bend = I::F32::keep(scale.gt(zero), scale.recip());
                weighted = zero;
                for (plane, (&shown, &matt)) in shown.iter().zip(&matt).enumerate() {
                    let (sample, weight, clipped) = look::<I::F32>(plate, plane, at);
                    let fresh = worth(sample, [shown, matt], noise(shown * unit), bend);
                    // A clipped sample says that there was at least so much light.
                    let silent = clipped & shown.ge(sample);
                    let known = weight.gt(zero) | clipped;
                    let fresh = I::F32::keep(known & !silent, fresh);
                    fresh.store(&mut plate.weights[plane * TILE + at..]);
                    let residual = sample - shown;
                    weighted = (fresh * residual).mul_add(residual, weighted);
                }
            }
            (weighted / used.max(one)).store(&mut settled.variance[at..]);
            at += I::F32::WIDTH;
        }
    }
}

/// Variance of a sample, both in units of the pixel's mean sample.
#[inline(always)]
fn noise<R: Real>(shown: R) -> R {
    shown.max(R::of(FLOOR))
}

/// What a sample is worth beside what is shown, in all and by the diffuse part alone: one over its
/// variance, less beyond the mean absolute residual (one over `bend`, in units of the deviation).
#[inline(always)]
fn worth<R: Real>(sample: R, [shown, matt]: [R; 2], variance: R, bend: R) -> R {
    let far = (sample - shown) / variance.sqrt() * bend;
    // Residuals count by their size, not its square.
    let tail = far.mul_add(far, R::one());
    let worth = (tail.sqrt() * variance).recip();
    // Less light than the diffuse part alone would show is a shadow (hard case 24).
    let lit = (sample / matt).max(tail.recip());
    R::select(matt.gt(sample), worth * lit * lit, worth)
}

/// What columns of these colours show.
#[inline(always)]
fn light_of<R: Real, const K: usize>(columns: &[R; K], colours: &[R; K]) -> R {
    let mut light = R::zero();
    for (&column, &colour) in columns.iter().zip(colours) {
        light = colour.mul_add(column, light);
    }
    light
}

/// Samples of some pixels, and what columns they are shown by.
struct Samples<'a, R, const K: usize> {
    plate: &'a Plate,
    columns: &'a [[R; K]],
    at: usize,
}

impl<R: Real<Scalar = f32>, const K: usize> Left<R, K> for Samples<'_, R, K> {
    #[inline(always)]
    fn left(&self, colours: &[[R; K]]) -> R {
        let Self { plate, columns, at } = self;
        let mut cost = R::zero();
        for (photograph, columns) in columns.iter().enumerate() {
            for (band, colours) in colours.iter().enumerate() {
                let (sample, weight, _) = look::<R>(plate, photograph * plate.bands + band, *at);
                let residual = R::keep(weight.gt(R::zero()), sample - light_of(columns, colours));
                cost = (weight * residual).mul_add(residual, cost);
            }
        }
        cost
    }
}

/// Sample, weight and whether the sample is clipped (then it is what it reached at least).
#[inline(always)]
fn look<R: Real<Scalar = f32>>(plate: &Plate, plane: usize, at: usize) -> (R, R, R::Mask) {
    let sample = R::load(&plate.samples[plane * TILE + at..]);
    let clipped = sample.gt(R::of(f64::from(f32::MAX)));
    let sample = R::select(clipped, R::splat(plate.ceilings[plane]), sample);
    (sample, R::load(&plate.weights[plane * TILE + at..]), clipped)
}
