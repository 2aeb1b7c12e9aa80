//! Snel's third pass: with shapes and normal known, colours are linear.

use crate::brdf::lafortune::{Lobe, Pair};
use crate::geometry::Rig;
use crate::lm::factor;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Mask, Real, Vec3};

use super::fit::{Scratch, TILE};
use super::sequence::{Found, MOST_LOBES};

/// Diffuse part and lobes.
const COLUMNS: usize = 1 + MOST_LOBES;

/// Rounds of the active set: columns leave and return at most so often (a column that returned and
/// left again stays out).
const ROUNDS: usize = 2 * COLUMNS;

/// Slope of a column at 0, relative to what it could pull, below which it stays there.
const FLAT: f64 = 1e-5;

/// Strengths of a tile.
pub(super) struct Tints {
    pixels: usize,
    /// `(band, column, pixel)`.
    values: Vec<f32>,
    /// Root mean square of the residuals over all bands.
    pub(super) residual: Vec<f32>,
}

impl Tints {
    pub(super) fn new(bands: usize, pixels: usize) -> Self {
        Self {
            pixels,
            values: vec![0.0; bands * COLUMNS * pixels],
            residual: vec![f32::NAN; pixels],
        }
    }

    pub(super) fn colour(&self, band: usize, column: usize, pixel: usize) -> f32 {
        self.values[(band * COLUMNS + column) * self.pixels + pixel]
    }
}

/// Finds the colours of some pixels of a tile.
pub(super) struct Colours<'a> {
    pub(super) rig: &'a Rig,
    pub(super) scratch: &'a Scratch,
    pub(super) fine: &'a [usize],
    pub(super) found: &'a [Found],
    pub(super) tints: &'a mut Tints,
}

impl Kernel for Colours<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { rig, scratch, fine, found, tints } = self;
        let width = I::F32::WIDTH;
        let bands = tints.values.len() / (COLUMNS * tints.pixels);
        let mut columns = vec![[I::F32::zero(); COLUMNS]; rig.observations()];
        for (pixels, found) in fine.chunks(width).zip(found.chunks(width)) {
            // Lanes beyond the last pixel repeat it.
            let pixel = |lane: usize| pixels[lane.min(pixels.len() - 1)];
            let gather = |of: &dyn Fn(usize) -> f32| -> I::F32 {
                let mut lanes = [0.0; 16];
                for (lane, value) in lanes.iter_mut().enumerate().take(width) {
                    *value = of(lane);
                }
                I::F32::load(&lanes)
            };
            let normal = [0, 1, 2].map(|axis| gather(&|lane| scratch.normals[pixel(lane)][axis]));
            let normal = Vec3::new(normal[0], normal[1], normal[2]);
            let place = [0, 1].map(|axis| gather(&|lane| scratch.places[pixel(lane)][axis]));
            let lobes: [_; MOST_LOBES] = core::array::from_fn(|lobe| {
                let number = |i: usize| {
                    gather(&|lane| {
                        let found = &found[lane.min(found.len() - 1)];
                        if lobe < found.lobes { found.shape(lobe)[i] as f32 } else { 0.0 }
                    })
                };
                let [cxy, cz, exponent] = [number(0), number(1), number(2)];
                // A lobe that is not there has the exponent 0 and shows nothing.
                let there = exponent.gt(I::F32::zero());
                let strength = I::F32::keep(there, I::F32::one());
                Lobe::of_coefficients(strength, cxy, cz, exponent)
            });
            for (photograph, columns) in columns.iter_mut().enumerate() {
                let view = rig.views()[photograph].splat();
                let (light, irradiance) = rig.lights()[photograph].at(place[0], place[1]);
                let pair = Pair::against(normal, light, view, light.dot(view));
                let cosine = pair.cosine * irradiance;
                columns[0] = cosine;
                for (column, lobe) in columns[1..].iter_mut().zip(&lobes) {
                    *column = cosine * lobe.value(&pair);
                }
            }
            let (mut square, mut count) = (I::F32::zero(), I::F32::zero());
            for band in 0..bands {
                let sample = |photograph: usize| {
                    let plane = (photograph * bands + band) * TILE;
                    gather(&|lane| scratch.samples[plane + pixel(lane)])
                };
                let mut sums = Sums::zero();
                for (photograph, columns) in columns.iter().enumerate() {
                    sums.add(columns, sample(photograph));
                }
                let colours = sums.solve();
                for (photograph, columns) in columns.iter().enumerate() {
                    let sample = sample(photograph);
                    let mut residual = sample;
                    for (&column, &colour) in columns.iter().zip(&colours) {
                        residual = (-colour).mul_add(column, residual);
                    }
                    let counts = sample.is_finite();
                    let residual = I::F32::keep(counts, residual);
                    square = residual.mul_add(residual, square);
                    count = count + I::F32::keep(counts, I::F32::one());
                }
                for (column, colour) in colours.into_iter().enumerate() {
                    let mut lanes = [0.0; 16];
                    colour.store(&mut lanes);
                    for (&pixel, &value) in pixels.iter().zip(&lanes) {
                        tints.values[(band * COLUMNS + column) * tints.pixels + pixel] = value;
                    }
                }
            }
            let mut lanes = [0.0; 16];
            (square / count).sqrt().store(&mut lanes);
            for (&pixel, &value) in pixels.iter().zip(&lanes) {
                tints.residual[pixel] = value;
            }
        }
    }
}

/// Sums over a band's samples: `c c'` (lower triangle), `c y` and `y y`.
struct Sums<R> {
    gram: [[R; COLUMNS]; COLUMNS],
    right: [R; COLUMNS],
    square: R,
}

impl<R: Real> Sums<R> {
    #[inline(always)]
    fn zero() -> Self {
        let o = R::zero();
        Self { gram: [[o; COLUMNS]; COLUMNS], right: [o; COLUMNS], square: o }
    }

    /// Adds a sample, unless it does not count.
    #[inline(always)]
    fn add(&mut self, columns: &[R; COLUMNS], sample: R) {
        let counts = sample.is_finite();
        let sample = R::keep(counts, sample);
        self.square = sample.mul_add(sample, self.square);
        for (i, &column) in columns.iter().enumerate() {
            let column = R::keep(counts, column);
            self.right[i] = column.mul_add(sample, self.right[i]);
            for (j, &other) in columns.iter().enumerate().take(i + 1) {
                self.gram[i][j] = column.mul_add(other, self.gram[i][j]);
            }
        }
    }

    /// The strengths that leave the smallest residuals, none negative (hard case 15): a column
    /// whose strength would be negative leaves, one that pulls comes back.
    #[inline(always)]
    fn solve(&self) -> [R; COLUMNS] {
        let zero = R::zero();
        let mut held = [R::Mask::splat(false); COLUMNS];
        for (i, held) in held.iter_mut().enumerate() {
            *held = !self.gram[i][i].gt(zero);
        }
        let mut returned = held;
        let mut values = [zero; COLUMNS];
        for _ in 0..ROUNDS {
            values = factor(&self.gram, zero, &held).solve(&self.right);
            let mut settled = true;
            for i in 0..COLUMNS {
                let mut slope = self.right[i];
                for (j, &value) in values.iter().enumerate() {
                    let entry = if i >= j { self.gram[i][j] } else { self.gram[j][i] };
                    slope = (-entry).mul_add(value, slope);
                }
                let reach = R::of(FLAT) * (self.gram[i][i] * self.square).sqrt();
                let leaves = !held[i] & values[i].lt(zero);
                let comes = held[i] & slope.gt(reach) & !returned[i];
                returned[i] = returned[i] | comes;
                held[i] = (held[i] | leaves) & !comes;
                settled &= !(leaves | comes).any();
            }
            if settled {
                break;
            }
        }
        values.map(|value| value.max(zero))
    }
}
