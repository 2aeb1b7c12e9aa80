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

use nalgebra::Matrix3;

use crate::error::{Error, Result};
use crate::geometry::{Grid, View};
use crate::math::{Isa, Kernel, Real, Vec3};
use crate::pixels::Run;

use march::{Heights, March, Rays};

/// Most samples of a pixel: from 83 degrees on they are more than half a painting pixel apart,
/// and the picture is a sliver anyway.
const MOST_SAMPLES: f64 = 16.0;

/// Rows and columns that are resampled together: what they see of the painting stays in the
/// second-level cache whatever the direction of the tilt.
const SIDE: usize = 64;

/// A picture in perspective has at most so many times the painting's rows or columns.
const LARGEST: f64 = 4.0;

type Line = [f32; SIDE];

/// How an eye sees the painting's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    view: View,
    /// From the painting's (x, y, 1) to the picture's (right, up, 1), up to a factor.
    forward: [[f64; 3]; 3],
    backward: [[f64; 3]; 3],
    painting: Grid,
    /// The picture's size and pitch.
    pub picture: Grid,
}

impl Projection {
    /// The projection of a painting to an eye in front of it (`z > 0`), a distant one in a unit
    /// direction.
    ///
    /// # Errors
    /// An eye so near that it sees a part of the painting several times as large as the middle.
    pub fn new(view: View, painting: Grid) -> Result<Self> {
        match view {
            View::Distant(view) => Ok(Self::parallel(view, painting)),
            View::Point(eye) => Self::perspective(eye, painting),
        }
    }

    fn parallel(view: Vec3<f64>, painting: Grid) -> Self {
        let [right, up] = axes(view);
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
        let affine = |[[a, b], [c, d]]: [[f64; 2]; 2]| [[a, b, 0.0], [c, d, 0.0], [0.0, 0.0, 1.0]];
        Self {
            view: View::Distant(view),
            forward: affine(forward),
            backward: affine(backward),
            painting,
            picture: Grid::whole(width, height, painting.pitch),
        }
    }

    fn perspective(eye: Vec3<f64>, painting: Grid) -> Result<Self> {
        let (view, distance) = (eye.normalised(), eye.length());
        let [right, up] = axes(view);
        let seen = Matrix3::new(
            right.x,
            right.y,
            0.0,
            up.x,
            up.y,
            0.0,
            -view.x / distance,
            -view.y / distance,
            1.0,
        );
        let half = [painting.width, painting.height].map(|size| 0.5 * size as f64 * painting.pitch);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let corner = seen * nalgebra::Vector3::new(x * half[0], y * half[1], 1.0);
            for axis in 0..2 {
                let place = if corner.z > 0.0 { corner[axis] / corner.z } else { f64::INFINITY };
                (low[axis], high[axis]) = (low[axis].min(place), high[axis].max(place));
            }
        }
        let size = [0, 1].map(|axis| (high[axis] - low[axis]) / painting.pitch);
        let largest = LARGEST * painting.width.max(painting.height) as f64;
        if size.iter().any(|size| size.is_nan() || *size > largest) {
            let problem = format!(
                "from ({:.4}, {:.4}, {:.4}) mm a corner of the painting is seen {LARGEST} times as large \
                 as its middle, or from behind; move the eye away",
                eye.x, eye.y, eye.z
            );
            return Err(Error::geometry("view", problem));
        }
        let middle = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]));
        let forward =
            Matrix3::new(1.0, 0.0, -middle[0], 0.0, 1.0, -middle[1], 0.0, 0.0, 1.0) * seen;
        let Some(backward) = forward.try_inverse() else {
            return Err(Error::geometry("view", "the eye sees the painting from its edge"));
        };
        let rows = |m: Matrix3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]));
        let [width, height] = size.map(|size| (size - 1e-9).ceil().max(1.0) as usize);
        Ok(Self {
            view: View::Point(eye),
            forward: rows(forward),
            backward: rows(backward),
            painting,
            picture: Grid::whole(width, height, painting.pitch),
        })
    }

    /// Where a point of the painting's plane (mm) appears in the picture (mm right, mm up).
    #[must_use]
    pub fn picture_from_painting(&self, x: f64, y: f64) -> (f64, f64) {
        let [right, up, depth] = self.forward.map(|row| row[0].mul_add(x, row[1] * y) + row[2]);
        (right / depth, up / depth)
    }

    /// How far the view moves any pixel, in pixels.
    #[must_use]
    pub fn displacement(&self) -> f64 {
        let (across, up) = (0.5 * self.painting.width as f64, 0.5 * self.painting.height as f64);
        let pitch = self.painting.pitch;
        // A homography keeps straight lines: a corner moves most.
        let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
        corners.into_iter().fold(0.0, |most: f64, (right, top)| {
            let (x, y) = (right * across, top * up);
            let (seen_x, seen_y) = self.picture_from_painting(x * pitch, y * pitch);
            most.max((seen_x / pitch - x).hypot(seen_y / pitch - y))
        })
    }

    /// Resamples three planes of light with their coverage: the light is weighted by the coverage,
    /// and what is not covered shows `background`.
    ///
    /// # Errors
    /// If the caller cancels.
    fn resample(
        &self,
        light: &[f32],
        coverage: &[f32],
        heights: Option<&Heights<'_>>,
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
                heights,
                background,
                row: index * SIDE,
                seen,
                covered,
            }
        });
        run.for_each(strips.collect(), || (), |(), strip| run.level.run(strip))?;
        Ok((seen, covered))
    }

    /// Column, row and 1, up to a factor, of the painting at which the centre of a picture's pixel
    /// lies.
    fn homogeneous(&self, column: f64, row: f64) -> [f64; 3] {
        let (right, up) = (self.picture.x(column), self.picture.y(row));
        let [x, y, one] = self.backward.map(|to| to[0].mul_add(right, to[1] * up) + to[2]);
        let Grid { width, height, pitch, .. } = self.painting;
        let middle = [width, height].map(|size| 0.5 * (size as f64 - 1.0) * one);
        [x / pitch + middle[0], middle[1] - y / pitch, one]
    }

    /// Column and row of the painting at which the centre of a picture's pixel lies.
    fn painting_from_picture(&self, column: f64, row: f64) -> [f64; 2] {
        let [column, row, one] = self.homogeneous(column, row);
        [column / one, row / one]
    }

    /// From the first to behind the last sample of a picture's pixel, in painting pixels to the right
    /// and down.
    fn spread(&self, column: f64, row: f64) -> [f64; 2] {
        if let View::Distant(view) = self.view {
            return [view.x / view.z, -view.y / view.z];
        }
        // The longest direction of what the pixel sees: the first left singular vector.
        let at = |right, down| self.painting_from_picture(column + right, row + down);
        let [[a, b], [c, d]] = [[0.5, 0.0], [0.0, 0.5]].map(|[right, down]: [f64; 2]| {
            let (to, from) = (at(right, down), at(-right, -down));
            [to[0] - from[0], to[1] - from[1]]
        });
        let (xx, xy, yy) = (a.mul_add(a, c * c), a.mul_add(b, c * d), b.mul_add(b, d * d));
        let apart = (0.5 * (xx - yy)).hypot(xy);
        let length = 0.5 * (xx + yy) + apart;
        let turn = 0.5 * (2.0 * xy).atan2(xx - yy);
        let box_ = (length - 1.0).max(0.0).sqrt();
        [box_ * turn.cos(), box_ * turn.sin()]
    }

    /// The rays that leave the painting about a column and row.
    fn rays(&self, [column, row]: [f64; 2]) -> Rays<f64> {
        let pitch = self.painting.pitch;
        match self.view {
            View::Distant(view) => {
                Rays { per: [view.x / view.z / pitch, -view.y / view.z / pitch], grows: 0.0 }
            }
            View::Point(eye) => {
                let [x, y] = [self.painting.x(column), self.painting.y(row)];
                let per = [(eye.x - x) / eye.z / pitch, (y - eye.y) / eye.z / pitch];
                Rays { per, grows: -1.0 / eye.z }
            }
        }
    }
}

/// Right and up of the picture of a unit view.
fn axes(view: Vec3<f64>) -> [Vec3<f64>; 2] {
    let up = Vec3::new(-view.y * view.x, 1.0 - view.y * view.y, -view.y * view.z).normalised();
    [up.cross(view), up]
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
    let projection = Projection::new(view, grid)?;
    let heights = relief.map(|map| Heights::new(map, grid, run)).transpose()?;
    let heights = heights.as_ref();
    let (light, coverage) = projection.resample(light, coverage, heights, background, run)?;
    Ok((light, coverage, projection.picture))
}

/// Some rows of the picture.
struct Strip<'a> {
    projection: &'a Projection,
    /// `(3, y, x)` and `(y, x)` of the painting.
    light: &'a [f32],
    coverage: &'a [f32],
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
        let Self { projection, light, coverage, heights, background, row: first, .. } = self;
        let Self { mut seen, covered, .. } = self;
        let width = projection.picture.width;
        let Grid { width: columns, height: rows, .. } = projection.painting;
        let painting = Painting { light, coverage, width: columns, height: rows };
        for left in (0..width).step_by(SIDE) {
            let count = SIDE.min(width - left);
            for row in 0..covered.len() / width {
                let line = projection.line::<I>([left, first + row], count, painting, heights);
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
        [left, row]: [usize; 2],
        count: usize,
        painting: Painting<'_>,
        heights: Option<&Heights<'_>>,
    ) -> Sampled {
        let size = [painting.width as f64, painting.height as f64];
        // Places are counted from a whole pixel beside the run: single precision then resolves
        // 1e-4 of a pixel up to 80 degrees.
        let (column, row) = (left as f64, row as f64);
        let start = self.homogeneous(column, row);
        let next = self.homogeneous(column + 1.0, row);
        // The step of the divisor, 0 in parallel rays.
        let (one, more) = (start[2], next[2] - start[2]);
        let origin = [0, 1].map(|axis| (start[axis] / one).floor());
        let middle = column + 0.5 * (count as f64 - 1.0);
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
        let spread = self.spread(middle, row);
        let samples = (2.0 * spread[0].hypot(spread[1])).ceil().clamp(1.0, MOST_SAMPLES) as usize;
        let march = heights.map(|heights| {
            let last = self.painting_from_picture(column + count as f64 - 1.0, row);
            let ends = [[start[0] / one, start[1] / one], last];
            March::new(heights, origin, ends, spread, self.rays(origin))
        });
        let mut sums = [[0.0; SIDE]; 4];
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
                march.displace(&mut part, count);
            }
            for axis in 0..2 {
                let low = I::F32::of(0.0 - origin[axis]);
                let high = I::F32::of(size[axis] - 1.0 - origin[axis]);
                for lane in (0..SIDE).step_by(I::F32::WIDTH) {
                    let place = I::F32::load(&part[axis][lane..]).max(low).min(high);
                    let nearest = place.round();
                    let below = I::F32::select(place.lt(nearest), nearest - I::F32::one(), nearest);
                    below.store(&mut whole[axis][lane..]);
                    (place - below).store(&mut part[axis][lane..]);
                }
            }
            let origin = origin.map(|place| place as isize);
            for pixel in 0..count {
                let at = [0, 1].map(|axis| (origin[axis] + whole[axis][pixel] as isize) as usize);
                let tap = painting.between(at, [part[0][pixel], part[1][pixel]]);
                for (sum, tap) in sums.iter_mut().zip(tap) {
                    sum[pixel] += tap;
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
        let projection = Projection::parallel(Vec3::new(0.0, 0.0, 1.0), GRID);
        assert_eq!((projection.picture.width, projection.picture.height), (40, 30));
        assert_eq!(projection.picture_from_painting(3.0, -2.0), (3.0, -2.0));
        let light: Vec<f32> = (0..3600).map(|i| ((i * 7919) % 101) as f32).collect();
        let resampled =
            serially(|run| projection.resample(&light, &[1.0; 1200], None, [9.0; 3], run));
        assert_eq!(resampled.unwrap(), (light, vec![1.0; 1200]));
    }

    #[test]
    fn a_view_from_the_side_narrows_the_picture_and_keeps_radiance() {
        // 60 degrees to the right: half as wide.
        let view = Vec3::new(3.0_f64.sqrt() / 2.0, 0.0, 0.5);
        let projection = Projection::parallel(view, GRID);
        assert_eq!((projection.picture.width, projection.picture.height), (20, 30));
        let (light, coverage) = (vec![0.25; 3 * 1200], vec![1.0; 1200]);
        let (seen, covered) =
            serially(|run| projection.resample(&light, &coverage, None, [9.0; 3], run)).unwrap();
        assert!(seen.iter().all(|&value| (value - 0.25).abs() < 1e-6));
        assert!(covered.iter().all(|&value| (value - 1.0).abs() < 1e-6));
    }

    #[test]
    fn up_stays_up_and_the_far_side_shrinks_from_below() {
        let projection = Projection::parallel(Vec3::new(0.0, -0.6, 0.8), GRID);
        let (right, up) = projection.picture_from_painting(1.0, 1.0);
        assert!((right - 1.0).abs() < 1e-15 && (up - 0.8).abs() < 1e-15);
        assert_eq!((projection.picture.width, projection.picture.height), (40, 24));
    }

    const VIEWS: [[f64; 3]; 4] =
        [[0.1, 0.0, 1.0], [0.5, -0.2, 0.8], [-0.6, 0.7, 0.4], [0.9, 0.3, 0.13]];

    fn projected([x, y, z]: [f64; 3]) -> Projection {
        let grid = Grid::whole(150, 190, 0.3);
        Projection::parallel(Vec3::new(x, y, z).normalised(), grid)
    }

    #[test]
    fn a_ramp_stays_a_ramp_wherever_a_pixel_lies_inside() {
        for projection in VIEWS.map(projected) {
            let Grid { width, height, .. } = projection.painting;
            let ramp = |c: f64, r: f64| 0.01 * c - 0.007 * r;
            let pixels = (0..width * height).map(|i| ((i % width) as f64, (i / width) as f64));
            let plane: Vec<f32> = pixels.map(|(c, r)| ramp(c, r) as f32).collect();
            let coverage = vec![1.0; plane.len()];
            let (seen, covered) = serially(|run| {
                projection.resample(&plane.repeat(3), &coverage, None, [0.0; 3], run)
            })
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
                let spread = projection.spread(0.0, 0.0);
                let margin = [0, 1].map(|axis| 0.5 * spread[axis].abs().max(reach[axis]) + 1.0);
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
            let (seen, covered) = serially(|run| {
                projection.resample(&light.repeat(3), &coverage, None, [0.0; 3], run)
            })
            .unwrap();
            let sum = |map: &[f32]| map.iter().map(|&v| f64::from(v)).sum::<f64>();
            let [[a, b, _], [c, d, _], _] = projection.forward;
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
        let projection = Projection::parallel(Vec3::new(sin, 0.0, cos), grid);
        let plane: Vec<f32> = (0..1200).map(|i| (i % 400 % 2) as f32).collect();
        let (seen, _) = serially(|run| {
            projection.resample(&plane.repeat(3), &[1.0; 1200], None, [0.0; 3], run)
        })
        .unwrap();
        let width = projection.picture.width;
        // Interpolated, the stripes are a triangular wave of amplitude 1/2 and period 2, whose mean
        // over 3.73 pixels is what 0.27 pixels at its peak hold, at most 0.27 / 3.73 / 2 from 1/2.
        for &value in &seen[2..width - 2] {
            assert!((value - 0.5).abs() < 0.04, "{value}");
        }
    }

    #[test]
    fn in_perspective_a_pixel_is_where_its_ray_meets_the_plane() {
        let grid = Grid::whole(150, 190, 0.3);
        let plane = |i: usize| ((i % 150) as f64, (i / 150) as f64);
        let ramps = [0, 1, 2].map(|which| {
            let ramp = |i| [plane(i).0, plane(i).1, 1.0][which] as f32;
            (0..150 * 190).map(ramp).collect::<Vec<f32>>()
        });
        for eye in [[0.0, 0.0, 120.0], [60.0, -30.0, 90.0], [-80.0, 70.0, 60.0]] {
            let eye = Vec3::new(eye[0], eye[1], eye[2]);
            let projection = Projection::new(View::Point(eye), grid).unwrap();
            let picture = projection.picture;
            let (seen, covered) = serially(|run| {
                let coverage = vec![1.0; 150 * 190];
                projection.resample(&ramps.concat(), &coverage, None, [0.0; 3], run)
            })
            .unwrap();
            // A pinhole: the ray of a place on the plane through the painting's middle that faces the
            // eye; the corners of the painting's outline bound the picture.
            let axis = eye.normalised();
            let up = Vec3::new(0.0, 1.0, 0.0);
            let up = (up - axis.scale(up.dot(axis))).normalised();
            let right = up.cross(axis);
            let corners =
                [(-22.5, -28.5), (-22.5, 28.5), (22.5, -28.5), (22.5, 28.5)].map(|(x, y)| {
                    let point = Vec3::new(x, y, 0.0);
                    let depth = axis.dot(eye - point) / eye.length();
                    [right.dot(point) / depth, up.dot(point) / depth]
                });
            let middle = [0, 1].map(|a| {
                let ends = corners.iter().map(|corner| corner[a]);
                0.5 * (ends.clone().fold(f64::MAX, f64::min) + ends.fold(f64::MIN, f64::max))
            });
            let mut inner = 0;
            for row in 0..picture.height {
                for column in 0..picture.width {
                    let pixel = row * picture.width + column;
                    let [u, v] = [picture.x(column as f64), picture.y(row as f64)];
                    let through = right.scale(u + middle[0]) + up.scale(v + middle[1]);
                    let ray = through - eye;
                    let met = eye + ray.scale(-eye.z / ray.z);
                    let exact = [met.x / 0.3 + 74.5, 94.5 - met.y / 0.3];
                    let inside =
                        (3.0..146.0).contains(&exact[0]) && (3.0..186.0).contains(&exact[1]);
                    if inside {
                        inner += 1;
                        assert!((covered[pixel] - 1.0).abs() < 1e-6, "{exact:?}");
                        for axis in 0..2 {
                            let found = f64::from(seen[axis * covered.len() + pixel]);
                            // Samples at equal distances are not quite at those of a perspective:
                            // over 3 pixels the scale changes by less than 3 * 0.3 / 60, half of which is
                            // their mean's shift. Single precision adds 1e-4.
                            assert!((found - exact[axis]).abs() < 0.01, "{found} {exact:?}");
                        }
                    }
                }
            }
            assert!(inner > 5000, "{inner}");
        }
        assert!(Projection::new(View::Point(Vec3::new(24.0, 0.0, 3.0)), grid).is_err());
        let far = Projection::new(View::Point(Vec3::new(0.0, 0.0, 1e9)), grid).unwrap();
        assert!(far.displacement() < 1e-5);
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
                projection.resample(&light, &coverage, None, [0.5; 3], &run).unwrap()
            }));
        }
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
        assert!(answers[0].0.iter().all(|value| value.is_finite()));
    }
}
