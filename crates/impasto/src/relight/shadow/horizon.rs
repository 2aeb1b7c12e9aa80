//! Horizons of a relief by a sweep of upper convex hulls [@timonen2010scalable]: soft shadows of
//! distant lamps with a size, and how much of the sky a place sees.
//!
//! Along the sheared lines of an azimuth ([`super::lines`]) each sample's horizon is the tangent to
//! the upper hull of the samples before it, kept as a stack: exact, and O(1) per sample. Horizons are
//! numbers `sin(elevation)`: solid angle is `d azimuth d sin(elevation)`, so that no arc function is
//! needed. They are interpolated to pixels between the two lines beside them. A horizon below a
//! floor counts as the floor: what can rise above it is near, and a tile has the same bits as the
//! whole picture.

use super::hull::{HullScratch, sweep};
use super::lines::{Lines, Span};
use super::{SIDE, Shares, span};
use crate::error::{Error, Result};
use crate::geometry::{Grid, Light};
use crate::math::{Level, Vec3};
use crate::pixels::{Run, zeros};
use crate::relight::area::disc;
use crate::relight::scene::Lamp;

/// Azimuths over a lamp: Gauss-Chebyshev nodes of the second kind, exact for a horizon that is a
/// polynomial of degree 15 across the lamp.
const ACROSS: usize = 8;

/// Sky below this sine of elevation (1.8 degrees) is left out: obstacles farther than 32 times the
/// range of the relief are not looked for. It is `1 / 1024` of the sky's cosine-weighted light.
pub(crate) const SKY_FLOOR: f64 = 1.0 / 32.0;

/// One azimuth of a sum over horizons.
#[derive(Clone, Copy, Debug)]
struct Azimuth {
    /// (x, y).
    direction: [f64; 2],
    /// Sines of elevation between which light comes.
    low: f32,
    high: f32,
    weight: f32,
}

/// What a horizon leaves of an azimuth's light.
#[derive(Clone, Copy, Debug)]
enum Weighting {
    /// Linear in the sine: radiance alone.
    Radiance,
    /// Quadratic in the sine: radiance times the cosine to the painting's normal.
    Irradiance,
}

/// A sum over azimuths: shares of light from 0 to 1.
#[derive(Clone, Debug)]
pub struct Horizons {
    azimuths: Vec<Azimuth>,
    of: Weighting,
}

impl Horizons {
    /// The sky above the painting's plane, weighted by the cosine to its normal, at so many azimuths.
    ///
    /// # Errors
    /// Fewer than 4 azimuths, or more than 1024.
    pub fn sky(azimuths: usize) -> Result<Self> {
        if !(4..=1024).contains(&azimuths) {
            let problem = format!("expected 4 to 1024, found {azimuths}");
            return Err(Error::argument("azimuths", problem));
        }
        let turn = core::f64::consts::TAU / azimuths as f64;
        let azimuths = (0..azimuths)
            .map(|index| {
                // Between the axes: two azimuths that share a line would be swept alike.
                let (y, x) = ((index as f64 + 0.5) * turn).sin_cos();
                let weight = 1.0 / azimuths as f64;
                Azimuth {
                    direction: [x, y],
                    low: SKY_FLOOR as f32,
                    high: 1.0,
                    weight: weight as f32,
                }
            })
            .collect();
        Ok(Self { azimuths, of: Weighting::Irradiance })
    }

    /// A distant lamp: a disc of angular radius `radius` (radians) about a direction.
    ///
    /// # Errors
    /// A lamp behind the painting, or a radius that is not between 0 and a right angle.
    pub fn disc(direction: Vec3<f64>, radius: f64) -> Result<Self> {
        if !(radius > 0.0 && radius < core::f64::consts::FRAC_PI_2) {
            let problem = format!("expected an angle between 0 and pi / 2, found {radius}");
            return Err(Error::argument("radius", problem));
        }
        let Vec3 { x, y, z: sine } = direction.normalised();
        if sine.is_nan() || sine <= 0.0 {
            return Err(Error::geometry("light", "it stands behind the painting"));
        }
        let cosine = x.hypot(y);
        let middle = if cosine > 0.0 { y.atan2(x) } else { 0.0 };
        let (size, limit) = radius.sin_cos();
        // About the zenith the lamp is seen at every azimuth.
        let (count, half) =
            if size < cosine { (ACROSS, Some((size / cosine).asin())) } else { (4 * ACROSS, None) };
        let mut azimuths = Vec::with_capacity(count);
        for index in 0..count {
            let (offset, share) = match half {
                Some(half) => {
                    let angle = (index as f64 + 1.0) * core::f64::consts::PI / (count as f64 + 1.0);
                    // The weight of a node times what the chord does not hold of it.
                    (half * angle.cos(), angle.sin())
                }
                None => ((index as f64 + 0.5) * core::f64::consts::TAU / count as f64, 1.0),
            };
            // cos(radius) = sin e sine + cos e cosine cos(offset).
            let along = cosine * offset.cos();
            let distance = sine.hypot(along);
            let between = (limit / distance).min(1.0).acos();
            let peak = sine.atan2(along);
            let low = (peak - between).sin();
            let top = peak + between;
            let high = if top > core::f64::consts::FRAC_PI_2 { 1.0 } else { top.sin() };
            if (high as f32) > low as f32 {
                azimuths.push(Azimuth {
                    direction: [(middle + offset).cos(), (middle + offset).sin()],
                    low: low as f32,
                    high: high as f32,
                    weight: ((high - low) * share) as f32,
                });
            }
        }
        let sum: f32 = azimuths.iter().map(|azimuth| azimuth.weight).sum();
        for azimuth in &mut azimuths {
            azimuth.weight /= sum;
        }
        Ok(Self { azimuths, of: Weighting::Radiance })
    }

    /// The share of the light that each pixel sees, `(y, x)`, over a relief `(y, x)` in mm. Where a
    /// height is NaN, all of it.
    ///
    /// # Errors
    /// If the sizes disagree, or the caller cancels.
    pub fn seen(&self, relief: &[f32], grid: Grid, run: &Run<'_>) -> Result<Vec<f32>> {
        if relief.len() != grid.width * grid.height || relief.is_empty() {
            return Err(Error::argument("height", "its size is not that of the painting"));
        }
        let span = span(relief, run)?;
        let Grid { width, height, .. } = grid;
        let tiles = (0..height.div_ceil(SIDE))
            .flat_map(|row| (0..width.div_ceil(SIDE)).map(move |column| (column, row)))
            .map(|(column, row)| (column * SIDE, row * SIDE))
            .collect::<Vec<_>>();
        let parts = run.map(tiles.clone(), HullScratch::default, |scratch, (left, top)| {
            let size = [SIDE.min(width - left), SIDE.min(height - top)];
            self.tile(relief, grid, span, ([left, top], size), (scratch, run.level))
        })?;
        let mut map = zeros(relief.len())?;
        run.in_turn(tiles.into_iter().zip(parts), |((left, top), part)| {
            let columns = SIDE.min(width - left);
            for (row, values) in part.chunks_exact(columns).enumerate() {
                map[(top + row) * width + left..][..columns].copy_from_slice(values);
            }
        })?;
        Ok(map)
    }

    /// The same where tiles of [`SIDE`] pixels, by column and row of tiles, are `wanted`; elsewhere
    /// all of the light is seen.
    ///
    /// # Errors
    /// As [`Self::seen`].
    pub fn seen_where(
        &self,
        relief: &[f32],
        grid: Grid,
        wanted: impl Fn(usize, usize) -> bool + Sync,
        run: &Run<'_>,
    ) -> Result<Shares> {
        if relief.len() != grid.width * grid.height || relief.is_empty() {
            return Err(Error::argument("height", "its size is not that of the painting"));
        }
        let span = span(relief, run)?;
        Shares::new(grid, wanted, run, |part, scratch: &mut HullScratch| {
            self.tile(relief, grid, span, part, (scratch, run.level))
        })
    }

    /// The same in `size` (width, height) pixels from `[column, row]` on: a plane of factors. `span`
    /// is that of the whole relief ([`span`]); the numbers are those of the whole picture.
    fn tile(
        &self,
        relief: &[f32],
        grid: Grid,
        span: Span,
        ([column, row], [width, height]): ([usize; 2], [usize; 2]),
        (scratch, level): (&mut HullScratch, Level),
    ) -> Vec<f32> {
        let mut shares = vec![0.0_f32; width * height];
        for azimuth in &self.azimuths {
            let lines = Lines::new(relief, grid, azimuth.direction);
            let part = (column..column + width, row..row + height);
            let Azimuth { low, high, weight, .. } = *azimuth;
            let of = self.of;
            sweep(&lines, part, low, span, (scratch, level), |pixel, sine| {
                let share = match of {
                    Weighting::Radiance => (high - sine) / (high - low),
                    Weighting::Irradiance => (1.0 - sine * sine) / (1.0 - low * low),
                };
                shares[pixel] = weight.mul_add(share.clamp(0.0, 1.0), shares[pixel]);
            });
        }
        // Weights are rounded numbers.
        for share in &mut shares {
            *share = share.min(1.0);
        }
        shares
    }
}

/// Visible share of a lamp of a size, `(y, x)` (of a lamp below a thousandth of a radian all or nothing): of a distant one, `radius` is its angular radius in
/// radians; of a near one its radius in mm, a disc that faces the middle of the painting, seen
/// through 32 of its points.
///
/// # Errors
/// As [`Horizons::disc`] and [`Horizons::seen`].
pub fn soft_shadows(
    relief: &[f32],
    grid: Grid,
    light: &Light,
    radius: f64,
    run: &Run<'_>,
) -> Result<Vec<f32>> {
    let lamp = Lamp { light: *light, intensity: 1.0, radius, colour: 0 };
    if radius > 0.0 && !lamp.has_size() {
        return super::cast_shadows(relief, grid, light, run);
    }
    let position = match *light {
        Light::Distant(direction) => {
            return Horizons::disc(direction, radius)?.seen(relief, grid, run);
        }
        Light::Point { position, .. } => position,
    };
    if !(radius > 0.0 && radius < position.length()) {
        let problem = format!("expected mm below the lamp's distance, found {radius}");
        return Err(Error::argument("radius", problem));
    }
    let mut sum = zeros(relief.len())?;
    // What lies behind the painting's own plane lights nothing.
    for point in disc(position, radius, POINTS).filter(|point| point.z > 0.0) {
        let light = Light::Point { position: point, falloff: true };
        let seen = super::cast_shadows(relief, grid, &light, run)?;
        for (sum, seen) in sum.iter_mut().zip(seen) {
            *sum += seen / POINTS as f32;
        }
    }
    Ok(sum)
}

/// The same where tiles are `wanted`, by column and row; elsewhere all of the lamp is seen.
///
/// # Errors
/// As [`soft_shadows`].
pub fn seen_where(
    relief: &[f32],
    grid: Grid,
    (light, radius): (&Light, f64),
    wanted: impl Fn(usize, usize) -> bool + Sync,
    run: &Run<'_>,
) -> Result<Shares> {
    match *light {
        Light::Distant(direction) => {
            Horizons::disc(direction, radius)?.seen_where(relief, grid, wanted, run)
        }
        Light::Point { .. } => {
            let map = soft_shadows(relief, grid, light, radius, run)?;
            Shares::of(&map, grid, wanted, run)
        }
    }
}

/// Points of a near lamp.
const POINTS: usize = 32;

#[cfg(test)]
mod tests {
    use super::super::lines::LineScratch;
    use super::*;
    use crate::pixels::serially;

    /// Horizons of all pixels from their definition: every sample of a line against every other.
    fn defined(relief: &[f32], grid: Grid, azimuth: [f64; 2], floor: f64) -> Vec<f64> {
        let lines = Lines::new(relief, grid, azimuth);
        let (first, count) = lines.all();
        let mut heights = vec![vec![f64::NEG_INFINITY; count]; lines.steps];
        let mut scratch = LineScratch::default();
        lines.walk((first, count), 0..lines.steps, &mut scratch, |step, part, row| {
            for (line, height) in heights[step].iter_mut().enumerate() {
                let (left, right, part) =
                    (f64::from(row[line]), f64::from(row[line + 1]), f64::from(part));
                let value = if part > 0.0 { right * part + left * (1.0 - part) } else { left };
                *height = if value > -1e20 { value } else { f64::NEG_INFINITY };
            }
        });
        let sine = |step: usize, line: usize| {
            let here = heights[step][line];
            let steepest = (0..step)
                .filter(|&other| heights[other][line].is_finite() && here.is_finite())
                .map(|other| (heights[other][line] - here) / ((step - other) as f64 * lines.step))
                .fold(f64::NEG_INFINITY, f64::max);
            if steepest.is_finite() { (steepest / steepest.hypot(1.0)).max(floor) } else { floor }
        };
        let mut sines = vec![0.0; relief.len()];
        for step in 0..lines.steps {
            let (whole, part) = lines.displacement(step);
            for column in 0..lines.width {
                let line = (column.cast_signed() - whole - first) as usize;
                let row = lines.row_at(step);
                let pixel = if lines.transposed {
                    column * grid.width + row
                } else {
                    row * grid.width + column
                };
                let part = f64::from(part);
                sines[pixel] = part * sine(step, line - 1) + (1.0 - part) * sine(step, line);
            }
        }
        sines
    }

    fn rough(grid: Grid, gaps: bool) -> Vec<f32> {
        (0..grid.width * grid.height)
            .map(|i| {
                let (x, y) = ((i % grid.width) as f32, (i / grid.width) as f32);
                let noise = (i * 7919 % 1009) as f32 / 1009.0;
                if gaps && noise > 0.97 {
                    return f32::NAN;
                }
                0.2 * (0.2 * x + 0.1 * y).sin() + 0.1 * noise
            })
            .collect()
    }

    #[test]
    fn hulls_find_the_horizons_of_the_definition() {
        for (width, height) in [(40, 31), (1, 25), (25, 1), (1, 1)] {
            let grid = Grid::whole(width, height, 0.1);
            for gaps in [false, true] {
                let relief = rough(grid, gaps);
                let span = Span::of(&relief);
                for degrees in [0.0_f64, 20.0, 45.0, 100.0, 190.0, 300.0] {
                    let (y, x) = degrees.to_radians().sin_cos();
                    for floor in [-0.5, 0.03, 0.4] {
                        let expected = defined(&relief, grid, [x, y], floor);
                        let lines = Lines::new(&relief, grid, [x, y]);
                        let mut visited = 0;
                        sweep(
                            &lines,
                            (0..width, 0..height),
                            floor as f32,
                            span,
                            (&mut HullScratch::default(), Level::detect()),
                            |pixel, sine| {
                                // Heights below 0.3 mm in single precision, at least 0.1 mm apart: a
                                // slope is right to 4 roundings of 3e-8 mm over 0.1 mm, 1.2e-6; the
                                // sine adds two roundings of at most 1.
                                let error = f64::from(sine) - expected[pixel];
                                assert!(error.abs() < 1.5e-6, "{pixel}: {error}");
                                visited += 1;
                            },
                        );
                        assert_eq!(visited, width * height);
                    }
                }
            }
        }
    }

    #[test]
    fn tiles_have_the_numbers_of_the_whole() {
        let grid = Grid::whole(300, 290, 0.1);
        let relief = rough(grid, false);
        let lamp = Vec3::new(0.5, 0.3, 0.3).normalised();
        for horizons in [Horizons::sky(6).unwrap(), Horizons::disc(lamp, 0.1).unwrap()] {
            serially(|run| {
                let whole = horizons.seen(&relief, grid, run).unwrap();
                let span = span(&relief, run).unwrap();
                let mut scratch = HullScratch::default();
                for (corner, size) in [([200, 100], [31, 57]), ([0, 233], [300, 57])] {
                    let scratch = (&mut scratch, run.level);
                    let part = horizons.tile(&relief, grid, span, (corner, size), scratch);
                    for (pixel, &share) in part.iter().enumerate() {
                        let (row, column) = (pixel / size[0], pixel % size[0]);
                        let there = (corner[1] + row) * 300 + corner[0] + column;
                        assert_eq!(share, whole[there]);
                    }
                }
            });
        }
    }

    #[test]
    fn on_a_slope_the_sky_is_that_of_a_tilted_plane() {
        // A plane tilted by a, alone in the world, sees (1 + cos a) / 2 of the sky's light.
        let grid = Grid::whole(64, 64, 0.1);
        for slope in [0.0_f64, 0.3, 1.0] {
            let relief: Vec<f32> =
                (0..64 * 64).map(|i| (slope * 0.1 * f64::from(i % 64)) as f32).collect();
            let seen = serially(|run| Horizons::sky(64).unwrap().seen(&relief, grid, run)).unwrap();
            let expected = 0.5 * (1.0 + 1.0 / slope.hypot(1.0));
            for row in 10..54 {
                for column in 10..54 {
                    // What is left out below 1.8 degrees is 1/1024 of the light.
                    let error = f64::from(seen[row * 64 + column]) - expected;
                    assert!(error.abs() < 1.0 / 1024.0, "{slope}: {error}");
                }
            }
        }
    }

    #[test]
    fn a_soft_shadow_is_the_mean_of_hard_ones_over_the_disc() {
        const COUNT: usize = 900;
        let grid = Grid::whole(60, 24, 0.1);
        let relief: Vec<f32> = (0..60 * 24).map(|i| if i % 60 == 40 { 0.5 } else { 0.0 }).collect();
        for (middle, radius) in [([0.9, 0.0], 0.08), ([0.7, 0.4], 0.15)] {
            let middle = Vec3::new(middle[0], middle[1], 0.4).normalised();
            serially(|run| {
                let soft =
                    soft_shadows(&relief, grid, &Light::Distant(middle), radius, run).unwrap();
                let mut mean = vec![0.0; relief.len()];
                let up = Vec3::new(0.0, 0.0, 1.0);
                let across = up.cross(middle).normalised();
                let up = middle.cross(across);
                for index in 0..COUNT {
                    // Equal solid angles of the cap.
                    let share = (index as f64 + 0.5) / COUNT as f64;
                    let cosine = 1.0 - share * (1.0 - radius.cos());
                    let sine = (1.0 - cosine * cosine).sqrt();
                    let (b, a) = (index as f64 * 2.399_963_229_728_653).sin_cos();
                    let [x, y, z] = [0, 1, 2].map(|axis| {
                        cosine * middle.array()[axis]
                            + sine * (a * across.array()[axis] + b * up.array()[axis])
                    });
                    let light = Light::Distant(Vec3::new(x, y, z));
                    let seen = super::super::cast_shadows(&relief, grid, &light, run).unwrap();
                    for (mean, seen) in mean.iter_mut().zip(seen) {
                        *mean += f64::from(seen) / COUNT as f64;
                    }
                }
                let mut partly = 0;
                for row in 8..16 {
                    for column in 15..40 {
                        let pixel = row * 60 + column;
                        // The spiral counts half-discs to 2 / sqrt(900) of a ring of its points,
                        // 0.02; hard shadows interpolate depths, soft ones sines: over a wall a
                        // pixel wide both are within a pixel of 0.1 mm, half a pixel's change of
                        // the horizon's angle, 0.5 * 0.1 mm * sin^2 / 0.5 mm = 0.016 of the
                        // diameter 0.16: 0.1.
                        let error = f64::from(soft[pixel]) - mean[pixel];
                        assert!(error.abs() < 0.12, "{row} {column}: {error}");
                        partly += usize::from(soft[pixel] > 0.05 && soft[pixel] < 0.95);
                    }
                }
                assert!(partly > 8, "{partly}");
            });
        }
    }

    #[test]
    fn flat_and_overhead_are_seen_wholly_and_wrong_lamps_are_refused() {
        let grid = Grid::whole(20, 20, 0.1);
        let up = Vec3::new(0.0, 0.0, 1.0);
        serially(|run| {
            for horizons in [Horizons::sky(8), Horizons::disc(up, 0.3)] {
                let seen = horizons.unwrap().seen(&[0.0; 400], grid, run).unwrap();
                assert!(seen.iter().all(|&share| (share - 1.0).abs() < 1e-6));
            }
            let wall: Vec<f32> = (0..400).map(|i| if i % 20 == 9 { 5.0 } else { 0.0 }).collect();
            let seen = Horizons::disc(up, 0.3).unwrap().seen(&wall, grid, run).unwrap();
            // Beside a wall fifty pixels high half of a lamp overhead is hidden.
            assert!((seen[210] - 0.5).abs() < 0.1, "{}", seen[210]);
        });
        assert!(Horizons::sky(3).is_err() && Horizons::disc(up, 0.0).is_err());
        assert!(Horizons::disc(Vec3::new(1.0, 0.0, -0.1), 0.1).is_err());
    }
}
