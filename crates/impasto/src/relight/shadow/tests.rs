//! Shadows of known reliefs, and the sweep against its definition.

use super::lines::Lines;
use super::*;
use crate::height::transposed;
use crate::math::{Level, Real, Vec3};
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

/// The definition in single precision, written as loops over whole lines.
fn defined(relief: &[f32], grid: Grid, light: Vec3<f64>) -> Vec<bool> {
    let lines = Lines::new(relief, grid, [light.x, light.y]);
    let fall = (light.z * lines.step / light.x.hypot(light.y)) as f32;
    let (first, count) = lines.all();
    let value = |step: usize, column: isize| {
        let width = lines.width.cast_signed();
        if column < -1 || column > width {
            return -1e30;
        }
        let (column, row) = (column.clamp(0, width - 1) as usize, lines.row_at(step));
        relief[if lines.transposed { column * grid.width + row } else { row * grid.width + column }]
    };
    let mut depths = vec![vec![0.0_f32; count]; lines.steps];
    for line in 0..count {
        let mut surface = -1e30_f32;
        for (step, depths) in depths.iter_mut().enumerate() {
            let (whole, part) = lines.displacement(step);
            let column = first + line.cast_signed() + whole;
            let (left, right) = (value(step, column), value(step, column + 1));
            let height = if part > 0.0 { right.mul_add(part, left * (1.0 - part)) } else { left };
            surface -= fall;
            depths[line] = if (surface - height).is_nan() { 0.0 } else { surface - height };
            surface = Real::max(height, surface);
        }
    }
    let mut lit = vec![true; relief.len()];
    for (step, depths) in depths.iter().enumerate() {
        let (whole, part) = lines.displacement(step);
        for column in 0..lines.width {
            let after = (column.cast_signed() - whole - first) as usize;
            let depth = part.mul_add(depths[after - 1], (1.0 - part) * depths[after]);
            let row = lines.row_at(step);
            let at = if lines.transposed {
                column * grid.width + row
            } else {
                row * grid.width + column
            };
            lit[at] = depth <= 0.0;
        }
    }
    lit
}

/// Reliefs of several kinds: rough, stepped, smooth, with gaps.
fn fuzzed(grid: Grid, seed: usize) -> Vec<f32> {
    (0..grid.width * grid.height)
        .map(|i| {
            let (x, y) = ((i % grid.width) as f32, (i / grid.width) as f32);
            let noise = ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0;
            match seed % 4 {
                0 => 0.3 * noise,
                1 => 0.4 * (0.11 * x + 0.07 * y + seed as f32).sin() + 0.01 * noise,
                2 if noise > 0.995 => 0.9,
                3 if noise > 0.9 => f32::NAN,
                _ => 0.05 * noise,
            }
        })
        .collect()
}

fn lights() -> Vec<Vec3<f64>> {
    let mut lights = Vec::new();
    for azimuth in [0.0_f64, 13.0, 45.0, 68.0, 90.0, 127.0, 200.0, 271.0, 315.0] {
        for elevation in [0.4_f64, 3.0, 12.0, 40.0, 89.0] {
            let ((y, x), (z, across)) =
                (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
            lights.push(Vec3::new(x * across, y * across, z));
        }
    }
    lights
}

#[test]
fn bits_of_the_whole_and_of_tiles_are_those_of_the_definition() {
    let sizes = [(150, 90), (1, 200), (200, 1), (70, 131), (1, 1)];
    for (number, (width, height)) in sizes.into_iter().enumerate() {
        let grid = Grid::whole(width, height, 0.1);
        for (seed, light) in lights().into_iter().enumerate() {
            let relief = fuzzed(grid, seed + number);
            let expected = defined(&relief, grid, light);
            let light = Light::Distant(light);
            serially(|run| {
                let map = cast_shadows(&relief, grid, &light, run).unwrap();
                let found: Vec<bool> = map.iter().map(|&seen| seen > 0.0).collect();
                assert_eq!(found, expected, "{light:?}");
                let span = span(&relief, run).unwrap();
                // Tiles of a size that is no multiple of anything, from both ends.
                let (wide, high) = (width.min(37), height.min(23));
                for [left, top] in [
                    [0, 0],
                    [width - wide, height - high],
                    [(width - wide) / 2, (height - high) / 2],
                ] {
                    let size = [wide, high];
                    let bits = tile(&relief, grid, &light, [left, top], size, (span, run)).unwrap();
                    for (row, column) in (0..high).flat_map(|r| (0..wide).map(move |c| (r, c))) {
                        let there = (top + row) * width + left + column;
                        assert_eq!(bits.get(column, row), expected[there], "{light:?}");
                    }
                }
            });
        }
    }
}

#[test]
fn a_tile_needs_no_more_of_the_relief_than_its_reach() {
    // The reach is used: a relief of 0.05 mm and light at 40 degrees, tiles of a large picture.
    let grid = Grid::whole(400, 900, 0.1);
    let relief = fuzzed(grid, 6);
    let light = Vec3::new(0.3, 0.7, 0.64);
    let sweep = Sweep::new(&relief, grid, light).unwrap();
    serially(|run| {
        let span = span(&relief, run).unwrap();
        // 0.9 mm / 0.084 mm per row, two rows more.
        assert!(sweep.reach(span).unwrap() <= 14, "{:?}", sweep.reach(span));
        let whole = visible(&relief, grid, &Light::Distant(light), run).unwrap();
        let half = visible_where(
            &relief,
            grid,
            &Light::Distant(light),
            |column, row| (column + row).is_multiple_of(2),
            run,
        )
        .unwrap();
        for (row, column) in (0..900).flat_map(|r| (0..400).map(move |c| (r, c))) {
            let swept = (row / SIDE + column / SIDE).is_multiple_of(2);
            assert_eq!(half.get(column, row), !swept || whole.get(column, row));
        }
    });
}

#[test]
fn skipping_blocks_below_the_ray_changes_no_shadow_of_a_point_light() {
    let grid = Grid::whole(120, 75, 0.1);
    for seed in 0..12 {
        let relief = fuzzed(grid, seed);
        let place =
            Vec3::new(-8.0 + 1.7 * seed as f64, 5.0 - 0.9 * seed as f64, 0.5 + 0.4 * seed as f64);
        let light = Light::Point { position: place, falloff: true };
        let map = serially(|run| cast_shadows(&relief, grid, &light, run)).unwrap();
        for (pixel, &seen) in map.iter().enumerate() {
            let lit = !relief[pixel].is_finite() || !marched(&relief, grid, place, pixel);
            assert_eq!(seen > 0.0, lit, "{pixel} of {seed}");
        }
    }
}

/// The march without anything skipped, up to the light.
fn marched(relief: &[f32], grid: Grid, light: Vec3<f64>, pixel: usize) -> bool {
    let (row, column) = (pixel / grid.width, pixel % grid.width);
    let start = f64::from(relief[pixel]);
    let across = (light.x - grid.x(column as f64)) / grid.pitch;
    let down = -(light.y - grid.y(row as f64)) / grid.pitch;
    let (steps, rise) = (across.abs().max(down.abs()), light.z - start);
    let (across, down, per) = (across / steps, down / steps, rise / steps);
    let inside = |x: f64, y: f64| {
        x >= 0.0 && y >= 0.0 && x <= (grid.width - 1) as f64 && y <= (grid.height - 1) as f64
    };
    let mut step = 1.0;
    while rise > 0.0 && step < steps {
        let ray = per.mul_add(step, start);
        let (x, y) = (across.mul_add(step, column as f64), down.mul_add(step, row as f64));
        if !inside(x, y) {
            return false;
        }
        let at = |x: f64, y: f64| {
            let (x, y) = (x.min((grid.width - 1) as f64), y.min((grid.height - 1) as f64));
            f64::from(relief[y as usize * grid.width + x as usize])
        };
        let (x0, y0) = (x.floor(), y.floor());
        let first = at(x0, y0);
        let (part, second) =
            if x - x0 > y - y0 { (x - x0, at(x0 + 1.0, y0)) } else { (y - y0, at(x0, y0 + 1.0)) };
        let obstacle = if part > 0.0 { part.mul_add(second, (1.0 - part) * first) } else { first };
        if obstacle > ray {
            return true;
        }
        step += 1.0;
    }
    rise <= 0.0
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
        let other = cast_shadows(&other, transposed_grid, &distant(0.3, -0.9, 0.2), run).unwrap();
        let other = transposed(&other, transposed_grid.width, transposed_grid.height, run).unwrap();
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
