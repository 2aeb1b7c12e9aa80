//! Lafortune lobes: two numbers, `ln n` and `n turn`.
//!
//! Seen from the mirror to the normal a lobe's strength goes with `(1 + turn)^n`: what samples tell
//! is `n turn`, and bounds on it hold for any n.

use crate::brdf::lafortune::{self, coefficients};
use crate::math::elementary::exp;
use crate::math::{Real, Vec3};

use super::model::{LobeModel, MAX_NUMBERS, MAX_SHAPES, Slope, Visit};

/// Isotropic Lafortune lobes with an arbitrary normal; radiance carries `N.L`.
#[derive(Clone, Copy, Debug)]
pub struct Lafortune;

/// A light and a view, unit vectors, and their product.
#[derive(Clone, Copy, Debug)]
pub struct Sighted<R> {
    light: Vec3<R>,
    view: Vec3<R>,
    light_view: R,
}

/// A lobe, and what its derivatives need besides.
#[derive(Clone, Copy, Debug)]
pub struct Turned<R> {
    lobe: lafortune::Lobe<R>,
    turn: R,
    /// `1 / n`.
    width: R,
}

/// `ln n` of the widest and of the sharpest lobe: n = 1/2 is broader than a cosine, 22,000 sharper
/// than any that was measured.
const LOG_EXPONENT: [f64; 2] = [-core::f64::consts::LN_2, 10.0];

/// Largest `n |turn|`; measured lobes have up to 6.
const TURN: f64 = 8.0;

/// Phong's lobes of n = 50, 5 and 20, from which the third paper starts.
const STARTS: [[f64; MAX_SHAPES]; 3] = [[3.912, 0.0], [1.609, 0.0], [2.996, 0.0]];

/// `L + V` shorter than this (hard case 23): light and view oppose each other.
const OPPOSED: f64 = 1e-3;

impl LobeModel for Lafortune {
    type Pair<R: Real> = Sighted<R>;
    type Lobe<R: Real> = Turned<R>;
    const SHAPES: usize = 2;
    const NAMES: &'static [&'static str] = &["cxy", "cz", "exponent"];

    #[inline(always)]
    fn pair<R: Real>(&self, light: Vec3<R>, view: Vec3<R>) -> Sighted<R> {
        Sighted { light, view, light_view: light.dot(view) }
    }
    #[inline(always)]
    fn spread<R: Real>(&self, pair: &Sighted<f64>) -> Sighted<R> {
        Sighted {
            light: pair.light.splat(),
            view: pair.view.splat(),
            light_view: R::of(pair.light_view),
        }
    }
    #[inline(always)]
    fn facing(&self, pair: &Sighted<f64>) -> Vec3<f64> {
        let sum = pair.light + pair.view;
        if sum.length() < OPPOSED { pair.view } else { sum.normalised() }
    }
    #[inline(always)]
    fn lobe<R: Real>(&self, [log_exponent, turning]: [R; MAX_SHAPES]) -> Turned<R> {
        let width = exp(-log_exponent);
        let turn = turning * width;
        Turned { lobe: lafortune::Lobe::new(R::one(), turn, log_exponent), turn, width }
    }
    #[inline(always)]
    fn told<R: Real>(&self, [cxy, cz, exponent]: [R; MAX_NUMBERS]) -> Turned<R> {
        // The tangent of half the angle from (-1, 1).
        let turn = (cz + cxy) / (R::of(2.0) + (cz - cxy));
        let lobe = lafortune::Lobe::of_coefficients(R::one(), cxy, cz, exponent);
        Turned { lobe, turn, width: exponent.recip() }
    }
    #[inline(always)]
    fn value<R: Real>(&self, lobe: &Turned<R>, pair: &Sighted<R>, normal: Vec3<R>) -> R {
        let pair = lafortune::Pair::against(normal, pair.light, pair.view, pair.light_view);
        pair.cosine * R::keep(pair.cosine.gt(R::zero()), lobe.lobe.value(&pair))
    }
    #[inline(always)]
    fn slope<R: Real>(&self, lobe: &Turned<R>, sight: &Sighted<R>, normal: Vec3<R>) -> Slope<R> {
        let Sighted { light, view, light_view } = *sight;
        let pair = lafortune::Pair::against(normal, light, view, light_view);
        let seen = pair.cosine.gt(R::zero());
        let g = lobe.lobe.gradient(&pair);
        // d f (N.L) / dN = f L + (N.L) df/dN, and d upright / dN = (N.V) L + (N.L) V.
        let upright = pair.cosine * g.normal;
        let along_light = R::keep(seen, upright.mul_add(normal.dot(view), g.value));
        let along_view = R::keep(seen, upright * pair.cosine);
        let lit = |value: R| R::keep(seen, pair.cosine * value);
        Slope {
            value: lit(g.value),
            shape: [lit((-lobe.turn).mul_add(g.turn, g.log_exponent)), lit(g.turn * lobe.width)],
            normal: light.scale(along_light) + view.scale(along_view),
        }
    }
    fn bounds(&self) -> [[f64; MAX_SHAPES]; 2] {
        [[LOG_EXPONENT[0], -TURN], [LOG_EXPONENT[1], TURN]]
    }
    fn starts(&self) -> &'static [[f64; MAX_SHAPES]] {
        &STARTS
    }
    fn spreads(&self) -> [f64; MAX_SHAPES] {
        // ln n as ln k of facets: n goes with k / 4.
        [0.25, 0.25]
    }
    fn order(&self, [log_exponent, _]: [f32; MAX_SHAPES]) -> f32 {
        log_exponent
    }
    fn report(&self, [log_exponent, turning]: [f32; MAX_SHAPES], numbers: &mut [f32]) {
        let exponent = f64::from(log_exponent).exp();
        let [cxy, cz] = coefficients(f64::from(turning) / exponent);
        numbers.copy_from_slice(&[cxy, cz, exponent].map(|number| number as f32));
    }
    fn dispatch<V: Visit>(lobes: usize, visit: V) -> V::Output {
        match lobes {
            0 => visit.visit::<0, 2, 2>(),
            1 => visit.visit::<1, 3, 4>(),
            2 => visit.visit::<2, 4, 6>(),
            _ => visit.visit::<3, 5, 8>(),
        }
    }
}
