//! A slanted view: parallel rays to the eye, the painting foreshortened along its tilt.
//!
//! The picture's up is the painting's up as the eye sees it, `u = Y - (Y.V) V`, its right is
//! `r = u x V`; the point (x, y, 0) appears at `(r.x x + r.y y, u.x x + u.y y)`. The picture has the
//! painting's pitch and is as large as the projected painting. Radiance is resampled, never
//! divided by the foreshortening: a matte white board looks as bright from the side.
//!
//! A pixel of the picture sees `1 / cos` of the painting's pixels along the tilt and one across, the
//! view standing at an angle from the normal. Its value is the mean of samples along the tilt, each
//! interpolated bilinearly (the anisotropic filter of texture mapping). A box of `1 / cos` pixels
//! has the variance `1 / (12 cos^2)`, of which interpolation between pixels supplies `1 / 12`: the
//! samples cover the rest, a box of `sqrt(1 / cos^2 - 1) = tan` pixels. Neighbours are at most half
//! a pixel apart. So a view that is almost frontal takes one sample, one at 45 degrees two.

pub mod parallax;

use crate::error::Result;
use crate::geometry::Grid;
use crate::math::{Isa, Kernel, Real, Vec3};
use crate::pixels::Run;

/// Most samples of a pixel: from 83 degrees on they are more than half a painting pixel apart,
/// and the picture is a sliver anyway.
const MOST_SAMPLES: f64 = 16.0;

/// Rows and columns that are resampled together: what they see of the painting stays in the
/// second-level cache whatever the direction of the tilt.
const SIDE: usize = 64;

type Line = [f32; SIDE];

/// How a view sees the painting's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Rows of the map from the painting's (x, y) to the picture's (right, up).
    forward: [[f64; 2]; 2],
    backward: [[f64; 2]; 2],
    /// From the first to behind the last sample of a pixel, painting pixels to the right and down.
    spread: [f64; 2],
    samples: usize,
    painting: Grid,
    /// The picture's size; its origin is the painting's.
    pub picture: Grid,
}

impl Projection {
    /// The projection of a painting along a unit view with `z > 0`.
    #[must_use]
    pub fn new(view: Vec3<f64>, painting: Grid) -> Self {
        let up = Vec3::new(-view.y * view.x, 1.0 - view.y * view.y, -view.y * view.z).normalised();
        let right = up.cross(view);
        let forward = [[right.x, right.y], [up.x, up.y]];
        // The determinant is the foreshortening, V.Z.
        let determinant = forward[0][0] * forward[1][1] - forward[0][1] * forward[1][0];
        let backward = [
            [forward[1][1] / determinant, -forward[0][1] / determinant],
            [-forward[1][0] / determinant, forward[0][0] / determinant],
        ];
        let extent = |row: [f64; 2]| {
            let size = row[0].abs() * painting.width as f64 + row[1].abs() * painting.height as f64;
            // A hair less than the next whole pixel is that pixel: rounding must not add a row.
            (size - 1e-9).ceil().max(1.0) as usize
        };
        let (width, height) = (extent(forward[0]), extent(forward[1]));
        let spread = [view.x / view.z, -view.y / view.z];
        let tangent = spread[0].hypot(spread[1]);
        let samples = (2.0 * tangent).ceil().clamp(1.0, MOST_SAMPLES) as usize;
        let picture = Grid::whole(width, height, painting.pitch);
        Self { forward, backward, spread, samples, painting, picture }
    }

    /// Where a point of the painting's plane (mm) appears in the picture (mm right, mm up).
    #[must_use]
    pub fn picture_from_painting(&self, x: f64, y: f64) -> (f64, f64) {
        let [right, up] = self.forward;
        (right[0].mul_add(x, right[1] * y), up[0].mul_add(x, up[1] * y))
    }

    /// How far the view moves any pixel, in pixels.
    #[must_use]
    pub fn displacement(&self) -> f64 {
        let (across, up) = (0.5 * self.painting.width as f64, 0.5 * self.painting.height as f64);
        // The map is linear: a corner moves most.
        [up, -up].into_iter().fold(0.0, |most: f64, up| {
            let (x, y) = self.picture_from_painting(across, up);
            most.max((x - across).hypot(y - up))
        })
    }

    /// Resamples three planes of light with their coverage: the light is weighted by the coverage,
    /// and what is not covered shows `background`.
    ///
    /// # Errors
    /// If the caller cancels.
    pub fn resample(
        &self,
        light: &[f32],
        coverage: &[f32],
        background: [f32; 3],
        run: &Run<'_>,
    ) -> Result<(Vec<f32>, Vec<f32>)> {
        let Grid { width, height, .. } = self.picture;
        let pixels = width * height;
        let (mut seen, mut covered) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let strip = SIDE * width;
        let mut planes: Vec<_> = seen.chunks_mut(pixels).map(|p| p.chunks_mut(strip)).collect();
        let strips = covered.chunks_mut(strip).enumerate().map(|(index, covered)| {
            let seen = planes.iter_mut().filter_map(Iterator::next).collect();
            Strip {
                projection: self,
                light,
                coverage,
                background,
                row: index * SIDE,
                seen,
                covered,
            }
        });
        run.for_each(strips.collect(), || (), |(), strip| run.level.run(strip))?;
        Ok((seen, covered))
    }

    /// Column and row of the painting at which the centre of a picture's pixel lies.
    fn painting_from_picture(&self, column: f64, row: f64) -> [f64; 2] {
        let (right, up) = (self.picture.x(column), self.picture.y(row));
        let [x, y] = self.backward.map(|to| to[0].mul_add(right, to[1] * up));
        let Grid { width, height, pitch, .. } = self.painting;
        [x / pitch + 0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0) - y / pitch]
    }
}

/// Light `(3, y, x)` with its coverage `(y, x)` as a distant eye along a unit `view` sees it: displaced
/// by the height of a `relief`, if there is one ([`parallax`]), and foreshortened. Returns the picture's
/// light, coverage and grid.
///
/// # Errors
/// If the caller cancels.
pub fn seen_from(
    view: Vec3<f64>,
    (light, coverage): (&[f32], &[f32]),
    grid: Grid,
    relief: Option<&[f32]>,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<(Vec<f32>, Vec<f32>, Grid)> {
    let projection = Projection::new(view, grid);
    let moved = match relief {
        Some(height) => parallax::displaced((light, coverage), height, grid, view, run)?,
        None => None,
    };
    let (light, coverage) =
        moved.as_ref().map_or((light, coverage), |(light, coverage)| (light, coverage));
    let (light, coverage) = projection.resample(light, coverage, background, run)?;
    Ok((light, coverage, projection.picture))
}

/// Some rows of the picture.
struct Strip<'a> {
    projection: &'a Projection,
    /// `(3, y, x)` and `(y, x)` of the painting.
    light: &'a [f32],
    coverage: &'a [f32],
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
        let Self { projection, light, coverage, background, row: first, mut seen, covered } = self;
        let width = projection.picture.width;
        for left in (0..width).step_by(SIDE) {
            let count = SIDE.min(width - left);
            for row in 0..covered.len() / width {
                let line = projection.line::<I>(first + row, left, count, light, coverage);
                let (sums, inside) = (&line.sums, &line.inside);
                let places = row * width + left..row * width + left + count;
                for ((pixel, place), &inside) in places.enumerate().zip(inside) {
                    let share = sums[3][pixel] * inside;
                    covered[place] = share;
                    for (channel, seen) in seen.iter_mut().enumerate() {
                        let light = sums[channel][pixel] * inside;
                        seen[place] = Real::mul_add(1.0 - share, background[channel], light);
                    }
                }
            }
        }
    }
}

/// A run of the picture's pixels.
struct Sampled {
    /// Mean light, times coverage, and mean coverage.
    sums: [Line; 4],
    /// How much of each pixel lies on the painting.
    inside: Line,
}

impl Projection {
    #[inline(always)]
    fn line<I: Isa>(
        &self,
        row: usize,
        left: usize,
        count: usize,
        light: &[f32],
        coverage: &[f32],
    ) -> Sampled {
        let Grid { width, height, .. } = self.painting;
        let size = [width as f64, height as f64];
        // Places are counted from a whole pixel beside the run: single precision then resolves
        // 1e-4 of a pixel up to 80 degrees.
        let start = self.painting_from_picture(left as f64, row as f64);
        let origin = start.map(f64::floor);
        let next = self.painting_from_picture(left as f64 + 1.0, row as f64);
        let below = self.painting_from_picture(left as f64, row as f64 + 1.0);
        let mut places = [[0.0; SIDE]; 2];
        let mut inside = [1.0; SIDE];
        for axis in 0..2 {
            let (step, down) = (next[axis] - start[axis], below[axis] - start[axis]);
            // How far a pixel of the picture reaches over the painting.
            let reach = step.abs() + down.abs();
            let [first, from] = [start[axis] - origin[axis], 0.0 - origin[axis] - 0.5];
            let (half, per) = (I::F32::of(0.5), I::F32::of(1.0 / reach));
            let (low, high) = (I::F32::of(from), I::F32::of(from + size[axis]));
            for lane in (0..SIDE).step_by(I::F32::WIDTH) {
                let index = I::F32::load(&INDICES[lane..]);
                let place = index.mul_add(I::F32::of(step), I::F32::of(first));
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
        let mut sums = [[0.0; SIDE]; 4];
        for sample in 0..self.samples {
            let along = (sample as f64 + 0.5) / self.samples as f64 - 0.5;
            let (mut whole, mut part) = ([[0.0; SIDE]; 2], [[0.0; SIDE]; 2]);
            for axis in 0..2 {
                let offset = I::F32::of(self.spread[axis] * along);
                let low = I::F32::of(0.0 - origin[axis]);
                let high = I::F32::of(size[axis] - 1.0 - origin[axis]);
                for lane in (0..SIDE).step_by(I::F32::WIDTH) {
                    let place = (I::F32::load(&places[axis][lane..]) + offset).max(low).min(high);
                    let nearest = place.round();
                    let below = I::F32::select(place.lt(nearest), nearest - I::F32::one(), nearest);
                    below.store(&mut whole[axis][lane..]);
                    (place - below).store(&mut part[axis][lane..]);
                }
            }
            let painting = Painting { light, coverage, width, height };
            let origin = origin.map(|place| place as isize);
            for pixel in 0..count {
                let at = [0, 1].map(|axis| (origin[axis] + whole[axis][pixel] as isize) as usize);
                let tap = painting.between(at, [part[0][pixel], part[1][pixel]]);
                for (sum, tap) in sums.iter_mut().zip(tap) {
                    sum[pixel] += tap;
                }
            }
        }
        let share = 1.0 / self.samples as f32;
        for value in sums.as_flattened_mut() {
            *value *= share;
        }
        Sampled { sums, inside }
    }
}

/// 0, 1, 2 ...
const INDICES: Line = {
    let mut indices = [0.0; SIDE];
    let mut index = 1;
    while index < SIDE {
        indices[index] = indices[index - 1] + 1.0;
        index += 1;
    }
    indices
};

/// What is resampled.
#[derive(Clone, Copy)]
struct Painting<'a> {
    light: &'a [f32],
    coverage: &'a [f32],
    width: usize,
    height: usize,
}

impl Painting<'_> {
    /// Light, times coverage, and coverage between four pixels.
    #[inline(always)]
    fn between(&self, [column, row]: [usize; 2], [right, down]: [f32; 2]) -> [f32; 4] {
        let pixels = self.width * self.height;
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
            let weight = weight * self.coverage[place];
            for (channel, sum) in sum[..3].iter_mut().enumerate() {
                let light = self.light[channel * pixels + place];
                // What is not covered may hold any background.
                let light = if weight > 0.0 { light } else { 0.0 };
                *sum = Real::mul_add(weight, light, *sum);
            }
            sum[3] += weight;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Level;
    use crate::pixels::serially;

    const GRID: Grid = Grid::whole(40, 30, 0.5);

    #[test]
    fn a_frontal_view_changes_nothing() {
        let projection = Projection::new(Vec3::new(0.0, 0.0, 1.0), GRID);
        assert_eq!((projection.picture.width, projection.picture.height), (40, 30));
        assert_eq!(projection.picture_from_painting(3.0, -2.0), (3.0, -2.0));
        let light: Vec<f32> = (0..3600).map(|i| ((i * 7919) % 101) as f32).collect();
        let resampled = serially(|run| projection.resample(&light, &[1.0; 1200], [9.0; 3], run));
        assert_eq!(resampled.unwrap(), (light, vec![1.0; 1200]));
    }

    #[test]
    fn a_view_from_the_side_narrows_the_picture_and_keeps_radiance() {
        // 60 degrees to the right: half as wide.
        let view = Vec3::new(3.0_f64.sqrt() / 2.0, 0.0, 0.5);
        let projection = Projection::new(view, GRID);
        assert_eq!((projection.picture.width, projection.picture.height), (20, 30));
        let (light, coverage) = (vec![0.25; 3 * 1200], vec![1.0; 1200]);
        let (seen, covered) =
            serially(|run| projection.resample(&light, &coverage, [9.0; 3], run)).unwrap();
        assert!(seen.iter().all(|&value| (value - 0.25).abs() < 1e-6));
        assert!(covered.iter().all(|&value| (value - 1.0).abs() < 1e-6));
    }

    #[test]
    fn up_stays_up_and_the_far_side_shrinks_from_below() {
        let projection = Projection::new(Vec3::new(0.0, -0.6, 0.8), GRID);
        let (right, up) = projection.picture_from_painting(1.0, 1.0);
        assert!((right - 1.0).abs() < 1e-15 && (up - 0.8).abs() < 1e-15);
        assert_eq!((projection.picture.width, projection.picture.height), (40, 24));
    }

    const VIEWS: [[f64; 3]; 4] =
        [[0.1, 0.0, 1.0], [0.5, -0.2, 0.8], [-0.6, 0.7, 0.4], [0.9, 0.3, 0.13]];

    fn projected([x, y, z]: [f64; 3]) -> Projection {
        let grid = Grid::whole(150, 190, 0.3);
        Projection::new(Vec3::new(x, y, z).normalised(), grid)
    }

    #[test]
    fn a_ramp_stays_a_ramp_wherever_a_pixel_lies_inside() {
        for projection in VIEWS.map(projected) {
            let Grid { width, height, .. } = projection.painting;
            let ramp = |c: f64, r: f64| 0.01 * c - 0.007 * r;
            let pixels = (0..width * height).map(|i| ((i % width) as f64, (i / width) as f64));
            let plane: Vec<f32> = pixels.map(|(c, r)| ramp(c, r) as f32).collect();
            let coverage = vec![1.0; plane.len()];
            let (seen, covered) =
                serially(|run| projection.resample(&plane.repeat(3), &coverage, [0.0; 3], run))
                    .unwrap();
            let at = |column, row| projection.painting_from_picture(column, row);
            let (origin, right, down) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0));
            let reach = [0, 1]
                .map(|axis| (right[axis] - origin[axis]).abs() + (down[axis] - origin[axis]).abs());
            let mut whole = 0;
            for (pixel, (&seen, &covered)) in seen.iter().zip(&covered).enumerate() {
                let (row, column) =
                    (pixel / projection.picture.width, pixel % projection.picture.width);
                let [c, r] = projection.painting_from_picture(column as f64, row as f64);
                // Samples reach half the spread to either side, the pixel itself half its reach, and
                // interpolation a pixel more.
                let margin =
                    [0, 1].map(|axis| 0.5 * projection.spread[axis].abs().max(reach[axis]) + 1.0);
                let inside = |at: f64, margin: f64, size: usize| {
                    at > margin && at < size as f64 - 1.0 - margin
                };
                if inside(c, margin[0], width) && inside(r, margin[1], height) {
                    whole += 1;
                    assert!((covered - 1.0).abs() < 1e-6);
                    // Places of up to 500 pixels in single precision, of a slope of 0.01, and
                    // values of up to 1.5.
                    assert!(
                        (f64::from(seen) - ramp(c, r)).abs() < 500.0 * 6e-8 * 0.01 * 2.0 + 1e-6
                    );
                }
            }
            assert!(whole > 500, "{whole}");
        }
    }

    #[test]
    fn light_is_conserved_up_to_the_foreshortening() {
        for projection in VIEWS.map(projected) {
            let Grid { width, height, .. } = projection.painting;
            let plane: Vec<f32> =
                (0..width * height).map(|i| ((i * 7919) % 1009) as f32 / 1009.0).collect();
            let coverage: Vec<f32> =
                (0..plane.len()).map(|i| f32::from(u8::from(i % 11 != 0))).collect();
            let light: Vec<f32> = plane.iter().zip(&coverage).map(|(l, c)| l * c).collect();
            let (seen, covered) =
                serially(|run| projection.resample(&light.repeat(3), &coverage, [0.0; 3], run))
                    .unwrap();
            let sum = |map: &[f32]| map.iter().map(|&v| f64::from(v)).sum::<f64>();
            let [[a, b], [c, d]] = projection.forward;
            let area = a * d - b * c;
            // Pixels on the border, of which there are 680 of 28500, are covered to a tenth.
            for (map, own) in [(&seen[..covered.len()], &light), (&covered[..], &coverage)] {
                let ratio = sum(map) / (area * sum(own));
                assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
            }
        }
    }

    #[test]
    fn stripes_that_are_finer_than_the_picture_turn_grey() {
        // Every other column is white; from 75 degrees a pixel sees 3.9 of them.
        let (sin, cos) = 75.0_f64.to_radians().sin_cos();
        let grid = Grid::whole(400, 3, 1.0);
        let projection = Projection::new(Vec3::new(sin, 0.0, cos), grid);
        let plane: Vec<f32> = (0..1200).map(|i| (i % 400 % 2) as f32).collect();
        let (seen, _) =
            serially(|run| projection.resample(&plane.repeat(3), &[1.0; 1200], [0.0; 3], run))
                .unwrap();
        let width = projection.picture.width;
        // Interpolated, the stripes are a triangular wave of amplitude 1/2 and period 2, whose mean
        // over 3.73 pixels is what 0.27 pixels at its peak hold, at most 0.27 / 3.73 / 2 from 1/2.
        for &value in &seen[2..width - 2] {
            assert!((value - 0.5).abs() < 0.04, "{value}");
        }
    }

    #[test]
    fn every_level_gives_the_same_bits_and_a_background_without_a_number_stays_out() {
        let projection = projected([0.5, -0.2, 0.4]);
        let pixels = projection.painting.width * projection.painting.height;
        let mut light: Vec<f32> = (0..3 * pixels).map(|i| ((i * 7919) % 997) as f32).collect();
        let mut coverage = vec![1.0; pixels];
        for channel in 0..3 {
            light[channel * pixels + 5000] = f32::NAN;
        }
        coverage[5000] = 0.0;
        let mut answers = Vec::new();
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            answers.push(serially(|run| {
                let run = Run { level, ..*run };
                projection.resample(&light, &coverage, [0.5; 3], &run).unwrap()
            }));
        }
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
        assert!(answers[0].0.iter().all(|value| value.is_finite()));
    }
}
