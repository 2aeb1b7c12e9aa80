//! Where a ray from the eye meets a relief: relief mapping [@policarpo2005relief] by a linear search
//! from the highest to the lowest height that can be met, with exact intersections.
//!
//! Seen at a place of the painting's plane, a point of height h lies `p h` pixels from there, towards
//! the eye. The search visits the whole columns (or rows, whichever p crosses more of) that the ray passes
//! on its way down; between neighbouring samples the relief is straight, and so is the ray. What can be
//! met is known from the extremes of blocks of the relief, so that the search is a few steps long where
//! the relief is low, whatever it is elsewhere. Beyond the border the relief goes on at the border's
//! height. A height that is NaN counts as the lowest around it.

use super::{Line, SIDE};
use crate::error::Result;
use crate::geometry::Grid;
use crate::pixels::Run;

/// Pixels of a block's side.
const BLOCK: usize = 32;

/// A relief with the extremes of its blocks.
#[derive(Debug)]
pub(super) struct Heights<'a> {
    map: &'a [f32],
    size: [usize; 2],
    /// Lowest and highest height, row by row; of a block without any number, none.
    blocks: Vec<[f32; 2]>,
    columns: usize,
}

/// No height.
const NONE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

fn joined([low, high]: [f32; 2], [lower, higher]: [f32; 2]) -> [f32; 2] {
    [low.min(lower), high.max(higher)]
}

impl<'a> Heights<'a> {
    /// Of a relief `(y, x)` in mm.
    pub(super) fn new(map: &'a [f32], grid: Grid, run: &Run<'_>) -> Result<Self> {
        let Grid { width, height, .. } = grid;
        let columns = width.div_ceil(BLOCK);
        let rows = run.map(
            map.chunks(BLOCK * width).collect(),
            || (),
            |(), strip: &[f32]| {
                let mut blocks = vec![NONE; columns];
                for row in strip.chunks_exact(width) {
                    for (block, heights) in blocks.iter_mut().zip(row.chunks(BLOCK)) {
                        let finite = heights.iter().filter(|height| height.is_finite());
                        *block = finite.fold(*block, |range, &height| joined(range, [height; 2]));
                    }
                }
                blocks
            },
        )?;
        Ok(Self { map, size: [width, height], blocks: rows.concat(), columns })
    }

    /// Lowest and highest height between two columns and two rows, in painting pixels; of what lies
    /// beyond the border, that of the border.
    fn range(&self, [left, right]: [f64; 2], [top, bottom]: [f64; 2]) -> [f32; 2] {
        let block = |place: f64, axis: usize| {
            place.max(0.0).min(self.size[axis] as f64 - 1.0) as usize / BLOCK
        };
        let mut range = NONE;
        for row in block(top.floor(), 1)..=block(bottom.ceil(), 1) {
            let columns = block(left.floor(), 0)..=block(right.ceil(), 0);
            let blocks = &self.blocks[row * self.columns..][columns];
            range = blocks.iter().fold(range, |range, &block| joined(range, block));
        }
        range
    }
}

/// How far a place moves for each mm of height: in painting pixels to the right and down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rays<T> {
    /// At the origin.
    pub(super) per: [T; 2],
    /// Per pixel away from it: to a near eye, less.
    pub(super) grows: T,
}

/// The search for a run of places.
#[derive(Debug)]
pub(super) struct March<'a> {
    heights: &'a Heights<'a>,
    origin: [isize; 2],
    rays: Rays<f32>,
    low: f32,
    high: f32,
}

impl<'a> March<'a> {
    /// For places about an `origin`, a whole pixel, on a line between two `ends`, give or take half of
    /// `spread`.
    pub(super) fn new(
        heights: &'a Heights<'a>,
        origin: [f64; 2],
        ends: [[f64; 2]; 2],
        spread: [f64; 2],
        Rays { per, grows }: Rays<f64>,
    ) -> Self {
        let whole = heights.range([0.0, f64::INFINITY], [0.0, f64::INFINITY]);
        let [low, high] = if whole[0] <= whole[1] { whole } else { [0.0; 2] };
        let reached = |axis: usize| {
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for end in ends {
                let per = grows.mul_add(end[axis] - origin[axis], per[axis]);
                for height in [low, high] {
                    let place = per.mul_add(f64::from(height), end[axis]);
                    let beside = 0.5 * spread[axis].abs() + 2.0;
                    (least, most) = (least.min(place - beside), most.max(place + beside));
                }
            }
            [least, most]
        };
        let near = heights.range(reached(0), reached(1));
        let [low, high] = if near[0] <= near[1] { near } else { [low; 2] };
        let rays = Rays { per: per.map(|per| per as f32), grows: grows as f32 };
        Self { heights, origin: origin.map(|place| place as isize), rays, low, high }
    }

    /// Moves places, counted from the origin, to what is seen there.
    #[inline(always)]
    pub(super) fn displace(&self, places: &mut [Line; 2], count: usize) {
        debug_assert!(count <= SIDE);
        if self.high == 0.0 && self.low == 0.0 {
            return;
        }
        let [columns, rows] = places;
        for (column, row) in columns.iter_mut().zip(rows).take(count) {
            let place = [*column, *row];
            let per = [0, 1].map(|axis| self.rays.grows.mul_add(place[axis], self.rays.per[axis]));
            let height = self.met(place, per);
            *column = per[0].mul_add(height, place[0]);
            *row = per[1].mul_add(height, place[1]);
        }
    }

    /// The height of what is seen at a place.
    #[inline(always)]
    fn met(&self, place: [f32; 2], per: [f32; 2]) -> f32 {
        let major = usize::from(per[1].abs() > per[0].abs());
        let minor = 1 - major;
        if per[major] == 0.0 {
            // Straight below the eye no place moves.
            return 0.0;
        }
        let mm = 1.0 / per[major];
        let down = -per[major].signum();
        let top = per[major].mul_add(self.high, place[major]);
        // From as far as the border: beyond it no height is another.
        let [first, last] = [-1, self.heights.size[major].cast_signed()];
        let [first, last] = [first, last].map(|end| (end - self.origin[major]) as f32);
        let mut at = if down < 0.0 { top.ceil().min(last) } else { top.floor().max(first) };
        let mut above: Option<[f32; 2]> = None;
        loop {
            let height = (at - place[major]) * mm;
            let across = per[minor].mul_add(height, place[minor]);
            let gap = self.relief(major, at, across) - height;
            if gap >= 0.0 {
                return match above {
                    Some([over, short]) => (height - over).mul_add(short / (short - gap), over),
                    // Met beyond the border, at its height.
                    None => height + gap,
                };
            }
            if height <= self.low {
                return self.low;
            }
            above = Some([height, gap]);
            at += down;
        }
    }

    /// The relief on a whole column (row) at a fractional row (column).
    #[inline(always)]
    fn relief(&self, major: usize, at: f32, across: f32) -> f32 {
        let minor = 1 - major;
        let inside = |place: isize, axis: usize| {
            let last = self.heights.size[axis].cast_signed() - 1;
            (place + self.origin[axis]).clamp(0, last) as usize
        };
        let before = across.floor();
        let part = across - before;
        let (line, first, second) = (
            inside(at as isize, major),
            inside(before as isize, minor),
            inside(before as isize + 1, minor),
        );
        let width = self.heights.size[0];
        let map = |other: usize| {
            let place = if major == 0 { other * width + line } else { line * width + other };
            let height = self.heights.map[place];
            if height.is_finite() { height } else { self.low }
        };
        let (one, other) = (map(first), map(second));
        part.mul_add(other - one, one)
    }
}

#[cfg(test)]
mod tests {
    use super::super::seen_from;
    use super::*;
    use crate::geometry::View;
    use crate::math::Vec3;
    use crate::pixels::serially;

    /// Light and coverage of a painting seen over a relief, and the picture's grid.
    fn seen(relief: &[f32], grid: Grid, view: View, light: &[f32]) -> (Vec<f32>, Vec<f32>, Grid) {
        let (planes, coverage) = (light.repeat(3), vec![1.0; relief.len()]);
        serially(|run| {
            seen_from(view, (&planes, &coverage), grid, Some(relief), [0.0; 3], run).unwrap()
        })
    }

    /// Columns of a painting 0.01 apart: what is seen says where it lies.
    fn columns(grid: Grid) -> Vec<f32> {
        (0..grid.width * grid.height).map(|i| 0.01 * (i % grid.width) as f32).collect()
    }

    #[test]
    fn a_raised_plane_is_met_at_its_height() {
        let grid = Grid::whole(60, 50, 0.1);
        for (x, y) in [(0.6, 0.0), (-0.6, 0.0), (0.36, 0.48), (0.0, -0.6)] {
            let view = View::Distant(Vec3::new(x, y, 0.8));
            let (flat, _, _) = seen(&[0.0; 3000], grid, view, &columns(grid));
            for height in [0.3_f32, -0.2, 0.001] {
                let (moved, covered, picture) = seen(&[height; 3000], grid, view, &columns(grid));
                let (mut inner, expected) = (0, 0.01 * f64::from(height) * x / 0.8 / 0.1);
                for row in 0..picture.height {
                    for column in 0..picture.width {
                        let pixel = row * picture.width + column;
                        if (0.05..0.54).contains(&flat[pixel]) && covered[pixel] == 1.0 {
                            let error = f64::from(moved[pixel]) - f64::from(flat[pixel]) - expected;
                            assert!(error.abs() < 1e-5, "{x} {y} {height}: {error}");
                            inner += 1;
                        }
                    }
                }
                assert!(inner > 1000, "{inner}");
            }
        }
    }

    #[test]
    fn places_are_those_of_a_ray_marched_finely() {
        let grid = Grid::whole(90, 40, 0.1);
        // A relief along x, so steep that it hides parts of itself at 60 degrees.
        let height = |column: f64| 0.25 * (0.35 * column).sin() + 0.1 * (0.1 * column).cos();
        let relief: Vec<f32> = (0..3600).map(|i| height(f64::from(i % 90)) as f32).collect();
        let heights = serially(|run| Heights::new(&relief, grid, run)).unwrap();
        let straight = |column: f64| {
            let left = column.floor();
            height(left) + (column - left) * (height(left + 1.0) - height(left))
        };
        // To the right, to the left, and to an eye 10 mm above column 45.
        let distant = 3.0_f64.sqrt() / 0.1;
        for (per, grows) in [(distant, 0.0), (-distant, 0.0), (4.5, -0.1)] {
            let rays = Rays { per: [per, 0.0], grows };
            let ends = [[10.0, 20.0], [79.0, 20.0]];
            let march = March::new(&heights, [0.0, 0.0], ends, [0.0; 2], rays);
            let mut places = [[0.0; SIDE], [20.0; SIDE]];
            for (index, place) in places[0].iter_mut().enumerate() {
                *place = 12.3 + index as f32;
            }
            march.displace(&mut places, SIDE);
            let mut hidden = 0;
            for index in 0..SIDE {
                let place = 12.3 + index as f64;
                let slope = grows.mul_add(place, per);
                // From the eye down: the first place at which the ray is in the relief.
                let mut z = 0.36;
                while z > straight(slope.mul_add(z, place)) {
                    z -= 1e-5;
                }
                let (found, expected) = (f64::from(places[0][index]), slope.mul_add(z, place));
                // The march is right to 1e-5 mm over the sine of the angle between ray and relief;
                // where they graze each other, to a tenth of a pixel.
                assert!((found - expected).abs() < 0.1, "{per} {index}: {found} for {expected}");
                let before = f64::from(places[0][index.max(1) - 1]);
                hidden += usize::from((found - before - 1.0).abs() > 3.0);
            }
            assert!(hidden >= 1 || grows != 0.0, "{per}: {hidden}");
        }
    }

    #[test]
    fn no_height_stops_it() {
        let view = View::Distant(Vec3::new(0.5, -0.6, 0.3).normalised());
        for (width, height) in [(1, 1), (1, 30), (30, 1), (31, 33), (70, 40)] {
            let grid = Grid::whole(width, height, 0.1);
            for odd in [f32::NAN, f32::INFINITY, 1e30, -1e30, f32::MAX] {
                let relief: Vec<f32> = (0..width * height)
                    .map(|i| if i % 7 == 3 { odd } else { 0.4 * (i * 7919 % 13) as f32 / 13.0 })
                    .collect();
                for view in [view, View::Point(Vec3::new(3.0, 2.0, 12.0))] {
                    let (moved, covered, _) = seen(&relief, grid, view, &vec![1.0; width * height]);
                    let cover = covered.repeat(3);
                    assert!(moved.iter().zip(cover).all(|(&v, c)| (v - c).abs() < 1e-5));
                    assert!(covered.iter().all(|&v| (0.0..=1.0 + 1e-6).contains(&v)));
                }
            }
        }
    }
}
