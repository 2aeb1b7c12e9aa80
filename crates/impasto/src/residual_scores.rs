//! Scores of what a fit leaves of the photographs, along principal components
//! [@hotelling1933components].

#![allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]

use core::ops::Range;

use crate::error::{Error, Result};
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::tail::{load, store};
use crate::math::{Kernel, Real};
use crate::pixels::{Run, TILE, stride, tiles};
use crate::stack::Stack;

/// Pixels whose scores of one band stay in the first cache while photographs are added.
const BLOCK: usize = 256;

/// Samples from one photograph of a block to the next.
const STRIDE: usize = stride(BLOCK);

/// Some photographs, and what a fit shows of them.
#[derive(Clone, Copy, Debug)]
pub struct ResidualScores<'a> {
    /// All photographs.
    pub stack: &'a Stack<'a>,
    /// Number of the first of them.
    pub first: usize,
    /// `(obs, band, y, x)`: linear light that the fit shows of some photographs, from `first` on; NaN
    /// counts as 0.
    pub shown: &'a [f32],
    /// `(obs,)` intensities of all lights, by which the stack's samples are divided.
    pub intensities: &'a [f64],
    /// Linear light of full scale under a light of intensity 1.
    pub top: f64,
    /// Codes at equal steps of the square root of light, from none to full scale. Residuals are
    /// differences of codes.
    pub curve: &'a [f32],
    /// `(component, obs)`: the components, over all photographs.
    pub basis: &'a [f64],
}

/// A tile of the scores.
struct Tile<'a> {
    start: usize,
    length: usize,
    /// `(component, band)`.
    planes: Vec<&'a mut [f32]>,
}

impl ResidualScores<'_> {
    /// Adds the part of these photographs to the scores `(component, band, y, x)`.
    ///
    /// Photographs that are added one after the other, in whatever groups, give the same bits. A sample
    /// that is clipped counts as its ceiling, or as what the fit shows if that is more; one that was
    /// never taken leaves no residual.
    ///
    /// # Errors
    /// If a size does not fit the stack, or the run is cancelled.
    pub fn add_to(&self, scores: &mut [f32], run: &Run<'_>) -> Result<()> {
        let shape = self.stack.shape();
        let (pixels, plane) = (shape.pixels(), shape.bands * shape.pixels());
        let components = self.basis.len() / shape.observations;
        let count = self.shown.len() / plane;
        let sizes = [
            ("basis", self.basis.len() == components * shape.observations),
            ("shown", self.shown.len() == count * plane),
            ("first", self.first + count <= shape.observations),
            ("intensities", self.intensities.len() == shape.observations),
            ("curve", self.curve.len() > 1),
            ("scores", scores.len() == components * plane),
        ];
        if let Some((name, _)) = sizes.iter().find(|(_, fits)| !fits) {
            return Err(Error::argument(name, "its size does not fit the photographs"));
        }
        let mut planes: Vec<_> =
            scores.chunks_mut(pixels).map(|plane| plane.chunks_mut(TILE)).collect();
        let tiles = tiles(pixels)
            .into_iter()
            .map(|(start, length)| {
                let planes = planes.iter_mut().filter_map(Iterator::next).collect();
                Tile { start, length, planes }
            })
            .collect();
        let scratch = || (vec![0.0; count * STRIDE], [[0.0; BLOCK]; 2]);
        run.for_each(tiles, scratch, |(residuals, codes), tile| {
            run.level.run(Add { photographs: self, count, residuals, codes, tile });
        })
    }
}

struct Add<'a, 'b> {
    photographs: &'a ResidualScores<'a>,
    count: usize,
    /// `(obs, pixel)` of a block.
    residuals: &'a mut [f32],
    /// A photograph's samples, then places on the curve; and those of what the fit shows.
    codes: &'a mut [[f32; BLOCK]; 2],
    tile: Tile<'b>,
}

impl Kernel for Add<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { photographs, count, residuals, codes, mut tile } = self;
        let shape = photographs.stack.shape();
        let components = tile.planes.len() / shape.bands;
        for at in (0..tile.length).step_by(BLOCK) {
            let block = at..tile.length.min(at + BLOCK);
            for band in 0..shape.bands {
                for index in 0..count {
                    let out = &mut residuals[index * STRIDE..][..BLOCK];
                    let pixels = tile.start + block.start..tile.start + block.end;
                    photographs.residuals::<I::F32>(index, band, pixels, codes, out);
                }
                for component in 0..components {
                    let plane = component * shape.bands + band;
                    let scores = &mut tile.planes[plane][block.clone()];
                    let own = component * shape.observations + photographs.first;
                    let weights = &photographs.basis[own..own + count];
                    for at in (0..block.len()).step_by(I::F32::WIDTH) {
                        let mut score = load::<I::F32>(scores, at);
                        for index in 0..count {
                            let residual = I::F32::load(&residuals[index * STRIDE + at..]);
                            score = I::F32::of(weights[index]).mul_add(residual, score);
                        }
                        store(score, scores, at);
                    }
                }
            }
        }
    }
}

impl ResidualScores<'_> {
    /// The residuals of some pixels in one photograph and band.
    #[inline(always)]
    fn residuals<R: Real<Scalar = f32>>(
        &self,
        index: usize,
        band: usize,
        pixels: Range<usize>,
        [seen, shown]: &mut [[f32; BLOCK]; 2],
        out: &mut [f32],
    ) {
        let shape = self.stack.shape();
        let (observation, length) = (self.first + index, pixels.len());
        self.stack.read(observation, band, pixels.start, &mut seen[..length]);
        let plane = (index * shape.bands + band) * shape.pixels();
        let fitted = &self.shown[plane + pixels.start..plane + pixels.end];
        let ceiling = self.stack.ceiling(observation, band);
        let ceiling = R::splat(if ceiling.is_finite() { ceiling } else { 0.0 });
        let light = R::of(self.intensities[observation]);
        let (zero, most, top) = (R::zero(), R::of(f64::from(f32::MAX)), R::of(self.top));
        for at in (0..length).step_by(R::WIDTH) {
            let expected = (load::<R>(fitted, at) / light).max(zero);
            let sample = R::load(&seen[at..]);
            let sample = R::select(sample.gt(most), expected.max(ceiling), sample);
            // A sample that was never taken is as expected.
            let sample = R::select(sample.le(sample), sample, expected);
            self.step(sample / top).store(&mut seen[at..]);
            self.step(expected / top).store(&mut shown[at..]);
        }
        for at in 0..length {
            out[at] = self.curve[seen[at] as usize] - self.curve[shown[at] as usize];
        }
        out[length..].fill(0.0);
    }

    /// The step of the curve that is nearest to a share of full scale.
    #[inline(always)]
    fn step<R: Real<Scalar = f32>>(&self, share: R) -> R {
        let root = share.max(R::zero()).min(R::one()).sqrt();
        (root * R::of((self.curve.len() - 1) as f64)).round()
    }
}

const _: () = assert!(BLOCK.is_multiple_of(MAX_LANES), "blocks are whole registers");

#[cfg(test)]
mod tests {
    use super::*;
    use core::sync::atomic::AtomicBool;

    use crate::math::Level;
    use crate::pixels::{Pool, Progress};
    use crate::stack::{Decode, Samples, Shape};

    /// Two tiles, the second of which no block divides.
    const SHAPE: Shape = Shape { observations: 3, bands: 2, height: 5, width: 851 };

    /// In groups of one and of three, in every instruction set and on several threads: the same bits,
    /// and plain sums to the steps of the curve.
    #[test]
    fn scores_are_sums_over_photographs_in_any_groups() {
        let plane = SHAPE.bands * SHAPE.pixels();
        let wave = |i: usize, by: f32| 0.5 + 0.4 * (i as f32 * by).sin();
        let mut samples: Vec<f32> = (0..3 * plane).map(|i| wave(i, 0.37)).collect();
        let mut shown: Vec<f32> = (0..3 * plane).map(|i| 2.0 * wave(i, 0.21)).collect();
        // Clipped, never taken, and where the fit has nothing.
        (samples[7], samples[plane + 9], shown[2 * plane + 11]) = (0.95, f32::NAN, f32::NAN);
        let decode = [Decode { gain: 1.0, offset: 0.0, saturation: 0.92 }; 6];
        let stack = Stack::new(Samples::F32(&samples), SHAPE, &decode, None).unwrap();
        // A curve that is light itself: its steps are 1e-4 apart where light is 1.
        let curve: Vec<f32> = (0..=20_000_u16).map(|i| (f32::from(i) / 2e4).powi(2)).collect();
        let basis = [0.6, -0.8, 0.1, 0.3, 0.2, 0.9];
        let added = |groups: &[usize], level: Level, threads: usize| {
            let pool = Pool::new(threads).unwrap();
            let (cancel, progress) = (AtomicBool::new(false), Progress::default());
            let run = Run { pool: Some(&pool), level, cancel: &cancel, progress: &progress };
            let mut scores = vec![0.0; 2 * plane];
            let mut first = 0;
            for &count in groups {
                let some = ResidualScores {
                    stack: &stack,
                    first,
                    shown: &shown[first * plane..(first + count) * plane],
                    intensities: &[2.0; 3],
                    top: 1.25,
                    curve: &curve,
                    basis: &basis,
                };
                some.add_to(&mut scores, &run).unwrap();
                first += count;
            }
            scores
        };
        let scores = added(&[3], Level::Baseline, 1);
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            assert!(scores == added(&[1, 2], level, 3), "{level:?}");
        }
        let mut largest = 0.0_f64;
        for at in 0..plane {
            for component in 0..2 {
                let mut expected = 0.0;
                for index in 0..3 {
                    let sample = f64::from(samples[index * plane + at]);
                    let fitted = f64::from(shown[index * plane + at].max(0.0)) / 2.0;
                    let sample = if sample >= 0.92 { fitted.max(0.92) } else { sample };
                    let residual = if sample.is_nan() { 0.0 } else { (sample - fitted) / 1.25 };
                    expected += basis[3 * component + index] * residual;
                }
                largest = largest.max((f64::from(scores[component * plane + at]) - expected).abs());
            }
        }
        // Half a step of either code is 1e-4 of a residual; the weights sum to at most 1.5.
        assert!(largest < 1.5e-4, "{largest}");
    }
}
