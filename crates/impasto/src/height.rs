//! Normals to height by a Poisson equation, solved with the discrete cosine transform
//! [@simchony1990poisson]: the surface whose slopes are closest to the measured ones.
//!
//! Least squares over all pixel edges is a Poisson equation with Neumann borders, which the
//! cosine transform solves exactly: the slopes are averaged
//! onto the edges between pixels, their divergence is transformed, divided by the eigenvalues
//! `(2 cos(pi k / W) - 2) + (2 cos(pi j / H) - 2)` and transformed back. The mean height, which no
//! slope determines, is zero.

use std::sync::Arc;

use rustdct::TransformType2And3;
use rustdct::algorithm::type2and3_butterflies::{
    Type2And3Butterfly2, Type2And3Butterfly3, Type2And3Butterfly4, Type2And3Butterfly8,
    Type2And3Butterfly16,
};
use rustdct::algorithm::{Type2And3ConvertToFft, Type2And3SplitRadix};
use rustdct::rustfft::{Fft, FftPlannerAvx, FftPlannerScalar};

use crate::error::{Error, Result};
use crate::pixels::{Run, TILE, zeros};

/// Steepest slope that is used, tan 80 degrees.
///
/// Guard: one normal that noise has tilted to the horizon (slope 1000) would lift the whole
/// surface, since the transform spreads every residual everywhere.
const STEEPEST: f64 = 5.671_281_819_617_709;

/// Rows of one piece of work: a row of a megapixel picture is 8 KiB, so 16 keep to the cache.
const ROWS: usize = 16;

/// Height above the mean, in the unit of `pitch`, from normals `(3, y, x)`.
///
/// Only the direction of a normal counts. A normal that is not finite, or that does not point to
/// the viewer, is left out: an edge next to it takes the slope of its other pixel, and an edge
/// between two such pixels the slope zero.
///
/// # Errors
/// If the sizes disagree, or the caller cancels.
pub fn integrate(
    normal: &[f32],
    width: usize,
    height: usize,
    pitch: f64,
    run: &Run<'_>,
) -> Result<Vec<f32>> {
    let pixels = width * height;
    if pixels == 0 || normal.len() != 3 * pixels {
        return Err(Error::argument("normal", "expected shape (3, y, x) with at least one pixel"));
    }
    if !(pitch.is_finite() && pitch > 0.0) {
        return Err(Error::argument(
            "pitch_mm",
            format!("expected a positive width, found {pitch}"),
        ));
    }
    let (along_x, along_y) = (cosine_transform(width), cosine_transform(height));

    let mut field = divergence(normal, width, height, run)?;
    transform(&mut field, width, &along_x, Direction::Forward, run)?;
    let mut field = transposed(&field, width, height, run)?;
    transform(&mut field, height, &along_y, Direction::Forward, run)?;
    divide(&mut field, width, height, pitch, run)?;
    transform(&mut field, height, &along_y, Direction::Back, run)?;
    let mut field = transposed(&field, height, width, run)?;
    transform(&mut field, width, &along_x, Direction::Back, run)?;
    let mut heights = zeros(pixels)?;
    run.for_each(
        heights.chunks_mut(TILE).zip(field.chunks(TILE)).collect(),
        || (),
        |(), (heights, field)| {
            for (height, &value) in heights.iter_mut().zip(field) {
                *height = value as f32;
            }
        },
    )?;
    Ok(heights)
}

/// The cosine transform of so many numbers.
///
/// `DctPlanner` chooses the same for processors with AVX, but compiles the algorithms for SSE, too:
/// an eighth of all the code that this crate gives to the compiler.
fn cosine_transform(length: usize) -> Arc<dyn TransformType2And3<f64>> {
    match length {
        2 => Arc::new(Type2And3Butterfly2::new()),
        3 => Arc::new(Type2And3Butterfly3::new()),
        4 => Arc::new(Type2And3Butterfly4::new()),
        8 => Arc::new(Type2And3Butterfly8::new()),
        16 => Arc::new(Type2And3Butterfly16::new()),
        _ if length.is_power_of_two() && length > 2 => {
            let (half, quarter) = (cosine_transform(length / 2), cosine_transform(length / 4));
            Arc::new(Type2And3SplitRadix::new(half, quarter))
        }
        _ => Arc::new(Type2And3ConvertToFft::new(fourier_transform(length))),
    }
}

fn fourier_transform(length: usize) -> Arc<dyn Fft<f64>> {
    match FftPlannerAvx::new() {
        Ok(mut planner) => planner.plan_fft_forward(length),
        Err(()) => FftPlannerScalar::new().plan_fft_forward(length),
    }
}

/// Slopes along columns (right) and rows (down) per pixel; none where the normal is left out.
fn slope(normal: &[f32], pixels: usize, pixel: usize) -> Option<(f64, f64)> {
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(normal[axis * pixels + pixel]));
    let limited = |slope: f64| slope.clamp(-STEEPEST, STEEPEST);
    (x.is_finite() && y.is_finite() && z.is_finite() && z > 0.0)
        .then(|| (limited(-x / z), limited(y / z)))
}

/// The slope of the edge between two pixels.
fn edge(first: Option<f64>, second: Option<f64>) -> f64 {
    match (first, second) {
        (Some(first), Some(second)) => 0.5 * (first + second),
        (Some(slope), None) | (None, Some(slope)) => slope,
        (None, None) => 0.0,
    }
}

/// What flows out of each pixel over its edges; none over the border.
fn divergence(normal: &[f32], width: usize, height: usize, run: &Run<'_>) -> Result<Vec<f64>> {
    let pixels = width * height;
    let mut field = zeros(pixels)?;
    let rows: Vec<_> = field.chunks_mut(width * ROWS).enumerate().collect();
    run.for_each(
        rows,
        || (),
        |(), (piece, out)| {
            for (index, out) in out.iter_mut().enumerate() {
                let pixel = piece * ROWS * width + index;
                let (row, column) = (pixel / width, pixel % width);
                let here = slope(normal, pixels, pixel);
                let across = |other: usize| {
                    edge(here.map(|s| s.0), slope(normal, pixels, other).map(|s| s.0))
                };
                let down = |other: usize| {
                    edge(here.map(|s| s.1), slope(normal, pixels, other).map(|s| s.1))
                };
                let mut flow = 0.0;
                if column + 1 < width {
                    flow += across(pixel + 1);
                }
                if column > 0 {
                    flow -= across(pixel - 1);
                }
                if row + 1 < height {
                    flow += down(pixel + width);
                }
                if row > 0 {
                    flow -= down(pixel - width);
                }
                *out = flow;
            }
        },
    )?;
    Ok(field)
}

#[derive(Clone, Copy)]
enum Direction {
    Forward,
    Back,
}

/// The cosine transform of every row.
fn transform(
    field: &mut [f64],
    length: usize,
    plan: &Arc<dyn TransformType2And3<f64>>,
    direction: Direction,
    run: &Run<'_>,
) -> Result<()> {
    run.for_each(
        field.chunks_mut(length * ROWS).collect(),
        || vec![0.0; plan.get_scratch_len()],
        |scratch, rows| {
            for row in rows.chunks_exact_mut(length) {
                match direction {
                    Direction::Forward => plan.process_dct2_with_scratch(row, scratch),
                    Direction::Back => plan.process_dct3_with_scratch(row, scratch),
                }
            }
        },
    )
}

/// `(x, y)` from `(y, x)`, in square pieces that stay in the cache.
pub(crate) fn transposed<T: Copy + Default + Send + Sync>(
    field: &[T],
    width: usize,
    height: usize,
    run: &Run<'_>,
) -> Result<Vec<T>> {
    const SIDE: usize = 32;
    let mut out = zeros(field.len())?;
    run.for_each(
        out.chunks_mut(height * SIDE).enumerate().collect(),
        || (),
        |(), (piece, out)| {
            let columns = out.len() / height;
            for top in (0..height).step_by(SIDE) {
                for row in top..height.min(top + SIDE) {
                    for column in 0..columns {
                        out[column * height + row] = field[row * width + piece * SIDE + column];
                    }
                }
            }
        },
    )?;
    Ok(out)
}

/// Divides the transform, transposed, by the eigenvalues of the discrete Laplacian.
fn divide(field: &mut [f64], width: usize, height: usize, pitch: f64, run: &Run<'_>) -> Result<()> {
    // 2 cos(pi k / n) - 2 = -4 sin^2(pi k / 2n), which loses nothing at small k.
    let eigenvalues = |n: usize| -> Vec<f64> {
        let step = core::f64::consts::FRAC_PI_2 / n as f64;
        (0..n).map(|k| -4.0 * (k as f64 * step).sin().powi(2)).collect()
    };
    let (across, down) = (eigenvalues(width), eigenvalues(height));
    // The transforms there and back multiply by half the length in each direction.
    let factor = pitch * 4.0 / (width as f64 * height as f64);
    run.for_each(
        field.chunks_mut(height).enumerate().collect(),
        || (),
        |(), (column, values)| {
            for (value, down) in values.iter_mut().zip(&down) {
                let eigenvalue = across[column] + down;
                *value = if eigenvalue < 0.0 { *value * factor / eigenvalue } else { 0.0 };
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    /// Normals of a smooth surface that is not periodic, and its heights (mean zero).
    fn surface(width: usize, height: usize, pitch: f64) -> (Vec<f32>, Vec<f64>) {
        let pixels = width * height;
        let (mut normal, mut truth) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        for pixel in 0..pixels {
            let x = (pixel % width) as f64 / width as f64;
            let y = -((pixel / width) as f64) / width as f64;
            // h = 0.05 (sin 3x + x y + cos 2y) in units of the picture's width.
            let size = width as f64 * pitch;
            truth[pixel] = 0.05 * size * ((3.0 * x).sin() + x * y + (2.0 * y).cos());
            let p = 0.05 * (3.0 * (3.0 * x).cos() + y);
            let q = 0.05 * (x - 2.0 * (2.0 * y).sin());
            let length = (p * p + q * q + 1.0).sqrt();
            for (axis, value) in [-p, -q, 1.0].into_iter().enumerate() {
                normal[axis * pixels + pixel] = (value / length) as f32;
            }
        }
        let mean = truth.iter().sum::<f64>() / pixels as f64;
        for h in &mut truth {
            *h -= mean;
        }
        (normal, truth)
    }

    fn relative_error(found: &[f32], truth: &[f64]) -> f64 {
        let error: f64 = found.iter().zip(truth).map(|(&a, b)| (f64::from(a) - b).powi(2)).sum();
        (error / truth.iter().map(|h| h * h).sum::<f64>()).sqrt()
    }

    #[test]
    fn a_known_surface_comes_back() {
        let (normal, truth) = surface(160, 96, 0.2);
        let found = serially(|run| integrate(&normal, 160, 96, 0.2, run)).unwrap();
        // The mean of two slopes is off the chord's by h^2 f'''/12: (3/160)^2 / 12 = 3e-5 of the
        // steepest wave, and single-precision normals add 1e-7 per pixel.
        assert!(relative_error(&found, &truth) < 1e-4);
    }

    #[test]
    fn normals_that_say_nothing_lift_nothing() {
        let (mut normal, truth) = surface(64, 64, 1.0);
        let pixels = 64 * 64;
        for axis in 0..3 {
            normal[axis * pixels + 20 * 64 + 20] = f32::NAN;
        }
        normal[2 * pixels + 40 * 64 + 40] = 1e-30;
        let found = serially(|run| integrate(&normal, 64, 64, 1.0, run)).unwrap();
        assert!(found.iter().all(|h| h.is_finite()));
        // One slope of at most 5.7 is wrong by about itself; its dipole dies with the distance.
        assert!((f64::from(found[0]) - truth[0]).abs() < 0.1);
    }

    #[test]
    fn a_flat_painting_is_flat_and_a_single_pixel_too() {
        for (width, height) in [(1, 1), (1, 7), (33, 2)] {
            let mut normal = vec![0.0; 3 * width * height];
            normal[2 * width * height..].fill(1.0);
            let found = serially(|run| integrate(&normal, width, height, 0.1, run)).unwrap();
            assert!(found.iter().all(|&h| h == 0.0));
        }
    }

    #[test]
    fn sizes_that_disagree_are_refused() {
        assert!(serially(|run| integrate(&[0.0; 11], 2, 2, 1.0, run)).is_err());
        assert!(serially(|run| integrate(&[0.0; 12], 2, 2, 0.0, run)).is_err());
    }
}
