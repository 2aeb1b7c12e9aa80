//! Where a ray from the eye meets a relief: relief mapping [@policarpo2005relief] by a linear search
//! from the highest to the lowest height that can be met, with exact intersections.
//!
//! Seen at a place of the painting's plane, a point of height h lies `p h` pixels from there, towards
//! the eye. The search visits the whole columns (or rows, whichever p crosses more of) that the ray passes
//! on its way down; between neighbouring samples the relief is straight, and so is the ray. What can be
//! met is known from the extremes of blocks of the relief, so that the search is a few steps long where
//! the relief is low, whatever it is elsewhere. Beyond the border the relief goes on at the border's
//! height. A height that is NaN counts as the lowest around it.

use super::projection::Rays;
use crate::error::Result;
use crate::geometry::Grid;
use crate::math::lanes::MAX_LANES;
use crate::math::{Mask, Real};
use crate::pixels::Run;

/// Rows and columns that are resampled together: what they see of the painting stays in the
/// second-level cache whatever the direction of the tilt.
pub(super) const SIDE: usize = 64;

pub(super) type Line = [f32; SIDE];

/// 0, 1, 2 ...
pub(super) const INDICES: Line = {
    let mut indices = [0.0; SIDE];
    let mut index = 1;
    while index < SIDE {
        indices[index] = indices[index - 1] + 1.0;
        index += 1;
    }
    indices
};

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
    /// Of the whole relief; 0 where it has no number.
    whole: [f32; 2],
}

/// Added to a whole number between -2^22 and 2^22 it makes a number whose bits are those of it and the
/// number's sum.
pub(super) const WHOLE: f32 = 12_582_912.0;

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
        let blocks = rows.concat();
        let whole = blocks.iter().copied().fold(NONE, joined);
        let whole = if whole[0] <= whole[1] { whole } else { [0.0; 2] };
        Ok(Self { map, size: [width, height], blocks, columns, whole })
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

/// The search for a run of places.
#[derive(Debug)]
pub(super) struct March<'a> {
    heights: &'a Heights<'a>,
    origin: [isize; 2],
    rays: Rays<f32>,
    /// The axis along which places move most.
    major: usize,
    /// Where no place that can be met is near the border, or too far away: the origin's number, less the
    /// bits of [`WHOLE`].
    corner: Option<usize>,
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
        let [low, high] = heights.whole;
        let reached = |axis: usize| {
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for end in ends {
                let per = grows.mul_add(end[axis] - origin[axis], per[axis]);
                for height in [low, high] {
                    let place = per.mul_add(f64::from(height), end[axis]);
                    let beside = 0.5 * spread[axis].abs() + 3.0;
                    (least, most) = (least.min(place - beside), most.max(place + beside));
                }
            }
            [least, most]
        };
        let reached = [reached(0), reached(1)];
        let near = heights.range(reached[0], reached[1]);
        let within = |axis: usize| {
            let [least, most] = reached[axis];
            least >= 0.0 && most <= heights.size[axis] as f64 - 2.0
        };
        let [width, _] = heights.size;
        let far = |axis: usize| {
            let [least, most] = reached[axis];
            (least - origin[axis]).abs().max((most - origin[axis]).abs())
        };
        let near_by = (far(1) + 2.0) * width as f64 + far(0) + 2.0 < f64::from(1 << 22);
        let corner = (within(0) && within(1) && near_by).then(|| {
            let number = origin[1] as usize * width + origin[0] as usize;
            number.wrapping_sub(WHOLE.to_bits() as usize)
        });
        let [low, high] = if near[0] <= near[1] { near } else { [low; 2] };
        let rays = Rays { per: per.map(|per| per as f32), grows: grows as f32 };
        let middle = [0, 1].map(|axis| {
            let place = 0.5 * (ends[0][axis] + ends[1][axis]) - origin[axis];
            grows.mul_add(place, per[axis]).abs()
        });
        let major = usize::from(middle[1] > middle[0]);
        Self { heights, origin: origin.map(|place| place as isize), rays, major, corner, low, high }
    }

    /// Moves the first places, counted from the origin, to what is seen there.
    #[inline(always)]
    pub(super) fn displace<R: Real<Scalar = f32>>(&self, places: &mut [Line; 2], count: usize) {
        if self.high == 0.0 && self.low == 0.0 {
            return;
        }
        let [columns, rows] = places;
        for lane in (0..count).step_by(R::WIDTH) {
            let place = [R::load(&columns[lane..]), R::load(&rows[lane..])];
            let [grows, across, down] =
                [self.rays.grows, self.rays.per[0], self.rays.per[1]].map(R::splat);
            let per = [grows.mul_add(place[0], across), grows.mul_add(place[1], down)];
            let there = R::load(&INDICES[lane..]).lt(R::of(count as f64));
            let height = self.met(place, per, there);
            per[0].mul_add(height, place[0]).store(&mut columns[lane..]);
            per[1].mul_add(height, place[1]).store(&mut rows[lane..]);
        }
    }

    /// The height of what is seen at places that are `there`.
    #[inline(always)]
    fn met<R: Real<Scalar = f32>>(&self, place: [R; 2], per: [R; 2], there: R::Mask) -> R {
        let (major, minor) = (self.major, 1 - self.major);
        // Straight below the eye a place moves by nothing, whatever the height.
        let tiny = R::of(1e-6);
        let towards = R::select(per[major].abs().lt(tiny), tiny, per[major]);
        let (mm, right) = (towards.recip(), towards.gt(R::zero()));
        let down = R::select(right, -R::one(), R::one());
        let top = towards.mul_add(R::splat(self.high), place[major]);
        // From as far as the border: beyond it no height is another.
        let [first, last] = [-1, self.heights.size[major].cast_signed()];
        let [first, last] = [first, last].map(|end| R::splat((end - self.origin[major]) as f32));
        let nearest = top.round();
        let above = R::select(nearest.lt(top), nearest + R::one(), nearest).min(last);
        let below = R::select(top.lt(nearest), nearest - R::one(), nearest).max(first);
        let mut at = R::select(right, above, below);
        let low = R::splat(self.low);
        let (mut met, mut sought) = (low, there);
        let mut before: Option<[R; 2]> = None;
        for _ in 0..self.heights.size[major] + 3 {
            let height = (at - place[major]) * mm;
            let gap = self.relief(at, per[minor].mul_add(height, place[minor])) - height;
            let hit = match before {
                Some([over, short]) => (height - over).mul_add(short / (short - gap), over),
                // Met beyond the border, at its height.
                None => height + gap,
            };
            met = R::select(sought & gap.ge(R::zero()), hit, met);
            sought = sought & gap.lt(R::zero()) & low.lt(height);
            if !sought.any() {
                break;
            }
            before = Some([height, gap]);
            at = at + down;
        }
        met
    }

    /// The relief on whole columns (rows) at fractional rows (columns).
    #[inline(always)]
    fn relief<R: Real<Scalar = f32>>(&self, at: R, across: R) -> R {
        let nearest = across.round();
        let before = R::select(across.lt(nearest), nearest - R::one(), nearest);
        let (mut line, mut first) = ([0.0; MAX_LANES], [0.0; MAX_LANES]);
        let (mut one, mut other) = ([0.0; MAX_LANES], [0.0; MAX_LANES]);
        let [width, height] = self.heights.size;
        let [apart, next] = if self.major == 0 { [1, width] } else { [width, 1] };
        let (of_line, of_place) = (self.origin[self.major], self.origin[1 - self.major]);
        if let Some(corner) = self.corner {
            // Whole numbers below 2^22, exact in single precision: the low bits of a sum.
            let place = at.mul_add(R::of(apart as f64), before * R::of(next as f64));
            (place + R::splat(WHOLE)).store(&mut line);
            for lane in 0..R::WIDTH {
                let place = (line[lane].to_bits() as usize).wrapping_add(corner);
                // Lanes behind the last place may lie anywhere.
                let map = |place: usize| self.heights.map.get(place).copied().unwrap_or(f32::NAN);
                (one[lane], other[lane]) = (map(place), map(place.wrapping_add(next)));
            }
        } else {
            let [lines, places] = if self.major == 0 { [width, height] } else { [height, width] };
            let kept = |place: isize, size: usize| place.clamp(0, size.cast_signed() - 1) as usize;
            at.store(&mut line);
            before.store(&mut first);
            for lane in 0..R::WIDTH {
                let line = kept(line[lane] as isize + of_line, lines) * apart;
                let place = first[lane] as isize + of_place;
                one[lane] = self.heights.map[line + kept(place, places) * next];
                other[lane] = self.heights.map[line + kept(place + 1, places) * next];
            }
        }
        let low = R::splat(self.low);
        let known = |height: R| R::select(height.is_finite(), height, low);
        let (one, other) = (known(R::load(&one)), known(R::load(&other)));
        (across - before).mul_add(other - one, one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

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
            march.displace::<f32>(&mut places, SIDE);
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
            assert!(hidden >= 2 || grows != 0.0, "{per}: {hidden}");
        }
    }
}
