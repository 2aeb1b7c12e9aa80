use super::projection::Projection;
use super::*;
use crate::math::{Level, Vec3};
use crate::pixels::serially;

const GRID: Grid = Grid::whole(40, 30, 0.5);

/// Planes of light as a projection shows them, without a relief.
fn resample(
    projection: &Projection,
    light: &[f32],
    coverage: &[f32],
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<(Vec<f32>, Vec<f32>)> {
    projection.resample(&lit_from_planes(light, coverage, run)?, None, background, run)
}

#[test]
fn a_frontal_view_changes_nothing() {
    let projection = Projection::parallel(Vec3::new(0.0, 0.0, 1.0), GRID);
    assert_eq!((projection.picture.width, projection.picture.height), (40, 30));
    assert_eq!(projection.picture_from_painting(3.0, -2.0), (3.0, -2.0));
    let light: Vec<f32> = (0..3600).map(|i| ((i * 7919) % 101) as f32).collect();
    let resampled = serially(|run| resample(&projection, &light, &[1.0; 1200], [9.0; 3], run));
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
        serially(|run| resample(&projection, &light, &coverage, [9.0; 3], run)).unwrap();
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
        let (seen, covered) =
            serially(|run| resample(&projection, &plane.repeat(3), &coverage, [0.0; 3], run))
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
            let inside =
                |at: f64, margin: f64, size: usize| at > margin && at < size as f64 - 1.0 - margin;
            if inside(c, margin[0], width) && inside(r, margin[1], height) {
                whole += 1;
                assert!((covered - 1.0).abs() < 1e-6);
                // Places of up to 500 pixels in single precision, of a slope of 0.01, and
                // values of up to 1.5.
                assert!((f64::from(seen) - ramp(c, r)).abs() < 500.0 * 6e-8 * 0.01 * 2.0 + 1e-6);
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
            serially(|run| resample(&projection, &light.repeat(3), &coverage, [0.0; 3], run))
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
    let (seen, _) =
        serially(|run| resample(&projection, &plane.repeat(3), &[1.0; 1200], [0.0; 3], run))
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
            resample(&projection, &ramps.concat(), &coverage, [0.0; 3], run)
        })
        .unwrap();
        // A pinhole: the ray of a place on the plane through the painting's middle that faces the
        // eye; the corners of the painting's outline bound the picture.
        let axis = eye.normalised();
        let up = Vec3::new(0.0, 1.0, 0.0);
        let up = (up - axis.scale(up.dot(axis))).normalised();
        let right = up.cross(axis);
        let corners = [(-22.5, -28.5), (-22.5, 28.5), (22.5, -28.5), (22.5, 28.5)].map(|(x, y)| {
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
                let inside = (3.0..146.0).contains(&exact[0]) && (3.0..186.0).contains(&exact[1]);
                if inside {
                    inner += 1;
                    assert!((covered[pixel] - 1.0).abs() < 1e-6, "{exact:?}");
                    for axis in 0..2 {
                        let found = f64::from(seen[axis * covered.len() + pixel]);
                        // As of the next test: roundings of places of up to 190 pixels.
                        assert!((found - exact[axis]).abs() < 2e-4, "{found} {exact:?}");
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
fn an_eye_close_to_the_wall_sees_the_painting_and_nothing_beyond() {
    let grid = Grid::whole(200, 200, 1.0);
    let light: Vec<f32> = [0, 1, 2]
        .iter()
        .flat_map(|which| (0..40_000).map(move |i| [i % 200, i / 200, 1][*which] as f32))
        .collect();
    let (mut seen, mut places) = (0, 0);
    for index in 0..60 {
        let turn = 0.1 + 0.105 * f64::from(index);
        let away = 180.0 + 3.0 * f64::from(index);
        let eye = Vec3::new(away * turn.cos(), away * turn.sin(), 22.0 + 0.3 * f64::from(index));
        let Ok(projection) = Projection::new(View::Point(eye), grid) else { continue };
        let coverage = vec![1.0; 40_000];
        let (found, covered) =
            serially(|run| resample(&projection, &light, &coverage, [-1.0; 3], run).unwrap());
        seen += 1;
        for (pixel, &share) in covered.iter().enumerate() {
            assert!((0.0..=1.0 + 1e-5).contains(&share));
            let (row, column) =
                (pixel / projection.picture.width, pixel % projection.picture.width);
            let [x, y, one] = projection.homogeneous(column as f64, row as f64);
            let exact = [x / one, y / one];
            let spread = projection.spread(column as f64, row as f64);
            // Whole pixels away from the border, half the samples' spread included.
            let inside = (0..2).all(|axis| {
                let margin = 2.0 + 0.5 * spread[axis].abs();
                exact[axis] > margin && exact[axis] < 199.0 - margin
            });
            // Where a pixel sees dozens of the painting's, a place says little.
            if one > 0.0 && inside && spread[0].hypot(spread[1]) < 4.0 {
                places += 1;
                for axis in 0..2 {
                    let value = f64::from(found[axis * covered.len() + pixel]);
                    // Samples lie evenly about their place, so that on a ramp their mean is that of
                    // the place. Single precision: places of up to 200 pixels from a quotient of two
                    // sums, four roundings of 200 * 6e-8, and the sum of 16 values as large, another.
                    let limit = 2e-4;
                    assert!((value - exact[axis]).abs() < limit, "{eye:?} {value} {exact:?}");
                }
            }
        }
    }
    assert!(seen > 5 && places > 10_000, "{seen} {places}");
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
            resample(&projection, &light, &coverage, [0.5; 3], &run).unwrap()
        }));
    }
    assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
    assert!(answers[0].0.iter().all(|value| value.is_finite()));
}

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
