//! A slanted view: parallel rays to the eye, the painting foreshortened along its tilt.
//!
//! The picture's up is the painting's up as the eye sees it, `u = Y - (Y.V) V`, its right is
//! `r = u x V`; the point (x, y, 0) appears at `(r.x x + r.y y, u.x x + u.y y)`. The picture has the
//! painting's pitch and is as large as the projected painting. Radiance is resampled, never
//! divided by the foreshortening: a matte white board looks as bright from the side.
//!
//! Each output pixel is the mean of a square of samples, each interpolated bilinearly between the
//! painting's pixels: enough samples that neighbours are at most half a painting pixel apart.

use crate::error::Result;
use crate::geometry::Grid;
use crate::math::Vec3;
use crate::pixels::Run;

/// Samples per output pixel and direction are bounded: at 83 degrees and beyond, a row shows eight
/// of the painting's, and the picture is a sliver anyway.
const MOST_SAMPLES: f64 = 16.0;

/// How a view sees the painting's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Rows of the map from the painting's (x, y) to the picture's (right, up).
    forward: [[f64; 2]; 2],
    backward: [[f64; 2]; 2],
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
        let samples = (2.0 / determinant).ceil().clamp(2.0, MOST_SAMPLES) as usize;
        let picture = Grid::whole(width, height, painting.pitch);
        Self { forward, backward, samples, painting, picture }
    }

    /// Where a point of the painting's plane (mm) appears in the picture (mm right, mm up).
    #[must_use]
    pub fn picture_from_painting(&self, x: f64, y: f64) -> (f64, f64) {
        let [right, up] = self.forward;
        (right[0].mul_add(x, right[1] * y), up[0].mul_add(x, up[1] * y))
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
        let (width, height) = (self.picture.width, self.picture.height);
        let pixels = width * height;
        let (mut seen, mut covered) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let mut planes: Vec<_> = seen.chunks_mut(pixels).map(|p| p.chunks_mut(width)).collect();
        let rows = covered.chunks_mut(width).enumerate().map(|(row, covered)| {
            (row, planes.iter_mut().filter_map(Iterator::next).collect::<Vec<_>>(), covered)
        });
        run.for_each(
            rows.collect(),
            || (),
            |(), (row, mut seen, covered)| {
                for (column, covered) in covered.iter_mut().enumerate() {
                    let [light @ .., share] = self.pixel(light, coverage, row, column);
                    *covered = share;
                    for ((plane, light), background) in seen.iter_mut().zip(light).zip(background) {
                        plane[column] = (1.0 - share).mul_add(background, light);
                    }
                }
            },
        )?;
        Ok((seen, covered))
    }

    /// Mean light, times coverage, and mean coverage of one output pixel.
    fn pixel(&self, light: &[f32], coverage: &[f32], row: usize, column: usize) -> [f32; 4] {
        let (across, down) = (self.painting.width as f64, self.painting.height as f64);
        let pixels = self.painting.width * self.painting.height;
        let step = 1.0 / self.samples as f64;
        let mut sum = [0.0_f64; 4];
        for i in 0..self.samples {
            for j in 0..self.samples {
                let offset = |k: usize| (k as f64 + 0.5).mul_add(step, -0.5);
                let right = self.picture.x(column as f64 + offset(j));
                let up = self.picture.y(row as f64 + offset(i));
                let [to_x, to_y] = self.backward;
                let x = to_x[0].mul_add(right, to_x[1] * up);
                let y = to_y[0].mul_add(right, to_y[1] * up);
                // Fractional column and row of the painting; pixel 0 reaches from -0.5 to 0.5.
                let c = x / self.painting.pitch + 0.5 * (across - 1.0);
                let r = 0.5 * (down - 1.0) - y / self.painting.pitch;
                if c < -0.5 || r < -0.5 || c >= across - 0.5 || r >= down - 0.5 {
                    continue;
                }
                let (c, r) = (c.clamp(0.0, across - 1.0), r.clamp(0.0, down - 1.0));
                let (c0, r0) = (c.floor(), r.floor());
                let (fc, fr) = (c - c0, r - r0);
                let (c0, r0) = (c0 as usize, r0 as usize);
                let c1 = (c0 + 1).min(self.painting.width - 1);
                let r1 = (r0 + 1).min(self.painting.height - 1);
                let taps = [
                    (r0, c0, (1.0 - fr) * (1.0 - fc)),
                    (r0, c1, (1.0 - fr) * fc),
                    (r1, c0, fr * (1.0 - fc)),
                    (r1, c1, fr * fc),
                ];
                for (r, c, weight) in taps {
                    let pixel = r * self.painting.width + c;
                    let weight = weight * f64::from(coverage[pixel]);
                    if weight > 0.0 {
                        for channel in 0..3 {
                            let value = f64::from(light[channel * pixels + pixel]);
                            sum[channel] = weight.mul_add(value, sum[channel]);
                        }
                        sum[3] += weight;
                    }
                }
            }
        }
        sum.map(|value| (value * step * step) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    const GRID: Grid = Grid::whole(40, 30, 0.5);

    #[test]
    fn a_frontal_view_changes_nothing() {
        let projection = Projection::new(Vec3::new(0.0, 0.0, 1.0), GRID);
        assert_eq!((projection.picture.width, projection.picture.height), (40, 30));
        assert_eq!(projection.picture_from_painting(3.0, -2.0), (3.0, -2.0));
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
}
