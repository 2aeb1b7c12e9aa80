//! Planes to display codes in one pass: a 3 x k matrix, then the tone curve.

use std::ops::Range;

use super::block::{BLOCK, Plane};
use super::curve::{CELLS, Curve, INTEGER_BITS};
use super::steps::{Entries, Steps, outside};
use crate::error::{Error, Result};
use crate::math::{Isa, Kernel, Level, Real};
use crate::pixels::Run;

/// A 3 x k matrix: one column per input plane.
pub type Matrix = [[f64; 3]];

/// How light becomes codes.
#[derive(Clone, Copy, Debug)]
pub struct Display<'a> {
    /// Linear display light from light.
    pub matrix: &'a Matrix,
    /// The tone curve.
    pub curve: &'a Curve,
}

/// Where a picture as display codes goes.
#[derive(Debug)]
pub struct Canvas<'a> {
    /// 8-bit codes `(y, x, 3)`.
    pub codes: &'a mut [u8],
    /// `(y, x)`, as of a [`Picture`](super::Picture).
    pub coverage: &'a mut [f32],
    /// How light becomes codes.
    pub display: Display<'a>,
}

impl Canvas<'_> {
    /// Shows some pixels that lie beyond the display in every channel: `above` its white or below 0.
    pub(crate) fn fill(&mut self, above: [bool; 3], pixels: Range<usize>) -> Clipped {
        let curve = self.display.curve;
        let colour = [0, 1, 2].map(|channel| curve.end(channel, above[channel]));
        let count = pixels.len() as u64;
        for code in self.codes[3 * pixels.start..3 * pixels.end].chunks_exact_mut(3) {
            code.copy_from_slice(&colour);
        }
        self.coverage[pixels].fill(1.0);
        Clipped {
            below: above.map(|above| if above { 0 } else { count }),
            above: above.map(|above| if above { count } else { 0 }),
        }
    }
}

/// Where the codes go, three per pixel, interleaved as files want them.
#[derive(Debug)]
pub enum Codes<'a> {
    /// Code 1.0 is 255.
    Eight(&'a mut [u8]),
    /// Code 1.0 is 65535.
    Sixteen(&'a mut [u16]),
    /// Code 1.0 is 1.0.
    Float(&'a mut [f32]),
}

impl<'a> Codes<'a> {
    fn len(&self) -> usize {
        match self {
            Self::Eight(codes) => codes.len(),
            Self::Sixteen(codes) => codes.len(),
            Self::Float(codes) => codes.len(),
        }
    }

    /// Disjoint runs of `pixels` pixels each.
    fn pieces(self, pixels: usize) -> Vec<Codes<'a>> {
        match self {
            Self::Eight(codes) => codes.chunks_mut(3 * pixels).map(Codes::Eight).collect(),
            Self::Sixteen(codes) => codes.chunks_mut(3 * pixels).map(Codes::Sixteen).collect(),
            Self::Float(codes) => codes.chunks_mut(3 * pixels).map(Codes::Float).collect(),
        }
    }
}

/// How many pixels of a channel lay outside what the display can show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clipped {
    /// Per channel, below zero: the colour is outside the display's gamut.
    pub below: [u64; 3],
    /// Per channel, above one: too bright.
    pub above: [u64; 3],
}

impl Clipped {
    /// The counts of both.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        let sum = |a: [u64; 3], b: [u64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        Self { below: sum(self.below, other.below), above: sum(self.above, other.above) }
    }
}

/// Codes from planes `(k, pixels)`: `code = curve(clip(matrix @ planes, 0, 1))`; NaN shows as 0.
///
/// # Errors
/// If the sizes disagree, or the caller cancels.
pub fn codes_from_planes(
    planes: &[f32],
    matrix: &Matrix,
    curve: &Curve,
    codes: Codes<'_>,
    run: &Run<'_>,
) -> Result<Clipped> {
    let pixels = codes.len() / 3;
    if matrix.is_empty() || planes.len() != matrix.len() * pixels || codes.len() != 3 * pixels {
        let problem = format!(
            "{} values do not fill {} planes of {pixels} pixels",
            planes.len(),
            matrix.len()
        );
        return Err(Error::argument("planes", problem));
    }
    let tile = crate::pixels::TILE;
    let pieces = codes.pieces(tile).into_iter().enumerate().collect();
    let counts = run.map(pieces, ShowScratch::default, |scratch, (index, codes)| {
        let show = Show { planes, pixels, start: index * tile, matrix, curve, codes };
        show.on(scratch, run.level)
    })?;
    Ok(counts.into_iter().fold(Clipped::default(), Clipped::plus))
}

/// Linear light from planes `(k, pixels)`: `(3, pixels)`, not clipped, in `out`.
///
/// # Errors
/// If the sizes disagree, or the caller cancels.
pub fn linear_from_planes(
    planes: &[f32],
    matrix: &Matrix,
    out: &mut [f32],
    run: &Run<'_>,
) -> Result<()> {
    let pixels = out.len() / 3;
    if matrix.is_empty() || planes.len() != matrix.len() * pixels || out.len() != 3 * pixels {
        return Err(Error::argument("planes", "their size is not that of the output"));
    }
    let tile = crate::pixels::TILE;
    let channels = out.chunks_exact_mut(pixels).enumerate();
    let pieces = channels
        .flat_map(|(c, plane)| plane.chunks_mut(tile).enumerate().map(move |(i, out)| (c, i, out)))
        .collect();
    run.for_each(
        pieces,
        || (),
        |(), (channel, index, out)| {
            run.level.run(WeightedSum {
                planes,
                pixels,
                start: index * tile,
                matrix,
                channel,
                out,
            });
        },
    )
}

struct WeightedSum<'a> {
    planes: &'a [f32],
    pixels: usize,
    start: usize,
    matrix: &'a Matrix,
    channel: usize,
    out: &'a mut [f32],
}

impl Kernel for WeightedSum<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self) {
        let mut padded = [[0.0; BLOCK]];
        for (index, out) in self.out.chunks_mut(BLOCK).enumerate() {
            let range = (self.start + index * BLOCK, out.len());
            let planes = (self.planes, self.pixels);
            weigh::<I, 1>(planes, range, self.matrix, [self.channel], &mut padded);
            out.copy_from_slice(&padded[0][..out.len()]);
        }
    }
}

/// Channels of the matrix product for `count` pixels from `start` on, and 0 behind them.
#[inline(always)]
fn weigh<I: Isa, const C: usize>(
    planes: (&[f32], usize),
    (start, count): (usize, usize),
    matrix: &Matrix,
    channels: [usize; C],
    out: &mut [Plane; C],
) {
    if let [one, two, three] = matrix {
        weigh_all::<I, C>(planes, (start, count), &[*one, *two, *three], channels, out);
    } else {
        weigh_all::<I, C>(planes, (start, count), matrix, channels, out);
    }
}

/// The same; a matrix of a size that the compiler knows stays in registers.
#[inline(always)]
fn weigh_all<I: Isa, const C: usize>(
    (planes, pixels): (&[f32], usize),
    (start, count): (usize, usize),
    matrix: &(impl AsRef<Matrix> + ?Sized),
    channels: [usize; C],
    out: &mut [Plane; C],
) {
    let matrix = matrix.as_ref();
    let width = I::F32::WIDTH;
    let whole = count - count % width;
    for lane in (0..whole).step_by(width) {
        let values = weighted::<I::F32, C>(planes, pixels, start + lane, matrix, channels);
        for (out, value) in out.iter_mut().zip(values) {
            value.store(&mut out[lane..]);
        }
    }
    for lane in whole..count {
        let values = weighted::<f32, C>(planes, pixels, start + lane, matrix, channels);
        for (out, value) in out.iter_mut().zip(values) {
            out[lane] = value;
        }
    }
    if count < BLOCK {
        for out in out {
            out[count..].fill(0.0);
        }
    }
}

#[inline(always)]
fn weighted<R: Real<Scalar = f32>, const C: usize>(
    planes: &[f32],
    pixels: usize,
    at: usize,
    matrix: &Matrix,
    channels: [usize; C],
) -> [R; C] {
    let first = R::load(&planes[at..]);
    let mut sums = [R::zero(); C];
    for (sum, channel) in sums.iter_mut().zip(channels) {
        *sum = first * R::of(matrix[0][channel]);
    }
    for (k, column) in matrix.iter().enumerate().skip(1) {
        let value = R::load(&planes[k * pixels + at..]);
        for (sum, channel) in sums.iter_mut().zip(channels) {
            *sum = value.mul_add(R::of(column[channel]), *sum);
        }
    }
    sums
}

/// Memory of one worker.
#[derive(Debug)]
pub(crate) struct ShowScratch {
    linear: [Plane; 3],
    entries: Entries,
    /// Cell numbers as low bits, then the codes.
    cell: Plane,
    fraction: Plane,
    value: Plane,
    rise: Plane,
    codes: [Plane; 3],
}

impl Default for ShowScratch {
    fn default() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            linear: [zero; 3],
            entries: Entries::default(),
            cell: zero,
            fraction: zero,
            value: zero,
            rise: zero,
            codes: [zero; 3],
        }
    }
}

/// One run of pixels on its way to the display.
pub(crate) struct Show<'a> {
    /// `(k, pixels)`.
    pub(crate) planes: &'a [f32],
    /// Pixels of one plane.
    pub(crate) pixels: usize,
    /// First pixel of the run.
    pub(crate) start: usize,
    pub(crate) matrix: &'a Matrix,
    pub(crate) curve: &'a Curve,
    /// Codes of the run.
    pub(crate) codes: Codes<'a>,
}

impl Show<'_> {
    pub(crate) fn on(self, scratch: &mut ShowScratch, level: Level) -> Clipped {
        let steps = match self.codes {
            Codes::Eight(_) => self.curve.steps(),
            Codes::Sixteen(_) | Codes::Float(_) => None,
        };
        level.run(ShowKernel { show: self, steps, scratch })
    }
}

struct ShowKernel<'a, 's> {
    show: Show<'a>,
    steps: Option<[&'a Steps; 3]>,
    scratch: &'s mut ShowScratch,
}

impl Kernel for ShowKernel<'_, '_> {
    type Output = Clipped;

    #[inline(always)]
    fn run<I: Isa>(self) -> Clipped {
        let Self { show: Show { planes, pixels, start, matrix, curve, mut codes }, steps, scratch } =
            self;
        let total = codes.len() / 3;
        let mut clipped = Clipped::default();
        for block in (0..total).step_by(BLOCK) {
            let count = BLOCK.min(total - block);
            let range = (start + block, count);
            weigh::<I, 3>((planes, pixels), range, matrix, [0, 1, 2], &mut scratch.linear);
            for (channel, linear) in scratch.linear.iter().enumerate() {
                let [below, above] = outside::<I>(linear, count);
                clipped.below[channel] += below;
                clipped.above[channel] += above;
            }
            let places = 3 * block..3 * (block + count);
            if let (Codes::Eight(codes), Some(steps)) = (&mut codes, steps) {
                let ShowScratch { linear, entries, .. } = scratch;
                Steps::codes::<I>(steps, linear, entries, &mut codes[places]);
            } else {
                encode::<I>(scratch, curve, &codes);
                write(&scratch.codes, &mut codes, places);
            }
        }
        clipped
    }
}

/// Planes of codes, one pixel after another.
#[inline(always)]
fn write([red, green, blue]: &[Plane; 3], codes: &mut Codes<'_>, places: Range<usize>) {
    let planar = red.iter().zip(green).zip(blue);
    match codes {
        Codes::Eight(out) => {
            for (out, ((r, g), b)) in out[places].chunks_exact_mut(3).zip(planar) {
                out.copy_from_slice(&[r, g, b].map(|code| code.to_bits() as u8));
            }
        }
        Codes::Sixteen(out) => {
            for (out, ((r, g), b)) in out[places].chunks_exact_mut(3).zip(planar) {
                out.copy_from_slice(&[r, g, b].map(|code| code.to_bits() as u16));
            }
        }
        Codes::Float(out) => {
            for (out, ((r, g), b)) in out[places].chunks_exact_mut(3).zip(planar) {
                out.copy_from_slice(&[*r, *g, *b]);
            }
        }
    }
}

/// The tone curve on the block's linear light; integral codes stand in the low bits.
#[inline(always)]
fn encode<I: Isa>(scratch: &mut ShowScratch, curve: &Curve, codes: &Codes<'_>) {
    let ShowScratch { linear, cell, fraction, value, rise, codes: encoded, .. } = scratch;
    let width = I::F32::WIDTH;
    let (zero, one) = (I::F32::zero(), I::F32::one());
    let (cells, last) = (I::F32::of(CELLS as f64), I::F32::of((CELLS - 1) as f64));
    let magic = I::F32::splat(INTEGER_BITS);
    let full = match codes {
        Codes::Eight(_) => 255.0,
        Codes::Sixteen(_) => 65535.0,
        Codes::Float(_) => 1.0,
    };
    let (full, integral) = (I::F32::of(full), !matches!(codes, Codes::Float(_)));
    for (channel, (linear, encoded)) in linear.iter().zip(encoded).enumerate() {
        for lane in (0..BLOCK).step_by(width) {
            // NaN becomes 0 at `max`: it must not choose a cell.
            let light = I::F32::load(&linear[lane..]).max(zero).min(one);
            let place = light.sqrt() * cells;
            let nearest = place.round();
            let below = I::F32::select(place.lt(nearest), nearest - one, nearest).min(last);
            (place - below).store(&mut fraction[lane..]);
            (below + magic).store(&mut cell[lane..]);
        }
        let table = curve.channel(channel);
        for lane in 0..BLOCK {
            [value[lane], rise[lane]] = table[cell[lane].to_bits() as usize % CELLS];
        }
        for lane in (0..BLOCK).step_by(width) {
            let (value, rise) = (I::F32::load(&value[lane..]), I::F32::load(&rise[lane..]));
            let code = rise.mul_add(I::F32::load(&fraction[lane..]), value).min(one);
            let code = if integral { code.mul_add(full, magic) } else { code };
            code.store(&mut encoded[lane..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    fn srgb(light: f64) -> f64 {
        if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
    }

    fn curve() -> Curve {
        let table: Vec<f32> =
            (0..=CELLS).map(|i| srgb((i as f64 / CELLS as f64).powi(2)) as f32).collect();
        Curve::new(&table).unwrap()
    }

    const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    #[test]
    fn codes_are_within_half_a_code_of_the_curve() {
        let pixels = 100_003;
        let ramp: Vec<f32> = (0..3 * pixels).map(|i| i as f32 / (3 * pixels - 1) as f32).collect();
        let (mut eight, mut sixteen) = (vec![0; 3 * pixels], vec![0; 3 * pixels]);
        let (mut float, curve) = (vec![0.0; 3 * pixels], curve());
        serially(|run| {
            for codes in
                [Codes::Eight(&mut eight), Codes::Sixteen(&mut sixteen), Codes::Float(&mut float)]
            {
                codes_from_planes(&ramp, &IDENTITY, &curve, codes, run).unwrap();
            }
        });
        for pixel in 0..pixels {
            for channel in 0..3 {
                let at = 3 * pixel + channel;
                let exact = srgb(f64::from(ramp[channel * pixels + pixel]));
                // Half a code of rounding plus the table's 7e-4 and 0.17 (see `Curve`).
                assert!((f64::from(eight[at]) - 255.0 * exact).abs() < 0.5007);
                assert!((f64::from(sixteen[at]) - 65535.0 * exact).abs() < 0.67);
                assert!((f64::from(float[at]) - exact).abs() < 2.6e-6);
            }
        }
    }

    #[test]
    fn every_level_gives_the_same_codes_and_awkward_light_is_clipped() {
        let pixels = 1037;
        let mut planes: Vec<f32> =
            (0..6 * pixels).map(|i| ((i * 7919) % 1009) as f32 / 700.0 - 0.2).collect();
        planes[..5].copy_from_slice(&[f32::NAN, f32::INFINITY, -f32::INFINITY, 1e30, -0.0]);
        let matrix: Vec<[f64; 3]> = (0..6).map(|k| [0.2, 0.1 * f64::from(k), 0.5]).collect();
        let curve = curve();
        let mut answers = Vec::new();
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            let mut codes = vec![0; 3 * pixels];
            let clipped = serially(|run| {
                let run = Run { level, ..*run };
                codes_from_planes(&planes, &matrix, &curve, Codes::Eight(&mut codes), &run)
            });
            answers.push((codes, clipped.unwrap()));
        }
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
        let (codes, clipped) = &answers[0];
        assert_eq!(&codes[..3], &[0, 0, 0]);
        assert_eq!((codes[3], codes[6], codes[9]), (255, 0, 255));
        assert!(clipped.above[0] > 0 && clipped.below[0] > 0);
    }

    #[test]
    fn codes_of_eight_bits_are_the_rounded_ones_of_the_curve() {
        let pixels = 50_021;
        let ramp: Vec<f32> =
            (0..3 * pixels).map(|i| (i as f32 / (3 * pixels - 1) as f32).powi(2)).collect();
        // The last is too steep for a table of steps.
        for (power, stepped) in [(1.0, true), (2.4, true), (5.0, false)] {
            let table: Vec<f32> =
                (0..=CELLS).map(|i| (i as f64 / CELLS as f64).powf(2.0 / power) as f32).collect();
            let curve = Curve::new(&table).unwrap();
            assert_eq!(curve.steps().is_some(), stepped, "{power}");
            for level in Level::ALL {
                let (mut eight, mut float) = (vec![0; 3 * pixels], vec![0.0; 3 * pixels]);
                for codes in [Codes::Eight(&mut eight), Codes::Float(&mut float)] {
                    serially(|run| {
                        let run = Run { level, ..*run };
                        codes_from_planes(&ramp, &IDENTITY, &curve, codes, &run).unwrap();
                    });
                }
                for (eight, float) in eight.into_iter().zip(float) {
                    // 255 times a code below 1 is rounded to 1.5e-5 before it is to an integer.
                    let apart = (f64::from(eight) - 255.0 * f64::from(float)).abs();
                    assert!(apart <= 0.5 + 1.6e-5, "{power} {level:?}: {eight} for {float}");
                }
            }
        }
    }

    #[test]
    fn linear_light_is_the_matrix_product() {
        let planes = [1.0_f32, 2.0, 3.0, 10.0, 20.0, 30.0];
        let matrix = [[1.0, 0.5, 0.0], [0.1, 0.0, -1.0]];
        let mut out = [0.0; 9];
        serially(|run| linear_from_planes(&planes, &matrix, &mut out, run)).unwrap();
        assert_eq!(out, [2.0, 4.0, 6.0, 0.5, 1.0, 1.5, -10.0, -20.0, -30.0]);
    }
}
