//! The M-scale of a pixel's residuals, whose minimum is an S-estimate [@rousseeuw1984s].
//!
//! The scale `s` of residuals `r_i` (each the root mean square over the bands of one photograph)
//! solves `mean rho(r_i^2 / s^2) = 1/4` with `rho(v) = v / (1 + v)`. Up to a quarter of
//! the photographs may be anything (shadows, highlights that the model does not know) before it
//! grows without bound, and a photograph's weight `rho'` = `1 / (1 + v)^2` falls to nothing. An
//! estimate that minimises this scale needs no scale from elsewhere, and iteratively reweighted
//! least squares with these weights lowers it step by step.

use crate::math::{Mask, Real};

/// Mean of `rho`: the share of photographs that may be lost.
const SHARE: f64 = 0.25;

/// Steps of Halley's method [@gander1985halley] at most. One changes the scale by at most [`REACH`]: they get past outliers of any
/// size, from a mean that those may have ruined.
const STEPS: usize = 20;
const REACH: f64 = 16.0;

/// A step of this relative size is the last: its error is the cube of it.
const NEAR: f64 = 1e-2;

/// A squared scale above that of `squares`, of which there are `count`, by the concavity of rho.
#[inline(always)]
pub(super) fn above<R: Real>(squares: &[R], count: R) -> R {
    let mut sum = R::zero();
    for &square in squares {
        sum = sum + square;
    }
    sum / count * R::of(1.0 / SHARE - 1.0)
}

/// The squared scale of `squares` (0 where not usable), of which there are `count`, from one that is
/// `near`; at least `floor`.
#[inline(always)]
pub(super) fn squared_scale<R: Real>(squares: &[R], count: R, floor: R, near: R) -> R {
    let target = count * R::of(SHARE);
    let mut scale = near.max(floor);
    // A lane stops on its own account: its neighbours change no bit of it.
    let mut active = scale.is_finite();
    for _ in 0..STEPS {
        // Derivatives by the logarithm of the scale, up to factors: numbers of the size of the count.
        let (mut level, mut slope, mut bend) = (-target, R::zero(), R::zero());
        for &square in squares {
            let inverse = (square + scale).recip();
            let (share, rest) = (square * inverse, scale * inverse);
            let tangent = share * rest;
            level = level + share;
            slope = slope + tangent;
            bend = tangent.mul_add(rest, bend);
        }
        // At most twice Newton's step.
        let square = slope * slope;
        let bottom = (-level).mul_add(bend, square).max(square * R::of(0.5));
        let step = R::keep(slope.gt(R::zero()), scale * (level * slope / bottom));
        let next = (scale + step).max(scale * R::of(1.0 / REACH)).min(scale * R::of(REACH));
        let next = next.max(floor);
        let far = (next - scale).abs().gt(scale * R::of(NEAR));
        scale = R::select(active, next, scale);
        active = active & far;
        if !active.any() {
            break;
        }
    }
    scale
}

/// Weight of a photograph with squared residual `square`; 0 where not `usable`, by selection.
#[inline(always)]
pub(super) fn weight<R: Real>(square: R, scale: R, usable: R::Mask) -> R {
    let fit = scale / (square + scale);
    R::keep(usable, fit * fit)
}

/// What normal noise of unit variance in every one of `bands` bands gives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaussian {
    /// Squared scale over the variance of one sample.
    pub(super) scale: f64,
    /// Curvature of the scale over that of the weighted least squares beside it.
    pub(super) curvature: f64,
    /// Variance of an estimate over that of `(sum of w J J')^-1`.
    pub(super) spread: f64,
}

impl Gaussian {
    /// By quadrature over the length of the residual vector, chi-distributed.
    pub(super) fn of(bands: usize) -> Self {
        let dimensions = bands as f64;
        let mean = |f: &dyn Fn(f64) -> f64| {
            let (mut top, mut bottom) = (0.0, 0.0);
            let reach = dimensions.sqrt() + 9.0;
            for i in 0..4000 {
                let length = reach * (f64::from(i) + 0.5) / 4000.0;
                let density = ((dimensions - 1.0) * length.ln() - 0.5 * length * length).exp();
                top += density * f(length * length / dimensions);
                bottom += density;
            }
            top / bottom
        };
        // Bisection: the mean of rho falls with the scale.
        let (mut low, mut high) = (1e-3, 1e3);
        for _ in 0..60 {
            let middle = f64::sqrt(low * high);
            if mean(&|square| square / (square + middle)) > SHARE {
                low = middle;
            } else {
                high = middle;
            }
        }
        let scale = f64::sqrt(low * high);
        let weight = |square: f64| (scale / (square + scale)).powi(2);
        let average = mean(&weight);
        // d(w r)/dr per dimension: w + 2 w' |r|^2 / B, w' = -2 w / (square + scale).
        let steepness =
            mean(&|square| weight(square) * (1.0 - 4.0 * square / (square + scale) / dimensions));
        let power = mean(&|square| weight(square).powi(2) * square);
        Self {
            scale,
            curvature: steepness / average,
            spread: power * average / (steepness * steepness),
        }
    }
}

/// Masks that are set, counted in every lane.
#[inline(always)]
pub(super) fn count<R: Real>(masks: &[R::Mask]) -> R {
    debug_assert!(masks.len() < 1 << 24, "f32 counts no further");
    let mut sum = R::zero();
    for &mask in masks {
        sum = sum + R::keep(mask, R::one());
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hard_case_31_the_scale_solves_its_equation_and_ignores_a_fifth() {
        let mut squares: Vec<f64> = (1..41).map(|i| (f64::from(i) * 0.618_034).fract()).collect();
        for spoiled in [0, 8] {
            for square in &mut squares[..spoiled] {
                *square = 1e12;
            }
            let scale = squared_scale(&squares, 40.0, 0.0, above(&squares, 40.0));
            let mean: f64 = squares.iter().map(|s| s / (s + scale)).sum::<f64>() / 40.0;
            assert!((mean - SHARE).abs() < 1e-9, "{spoiled}: {mean}");
        }
        assert!(squared_scale(&squares, 40.0, 0.0, above(&squares, 40.0)) < 1e3);
    }

    #[test]
    fn no_residual_gives_the_floor() {
        assert_eq!(squared_scale(&[0.0_f32; 5], 5.0, 1e-12, 0.0), 1e-12);
    }

    #[test]
    fn noise_of_unit_variance_is_recognised() {
        // By adaptive quadrature with SciPy (`quad` over `chi2.pdf`, `brentq` for the scale).
        let tables = [
            (1, [1.888_985_943_5, 0.429_268_964_98, 1.004_249_921_1]),
            (3, [2.553_887_903_2, 0.733_206_227_45, 0.686_186_985_87]),
            (6, [2.764_445_055_4, 0.851_831_923_53, 0.622_305_529_18]),
        ];
        for (bands, expected) in tables {
            let found = Gaussian::of(bands);
            let found = [found.scale, found.curvature, found.spread];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-5, "{bands}: {found} {expected}");
            }
        }
    }
}
