//! Cast shadows: which pixels see a light over the relief.
//!
//! **Distant light.** The rows (or columns, whichever the light's azimuth is closer to crossing)
//! are walked towards darkness along *sheared lines*: line c runs through `column = c + m * step`,
//! one row per step, m in [-1, 1]. On it the height is interpolated linearly between the two
//! neighbouring pixels of the row. With k the fall of the light's ray per step, the shadow's upper
//! surface follows `M <- max(M - k, v)`, carried from sample to sample: O(1) per pixel at any
//! elevation, and no large number `k * step` to lose digits against. The depth below that surface,
//! `D = (M - k) - v`, is interpolated back to the pixel's centre between the two lines beside it;
//! the pixel is in shadow where `D > 0`. This is the definition of the shadow, not an approximation
//! of a ray march.
//!
//! **Point light.** From the pixel towards the light, one row (or column) per step, heights
//! interpolated across; in shadow if some height exceeds the ray. The walk ends where the ray
//! leaves the picture or rises above the highest point.
//!
//! Beyond the border the relief goes on at the border's height for one pixel and throws no
//! shadow after that. A height that is NaN throws no shadow and receives none.

use crate::error::{Error, Result};
use crate::geometry::{Grid, Light};
use crate::height::transposed;
use crate::math::{Isa, Kernel, Real, Vec3};
use crate::pixels::{Run, TILE};

/// Lines of one piece of work. Fixed, though no result depends on it: 2 KiB per row of the strip
/// keep the shadow surface and the row in the first-level cache.
const STRIP: usize = 512;

/// Pixels of one piece of work from which the relief is walked towards a near light, each over up
/// to as many pixels as the picture is wide.
const WALKS: usize = 256;

/// Far below any painting: what throws no shadow. Finite, so that interpolating towards it gives
/// no NaN.
const ABYSS: f32 = -1e30;

/// Visibility of a light, 1 or 0 per pixel, `(y, x)`.
///
/// `relief` is the height in mm, `(y, x)`, on `grid`.
///
/// # Errors
/// If the sizes disagree, the light stands behind the painting, or the caller cancels.
pub fn cast_shadows(relief: &[f32], grid: Grid, light: &Light, run: &Run<'_>) -> Result<Vec<f32>> {
    if relief.len() != grid.width * grid.height || relief.is_empty() {
        return Err(Error::argument("height", "its size is not that of the painting"));
    }
    if light.direction().z <= 0.0 || !light.direction().length_squared().is_finite() {
        return Err(Error::geometry("light", "it stands behind the painting"));
    }
    match *light {
        Light::Distant(direction) => distant(relief, grid, direction, run),
        Light::Point { position, .. } => near(relief, grid, position, run),
    }
}

fn distant(relief: &[f32], grid: Grid, light: Vec3<f64>, run: &Run<'_>) -> Result<Vec<f32>> {
    let Grid { width, height, pitch, .. } = grid;
    // Rows run down, y runs up.
    let (across, down) = (light.x, -light.y);
    if across == 0.0 && down == 0.0 {
        return run.filled(1.0, relief.len());
    }
    if across.abs() > down.abs() {
        let relief = transposed(relief, width, height, run)?;
        let visible = sweep(&relief, height, width, Ray::new(down, across, light.z, pitch), run)?;
        return transposed(&visible, height, width, run);
    }
    sweep(relief, width, height, Ray::new(across, down, light.z, pitch), run)
}

/// A distant light as the sweep sees it.
#[derive(Clone, Copy)]
struct Ray {
    /// Columns per row walked, away from the light.
    shear: f64,
    /// Fall of the ray per row walked, in the unit of the height.
    fall: f32,
    /// Whether the light stands towards larger rows, so that the walk goes up.
    upwards: bool,
}

impl Ray {
    /// `along` is the light's component in the direction of the walk.
    fn new(across: f64, along: f64, z: f64, pitch: f64) -> Self {
        let shear = -across / along.abs();
        let fall = z * pitch * shear.mul_add(shear, 1.0).sqrt() / across.hypot(along);
        Self { shear, fall: fall as f32, upwards: along > 0.0 }
    }

    /// Whole and fractional columns by which lines are displaced after so many rows.
    fn displacement(&self, step: usize) -> (isize, f32) {
        let shift = self.shear * step as f64;
        let whole = shift.floor();
        (whole as isize, (shift - whole) as f32)
    }
}

/// Visibility by rows: see the head of this module.
fn sweep(relief: &[f32], width: usize, height: usize, ray: Ray, run: &Run<'_>) -> Result<Vec<f32>> {
    // Lines that meet the picture anywhere, one more on each side for interpolation back.
    let (last, _) = ray.displacement(height - 1);
    let (first_line, last_line) = ((-last).min(0) - 2, width.cast_signed() - last.min(0) + 1);
    let lines = (last_line - first_line) as usize;
    let row_at = |step: usize| if ray.upwards { height - 1 - step } else { step };

    let strips: Vec<usize> = (0..lines).step_by(STRIP).collect();
    let depths = run.map(
        strips,
        || [0.0; STRIP + 32],
        |padded, start| {
            let mut surface = [ABYSS; STRIP];
            let mut depth = vec![0.0; STRIP * height];
            for (step, depth) in depth.chunks_exact_mut(STRIP).enumerate() {
                let (whole, fraction) = ray.displacement(step);
                let row = &relief[row_at(step) * width..][..width];
                let left = first_line + start.cast_signed() + whole;
                extended(row, left, padded);
                run.level.run(Advance {
                    padded,
                    fraction,
                    fall: ray.fall,
                    surface: &mut surface,
                    depth,
                });
            }
            depth
        },
    )?;

    let mut visible = vec![0.0; relief.len()];
    run.for_each(
        visible.chunks_exact_mut(width).enumerate().collect(),
        || vec![0.0; lines + STRIP],
        |sheared, (row, visible)| {
            let step = row_at(row);
            let (whole, fraction) = ray.displacement(step);
            for (strip, depth) in depths.iter().enumerate() {
                sheared[strip * STRIP..][..STRIP].copy_from_slice(&depth[step * STRIP..][..STRIP]);
            }
            // Pixel j lies between line j - whole - 1 (left of it) and line j - whole.
            let left = (-whole - 1 - first_line) as usize;
            let pairs = sheared[left..].iter().zip(&sheared[left + 1..]);
            for (visible, (&before, &after)) in visible.iter_mut().zip(pairs) {
                let depth = fraction.mul_add(before, (1.0 - fraction) * after);
                *visible = if depth > 0.0 { 0.0 } else { 1.0 };
            }
        },
    )?;
    Ok(visible)
}

/// A piece of a row from column `left` on; the border's height one pixel beyond it, the abyss
/// after that.
#[inline]
fn extended(row: &[f32], left: isize, out: &mut [f32]) {
    let width = row.len().cast_signed();
    for (index, out) in out.iter_mut().enumerate() {
        let column = left + index.cast_signed();
        *out = if column < -1 || column > width {
            ABYSS
        } else {
            row[column.clamp(0, width - 1) as usize]
        };
    }
}

/// One row's step of all lines of a strip.
struct Advance<'a> {
    padded: &'a [f32],
    fraction: f32,
    fall: f32,
    surface: &'a mut [f32],
    depth: &'a mut [f32],
}

impl Kernel for Advance<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self) {
        let (fraction, fall) = (I::F32::splat(self.fraction), I::F32::splat(self.fall));
        let rest = I::F32::splat(1.0 - self.fraction);
        for lane in (0..STRIP).step_by(I::F32::WIDTH) {
            let left = I::F32::load(&self.padded[lane..]);
            let right = I::F32::load(&self.padded[lane + 1..]);
            // A right neighbour without weight may be NaN.
            let height =
                if self.fraction > 0.0 { right.mul_add(fraction, left * rest) } else { left };
            let surface = I::F32::load(&self.surface[lane..]) - fall;
            let depth = surface - height;
            I::F32::keep(depth.le(depth), depth).store(&mut self.depth[lane..]);
            // Where the height is NaN, `max` keeps the surface.
            height.max(surface).store(&mut self.surface[lane..]);
        }
    }
}

fn near(relief: &[f32], grid: Grid, light: Vec3<f64>, run: &Run<'_>) -> Result<Vec<f32>> {
    let mut highest = ABYSS;
    run.in_turn(relief.chunks(TILE), |part| {
        highest = part.iter().copied().fold(highest, Real::max);
    })?;
    let mut visible = vec![0.0; relief.len()];
    run.for_each(
        visible.chunks_mut(WALKS).enumerate().collect(),
        || (),
        |(), (piece, visible)| {
            for (index, visible) in visible.iter_mut().enumerate() {
                let pixel = piece * WALKS + index;
                let (row, column) = (pixel / grid.width, pixel % grid.width);
                let lit = !relief[pixel].is_finite()
                    || !hidden(relief, grid, light, row, column, highest.into());
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
    highest: f64,
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
        if outside || ray > highest {
            return false;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Level;
    use crate::pixels::serially;

    const GRID: Grid = Grid::whole(61, 47, 0.1);

    fn distant(x: f64, y: f64, z: f64) -> Light {
        Light::Distant(Vec3::new(x, y, z).normalised())
    }

    /// A wall 0.5 mm high, one column wide.
    fn wall() -> Vec<f32> {
        (0..GRID.width * GRID.height)
            .map(|pixel| if pixel % GRID.width == 30 { 0.5 } else { 0.0 })
            .collect()
    }

    #[test]
    fn a_wall_throws_a_shadow_as_long_as_its_height_over_the_tangent() {
        // tan = 0.6 / 0.8: 0.5 mm throw 0.667 mm, six whole pixels of 0.1 mm.
        for (x, shaded) in [(0.8, 24..30), (-0.8, 31..37)] {
            let light = distant(x, 0.0, 0.6);
            let visible = serially(|run| cast_shadows(&wall(), GRID, &light, run)).unwrap();
            for (pixel, &seen) in visible.iter().enumerate() {
                let expected = !shaded.contains(&(pixel % GRID.width));
                assert_eq!(seen, f32::from(u8::from(expected)), "{pixel}");
            }
        }
    }

    #[test]
    fn walking_rows_is_walking_columns_of_the_transposed_picture() {
        let transposed_grid = Grid::whole(GRID.height, GRID.width, GRID.pitch);
        let relief: Vec<f32> =
            (0..GRID.width * GRID.height).map(|i| ((i * 7919) % 101) as f32 * 1e-3).collect();
        serially(|run| {
            // Transposing rows and columns swaps x with -y.
            let one = cast_shadows(&relief, GRID, &distant(0.9, -0.3, 0.2), run).unwrap();
            let other = transposed(&relief, GRID.width, GRID.height, run).unwrap();
            let other =
                cast_shadows(&other, transposed_grid, &distant(0.3, -0.9, 0.2), run).unwrap();
            let other =
                transposed(&other, transposed_grid.width, transposed_grid.height, run).unwrap();
            assert_eq!(one, other);
            assert!(one.contains(&0.0) && one.contains(&1.0));
        });
    }

    #[test]
    fn a_far_point_light_throws_the_shadow_of_a_distant_one_along_rows() {
        let near = Light::Point { position: Vec3::new(8e6, 0.0, 6e6), falloff: true };
        serially(|run| {
            let one = cast_shadows(&wall(), GRID, &near, run).unwrap();
            let other = cast_shadows(&wall(), GRID, &distant(0.8, 0.0, 0.6), run).unwrap();
            assert_eq!(one, other);
        });
    }

    #[test]
    fn every_level_gives_the_same_shadows_and_nan_throws_none() {
        let mut relief: Vec<f32> =
            (0..GRID.width * GRID.height).map(|i| ((i * 7919) % 997) as f32 * 2e-4).collect();
        relief[20 * GRID.width + 30] = f32::NAN;
        let mut answers = Vec::new();
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            answers.push(serially(|run| {
                let run = Run { level, ..*run };
                cast_shadows(&relief, GRID, &distant(0.5, 0.8, 0.3), &run).unwrap()
            }));
        }
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));

        let mut flat = vec![0.0; relief.len()];
        flat[20 * GRID.width + 30] = f32::NAN;
        for light in [distant(0.8, 0.0, 0.1), distant(0.5, -0.8, 0.1)] {
            let visible = serially(|run| cast_shadows(&flat, GRID, &light, run)).unwrap();
            assert!(visible.iter().all(|&seen| seen == 1.0));
        }
    }

    #[test]
    fn a_light_overhead_throws_none_and_one_behind_is_refused() {
        serially(|run| {
            let visible = cast_shadows(&wall(), GRID, &distant(0.0, 0.0, 1.0), run).unwrap();
            assert!(visible.iter().all(|&seen| seen == 1.0));
            assert!(cast_shadows(&wall(), GRID, &distant(1.0, 0.0, 0.0), run).is_err());
        });
    }
}
