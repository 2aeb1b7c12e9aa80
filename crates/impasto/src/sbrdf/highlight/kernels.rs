//! Whole registers of pixels before the search and after it.

use core::f64::consts::LN_2;

use crate::brdf::torrance_sparrow::{GAMMA_MAX, GAMMA_MIN};
use crate::maps::Status;
use crate::math::Kernel;
use crate::math::elementary::{exp, power_of_two};
use crate::math::lanes::Isa;

use super::tile::{HighlightTile, HighlightTileMaps, STAGE};

/// `phi^2` of a sample that does not count: any lobe has vanished there.
const FAR: f32 = 1e10;

/// Beyond one, the width may be anything: its standard deviation relative to itself.
const OPEN: f32 = 1.0;

/// Largest strength in units of the brightest sample. Beyond it every sample lies where the lobe has
/// fallen below the rounding of its strength: one dim sample determines neither strength nor width,
/// which a search then makes as narrow and as strong as numbers allow.
const FARTHEST: f32 = 1.0 / f32::EPSILON;

/// Makes the pixels from `staged` on ready.
pub(super) struct Prepare<'t, 'a>(pub(super) &'t mut HighlightTile<'a>);

impl Kernel for Prepare<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let HighlightTile {
            highlights,
            observations,
            maps,
            used,
            top,
            size,
            stage,
            strengths,
            staged,
            ..
        } = self.0;
        let count = STAGE.min(used.len() - *staged);
        let mut scales = [0.0; STAGE];
        for (((scale, strength), &size), &top) in
            scales.iter_mut().zip(strengths).zip(&size[*staged..]).zip(&top[*staged..])
        {
            *scale = power_of_two(size).recip();
            *strength = top * *scale;
        }
        let (samples, angles) = stage.split_at_mut(*observations);
        for (i, (sample, angle)) in samples.iter_mut().zip(angles).enumerate() {
            let from = i * highlights.pixels + maps.start + *staged;
            let ys = &highlights.samples[from..from + count];
            let phis = &highlights.phi[from..from + count];
            for ((((sample, angle), &y), &phi), &scale) in
                sample.iter_mut().zip(angle).zip(ys).zip(phis).zip(&scales)
            {
                let counts = y.is_finite() & phi.is_finite();
                *sample = if counts { y * scale } else { 0.0 };
                *angle = if counts { (phi * phi).min(FAR) } else { FAR };
            }
        }
    }
}

/// Counts the samples of every pixel and finds the largest, signed and in magnitude, plane by plane
/// as they lie in memory.
pub(super) struct Survey<'t, 'a>(pub(super) &'t mut HighlightTile<'a>);

impl Kernel for Survey<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let HighlightTile { highlights, observations, maps, used, top, size, .. } = self.0;
        for i in 0..*observations {
            let from = i * highlights.pixels + maps.start;
            let samples = &highlights.samples[from..from + used.len()];
            let angles = &highlights.phi[from..from + used.len()];
            for ((((&y, &phi), used), top), size) in samples
                .iter()
                .zip(angles)
                .zip(used.iter_mut())
                .zip(top.iter_mut())
                .zip(size.iter_mut())
            {
                let counts = y.is_finite() & phi.is_finite();
                *used += u32::from(counts);
                *top = if counts && y > *top { y } else { *top };
                *size = if counts && y.abs() > *size { y.abs() } else { *size };
            }
        }
    }
}

/// Makes maps of what the search found.
pub(super) struct Finish<'t, 'a>(pub(super) &'t mut HighlightTile<'a>);

impl Kernel for Finish<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let HighlightTile { maps, used, size, .. } = self.0;
        let count = used.len();
        let HighlightTileMaps { beta, gamma, covariance, residual, status, .. } = maps;
        let (betas, sizes) = (&mut beta[..count], &size[..count]);
        let [of_beta, of_both, of_gamma] = covariance.each_mut().map(|plane| &mut plane[..count]);
        let (gammas, residuals, codes) =
            (&mut gamma[..count], &mut residual[..count], &mut status[..count]);
        let doubtful = Status::IllConditioned.code();
        let too_far = Status::RankDeficient.code();
        let too_large = Status::InvalidInput.code();
        for i in 0..count {
            let samples = used[i] as f32;
            // Pixels that were given up hold NaN and their status already.
            let known = codes[i] < Status::Dark.code();
            let exact = samples <= 2.0;
            let cost = residuals[i];
            let gamma = (LN_2 as f32).sqrt() * exp(gammas[i] * -0.5);
            let variance = if exact { f32::NAN } else { cost / (samples - 2.0) };
            // d gamma / d ln k = -gamma / 2.
            let slope = -0.5 * gamma;
            let spread = of_gamma[i] * variance * slope * slope;
            let at_bound = gamma >= 0.999 * GAMMA_MAX as f32 || gamma <= 1.001 * GAMMA_MIN as f32;
            let wide = spread > OPEN * OPEN * gamma * gamma;
            let open = at_bound || wide || codes[i] == doubtful;
            let fitted = if open { Status::IllConditioned } else { Status::Fitted }.code();
            let code = if exact { Status::Exact.code() } else { fitted };
            let own = [of_beta[i] * variance, of_both[i] * variance * slope, spread];
            // One factor at a time: the square of a scale may leave the range that the variance,
            // far smaller, stays in.
            let scale = power_of_two(sizes[i]);
            let square = own[0] * scale * scale;
            let square = if own[0] > 0.0 { square.max(f32::MIN_POSITIVE) } else { square };
            let whole = [square, own[1] * scale, spread];
            let beta = betas[i] * scale;
            let sure = |[b, both, g]: [f32; 3]| exact | (b + both.abs() + g).is_finite();
            let code = if sure(whole) & beta.is_normal() { code } else { too_large };
            // NaN is too far as well.
            let near = betas[i] <= FARTHEST;
            let code = if sure(own) & near { code } else { too_far };
            let given = known & (code < Status::Dark.code());
            let or_nan = |value: f32| if given { value } else { f32::NAN };
            gammas[i] = or_nan(gamma);
            of_beta[i] = or_nan(if exact { f32::NAN } else { square });
            of_both[i] = or_nan(whole[1]);
            of_gamma[i] = or_nan(spread);
            residuals[i] = or_nan(if exact { f32::NAN } else { (cost / samples).sqrt() * scale });
            betas[i] = if known { or_nan(beta) } else { betas[i] };
            codes[i] = if known { code } else { codes[i] };
        }
    }
}
