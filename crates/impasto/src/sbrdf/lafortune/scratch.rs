//! One tile's samples, each pixel's at its own scale.
//!
//! Every pixel is fitted at the scale of its own largest sample, to a power of two, and scaled back
//! at the end: no square of a sample or of a lobe's tail leaves the range of single precision at one
//! scale and not at another (hard case 28).

use crate::geometry::Rig;
use crate::math::elementary::power_of_two;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level};
use crate::pixels::stride;
use crate::stack::Stack;

use super::luminance::Luminance;

/// Pixels of a tile: enough for lanes to refill many times, few enough that 770 photographs of
/// three bands take 6 MB.
pub(super) const TILE: usize = 512;

/// Samples from one plane to the next.
pub(super) const STRIDE: usize = stride(TILE);

/// One tile's samples; each worker has one.
pub(super) struct LafortuneScratch {
    /// Powers of two that samples were divided by.
    pub(super) scales: Vec<f32>,
    /// `(obs, band, pixel)` linear, at each pixel's own scale, planes [`STRIDE`] apart, as the next two.
    pub(super) samples: Vec<f32>,
    /// `(obs, pixel)` their means over the bands; not finite where a band's sample is not, as where
    /// it clipped (hard case 3).
    pub(super) means: Vec<f32>,
    /// The means that count, NaN for the others.
    pub(super) kept: Vec<f32>,
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) places: Vec<[f32; 2]>,
    pub(super) normals: Vec<[f32; 3]>,
}

impl LafortuneScratch {
    pub(super) fn new(stack: &Stack<'_>) -> Self {
        let shape = stack.shape();
        Self {
            scales: vec![1.0; TILE],
            samples: vec![0.0; shape.observations * shape.bands * STRIDE],
            means: vec![0.0; shape.observations * STRIDE],
            kept: vec![0.0; shape.observations * STRIDE],
            x: vec![0.0; TILE],
            y: vec![0.0; TILE],
            places: vec![[0.0; 2]; TILE],
            normals: vec![[0.0; 3]; TILE],
        }
    }

    /// Takes up the samples of the tile that begins at a pixel.
    pub(super) fn read(&mut self, level: Level, stack: &Stack<'_>, start: usize) {
        level.run(ReadTile { stack, start, scratch: self });
    }

    pub(super) fn luminance<'a>(&'a self, rig: &'a Rig) -> Luminance<'a> {
        Luminance {
            rig,
            samples: &self.kept,
            stride: STRIDE,
            normals: &self.normals,
            places: &self.places,
        }
    }

    /// Leaves a photograph that a pixel does not count out of all its bands.
    pub(super) fn leave_out(&mut self, pixels: &[usize]) {
        let bands = self.samples.len() / self.means.len();
        for (photograph, (means, kept)) in
            self.means.chunks(STRIDE).zip(self.kept.chunks(STRIDE)).enumerate()
        {
            for &pixel in pixels.iter().filter(|&&p| means[p].is_finite() && kept[p].is_nan()) {
                for band in 0..bands {
                    self.samples[(photograph * bands + band) * STRIDE + pixel] = f32::NAN;
                }
            }
        }
    }
}

/// Decodes a tile and scales its pixels.
struct ReadTile<'a> {
    stack: &'a Stack<'a>,
    start: usize,
    scratch: &'a mut LafortuneScratch,
}

impl Kernel for ReadTile<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { stack, start, scratch } = self;
        let bands = stack.shape().bands;
        let share = 1.0 / bands as f32;
        let photographs = scratch.samples.chunks_exact_mut(bands * STRIDE);
        for (number, (planes, mean)) in
            photographs.zip(scratch.means.chunks_exact_mut(STRIDE)).enumerate()
        {
            mean.fill(0.0);
            for (band, plane) in planes.chunks_exact_mut(STRIDE).enumerate() {
                stack.read(number, band, start, &mut plane[..TILE]);
                for (mean, &sample) in mean.iter_mut().zip(&*plane) {
                    *mean += sample;
                }
            }
            for mean in mean {
                *mean *= share;
            }
        }
        // Bands may cancel out in the mean; in the squares of residuals they do not.
        scratch.scales.fill(0.0);
        let photographs = scratch.samples.chunks_exact(bands * STRIDE);
        for (planes, means) in photographs.zip(scratch.means.chunks_exact(STRIDE)) {
            for plane in planes.chunks_exact(STRIDE) {
                for ((size, &mean), &sample) in scratch.scales.iter_mut().zip(means).zip(plane) {
                    *size = if mean.is_finite() { size.max(sample.abs()) } else { *size };
                }
            }
        }
        // No sample of a pixel tells its scale: it stays as it is.
        let scale = |size: f32| if size > 0.0 { power_of_two(size) } else { 1.0 };
        scratch.scales.iter_mut().for_each(|size| *size = scale(*size));
        for planes in [&mut scratch.samples, &mut scratch.means] {
            for plane in planes.chunks_exact_mut(STRIDE) {
                for (sample, &scale) in plane.iter_mut().zip(&scratch.scales) {
                    *sample *= scale.recip();
                }
            }
        }
        scratch.kept.copy_from_slice(&scratch.means);
    }
}
