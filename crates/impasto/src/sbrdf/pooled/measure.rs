//! Errors of every pixel under a known lobe: its residual, the standard deviation of its normal, and
//! how far the strength of its own samples is from the painting's.

use crate::math::lanes::Isa;
use crate::math::{Kernel, Real};
use crate::pixels::Run;
use crate::sbrdf::neighbouring_lights::NeighbouringLights;

use super::normal_covariance::NormalErrors;
use super::pixel::{CommonLobe, Pixels};
use super::samples::{Photographs, PooledTile, Samples};
use super::scale::Gaussian;
use crate::math::tail::{load, store};

/// What a tile's pixels show, side by side.
#[derive(Default)]
pub(super) struct Measured {
    pub(super) residual: Vec<f32>,
    pub(super) sigma: Vec<f32>,
    /// Standard deviation of a sample, estimated from the pixel's own residuals.
    pub(super) noise: Vec<f32>,
    /// The pixel's own strength less the painting's: one least-squares step, every sample counted.
    pub(super) apart: Vec<f32>,
    /// Standard deviation of that step per unit of noise.
    pub(super) doubt: Vec<f32>,
    /// Photographs that count.
    pub(super) used: Vec<f32>,
}

impl Measured {
    pub(super) fn resize(&mut self, count: usize) {
        let Self { residual, sigma, noise, apart, doubt, used } = self;
        for map in [residual, sigma, noise, apart, doubt, used] {
            map.resize(count, 0.0);
        }
    }
}

pub(super) struct Measure<'a, 'b> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'b PooledTile<'a>,
    pub(super) out: &'b mut Measured,
    pub(super) samples: &'a Samples,
    pub(super) lobe: CommonLobe,
    pub(super) gaussian: Gaussian,
    pub(super) neighbours: &'a NeighbouringLights,
}

impl Kernel for Measure<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { photographs, run, tile, out, samples, lobe, gaussian, neighbours } = self;
        let zero = I::F32::zero();
        let endless = I::F32::of(f64::from(f32::MAX));
        let mut pixels = Pixels::<I::F32>::new(photographs, lobe);
        let mut colours = vec![zero; photographs.bands];
        let mut pulls = vec![zero; photographs.bands];
        let mut errors = NormalErrors::<I::F32>::new(photographs.pairs.len(), photographs.bands);
        // Unknowns of a pixel, in photographs: two tilts are shared by all bands.
        let unknowns = I::F32::of(1.0 + 2.0 / photographs.bands as f64);
        let mut at = 0;
        // A tile of hundreds of photographs takes long.
        while at < tile.count && !run.cancelled() {
            pixels.look(&samples.rows(), at);
            for (band, colour) in colours.iter_mut().enumerate() {
                *colour = load(tile.diffuse[band], at);
            }
            let normal = tile.normal_at::<I::F32>(at);
            pixels.leave::<true>(normal, &colours);
            let scale = pixels.scale(pixels.above());
            let sums = pixels.equations::<4>(normal, &colours, scale, &mut pulls);
            let reduced = sums.reduced(&colours, &pulls);
            // Variance of one sample, were the noise normal.
            // As many samples as unknowns leave no residual to judge by (hard case 30).
            let freedom = pixels.used - unknowns;
            let judged = freedom.gt(zero);
            let nan = I::F32::splat(f32::NAN);
            let noise = scale * I::F32::of(1.0 / gaussian.scale) * pixels.used / freedom;
            let noise = I::F32::select(judged, noise, nan);
            let spread = noise * I::F32::of(gaussian.spread);

            // Larger eigenvalue of the inverse of the normal's 2 x 2 block.
            let [xx, xy, yy, ..] = reduced.matrix;
            let middle = (xx + yy) * I::F32::of(0.5);
            let apart = (xx - yy) * I::F32::of(0.5);
            let reach = apart.mul_add(apart, xy * xy).sqrt();
            let determinant = xx.mul_add(yy, -(xy * xy));
            let worst =
                I::F32::select(determinant.gt(zero), (middle + reach) / determinant, endless);
            let [scatter, coherence, smooth] =
                errors.of(&pixels, normal, &colours, scale, &neighbours.nearest);
            let variance = spread * worst;
            let more = (scatter * pixels.used / freedom - variance).max(zero);
            let sigma = coherence.mul_add(more, variance).sqrt() * smooth;
            // Half a sphere is as unknown as a normal can be.
            let sigma = sigma.min(I::F32::of(core::f64::consts::FRAC_PI_2));
            let sigma = I::F32::select(judged, sigma, nan);

            let residual = (sums.square / sums.weight).sqrt();
            let residual = I::F32::select(judged, residual, nan);

            // One Gauss-Newton step of the pixel's own beta. A highlight that the painting's lobe
            // does not describe would be an outlier; here it keeps its weight.
            let sums = pixels.equations::<4>(normal, &colours, endless, &mut pulls);
            let own = sums.reduced(&colours, &pulls).without_tilts();
            let information = own.matrix[0];
            let determined = information.gt(zero);
            let apart = I::F32::keep(determined, own.descent[0] / information);
            let doubt = I::F32::select(determined, information.sqrt().recip(), endless);

            store(residual, &mut out.residual, at);
            store(sigma, &mut out.sigma, at);
            store(noise.sqrt(), &mut out.noise, at);
            store(apart, &mut out.apart, at);
            store(doubt, &mut out.doubt, at);
            store(pixels.used, &mut out.used, at);
            at += I::F32::WIDTH;
        }
    }
}
