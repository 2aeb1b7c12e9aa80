//! What can be said of every pixel once the lobe is known: residual, error of the normal, and
//! whether its own samples agree with the painting's lobe.

use crate::math::lanes::Isa;
use crate::math::{Kernel, Real};
use crate::pixels::Run;

use super::irls::eliminate_tilts;
use super::pixel::{Lobe, Pixels};
use super::samples::{Photographs, Tile};
use super::scale::Gaussian;
use crate::sbrdf::lanes::{load, store};

/// Maps that a tile fills.
pub(super) struct Plates<'a> {
    pub(super) residual: &'a mut [f32],
    pub(super) sigma: &'a mut [f32],
    /// Standard deviation of a sample, as far as the pixel's own residuals tell.
    pub(super) noise: &'a mut [f32],
    /// The pixel's own strength less the painting's: one least-squares step, every sample counted.
    pub(super) apart: &'a mut [f32],
    /// Standard deviation of that step per unit of noise.
    pub(super) doubt: &'a mut [f32],
}

pub(super) struct Measure<'a, 'b> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'b Tile<'a>,
    pub(super) out: Plates<'b>,
    pub(super) samples: &'a [f32],
    pub(super) stride: usize,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) lobe: Lobe,
    pub(super) gaussian: Gaussian,
}

impl Kernel for Measure<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { photographs, run, tile, out, samples, stride, x, y, lobe, gaussian } = self;
        let zero = I::F32::zero();
        let endless = I::F32::of(f64::from(f32::MAX));
        let mut pixels = Pixels::<I::F32>::new(photographs, lobe);
        let mut colours = vec![zero; photographs.bands];
        let mut pulls = vec![zero; photographs.bands];
        // Unknowns of a pixel, in photographs: two tilts are shared by all bands.
        let unknowns = I::F32::of(1.0 + 2.0 / photographs.bands as f64);
        let mut at = 0;
        // A tile of hundreds of photographs takes long.
        while at < tile.count && !run.cancelled() {
            pixels.look(samples, stride, x, y, at);
            for (band, colour) in colours.iter_mut().enumerate() {
                *colour = load(tile.diffuse[band], at);
            }
            let normal = tile.normal_at::<I::F32>(at);
            let scale = pixels.visit(normal, &colours, None);
            let sums = pixels.equations(normal, &colours, scale, &mut pulls);
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
            // Half a sphere is as unknown as a normal can be.
            let sigma = (spread * worst).sqrt().min(I::F32::of(core::f64::consts::FRAC_PI_2));
            let sigma = I::F32::select(judged, sigma, nan);

            let residual = (sums.square / sums.weight).sqrt();
            let residual = I::F32::select(judged, residual, nan);

            // One step of the pixel's own beta. A highlight that the painting's lobe does not
            // describe would be an outlier: here it is what is asked for, and keeps its weight.
            let sums = pixels.equations(normal, &colours, endless, &mut pulls);
            let own = eliminate_tilts(&sums.reduced(&colours, &pulls));
            let information = own.matrix[0];
            let told = information.gt(zero);
            let apart = I::F32::keep(told, own.descent[0] / information);
            let doubt = I::F32::select(told, information.sqrt().recip(), endless);

            store(residual, out.residual, at);
            store(sigma, out.sigma, at);
            store(noise.sqrt(), out.noise, at);
            store(apart, out.apart, at);
            store(doubt, out.doubt, at);
            at += I::F32::WIDTH;
        }
        for pixel in (0..tile.count).filter(|&pixel| !tile.estimated(pixel)) {
            out.residual[pixel] = f32::NAN;
            out.sigma[pixel] = f32::NAN;
            out.noise[pixel] = f32::NAN;
        }
    }
}
