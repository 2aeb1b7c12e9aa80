//! Estimation of Lafortune lobes: two unknowns, `ln n` and `n turn`.
//!
//! In directions off the mirror a lobe's strength goes with `(1 + turn)^n`: samples determine
//! `n turn`, and bounds on it hold for any n.

use crate::brdf::lafortune::{self, coefficients};
use crate::math::elementary::exp;
use crate::math::{Real, Vec3};
use crate::surface::{Lafortune, LightView, TurnedLobe};

use super::model::{LobeEstimation, MAX_SHAPES, Slope, Visit};

/// `ln n` of the widest and of the sharpest lobe: n = 1/2 is broader than a cosine, 22,000 sharper
/// than any that was measured.
const LOG_EXPONENT: [f64; 2] = [-core::f64::consts::LN_2, 10.0];

/// Largest `n |turn|`; measured lobes have up to 6.
const TURN: f64 = 8.0;

/// Phong's lobes of n = 50, 5 and 20, from which the third paper starts.
const STARTS: [[f64; MAX_SHAPES]; 3] = [[3.912, 0.0], [1.609, 0.0], [2.996, 0.0]];

/// `L + V` shorter than this (hard case 23): light and view oppose each other.
const OPPOSED: f64 = 1e-3;

impl LobeEstimation for Lafortune {
    const SHAPES: usize = 2;

    #[inline(always)]
    fn facing(&self, pair: &LightView<f64>) -> Vec3<f64> {
        let sum = pair.light + pair.view;
        if sum.length() < OPPOSED { pair.view } else { sum.normalised() }
    }
    #[inline(always)]
    fn lobe_from_unknowns<R: Real>(
        &self,
        [log_exponent, turning]: [R; MAX_SHAPES],
    ) -> TurnedLobe<R> {
        let width = exp(-log_exponent);
        let turn = turning * width;
        TurnedLobe { lobe: lafortune::Lobe::new(R::one(), turn, log_exponent), turn, width }
    }
    #[inline(always)]
    fn slope<R: Real>(
        &self,
        lobe: &TurnedLobe<R>,
        sight: &LightView<R>,
        normal: Vec3<R>,
    ) -> Slope<R> {
        let LightView { light, view, light_view } = *sight;
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
    fn deviations(&self) -> [f64; MAX_SHAPES] {
        // ln n as ln k of facets: n goes with k / 4.
        [0.25, 0.25]
    }
    fn order(&self, [log_exponent, _]: [f32; MAX_SHAPES]) -> f32 {
        log_exponent
    }
    fn parameters_from_unknowns(
        &self,
        [log_exponent, turning]: [f32; MAX_SHAPES],
        parameters: &mut [f32],
    ) {
        let exponent = f64::from(log_exponent).exp();
        let [cxy, cz] = coefficients(f64::from(turning) / exponent);
        parameters.copy_from_slice(&[cxy, cz, exponent].map(|number| number as f32));
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
