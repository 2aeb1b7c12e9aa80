//! Cast shadows of a distant light by prefix maximum along sheared lines, in the manner of horizon
//! sweeps [@timonen2010scalable].
//!
//! The lines ([`super::lines`]) are walked towards darkness. With k the fall of the light's ray per
//! step, the shadow's upper surface follows `M <- max(M - k, v)`, carried from sample to sample: O(1)
//! per pixel at any elevation, and no large number `k * step` to lose digits against. The depth
//! below that surface, `D = (M - k) - v`, is interpolated back to the pixel's centre between the two
//! lines beside it; the pixel is in shadow where `D > 0`. This is the definition of the shadow, not an
//! approximation of a ray march.
//!
//! Only bits are kept. The whole picture is swept in strips of lines; their bits are then shifted
//! into the picture's rows. A tile is swept with as many rows before it as a height can carry a shadow
//! ([`Span::reach`]), and has the bits of the whole picture.

use core::ops::Range;

use super::bits::{Bits, WORD, shifted};
use super::lines::{ABYSS, LineScratch, Lines, Part, Span};
use crate::error::Result;
use crate::geometry::Grid;
use crate::math::lanes::MAX_LANES;
use crate::math::{Isa, Kernel, Level, Mask, Real, Vec3};
use crate::pixels::Run;

/// Lines of one piece of work. Fixed, though no result depends on it: 2 KiB per row of the strip
/// keep the shadow surface and the row in the first-level cache.
const STRIP: usize = 512;

/// A distant light over a relief.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sweep<'a> {
    lines: Lines<'a>,
    /// Fall of the ray per row walked, mm.
    fall: f32,
}

/// Memory of one worker.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    lines: LineScratch,
    surface: Vec<f32>,
    depth: Vec<f32>,
    words: Vec<u64>,
}

impl<'a> Sweep<'a> {
    /// None: the light stands overhead, and throws no shadow.
    pub(super) fn new(relief: &'a [f32], grid: Grid, light: Vec3<f64>) -> Option<Self> {
        if light.x == 0.0 && light.y == 0.0 {
            return None;
        }
        let lines = Lines::new(relief, grid, [light.x, light.y]);
        let fall = light.z * lines.step / light.x.hypot(light.y);
        Some(Self { lines, fall: fall as f32 })
    }

    /// Rows before a tile that may throw shadows on it; None: all of them.
    pub(super) fn reach(&self, span: Span) -> Option<usize> {
        span.reach(self.fall.into()).filter(|&rows| rows < self.lines.steps)
    }

    /// Samples of the whole picture's sweep.
    pub(super) fn cost(&self) -> usize {
        self.lines.all().1 * self.lines.steps
    }

    /// Samples of a tile's sweep.
    pub(super) fn cost_of_tile(
        &self,
        columns: Range<usize>,
        rows: Range<usize>,
        reach: Option<usize>,
    ) -> usize {
        let part = self.lines.part(columns, rows);
        let before = reach.map_or(part.steps.start, |reach| reach.min(part.steps.start));
        self.lines.of(&part).1 * (before + part.steps.len())
    }

    /// Visibility of the whole picture.
    pub(super) fn whole(&self, run: &Run<'_>) -> Result<Bits> {
        let lines = &self.lines;
        let (first, count) = lines.all();
        let strips: Vec<usize> = (0..count).step_by(STRIP).collect();
        let per_row = STRIP / WORD;
        let lit = run.map(strips, Scratch::default, |scratch, start| {
            let mut words = vec![0; per_row * lines.steps];
            let range = (first + start.cast_signed(), STRIP);
            self.sweep(range, 0..lines.steps, run.level, scratch, |step, lit| {
                words[step * per_row..][..per_row].copy_from_slice(lit);
            });
            words
        })?;
        let mut bits = Bits::filled(false, lines.width, lines.steps);
        let stride = bits.stride();
        run.for_each(
            bits.words_mut().chunks_exact_mut(stride).enumerate().collect(),
            Vec::new,
            |joined: &mut Vec<u64>, (row, out)| {
                let step = lines.row_at(row);
                joined.clear();
                for strip in &lit {
                    joined.extend_from_slice(&strip[step * per_row..][..per_row]);
                }
                let (whole, _) = lines.displacement(step);
                shifted(joined, (-whole - first) as usize, lines.width, out);
            },
        )?;
        Ok(if lines.transposed { bits.transposed() } else { bits })
    }

    /// Visibility of some `columns` and `rows` of the picture, the same bits as in the whole: `reach`
    /// rows towards the light are walked before it ([`Self::reach`]; None: all).
    pub(super) fn tile(
        &self,
        columns: Range<usize>,
        rows: Range<usize>,
        reach: Option<usize>,
        level: Level,
        scratch: &mut Scratch,
    ) -> Bits {
        let lines = &self.lines;
        let part = lines.part(columns, rows);
        let Part { columns, steps } = part.clone();
        let (first, count) = lines.of(&part);
        let mut bits = Bits::filled(false, columns.len(), steps.len());
        let stride = bits.stride();
        let top = lines.row_at(steps.start).min(lines.row_at(steps.end - 1));
        let from = reach.map_or(0, |reach| steps.start.saturating_sub(reach));
        let range = (first, count.next_multiple_of(WORD));
        // Before the tile no bit is wanted.
        let emit = steps.start;
        self.sweep_from(emit, range, from..steps.end, level, scratch, |step, lit| {
            let (whole, _) = lines.displacement(step);
            let offset = (columns.start.cast_signed() - whole - first) as usize;
            let row = lines.row_at(step) - top;
            let out = &mut bits.words_mut()[row * stride..][..stride];
            shifted(lit, offset, columns.len(), out);
        });
        if lines.transposed { bits.transposed() } else { bits }
    }

    fn sweep(
        &self,
        range: (isize, usize),
        steps: Range<usize>,
        level: Level,
        scratch: &mut Scratch,
        visit: impl FnMut(usize, &[u64]),
    ) {
        self.sweep_from(steps.start, range, steps, level, scratch, visit);
    }

    /// Sweeps so many lines, a multiple of 64; from step `emit` on, `visit` gets for each line
    /// whether the pixel left of it is lit.
    fn sweep_from(
        &self,
        emit: usize,
        (start, count): (isize, usize),
        steps: Range<usize>,
        level: Level,
        scratch: &mut Scratch,
        mut visit: impl FnMut(usize, &[u64]),
    ) {
        let Scratch { lines, surface, depth, words } = scratch;
        // A register more on the left: the first pixel lies between two lines.
        let all = count + MAX_LANES;
        surface.clear();
        surface.resize(all, ABYSS);
        depth.resize(all, 0.0);
        words.clear();
        words.resize(count / WORD, 0);
        let fall = self.fall;
        let range = (start - MAX_LANES.cast_signed(), all);
        self.lines.walk(range, steps, lines, |step, fraction, row| {
            if step < emit {
                level.run(Advance { row, fraction, fall, surface });
            } else {
                level.run(Shade { row, fraction, fall, surface, depth, words });
                visit(step, words);
            }
        });
    }
}

/// One row's step of all lines.
struct Advance<'a> {
    row: &'a [f32],
    fraction: f32,
    fall: f32,
    surface: &'a mut [f32],
}

impl Kernel for Advance<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self) {
        let between = Between::<I>::new(self.fraction);
        let fall = I::F32::splat(self.fall);
        for lane in (0..self.surface.len()).step_by(I::F32::WIDTH) {
            let height = between.height(self.row, lane);
            let surface = I::F32::load(&self.surface[lane..]) - fall;
            // Where the height is NaN, `max` keeps the surface.
            height.max(surface).store(&mut self.surface[lane..]);
        }
    }
}

/// The same, and which pixels are lit.
struct Shade<'a> {
    row: &'a [f32],
    fraction: f32,
    fall: f32,
    surface: &'a mut [f32],
    depth: &'a mut [f32],
    words: &'a mut [u64],
}

impl Kernel for Shade<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self) {
        let between = Between::<I>::new(self.fraction);
        let fall = I::F32::splat(self.fall);
        for lane in (0..self.surface.len()).step_by(I::F32::WIDTH) {
            let height = between.height(self.row, lane);
            let surface = I::F32::load(&self.surface[lane..]) - fall;
            let depth = surface - height;
            I::F32::keep(depth.le(depth), depth).store(&mut self.depth[lane..]);
            height.max(surface).store(&mut self.surface[lane..]);
        }
        for (index, word) in self.words.iter_mut().enumerate() {
            let mut dark = 0;
            for lane in (0..WORD).step_by(I::F32::WIDTH) {
                let at = MAX_LANES + index * WORD + lane;
                let before = I::F32::load(&self.depth[at - 1..]);
                let after = I::F32::load(&self.depth[at..]);
                let depth = before.mul_add(between.fraction, between.rest * after);
                dark |= u64::from(depth.gt(I::F32::zero()).bits()) << lane;
            }
            *word = !dark;
        }
    }
}

/// Linear interpolation in a row.
#[derive(Clone, Copy)]
struct Between<I: Isa> {
    fraction: I::F32,
    rest: I::F32,
    whole: bool,
}

impl<I: Isa> Between<I> {
    #[inline(always)]
    fn new(fraction: f32) -> Self {
        Self {
            fraction: I::F32::splat(fraction),
            rest: I::F32::splat(1.0 - fraction),
            whole: fraction <= 0.0,
        }
    }

    #[inline(always)]
    fn height(&self, row: &[f32], lane: usize) -> I::F32 {
        let left = I::F32::load(&row[lane..]);
        // A right neighbour without weight may be NaN.
        if self.whole {
            return left;
        }
        I::F32::load(&row[lane + 1..]).mul_add(self.fraction, left * self.rest)
    }
}
