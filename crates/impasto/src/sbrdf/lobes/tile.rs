//! A tile's samples and weights, and the estimates of its pixels.

use core::ops::Range;

use crate::geometry::Rig;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Mask, Real, Vec3};
use crate::pixels::stride;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::maps::MOST_LOBES;
use super::model::{LobeEstimation, MAX_SHAPES};

/// Pixels of a tile: few enough that a cancelled call ends within a moment with hundreds of
/// photographs, enough for the lanes to refill.
pub(super) const TILE: usize = 256;

/// Samples from one plane to the next.
pub(super) const STRIDE: usize = stride(TILE);

/// A number of the estimates from `at` on, as lanes; lanes beyond the last repeat it.
#[inline(always)]
pub(super) fn gather<R: Real<Scalar = f32>>(
    estimates: &[Estimate],
    at: usize,
    number: impl Fn(&Estimate) -> f32,
) -> R {
    let mut lanes = [0.0; MAX_LANES];
    for (lane, value) in lanes.iter_mut().enumerate().take(R::WIDTH) {
        *value = number(&estimates[(at + lane).min(estimates.len() - 1)]);
    }
    R::load(&lanes)
}

/// The normals of the estimates from `at` on.
#[inline(always)]
pub(super) fn gather_normal<R: Real<Scalar = f32>>(estimates: &[Estimate], at: usize) -> Vec3<R> {
    Vec3::new(
        gather(estimates, at, |estimate| estimate.normal[0]),
        gather(estimates, at, |estimate| estimate.normal[1]),
        gather(estimates, at, |estimate| estimate.normal[2]),
    )
}

/// The lobes of the estimates from `at` on.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
pub(super) fn gather_lobes<R: Real<Scalar = f32>, M: LobeEstimation, const J: usize>(
    model: &M,
    estimates: &[Estimate],
    at: usize,
) -> [M::Lobe<R>; J] {
    let mut lobes = [model.lobe_from_unknowns([R::zero(); MAX_SHAPES]); J];
    for j in 0..J {
        let mut shape = [R::zero(); MAX_SHAPES];
        for s in 0..M::SHAPES {
            shape[s] = gather(estimates, at, |estimate| estimate.shapes[j][s]);
        }
        lobes[j] = model.lobe_from_unknowns(shape);
    }
    lobes
}

/// Runs of whole registers of estimates, each with the most lobes that one of its registers has.
///
/// A register is as wide as the widest, so that runs are the same on every processor. Pixels with
/// fewer lobes have columns of zeros, which change no bit of their results.
pub(super) fn runs_by_lobes(
    estimates: &[Estimate],
) -> impl Iterator<Item = (usize, Range<usize>)> + use<> {
    let most: Vec<usize> = estimates
        .chunks(MAX_LANES)
        .map(|register| register.iter().map(|estimate| estimate.lobes).max().unwrap_or(0))
        .collect();
    let count = estimates.len();
    let mut first = 0;
    core::iter::from_fn(move || {
        let &lobes = most.get(first)?;
        let start = first;
        first += most[start..].iter().take_while(|&&other| other == lobes).count();
        Some((lobes, start * MAX_LANES..count.min(first * MAX_LANES)))
    })
}

/// The present estimate of one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    pub(super) normal: [f32; 3],
    /// How many lobes it has.
    pub(super) lobes: usize,
    pub(super) shapes: [[f32; MAX_SHAPES]; MOST_LOBES],
    /// Weighted sum of squares.
    pub(super) cost: f32,
    /// Standard deviation of the normal along its worst axis, and of every shape's first number,
    /// for residuals of unit variance.
    pub(super) normal_deviation: f32,
    pub(super) shape_deviation: [f32; MOST_LOBES],
    /// The deviation of a shape's first number by the photographs alone, without the prior.
    pub(super) own_deviation: [f32; MOST_LOBES],
    /// What its fit would be without the bound.
    pub(super) unbounded: Unbounded,
    /// Whether the last search ended by its own tests.
    pub(super) converged: bool,
}

/// A fit with lobes and normal free of the bound.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unbounded {
    /// Its cost over that with the normal kept; NaN for a pixel that does not reach the bound, or
    /// where this was not asked for.
    pub(super) left: f32,
    /// By how much the cost falls, in units of the variance of its samples; NaN like `left`.
    pub(super) gain: f32,
    /// Mean correlation of its residuals with those of the pixels before it in its piece of [`TILE`]
    /// pixels that reach the bound; NaN for the first.
    pub(super) alike: f32,
}

impl Unbounded {
    const UNKNOWN: Self = Self { left: f32::NAN, gain: f32::NAN, alike: f32::NAN };
}

impl Estimate {
    pub(super) fn new(normal: [f32; 3]) -> Self {
        Self {
            normal,
            lobes: 0,
            shapes: [[0.0; MAX_SHAPES]; MOST_LOBES],
            cost: f32::INFINITY,
            normal_deviation: f32::NAN,
            shape_deviation: [f32::NAN; MOST_LOBES],
            own_deviation: [f32::NAN; MOST_LOBES],
            unbounded: Unbounded::UNKNOWN,
            converged: false,
        }
    }
}

/// A pixel's estimates without a lobe, with one ..., up to the number of lobes that was chosen.
#[derive(Clone, Copy, Debug)]
pub(super) struct ByLobeCount {
    pub(super) estimates: [Estimate; MOST_LOBES + 1],
    /// How many lobes were chosen.
    pub(super) lobes: usize,
}

impl ByLobeCount {
    pub(super) fn chosen(&self) -> &Estimate {
        &self.estimates[self.lobes]
    }
}

/// Samples `(obs, band, pixel)` of a tile with a weight each, planes [`STRIDE`] apart.
pub(super) struct TileSamples {
    pub(super) bands: usize,
    /// Linear, clipped ones at their ceiling; 0 where unusable.
    pub(super) samples: Vec<f32>,
    /// Inverse of the expected variance in units of the pixel's mean sample: free of scale, so that
    /// costs go with its square (hard case 28). 0 where a sample does not count; negative where it
    /// is clipped: then it is a [lower bound](super::bounds).
    pub(super) weights: Vec<f32>,
}

impl TileSamples {
    pub(super) fn new(photographs: usize, bands: usize) -> Self {
        let size = photographs * bands * STRIDE;
        Self { bands, samples: vec![0.0; size], weights: vec![0.0; size] }
    }

    /// Photographs times bands.
    pub(super) fn planes(&self) -> usize {
        self.samples.len() / STRIDE
    }

    /// The mean of the bands of a pixel's photograph, and its weight; both 0 where a band does not
    /// count or is a bound.
    pub(super) fn mean(&self, photograph: usize, pixel: usize) -> [f64; 2] {
        let planes = photograph * self.bands..(photograph + 1) * self.bands;
        let (mut light, mut variance) = (0.0, 0.0);
        for plane in planes {
            light += f64::from(self.samples[plane * STRIDE + pixel]);
            variance += f64::from(self.weights[plane * STRIDE + pixel].max(0.0)).recip();
        }
        let bands = self.bands as f64;
        if variance.is_finite() { [light / bands, bands * bands / variance] } else { [0.0; 2] }
    }

    /// Sample and weight of some pixels in one plane.
    #[inline(always)]
    pub(super) fn at<R: Real<Scalar = f32>>(&self, plane: usize, at: usize) -> (R, R) {
        let place = plane * STRIDE + at;
        (R::load(&self.samples[place..]), R::load(&self.weights[place..]))
    }

    /// Lowers the weight of samples that are darker than a diffuse surface would be. What is clipped
    /// is not in shadow.
    #[inline(always)]
    fn darken<R: Real<Scalar = f32>>(&mut self, plane: usize, at: usize, diffuse: R, floor: R) {
        let (sample, weight) = self.at::<R>(plane, at);
        let sample = sample + floor;
        let share = sample.max(R::zero()) / diffuse;
        let dark = diffuse.gt(sample) & weight.gt(R::zero());
        let lit = R::select(dark, share * share * share, R::one());
        (weight * lit).store(&mut self.weights[plane * STRIDE + at..]);
    }
}

/// The samples, weights and estimates of a tile's pixels.
pub(super) struct LobeFitTile {
    /// Indices of the pixels in the picture, rising.
    pub(super) pixels: Vec<usize>,
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) colour: TileSamples,
    /// The mean over the bands, where all of them count. A clipped sample counts as its ceiling: the
    /// lobes that are selected are those of the least highlights, from which bounds then raise them.
    /// With bounds from the start, lobes that few lamps show are less well determined
    /// (docs/clipping.md).
    pub(super) grey: TileSamples,
    /// The lower bound that a clipped sample stands for, per (obs, band).
    ceilings: Vec<f32>,
    /// Usable photographs per pixel.
    pub(super) usable: Vec<usize>,
    /// Weighted sum of squares of the rounding of the mean of the bands.
    pub(super) rounding: Vec<f32>,
    pub(super) estimates: Vec<Estimate>,
    /// Diffuse colours by photometric stereo, `(band, pixel)`.
    diffuse: Vec<f32>,
}

/// Relative rounding of a weighted sum of squares: f32 has 24 bits, and a predicted sample is a sum
/// of about ten rounded terms.
pub(super) const ROUNDING: f32 = 1.0 / (1_u64 << 40) as f32;

/// Fraction of a pixel's mean sample below which the variance no longer falls with the light, for the
/// first weights.
const FIRST_FLOOR: f64 = 0.1;

/// Fraction of a pixel's colour below which samples cannot tell shadow from noise.
const SHADE: f64 = 0.03;

impl LobeFitTile {
    pub(super) fn new(stack: &Stack<'_>) -> Self {
        let shape = stack.shape();
        let ceilings = (0..shape.observations * shape.bands)
            .map(|plane| stack.ceiling(plane / shape.bands, plane % shape.bands))
            .collect();
        Self {
            pixels: Vec::with_capacity(TILE),
            x: vec![0.0; TILE],
            y: vec![0.0; TILE],
            colour: TileSamples::new(shape.observations, shape.bands),
            grey: TileSamples::new(shape.observations, 1),
            ceilings,
            usable: vec![0; TILE],
            rounding: vec![0.0; TILE],
            estimates: Vec::with_capacity(TILE),
            diffuse: vec![0.0; shape.bands * TILE],
        }
    }

    /// Reads some pixels, at most [`TILE`], and their start.
    pub(super) fn read(
        &mut self,
        stack: &Stack<'_>,
        rig: &Rig,
        chosen: &[usize],
        start: &Start<'_>,
        level: Level,
    ) {
        let pixels = stack.shape().pixels();
        self.pixels.clear();
        self.pixels.extend_from_slice(chosen);
        self.estimates.clear();
        self.estimates.extend(chosen.iter().map(|&pixel| Estimate::new(start.normal(pixel))));
        for (band, colours) in self.diffuse.chunks_mut(TILE).enumerate() {
            for (colour, pixel) in colours.iter_mut().zip(chosen) {
                *colour = start.diffuse[band * pixels + pixel];
            }
        }
        level.run(Read { tile: self, stack, rig });
    }
}

/// Samples of a tile's pixels and their first weights.
struct Read<'a> {
    tile: &'a mut LobeFitTile,
    stack: &'a Stack<'a>,
    rig: &'a Rig,
}

impl Kernel for Read<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { tile, stack, rig } = self;
        let bands = tile.colour.bands;
        let mut at = 0;
        for run in tile.pixels.chunk_by(|pixel, next| pixel + 1 == *next) {
            let end = at + run.len();
            rig.grid().coordinates(run[0], &mut tile.x[at..end], &mut tile.y[at..end]);
            for (plane, out) in tile.colour.samples.chunks_mut(STRIDE).enumerate() {
                stack.read(plane / bands, plane % bands, run[0], &mut out[at..end]);
            }
            at = end;
        }
        for at in (0..tile.estimates.len()).step_by(I::F32::WIDTH) {
            tile.weigh::<I::F32>(at);
            tile.shade::<I::F32>(rig, at);
        }
    }
}

impl LobeFitTile {
    /// Variance proportional to the sample, with a floor.
    #[inline(always)]
    fn weigh<R: Real<Scalar = f32>>(&mut self, at: usize) {
        let (zero, one) = (R::zero(), R::one());
        let bands = self.colour.bands;
        let (mut sum, mut count, mut usable) = (zero, zero, zero);
        for photograph in 0..self.colour.planes() / bands {
            let (mut grey, mut whole) = (zero, R::Mask::splat(true));
            for plane in photograph * bands..(photograph + 1) * bands {
                let place = plane * STRIDE + at;
                let sample = R::load(&self.colour.samples[place..]);
                let clipped = sample.gt(R::of(f64::from(f32::MAX)));
                let light = R::select(clipped, R::splat(self.ceilings[plane]), sample);
                // Squares must be numbers, too (hard case 26).
                let counts = (light * light).is_finite();
                let light = R::keep(counts, light);
                light.store(&mut self.colour.samples[place..]);
                let sign = R::select(clipped, -one, one);
                R::keep(counts, sign).store(&mut self.colour.weights[place..]);
                sum = sum + light;
                count = count + R::keep(counts, one);
                grey = grey + light;
                whole = whole & counts;
            }
            let place = photograph * STRIDE + at;
            usable = usable + R::keep(whole, one);
            let grey = R::keep(whole, grey / R::of(bands as f64));
            grey.store(&mut self.grey.samples[place..]);
            R::keep(whole, one).store(&mut self.grey.weights[place..]);
        }
        let mean = sum / count.max(one);
        let floor = R::of(FIRST_FLOOR) * mean;
        for samples in [&mut self.colour, &mut self.grey] {
            for plane in 0..samples.planes() {
                let (sample, sign) = samples.at::<R>(plane, at);
                let variance = sample.max(floor);
                let weight = sign * R::keep(variance.gt(zero), mean / variance);
                weight.store(&mut samples.weights[plane * STRIDE + at..]);
            }
        }
        let mut squares = zero;
        for plane in 0..self.grey.planes() {
            let (sample, weight) = self.grey.at::<R>(plane, at);
            squares = (weight.abs() * sample).mul_add(sample, squares);
        }
        (R::splat(ROUNDING) * squares).store(&mut self.rounding[at..]);
        let mut numbers = [0.0; MAX_LANES];
        usable.store(&mut numbers);
        for (usable, &number) in self.usable[at..].iter_mut().zip(&numbers[..R::WIDTH]) {
            *usable = number as usize;
        }
    }

    /// Lowers the weight of samples that are darker than the surface of photometric stereo: they are
    /// in shadow (hard case 24).
    #[inline(always)]
    fn shade<R: Real<Scalar = f32>>(&mut self, rig: &Rig, at: usize) {
        let zero = R::zero();
        let bands = self.colour.bands;
        let normal = gather_normal(&self.estimates, at);
        let (x, y) = (R::load(&self.x[at..]), R::load(&self.y[at..]));
        let mut mean = zero;
        for band in 0..bands {
            mean = mean + R::load(&self.diffuse[band * TILE + at..]);
        }
        let mean = mean / R::of(bands as f64);
        let floor = R::of(SHADE) * mean;
        for (photograph, light) in rig.lights().iter().enumerate() {
            let (towards, irradiance) = light.at(x, y);
            let diffuse = normal.dot(towards).max(zero) * irradiance;
            for band in 0..bands {
                let colour = R::load(&self.diffuse[band * TILE + at..]);
                self.colour.darken(
                    photograph * bands + band,
                    at,
                    diffuse.mul_add(colour, floor),
                    floor,
                );
            }
            self.grey.darken(photograph, at, diffuse.mul_add(mean, floor), floor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_whole_registers_with_as_many_lobes_as_one_needs() {
        let runs = |lobes: &[usize]| -> Vec<(usize, Range<usize>)> {
            let with = |&lobes: &usize| Estimate { lobes, ..Estimate::new([0.0, 0.0, 1.0]) };
            runs_by_lobes(&lobes.iter().map(with).collect::<Vec<_>>()).collect()
        };
        assert_eq!(runs(&[]), []);
        assert_eq!(runs(&[2]), [(2, 0..1)]);
        let mut lobes = [1; 4 * MAX_LANES + 3];
        assert_eq!(runs(&lobes), [(1, 0..lobes.len())]);
        lobes[MAX_LANES + 5] = 2;
        lobes[3 * MAX_LANES - 1] = 2;
        lobes[4 * MAX_LANES..].fill(0);
        assert_eq!(
            runs(&lobes),
            [
                (1, 0..MAX_LANES),
                (2, MAX_LANES..3 * MAX_LANES),
                (1, 3 * MAX_LANES..4 * MAX_LANES),
                (0, 4 * MAX_LANES..lobes.len()),
            ]
        );
    }
}
