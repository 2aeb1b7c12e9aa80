//! Stored samples, decoded block by block.

use crate::math::Real;

use super::problem::StereoProblem;
use super::rows::{Aligned, MAX_LANES, PlaneRows};

/// Pixels that are decoded at a time: 16 photographs of them fill the first-level cache.
pub(super) const BLOCK: usize = 512;

/// From plane to plane of a block: not a power of two, so that the planes do not compete for the
/// same lines of the cache.
const STRIDE: usize = BLOCK + 16;

/// Planes that are prefetched ahead of the one that is read: reading four takes as long as memory
/// does to answer, and of planes that lie a power of two apart a set of the cache holds eight.
const AHEAD: usize = 4;

/// One block of pixels; each worker has one.
pub(super) struct StereoScratch {
    /// Linear samples `(obs, band)`, or where nobody needs them any more those of one photograph.
    samples: Aligned,
    /// Whether they are kept.
    kept: bool,
    /// Their means over the bands `(obs)`, empty if there is only one band.
    means: Aligned,
    /// Coordinates in mm.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
}

impl StereoScratch {
    pub(super) fn new(problem: &StereoProblem<'_>) -> Self {
        let shape = problem.stack.shape();
        let means = if shape.bands == 1 { 0 } else { shape.observations };
        let kept = shape.bands == 1 || problem.albedo || problem.options.selection.is_some();
        let photographs = if kept { shape.observations } else { 1 };
        Self {
            samples: Aligned::new(photographs * shape.bands * STRIDE),
            kept,
            means: Aligned::new(means * STRIDE),
            x: vec![0.0; BLOCK],
            y: vec![0.0; BLOCK],
        }
    }

    #[inline(always)]
    pub(super) fn read<R: Real<Scalar = f32>>(
        &mut self,
        problem: &StereoProblem<'_>,
        start: usize,
    ) {
        let bands = problem.stack.shape().bands;
        let planes = problem.stack.shape().observations * bands;
        let share = R::of(1.0 / bands as f64);
        let samples = self.samples.get_mut();
        for k in 0..problem.stack.shape().observations {
            let first = if self.kept { k * bands } else { 0 };
            let rows = &mut samples[first * STRIDE..(first + bands) * STRIDE];
            for band in 0..bands {
                let next = k * bands + band + AHEAD;
                let (next, block) =
                    if next < planes { (next, start) } else { (next % planes, start + BLOCK) };
                problem.stack.prefetch(next / bands, next % bands, block, BLOCK);
                problem.stack.read(k, band, start, &mut rows[band * STRIDE..][..BLOCK]);
            }
            if bands > 1 {
                // While they are in the nearest cache.
                let (rows, mean) =
                    (PlaneRows::new(rows, STRIDE), &mut self.means.get_mut()[k * STRIDE..]);
                for at in (0..BLOCK).step_by(R::WIDTH) {
                    let mut sum: R = rows.from(at).at(0);
                    for band in 1..bands {
                        sum = sum + rows.from(at).at::<R>(band);
                    }
                    (sum * share).store(&mut mean[at..]);
                }
            }
        }
        if !problem.rig.is_distant() || problem.near_views {
            problem.rig.grid().coordinates(start, &mut self.x, &mut self.y);
        }
    }
}

/// The samples of one register of pixels.
#[derive(Clone, Copy)]
pub(super) struct RegisterSamples<'a> {
    /// Every band of every light, `(obs, band)`.
    pub(super) bands: PlaneRows<'a>,
    /// Their means: one clipped band makes it infinite, one missing band NaN.
    pub(super) means: PlaneRows<'a>,
    /// What normals are solved from.
    pub(super) signal: PlaneRows<'a>,
}

impl<'a> RegisterSamples<'a> {
    #[inline(always)]
    pub(super) fn of(scratch: &'a StereoScratch, problem: &StereoProblem<'_>, at: usize) -> Self {
        let count = problem.stack.shape().bands;
        let bands = PlaneRows::new(&scratch.samples.get()[at..], STRIDE);
        let means =
            if count == 1 { bands } else { PlaneRows::new(&scratch.means.get()[at..], STRIDE) };
        let signal = match problem.options.selection {
            Some(band) => {
                PlaneRows::new(&scratch.samples.get()[band * STRIDE + at..], count * STRIDE)
            }
            None => means,
        };
        Self { bands, means, signal }
    }
}

/// Samples of one register of pixels after a look at each, `(obs, lane)`.
pub(super) struct ScreenedSamples {
    /// Means of the bands relative to the light's irradiance; NaN where invalid.
    pub(super) relative: Vec<f32>,
    /// What normals are solved from; 0 where invalid.
    pub(super) signal: Vec<f32>,
}

impl ScreenedSamples {
    pub(super) fn new(problem: &StereoProblem<'_>) -> Self {
        let empty = vec![0.0; problem.rig.observations() * MAX_LANES];
        Self { relative: empty.clone(), signal: empty }
    }
}
