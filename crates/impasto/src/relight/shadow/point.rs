//! Cast shadows of a point light by marching each pixel's ray over the relief, with blocks of a maximum
//! map skipped: maximum mipmaps [@tevs2008maximum] of one level.
//!
//! From the pixel towards the light, one row (or column) per step, heights interpolated across; in
//! shadow if some height exceeds the ray. The walk ends where the ray leaves the picture or rises
//! above the highest point. It jumps over a block of the picture whose highest point the ray, which
//! only rises, has passed: the steps that it leaves out find nothing.

use super::lines::ABYSS;
use crate::error::Result;
use crate::geometry::Grid;
use crate::math::{Real, Vec3};
use crate::pixels::{Run, TILE, zeros};

/// Pixels of one piece of work from which the relief is walked towards a near light, each over up
/// to as many pixels as the picture is wide.
const WALKS: usize = 256;

/// Pixels of a side of a block.
const SIDE: usize = 16;

/// Highest points of blocks of pixels.
struct Highest {
    blocks: Vec<f32>,
    columns: usize,
    all: f64,
}

impl Highest {
    fn new(relief: &[f32], grid: Grid, run: &Run<'_>) -> Result<Self> {
        let Grid { width, height, .. } = grid;
        let mut all = ABYSS;
        run.in_turn(relief.chunks(TILE), |part| {
            all = part.iter().copied().fold(all, higher);
        })?;
        let columns = width.div_ceil(SIDE);
        let rows = run.map(
            (0..height.div_ceil(SIDE)).collect(),
            || (),
            |(), row| {
                let mut line = vec![ABYSS; columns];
                // Interpolation reaches a pixel further.
                for row in row * SIDE..height.min((row + 1) * SIDE + 1) {
                    let row = &relief[row * width..][..width];
                    for (block, highest) in line.iter_mut().enumerate() {
                        let values = &row[block * SIDE..width.min((block + 1) * SIDE + 1)];
                        *highest = values.iter().copied().fold(*highest, higher);
                    }
                }
                line
            },
        )?;
        Ok(Self { blocks: run.joined(rows)?, columns, all: all.into() })
    }

    /// Steps that lead through a block below the ray, from a place in the picture.
    fn below(&self, ray: f64, [x, y]: [f64; 2], [across, down]: [f64; 2]) -> f64 {
        let (column, row) = (x as usize / SIDE, y as usize / SIDE);
        let highest = f64::from(self.blocks[row * self.columns + column]);
        // Interpolated heights exceed the highest by rounding only.
        if ray <= highest + highest.abs() * 1e-12 {
            return 0.0;
        }
        let left = |place: f64, block: usize, step: f64| {
            let (low, high) = ((block * SIDE) as f64, ((block + 1) * SIDE) as f64);
            if step > 0.0 {
                (high - place) / step
            } else if step < 0.0 {
                (place - low) / -step
            } else {
                f64::INFINITY
            }
        };
        // A step less than the last that is in the block: rounding of the place changes nothing.
        (left(x, column, across).min(left(y, row, down)) - 1.0).floor().max(0.0)
    }
}

/// The higher of two heights; a height that is NaN is none.
fn higher(highest: f32, height: f32) -> f32 {
    Real::max(height, highest)
}

/// Visibility of a light, 1 or 0 per pixel, `(y, x)`.
pub(super) fn near(
    relief: &[f32],
    grid: Grid,
    light: Vec3<f64>,
    run: &Run<'_>,
) -> Result<Vec<f32>> {
    let highest = Highest::new(relief, grid, run)?;
    let mut visible = zeros(relief.len())?;
    run.for_each(
        visible.chunks_mut(WALKS).enumerate().collect(),
        || (),
        |(), (piece, visible)| {
            for (index, visible) in visible.iter_mut().enumerate() {
                let pixel = piece * WALKS + index;
                let (row, column) = (pixel / grid.width, pixel % grid.width);
                let lit = !relief[pixel].is_finite()
                    || !hidden(relief, grid, light, row, column, &highest);
                *visible = f32::from(u8::from(lit));
            }
        },
    )?;
    Ok(visible)
}

/// Whether the relief stands between a pixel and a point light.
fn hidden(
    relief: &[f32],
    grid: Grid,
    light: Vec3<f64>,
    row: usize,
    column: usize,
    highest: &Highest,
) -> bool {
    let Grid { width, height, pitch, .. } = grid;
    let start = f64::from(relief[row * width + column]);
    let rise = light.z - start;
    // Where the light stands, in pixels from here.
    let across = (light.x - grid.x(column as f64)) / pitch;
    let down = -(light.y - grid.y(row as f64)) / pitch;
    let steps = across.abs().max(down.abs());
    if rise <= 0.0 {
        return true;
    }
    let (across, down, rise) = (across / steps, down / steps, rise / steps);
    let mut step = 1.0;
    while step < steps {
        let ray = rise.mul_add(step, start);
        let (x, y) = (across.mul_add(step, column as f64), down.mul_add(step, row as f64));
        let outside = x < 0.0 || y < 0.0 || x > (width - 1) as f64 || y > (height - 1) as f64;
        if outside || ray > highest.all {
            return false;
        }
        let skipped = highest.below(ray, [x, y], [across, down]);
        if skipped > 0.0 {
            step += skipped;
            continue;
        }
        // One of the two coordinates is whole: the height between two neighbours of a line.
        let (x0, y0) = (x.floor(), y.floor());
        let first = y0 as usize * width + x0 as usize;
        let (part, second) = if x - x0 > y - y0 {
            (x - x0, first + usize::from(x0 as usize + 1 < width))
        } else {
            (y - y0, first + if y0 as usize + 1 < height { width } else { 0 })
        };
        let (first, second) = (f64::from(relief[first]), f64::from(relief[second]));
        let obstacle = if part > 0.0 { part.mul_add(second, (1.0 - part) * first) } else { first };
        if obstacle > ray {
            return true;
        }
        step += 1.0;
    }
    false
}
