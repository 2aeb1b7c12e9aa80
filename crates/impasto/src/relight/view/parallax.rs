//! Parallax of a relief in a slanted view: relief mapping [@policarpo2005relief] with exact
//! intersections, by a sweep along the sheared lines of the view.
//!
//! A ray to the eye that leaves the painting's plane at q crosses the relief where a sample at step s
//! of height v appears at `q = s + k v` steps away from the eye, k being the tangent of the view's angle
//! from the normal over a step's width. The lines are walked from the eye's side on. Between
//! neighbouring samples the relief is straight, and so is q: each segment that goes beyond the farthest q
//! reached so far is seen there; one that goes back is hidden. O(1) per pixel at any angle. Places
//! beyond the border that the relief moves out of the picture are lost; places that no part of the
//! relief covers show the background. A height that is NaN counts as that of the sample before it.

use crate::error::Result;
use crate::geometry::Grid;
use crate::math::{Real, Vec3};
use crate::pixels::Run;
use crate::relight::shadow::lines::{ABYSS, LineScratch, Lines};

/// Lines of one piece of work.
const STRIP: usize = 256;

/// Rows and columns that are resampled together.
const SIDE: usize = 64;

/// Pixels of displacement below which a relief is taken as flat.
const NOTICEABLE: f64 = 0.1;

/// Light `(3, y, x)` and coverage `(y, x)`.
type Light = (Vec<f32>, Vec<f32>);

/// The painting's light as a distant eye along the unit `view` sees it over the relief, at the places
/// of the painting's plane: what [`super::Projection`] then foreshortens. None: no height moves a pixel
/// by a tenth of one.
///
/// # Errors
/// If the caller cancels.
pub fn displaced(
    (light, coverage): (&[f32], &[f32]),
    relief: &[f32],
    grid: Grid,
    view: Vec3<f64>,
    run: &Run<'_>,
) -> Result<Option<Light>> {
    let slant = view.x.hypot(view.y) / view.z;
    let highest = relief
        .iter()
        .filter(|height| height.is_finite())
        .fold(0.0, |most: f32, height| most.max(height.abs()));
    if slant == 0.0 || slant * f64::from(highest) < NOTICEABLE * grid.pitch {
        return Ok(None);
    }
    let lines = Lines::new(relief, grid, [view.x, view.y]);
    let per = (slant / lines.step) as f32;
    let (first, count) = lines.all();
    let strips =
        run.map((0..count).step_by(STRIP).collect(), LineScratch::default, |scratch, start| {
            shifts(&lines, first + start.cast_signed(), per, scratch)
        })?;
    let moves: Vec<_> = (0..lines.steps).map(|step| lines.displacement(step)).collect();
    let shift = |step: usize, column: usize| {
        let (whole, part) = moves[step];
        let after = (column.cast_signed() - whole - first) as usize;
        let at = |line: usize| strips[line / STRIP][step * STRIP + line % STRIP];
        let (before, after) = (at(after - 1), at(after));
        // Beside an edge that hides something the nearer line alone decides.
        if (before - after).abs() < 1.0 {
            part.mul_add(before, (1.0 - part) * after)
        } else if part > 0.5 {
            before
        } else {
            after
        }
    };
    let Grid { width, height, .. } = grid;
    let pixels = width * height;
    let (mut seen, mut covered) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let mut planes: Vec<_> =
        seen.chunks_mut(pixels).map(|plane| plane.chunks_mut(SIDE * width)).collect();
    let pieces = covered.chunks_mut(SIDE * width).enumerate().map(|(index, covered)| {
        let seen: Vec<_> = planes.iter_mut().filter_map(Iterator::next).collect();
        (index * SIDE, seen, covered)
    });
    run.for_each(
        pieces.collect(),
        || (),
        |(), (top, mut seen, covered)| {
            // Square pieces: lines may run along either side.
            for left in (0..width).step_by(SIDE) {
                for row in 0..covered.len() / width {
                    for column in left..width.min(left + SIDE) {
                        let (along, across) = if lines.transposed {
                            (column, top + row)
                        } else {
                            (top + row, column)
                        };
                        let step = lines.row_at(along);
                        let shift = shift(step, across);
                        if shift.is_finite() {
                            let values =
                                sampled((light, coverage), &lines, width, (step, across), shift);
                            let pixel = row * width + column;
                            covered[pixel] = values[3];
                            for (plane, value) in seen.iter_mut().zip(values) {
                                plane[pixel] = value;
                            }
                        }
                    }
                }
            }
        },
    )?;
    Ok(Some((seen, covered)))
}

/// For the places q of some lines, by how many steps what is seen there lies before it; NaN: nothing.
fn shifts(lines: &Lines<'_>, start: isize, per: f32, scratch: &mut LineScratch) -> Vec<f32> {
    let mut shifts = vec![f32::NAN; STRIP * lines.steps];
    // The last sample: place q and height; the farthest q.
    let mut last = [[f32::NAN; 3]; STRIP];
    lines.walk((start, STRIP), 0..lines.steps, scratch, |step, part, row| {
        let here = step as f32;
        for (line, last) in last.iter_mut().enumerate() {
            let (left, right) = (row[line], row[line + 1]);
            let height = if part > 0.0 { right.mul_add(part, left * (1.0 - part)) } else { left };
            if height < 1e-10 * ABYSS {
                continue;
            }
            let [place, before, farthest] = *last;
            let known = place.is_finite();
            let height = match (height.is_finite(), known) {
                (true, _) => height,
                (false, true) => before,
                (false, false) => 0.0,
            };
            let next = height.mul_add(per, here);
            if !known {
                // The border's height goes on towards the eye.
                for at in 0..lines.steps.min(next.floor().max(-1.0) as usize + 1) {
                    shifts[at * STRIP + line] = height * per;
                }
            } else if next > farthest {
                let rise = (height - before) / (next - place);
                let from = (farthest.floor() + 1.0).max(0.0) as usize;
                let to = (next.floor() + 1.0).max(0.0) as usize;
                for at in from..to.min(lines.steps) {
                    let height = rise.mul_add(at as f32 - place, before);
                    shifts[at * STRIP + line] = height * per;
                }
            }
            *last = [next, height, if known { Real::max(farthest, next) } else { next }];
        }
    });
    shifts
}

/// Light and coverage at a place along a line before a pixel.
#[inline]
fn sampled(
    (light, coverage): (&[f32], &[f32]),
    lines: &Lines<'_>,
    width: usize,
    (step, across): (usize, usize),
    shift: f32,
) -> [f32; 4] {
    let limit = |place: f32, size: usize| place.max(0.0).min((size - 1) as f32);
    let along = limit(step as f32 - shift, lines.steps);
    let across = limit((-shift).mul_add(lines.shear() as f32, across as f32), lines.width);
    let (before, left) = (along as usize, across as usize);
    let (part, right) = (along - before as f32, across - left as f32);
    let next = lines.row_at((before + 1).min(lines.steps - 1));
    let before = lines.row_at(before);
    let beside = (left + 1).min(lines.width - 1);
    let pixel = |row: usize, column: usize| {
        if lines.transposed { column * width + row } else { row * width + column }
    };
    let taps = [
        (pixel(before, left), (1.0 - part) * (1.0 - right)),
        (pixel(before, beside), (1.0 - part) * right),
        (pixel(next, left), part * (1.0 - right)),
        (pixel(next, beside), part * right),
    ];
    let pixels = coverage.len();
    let mut sum = [0.0; 4];
    for (pixel, weight) in taps {
        let weight = weight * coverage[pixel];
        // What is not covered may hold any background.
        if weight > 0.0 {
            for (channel, sum) in sum[..3].iter_mut().enumerate() {
                *sum = Real::mul_add(weight, light[channel * pixels + pixel], *sum);
            }
            sum[3] += weight;
        }
    }
    if sum[3] > 0.0 {
        let per = 1.0 / sum[3];
        for value in &mut sum[..3] {
            *value *= per;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    fn seen(relief: &[f32], grid: Grid, view: Vec3<f64>, light: &[f32]) -> Option<Light> {
        let coverage = vec![1.0; relief.len()];
        let planes = light.repeat(3);
        serially(|run| displaced((&planes, &coverage), relief, grid, view, run)).unwrap()
    }

    #[test]
    fn a_raised_plane_moves_by_its_height_and_a_small_one_not_at_all() {
        let grid = Grid::whole(60, 50, 0.1);
        let light: Vec<f32> = (0..3000).map(|i| 0.01 * (i % 60) as f32).collect();
        for (x, y) in [(0.6, 0.0), (-0.6, 0.0), (0.36, 0.48), (0.0, -0.6)] {
            let view = Vec3::new(x, y, 0.8);
            let (moved, covered) = seen(&[0.3; 3000], grid, view, &light).unwrap();
            // tan = 0.75: 2.25 pixels from the eye; what is seen at q lies that much towards it.
            for row in 10..40 {
                for column in 10..50 {
                    let expected = 0.01 * (column as f64 + 2.25 * x / 0.6);
                    let error = f64::from(moved[row * 60 + column]) - expected;
                    assert!(error.abs() < 1e-5, "{x} {y}: {error}");
                    assert_eq!(covered[row * 60 + column], 1.0);
                }
            }
            assert!(seen(&[0.01; 3000], grid, view, &light).is_none());
        }
    }

    #[test]
    fn places_are_those_of_a_ray_marched_finely() {
        let grid = Grid::whole(90, 40, 0.1);
        // A relief along x, so steep that it hides parts of itself at 60 degrees.
        let height = |column: f64| 0.25 * (0.35 * column).sin() + 0.1 * (0.1 * column).cos();
        let relief: Vec<f32> = (0..3600).map(|i| height(f64::from(i % 90)) as f32).collect();
        let straight = |column: f64| {
            let left = column.floor();
            height(left) + (column - left) * (height(left + 1.0) - height(left))
        };
        let light: Vec<f32> = (0..3600).map(|i| (i % 90) as f32).collect();
        let view = Vec3::new(0.75_f64.sqrt(), 0.0, 0.5);
        let (moved, _) = seen(&relief, grid, view, &light).unwrap();
        let slant = 3.0_f64.sqrt() / 0.1;
        let mut hidden = 0;
        for column in 20..70 {
            // From the eye down: the first place at which the ray is in the relief.
            let mut z = 0.36;
            while z > straight(column as f64 + slant * z) {
                z -= 1e-5;
            }
            let found = f64::from(moved[20 * 90 + column]);
            let expected = column as f64 + slant * z;
            // The march is right to 1e-5 mm over the sine of the angle between ray and relief; where
            // they graze each other, to a tenth of a pixel.
            assert!((found - expected).abs() < 0.1, "{column}: {found} for {expected}");
            let next = f64::from(moved[20 * 90 + column + 1]);
            hidden += usize::from(next - found > 3.0);
        }
        assert!(hidden >= 2, "{hidden}");
    }

    #[test]
    fn nan_heights_one_pixel_and_thin_pictures_stay_finite() {
        let view = Vec3::new(0.5, -0.6, 0.3).normalised();
        for (width, height) in [(1, 1), (1, 30), (30, 1), (31, 33)] {
            let grid = Grid::whole(width, height, 0.1);
            let relief: Vec<f32> = (0..width * height)
                .map(|i| if i % 7 == 3 { f32::NAN } else { 0.4 * ((i * 7919 % 13) as f32) / 13.0 })
                .collect();
            let light = vec![1.0; width * height];
            if let Some((moved, covered)) = seen(&relief, grid, view, &light) {
                assert!(moved.iter().all(|&v| v == 0.0 || (v - 1.0).abs() < 1e-6));
                assert!(covered.iter().all(|&v| (0.0..=1.0 + 1e-6).contains(&v)));
            }
        }
    }
}
