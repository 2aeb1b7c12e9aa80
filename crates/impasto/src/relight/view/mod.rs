//! The painting as an eye sees it: a distant one in parallel rays, a near one in perspective.
//!
//! The picture's up is the painting's up as the eye sees it, `u = Y - (Y.V) V` for the view V from the
//! painting's middle, its right is `r = u x V`. In parallel rays the point P = (x, y, 0) appears at
//! `(r.P, u.P)`; in perspective from the distance d at `(r.P, u.P) d / (d - V.P)`, a homography
//! [@hartley2004multiple]. The picture has the painting's pitch in its middle and is as large as the
//! projected painting. Radiance is resampled, never divided by the foreshortening: a matte white board
//! looks as bright from the side.
//!
//! A pixel of the picture sees a parallelogram of the painting. Its value is the mean of samples along
//! the longest direction of that, each interpolated bilinearly (the anisotropic filter of texture
//! mapping). A box of l pixels has the variance `l^2 / 12`, of which interpolation between pixels
//! supplies `1 / 12`: the samples cover the rest, a box of `sqrt(l^2 - 1)` pixels; in parallel rays l is
//! `1 / cos` of the view's angle from the normal, the rest `tan`. Neighbours are at most half a pixel
//! apart. So a view that is almost frontal takes one sample, one at 45 degrees two.
//!
//! Over a relief each sample is where its ray meets the relief ([`march`]).

mod march;
mod projection;

pub use projection::Projection;

use crate::error::Result;
use crate::geometry::{Grid, View};
use crate::math::{Isa, Kernel, Real};
use crate::pixels::{Run, TILE, zeros};

use march::{Heights, INDICES, Line, March, SIDE, WHOLE};

/// Most samples of a pixel: from 83 degrees on they are more than half a painting pixel apart,
/// and the picture is a sliver anyway.
const MOST_SAMPLES: f64 = 16.0;

/// A pixel of the painting as it is resampled: three channels of light, times coverage, and coverage.
/// They lie together, as a sample reads all of four neighbours.
pub(super) type Lit = [f32; 4];

/// Pixels from planes of light `(3, y, x)` and coverage; what is not covered may hold any background.
fn lit_from_planes(light: &[f32], coverage: &[f32], run: &Run<'_>) -> Result<Vec<Lit>> {
    let mut pixels = zeros(coverage.len())?;
    let tiles = pixels.chunks_mut(TILE).enumerate().collect();
    run.for_each(
        tiles,
        || (),
        |(), (tile, pixels): (usize, &mut [Lit])| {
            let start = tile * TILE;
            for (pixel, covered) in pixels.iter_mut().zip(&coverage[start..]) {
                pixel[3] = *covered;
            }
            for (channel, plane) in light.chunks_exact(coverage.len()).enumerate() {
                for (pixel, light) in pixels.iter_mut().zip(&plane[start..]) {
                    pixel[channel] = if pixel[3] > 0.0 { pixel[3] * light } else { 0.0 };
                }
            }
        },
    )?;
    Ok(pixels)
}

impl Projection {
    /// Resamples the pixels of a painting; what is not covered shows `background`.
    ///
    /// # Errors
    /// If the caller cancels.
    fn resample(
        &self,
        lit: &[Lit],
        heights: Option<&Heights<'_>>,
        background: [f32; 3],
        run: &Run<'_>,
    ) -> Result<(Vec<f32>, Vec<f32>)> {
        let Grid { width, height, .. } = self.picture;
        let pixels = width * height;
        let (mut seen, mut covered) = (zeros(3 * pixels)?, zeros(pixels)?);
        let strip = SIDE * width;
        let mut planes: Vec<_> = seen.chunks_mut(pixels).map(|p| p.chunks_mut(strip)).collect();
        let strips = covered.chunks_mut(strip).enumerate().map(|(index, covered)| {
            let seen = planes.iter_mut().filter_map(Iterator::next).collect();
            Strip { projection: self, lit, heights, background, row: index * SIDE, seen, covered }
        });
        run.for_each(strips.collect(), || (), |(), strip| run.level.run(strip))?;
        Ok((seen, covered))
    }
}

/// Light `(3, y, x)` with its coverage `(y, x)` as an eye sees it, over a `relief` in mm if there is
/// one. Returns the picture's light, coverage and grid.
///
/// # Errors
/// As [`Projection::new`], or if the caller cancels.
pub fn seen_from(
    view: View,
    (light, coverage): (&[f32], &[f32]),
    grid: Grid,
    relief: Option<&[f32]>,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<(Vec<f32>, Vec<f32>, Grid)> {
    lit_seen_from(view, &lit_from_planes(light, coverage, run)?, grid, relief, background, run)
}

/// The same of the painting's pixels.
///
/// # Errors
/// As [`Projection::new`], or if the caller cancels.
pub(super) fn lit_seen_from(
    view: View,
    lit: &[Lit],
    grid: Grid,
    relief: Option<&[f32]>,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<(Vec<f32>, Vec<f32>, Grid)> {
    let projection = Projection::new(view, grid)?;
    let heights = relief.map(|map| Heights::new(map, grid, run)).transpose()?;
    let heights = heights.as_ref();
    let (light, coverage) = projection.resample(lit, heights, background, run)?;
    Ok((light, coverage, projection.picture))
}

/// Some rows of the picture.
struct Strip<'a> {
    projection: &'a Projection,
    /// `(y, x)` of the painting.
    lit: &'a [Lit],
    heights: Option<&'a Heights<'a>>,
    background: [f32; 3],
    /// The first row.
    row: usize,
    seen: Vec<&'a mut [f32]>,
    covered: &'a mut [f32],
}

impl Kernel for Strip<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { projection, lit, heights, background, row: first, .. } = self;
        let Self { mut seen, covered, .. } = self;
        let width = projection.picture.width;
        let Grid { width: columns, height: rows, .. } = projection.painting;
        let painting = Painting { lit, width: columns, height: rows };
        for left in (0..width).step_by(SIDE) {
            let count = SIDE.min(width - left);
            for row in 0..covered.len() / width {
                let line = projection.line::<I>([left, first + row], count, painting, heights);
                let places = row * width + left..row * width + left + count;
                let covered = &mut covered[places.clone()];
                for ((share, sum), inside) in covered.iter_mut().zip(&line.sums).zip(&line.inside) {
                    *share = sum[3] * inside;
                }
                for (channel, seen) in seen.iter_mut().enumerate() {
                    let seen = seen[places.clone()].iter_mut().zip(&*covered);
                    for ((seen, share), (sum, inside)) in
                        seen.zip(line.sums.iter().zip(&line.inside))
                    {
                        let light = sum[channel] * inside;
                        *seen = Real::mul_add(1.0 - share, background[channel], light);
                    }
                }
            }
        }
    }
}

/// A run of the picture's pixels.
struct Sampled {
    /// The mean of each pixel's samples.
    sums: [Lit; SIDE],
    /// How much of each pixel lies on the painting.
    inside: Line,
}

impl Projection {
    #[inline(always)]
    fn line<I: Isa>(
        &self,
        [left, row]: [usize; 2],
        count: usize,
        painting: Painting<'_>,
        heights: Option<&Heights<'_>>,
    ) -> Sampled {
        let size = [painting.width as f64, painting.height as f64];
        // Places are counted from a whole pixel beside the run: single precision then resolves
        // 1e-4 of a pixel in parallel rays up to 80 degrees.
        let (column, row) = (left as f64, row as f64);
        let start = self.homogeneous(column, row);
        let next = self.homogeneous(column + 1.0, row);
        // The step of the divisor, 0 in parallel rays.
        let (one, more) = (start[2], next[2] - start[2]);
        // On the painting: a run that begins near the horizon of a perspective begins anywhere.
        let origin = [0, 1].map(|axis| (start[axis] / one).floor().max(0.0).min(size[axis] - 1.0));
        // Near the horizon of a perspective a run goes from near to far, or behind the eye: what
        // speaks for it is the place where samples lie closest together.
        let part = |share: f64| column + share * (count as f64 - 1.0);
        let mut middle = part(0.5);
        let mut spread = self.spread(middle, row);
        if more != 0.0 {
            let mut least = f64::INFINITY;
            for place in [0.5, 0.0, 1.0].map(part) {
                let here = self.spread(place, row);
                let length = here[0].hypot(here[1]);
                if self.homogeneous(place, row)[2] > 0.0 && length < least {
                    (middle, spread, least) = (place, here, length);
                }
            }
        }
        let here = self.painting_from_picture(middle, row);
        let beside = self.painting_from_picture(middle + 1.0, row);
        let below = self.painting_from_picture(middle, row + 1.0);
        let mut places = [[0.0; SIDE]; 2];
        let mut inside = [1.0; SIDE];
        for axis in 0..2 {
            // How far a pixel of the picture reaches over the painting.
            let reach = (beside[axis] - here[axis]).abs() + (below[axis] - here[axis]).abs();
            let first = origin[axis].mul_add(-one, start[axis]) / one;
            let step = origin[axis].mul_add(-more, next[axis] - start[axis]) / one;
            let from = 0.0 - origin[axis] - 0.5;
            let (half, per) = (I::F32::of(0.5), I::F32::of(1.0 / reach));
            let (low, high) = (I::F32::of(from), I::F32::of(from + size[axis]));
            for lane in (0..SIDE).step_by(I::F32::WIDTH) {
                let index = I::F32::load(&INDICES[lane..]);
                let place = index.mul_add(I::F32::of(step), I::F32::of(first));
                let place = place / index.mul_add(I::F32::of(more / one), I::F32::one());
                place.store(&mut places[axis][lane..]);
                // What either border leaves of the pixel, less what both do: exactly 1 within.
                let left = |to_border: I::F32| {
                    to_border.mul_add(per, half).max(I::F32::zero()).min(I::F32::one())
                };
                let share = left(place - low) + left(high - place) - I::F32::one();
                let share = share.max(I::F32::zero());
                (I::F32::load(&inside[lane..]) * share).store(&mut inside[lane..]);
            }
        }
        let samples = (2.0 * spread[0].hypot(spread[1])).ceil().clamp(1.0, MOST_SAMPLES) as usize;
        let march = heights.map(|heights| {
            let last = self.painting_from_picture(column + count as f64 - 1.0, row);
            let ends = [[start[0] / one, start[1] / one], last];
            March::new(heights, origin, ends, spread, self.rays(origin))
        });
        let mut sums = [[0.0; 4]; SIDE];
        for sample in 0..samples {
            let along = (sample as f64 + 0.5) / samples as f64 - 0.5;
            let (mut whole, mut part) = ([[0.0; SIDE]; 2], [[0.0; SIDE]; 2]);
            for axis in 0..2 {
                let offset = I::F32::of(spread[axis] * along);
                for lane in (0..SIDE).step_by(I::F32::WIDTH) {
                    let place = I::F32::load(&places[axis][lane..]) + offset;
                    place.store(&mut part[axis][lane..]);
                }
            }
            if let Some(march) = &march {
                march.displace::<I::F32>(&mut part, count);
            }
            for axis in 0..2 {
                let low = I::F32::of(0.0 - origin[axis]);
                let high = I::F32::of(size[axis] - 1.0 - origin[axis]);
                for lane in (0..SIDE).step_by(I::F32::WIDTH) {
                    let place = I::F32::load(&part[axis][lane..]).max(low).min(high);
                    let nearest = place.round();
                    let below = I::F32::select(place.lt(nearest), nearest - I::F32::one(), nearest);
                    (below + I::F32::splat(WHOLE)).store(&mut whole[axis][lane..]);
                    (place - below).store(&mut part[axis][lane..]);
                }
            }
            let origin =
                origin.map(|place| (place as usize).wrapping_sub(WHOLE.to_bits() as usize));
            for (pixel, sum) in sums[..count].iter_mut().enumerate() {
                let [column, row] = [whole[0][pixel], whole[1][pixel]];
                let at = [column, row].map(|place: f32| place.to_bits() as usize);
                let at = [at[0].wrapping_add(origin[0]), at[1].wrapping_add(origin[1])];
                let tap = painting.between(at, [part[0][pixel], part[1][pixel]]);
                for (sum, tap) in sum.iter_mut().zip(tap) {
                    *sum += tap;
                }
            }
        }
        let share = 1.0 / samples as f32;
        for value in sums.as_flattened_mut() {
            *value *= share;
        }
        Sampled { sums, inside }
    }
}

/// What is resampled.
#[derive(Clone, Copy)]
struct Painting<'a> {
    lit: &'a [Lit],
    width: usize,
    height: usize,
}

impl Painting<'_> {
    /// What is between four pixels.
    #[inline(always)]
    fn between(&self, [column, row]: [usize; 2], [right, down]: [f32; 2]) -> Lit {
        let at = row * self.width + column;
        let beside = usize::from(column + 1 < self.width);
        let below = if row + 1 < self.height { self.width } else { 0 };
        let taps = [
            (at, (1.0 - down) * (1.0 - right)),
            (at + beside, (1.0 - down) * right),
            (at + below, down * (1.0 - right)),
            (at + below + beside, down * right),
        ];
        let mut sum = [0.0; 4];
        for (place, weight) in taps {
            for (sum, &value) in sum.iter_mut().zip(&self.lit[place]) {
                *sum = Real::mul_add(weight, value, *sum);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests;
