//! The cost of a lobe, and its equations that remain when every pixel's normal and colours are
//! eliminated (variable projection [@golub1973varpro]).
//!
//! The colours are eliminated first, then the normal; the Schur complement that is left is the pixel's
//! 2 x 2 part of the normal equations of (beta, log k). The pooled step thereby accounts for normals and
//! colours that will follow it; a separate fit of the lobe does not.

use crate::lm::Normal;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::tail::load;
use crate::math::{Kernel, Real};
use crate::pixels::Run;

use super::pixel::{CommonLobe, Pixels};
use super::samples::{Photographs, PooledTile, Samples};

/// What the scales of pixels are compared with.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaleReference {
    /// A bright colour of the painting, the unit of scales.
    pub(super) brightness: f64,
    /// Added to every squared scale before its logarithm is taken: a pixel whose few codes the model
    /// happens to meet exactly determines no more than the noise of the painting permits.
    pub(super) noise_floor: f64,
}

/// Scales of pixels, each counted with its samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cost {
    /// Samples.
    count: f64,
    /// Samples times the logarithm of squared scale plus noise floor, over the brightness squared.
    log_scale: f64,
}

impl Cost {
    /// Of one pixel, if `used` photographs of so many bands determine its squared scale.
    pub(super) fn of(
        scale: f64,
        used: f64,
        bands: usize,
        reference: ScaleReference,
    ) -> Option<Self> {
        let count = used * bands as f64;
        let ScaleReference { brightness, noise_floor } = reference;
        // As many samples as unknowns determine no scale (hard case 30); NaN fails the tests (hard case 26).
        let determined = count > (bands + 2) as f64 && scale > 0.0 && scale < f64::INFINITY;
        determined.then(|| Self {
            count,
            log_scale: count * ((scale + noise_floor) / (brightness * brightness)).ln(),
        })
    }

    pub(super) fn merge(&mut self, other: Self) {
        self.count += other.count;
        self.log_scale += other.log_scale;
    }

    /// Geometric mean over the pixels of squared scale plus noise floor.
    fn mean(self, brightness: f64) -> f64 {
        let mean = if self.count > 0.0 { (self.log_scale / self.count).exp() } else { 0.0 };
        mean * brightness * brightness
    }

    /// The number of samples times the mean. Where all pixels are equally noisy it is the weighted sum of
    /// squares; a pixel that the model does not describe cannot outweigh the others.
    pub(super) fn value(self, brightness: f64) -> f64 {
        self.mean(brightness) * self.count
    }
}

/// The normal equations of (beta, log k), a sum over pixels, each in units of its own scale.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LobeEquations {
    pub(super) cost: Cost,
    pub(super) descent: [f64; 2],
    pub(super) matrix: [[f64; 2]; 2],
    /// The same of pixels whose residuals are rounding: they contribute to no step, but determine
    /// (beta, log k) as well as rounding permits.
    pub(super) exact: [[f64; 2]; 2],
    /// Sum of the outer products of the pixels' gradients, or the expected value of those.
    pub(super) scatter: [[f64; 2]; 2],
}

impl LobeEquations {
    pub(super) fn merge(&mut self, other: &Self) {
        self.cost.merge(other.cost);
        for i in 0..2 {
            self.descent[i] += other.descent[i];
            for j in 0..=i {
                self.matrix[i][j] += other.matrix[i][j];
                self.exact[i][j] += other.exact[i][j];
                self.scatter[i][j] += other.scatter[i][j];
            }
        }
    }

    /// Information of all pixels about (beta, log k).
    pub(super) fn information(&self) -> [[f64; 2]; 2] {
        core::array::from_fn(|i| core::array::from_fn(|j| self.matrix[i][j] + self.exact[i][j]))
    }

    /// As a sum of squares.
    pub(super) fn normal(&self, brightness: f64) -> Normal<f64, 2> {
        let mean = self.cost.mean(brightness);
        Normal {
            cost: self.cost.value(brightness),
            descent: self.descent.map(|v| v * mean),
            matrix: self.matrix.map(|row| row.map(|v| v * mean)),
        }
    }
}

/// The equations of a lobe from a tile's pixels, whose normals and colours are the best under it.
pub(super) struct Equate<'a, 'b> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'b PooledTile<'b>,
    /// Squared scales there.
    pub(super) scales: &'b [f32],
    pub(super) samples: &'b Samples,
    pub(super) lobe: CommonLobe,
    pub(super) scale_reference: ScaleReference,
}

impl Kernel for Equate<'_, '_> {
    type Output = LobeEquations;

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn run<I: Isa>(self) -> LobeEquations {
        let Self { photographs, run, tile, scales, samples, lobe, scale_reference } = self;
        let bands = photographs.bands;
        let pixels = &mut Pixels::<I::F32>::new(photographs, lobe);
        let mut colours = vec![I::F32::zero(); bands];
        let mut pulls = vec![I::F32::zero(); bands];
        let mut equations = LobeEquations::default();
        let mut at = 0;
        // A tile of hundreds of photographs takes long.
        while at < tile.count && !run.cancelled() {
            pixels.look(&samples.rows(), at);
            tile.colours_at(at, &mut colours);
            let normal = tile.normal_at::<I::F32>(at);
            pixels.leave::<true>(normal, &colours);
            let scale = pixels.scale(load(scales, at));
            let sums = pixels.equations::<4>(normal, &colours, scale, &mut pulls);
            let lobe = sums.reduced(&colours, &pulls).without_tilts();
            let values = [
                scale,
                pixels.floor,
                pixels.used,
                sums.square,
                lobe.descent[0],
                lobe.descent[1],
                lobe.matrix[0],
                lobe.matrix[1],
                lobe.matrix[2],
            ];
            let mut lanes = [[0.0_f32; MAX_LANES]; 9];
            for i in 0..values.len() {
                values[i].store(&mut lanes[i]);
            }
            for lane in 0..I::F32::WIDTH.min(tile.count - at) {
                let mut values = [0.0; 9];
                for i in 0..values.len() {
                    values[i] = f64::from(lanes[i][lane]);
                }
                if let Some(pixel) = of_pixel(values, bands, scale_reference) {
                    equations.merge(&pixel);
                }
            }
            at += I::F32::WIDTH;
        }
        equations
    }
}

/// One pixel's part of the equations.
fn of_pixel(
    values: [f64; 9],
    bands: usize,
    scale_reference: ScaleReference,
) -> Option<LobeEquations> {
    let [scale, floor, used, square, db, dk, bb, kb, kk] = values;
    let cost = Cost::of(scale, used, bands, scale_reference)?;
    if !values.iter().all(|value| value.is_finite()) {
        return None;
    }
    let noise_floor = scale_reference.noise_floor;
    // d log s^2 = -2 sum(w r dr) / sum(w r^2), and the pixel counts with its samples. At the floor
    // the scale moves no more.
    let moves = scale > floor && square > 0.0;
    let share = if moves { scale / (scale + noise_floor) } else { 0.0 };
    let rate = share * cost.count / (square * bands as f64).max(f64::MIN_POSITIVE);
    let descent = [db * rate, dk * rate];
    let known = |rate: f64| [[bb * rate, 0.0], [kb * rate, kk * rate]];
    // A sample within one scale counts for more where the scale moves: this errs on the safe side.
    let exact = known(if moves { 0.0 } else { (scale + noise_floor).recip() });
    Some(LobeEquations {
        cost,
        descent,
        matrix: known(rate),
        exact,
        // Rounding has no gradient: its scatter is the information (Fisher's identity).
        scatter: [
            [descent[0] * descent[0] + exact[0][0], 0.0],
            [descent[1] * descent[0] + exact[1][0], descent[1] * descent[1] + exact[1][1]],
        ],
    })
}
