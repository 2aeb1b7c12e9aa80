//! Diffuse part and strengths by non-negative least squares [@lawson1974nnls]: Snel's third pass
//! [@snel]. With shapes and normal known, colours are linear.

use crate::brdf::lafortune::{Lobe, Pair};
use crate::geometry::Rig;
use crate::lm::nnls::Sums;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Mask, Real, Vec3};

use super::estimate::{LafortuneEstimate, MOST_LOBES, OUTLIER_DEVIATIONS, OUTLIER_SHARE};
use super::scratch::{LafortuneScratch, STRIDE};

/// Diffuse part and lobes.
pub(super) const COLUMNS: usize = 1 + MOST_LOBES;

/// Strengths of a tile.
pub(super) struct TileColours {
    pixels: usize,
    /// `(band, column, pixel)`.
    values: Vec<f32>,
    /// Root mean square of the residuals over all bands.
    pub(super) residual: Vec<f32>,
}

impl TileColours {
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

    /// Whether single precision holds all of a pixel at its own scale.
    pub(super) fn finite(&self, pixel: usize, scale: f32) -> bool {
        let colours = self.values[pixel..].iter().step_by(self.pixels);
        colours.chain([&self.residual[pixel]]).all(|value| (scale * value).is_finite())
    }
}

/// Estimates the colours of some pixels of a tile.
///
/// A photograph that clipped in a band, or lacks it, was not used for the lobes, and was not tested
/// for outliers: a flash may clip red alone. Its other bands count if they are no outliers beside the
/// fit to the complete photographs (hard case 31).
pub(super) struct LafortuneColours<'a> {
    pub(super) rig: &'a Rig,
    pub(super) scratch: &'a LafortuneScratch,
    pub(super) fine: &'a [usize],
    pub(super) found: &'a [LafortuneEstimate],
    pub(super) tints: &'a mut TileColours,
}

impl Kernel for LafortuneColours<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { rig, scratch, fine, found, tints } = self;
        let width = I::F32::WIDTH;
        let bands = tints.values.len() / (COLUMNS * tints.pixels);
        let mut columns = vec![[I::F32::zero(); COLUMNS]; rig.observations()];
        let mut means = vec![I::F32::zero(); rig.observations()];
        let mut samples = vec![I::F32::zero(); rig.observations()];
        for (pixels, found) in fine.chunks(width).zip(found.chunks(width)) {
            let facets = LaneLobes::<I::F32>::new(scratch, pixels, found);
            for (photograph, columns) in columns.iter_mut().enumerate() {
                *columns = facets.columns(rig, photograph);
            }
            for (photograph, mean) in means.iter_mut().enumerate() {
                let plane = &scratch.means[photograph * STRIDE..];
                *mean = gather(pixels, |_, pixel| plane[pixel]);
            }
            let whole = means.iter().all(|mean| mean.is_finite().all());
            // The bands' noise, in their mean square if it is independent; a noisier band is left to
            // `OUTLIER_SHARE`.
            let limit: I::F32 = gather(pixels, |place, _| {
                (OUTLIER_DEVIATIONS * (bands as f64 * found[place].mean()).sqrt()) as f32
            });
            let (mut square, mut count) = (I::F32::zero(), I::F32::zero());
            for band in 0..bands {
                for (photograph, sample) in samples.iter_mut().enumerate() {
                    let plane = &scratch.samples[(photograph * bands + band) * STRIDE..];
                    *sample = gather(pixels, |_, pixel| plane[pixel]);
                }
                let mut sums = Sums::zero();
                for photograph in 0..columns.len() {
                    let (columns, sample) = (&columns[photograph], samples[photograph]);
                    let counts = sample.is_finite() & means[photograph].is_finite();
                    let weight = I::F32::keep(counts, I::F32::one());
                    sums.add(columns, weight, I::F32::keep(counts, sample));
                }
                let mut colours = sums.solve(&[false; COLUMNS]).values;
                let first = colours;
                if !whole {
                    for photograph in 0..columns.len() {
                        let (columns, sample) = (&columns[photograph], samples[photograph]);
                        let near = near(columns, &first, sample, limit);
                        let counts = sample.is_finite() & !means[photograph].is_finite() & near;
                        let weight = I::F32::keep(counts, I::F32::one());
                        sums.add(columns, weight, I::F32::keep(counts, sample));
                    }
                    colours = sums.solve(&[false; COLUMNS]).values;
                }
                for photograph in 0..columns.len() {
                    let (columns, sample) = (&columns[photograph], samples[photograph]);
                    let mut counts = sample.is_finite();
                    if !whole {
                        let near = near(columns, &first, sample, limit);
                        counts = counts & (means[photograph].is_finite() | near);
                    }
                    let residual = I::F32::keep(counts, left(columns, &colours, sample));
                    square = residual.mul_add(residual, square);
                    count = count + I::F32::keep(counts, I::F32::one());
                }
                for (column, colour) in colours.into_iter().enumerate() {
                    let mut lanes = [0.0; MAX_LANES];
                    colour.store(&mut lanes);
                    for (&pixel, &value) in pixels.iter().zip(&lanes) {
                        tints.values[(band * COLUMNS + column) * tints.pixels + pixel] = value;
                    }
                }
            }
            let mut lanes = [0.0; MAX_LANES];
            (square / count).sqrt().store(&mut lanes);
            for (&pixel, &value) in pixels.iter().zip(&lanes) {
                tints.residual[pixel] = value;
            }
        }
    }
}

/// The residual of a sample.
#[inline(always)]
fn left<R: Real>(columns: &[R; COLUMNS], colours: &[R; COLUMNS], sample: R) -> R {
    let mut left = sample;
    for i in 0..COLUMNS {
        left = (-colours[i]).mul_add(columns[i], left);
    }
    left
}

/// Whether a sample lies within the limit of noise, or a share of the larger of itself and what the
/// colours show.
#[inline(always)]
fn near<R: Real<Scalar = f32>>(
    columns: &[R; COLUMNS],
    colours: &[R; COLUMNS],
    sample: R,
    limit: R,
) -> R::Mask {
    let off = left(columns, colours, sample);
    let share = R::splat(OUTLIER_SHARE) * sample.max(sample - off);
    off.abs().le(limit.max(share))
}

/// One number of each of some pixels, from their indices in the list and in the tile; lanes beyond
/// the last pixel repeat it.
#[inline(always)]
pub(super) fn gather<R: Real<Scalar = f32>>(
    pixels: &[usize],
    of: impl Fn(usize, usize) -> f32,
) -> R {
    let mut lanes = [0.0; MAX_LANES];
    for (lane, value) in lanes.iter_mut().enumerate().take(R::WIDTH) {
        let place = lane.min(pixels.len() - 1);
        *value = of(place, pixels[place]);
    }
    R::load(&lanes)
}

/// Pixels side by side in registers, with lobes of strength 1.
pub(super) struct LaneLobes<R> {
    normal: Vec3<R>,
    place: [R; 2],
    lobes: [Lobe<R>; MOST_LOBES],
}

impl<R: Real<Scalar = f32>> LaneLobes<R> {
    #[inline(always)]
    pub(super) fn new(
        scratch: &LafortuneScratch,
        pixels: &[usize],
        found: &[LafortuneEstimate],
    ) -> Self {
        let normal = [0, 1, 2].map(|axis| gather(pixels, |_, pixel| scratch.normals[pixel][axis]));
        let lobes = core::array::from_fn(|lobe| {
            let [cxy, cz, exponent] = [0, 1, 2].map(|i| {
                gather::<R>(pixels, |place, _| {
                    let found = &found[place];
                    if lobe < found.lobes { found.shape(lobe)[i] as f32 } else { 0.0 }
                })
            });
            // A lobe that is not there has the exponent 0 and shows nothing.
            let strength = R::keep(exponent.gt(R::zero()), R::one());
            Lobe::of_coefficients(strength, cxy, cz, exponent)
        });
        Self {
            normal: Vec3::new(normal[0], normal[1], normal[2]),
            place: [0, 1].map(|axis| gather(pixels, |_, pixel| scratch.places[pixel][axis])),
            lobes,
        }
    }

    /// What a diffuse part of 1 and each lobe show in a photograph.
    #[inline(always)]
    pub(super) fn columns(&self, rig: &Rig, photograph: usize) -> [R; COLUMNS] {
        let view = rig.views()[photograph].at(self.place[0], self.place[1]);
        let (light, irradiance) = rig.lights()[photograph].at(self.place[0], self.place[1]);
        let pair = Pair::against(self.normal, light, view, light.dot(view));
        let cosine = pair.cosine * irradiance;
        let mut columns = [cosine; COLUMNS];
        for (column, lobe) in columns[1..].iter_mut().zip(&self.lobes) {
            *column = cosine * lobe.value(&pair);
        }
        columns
    }
}
