//! Lafortune lobes [@lafortune1997nonlinear] of three parameters: Cxy, Cz and the exponent.

use crate::brdf::lafortune;
use crate::math::{Real, Scalar, Vec3};

use super::lobe_model::{LobeModel, MAX_PARAMETERS, Shape};
use super::sight::{Sight, angle, cosine};

/// Isotropic Lafortune lobes with an arbitrary normal; radiance carries `N.L`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lafortune;

/// A light and a view, unit vectors, and their inner product.
#[derive(Clone, Copy, Debug)]
pub struct LightView<R> {
    /// Direction to the light.
    pub light: Vec3<R>,
    /// Direction to the eye.
    pub view: Vec3<R>,
    /// `L.V`.
    pub light_view: R,
}

impl LobeModel for Lafortune {
    type Pair<R: Real> = LightView<R>;
    type Lobe<R: Real> = lafortune::Lobe<R>;
    type Seen<R: Real> = lafortune::Pair<R>;
    const NAMES: &'static [&'static str] = &["cxy", "cz", "exponent"];

    #[inline(always)]
    fn pair<R: Real>(&self, light: Vec3<R>, view: Vec3<R>) -> LightView<R> {
        LightView { light, view, light_view: light.dot(view) }
    }
    #[inline(always)]
    fn splat<S: Scalar, R: Real>(&self, pair: &LightView<S>) -> LightView<R> {
        LightView {
            light: pair.light.broadcast(),
            view: pair.view.broadcast(),
            light_view: R::of(pair.light_view.to_f64()),
        }
    }
    #[inline(always)]
    fn view<R: Real>(&self, pair: &LightView<R>) -> Vec3<R> {
        pair.view
    }
    #[inline(always)]
    fn lobe_from_parameters<R: Real>(
        &self,
        [cxy, cz, exponent]: [R; MAX_PARAMETERS],
    ) -> lafortune::Lobe<R> {
        lafortune::Lobe::of_coefficients(R::one(), cxy, cz, exponent)
    }
    #[inline(always)]
    fn seen<R: Real>(&self, pair: &LightView<R>, normal: Vec3<R>) -> lafortune::Pair<R> {
        lafortune::Pair::against(normal, pair.light, pair.view, pair.light_view)
    }
    #[inline(always)]
    fn shown<R: Real>(&self, lobe: &lafortune::Lobe<R>, pair: &lafortune::Pair<R>) -> R {
        pair.cosine * R::keep(pair.cosine.gt(R::zero()), lobe.value(pair))
    }
    /// Around its direction the lobe `cos^n` is a Gaussian of variance `1 / n`.
    #[inline(always)]
    fn spread_value<R: Real>(
        &self,
        lobe: &lafortune::Lobe<R>,
        pair: &LightView<R>,
        normal: Vec3<R>,
        spread: R,
    ) -> R {
        let seen = normal.dot(pair.view);
        let pair = lafortune::Pair::against(normal, pair.light, pair.view, pair.light_view);
        let value = lobe.spread_value(&pair, seen, spread);
        pair.cosine * R::keep(pair.cosine.gt(R::zero()), value)
    }

    /// Seen from the front the lobe is `|Cz|^n cos^n`: `cos^n` has the total `2 pi / (n + 1)` and the
    /// variance `1 / n` over directions of light, which move by twice what the normal does.
    fn total(&self, [_, cz, exponent]: [f64; MAX_PARAMETERS]) -> f64 {
        let log = (exponent * cz.abs().max(1e-9).ln()).clamp(-60.0, 60.0);
        log.exp() / (exponent + 1.0)
    }
    fn variance(&self, [_, _, exponent]: [f64; MAX_PARAMETERS]) -> f64 {
        0.25 / exponent.max(1e-3)
    }
    fn widened(&self, [cxy, cz, _]: [f64; MAX_PARAMETERS], variance: f64) -> [f64; MAX_PARAMETERS] {
        [cxy, cz, 0.25 / variance]
    }

    /// `s^n (N.L)`: with the view's mirror image `R = 2 (N.V) N - V`, which moves by twice the angle
    /// by which the normal does, `s = Cz (V.L + R.L) / 2 + Cxy (V.L - R.L) / 2` is largest in a
    /// corner of what its terms can be.
    fn most(&self, [cxy, cz, exponent]: &Shape, sight: &Sight) -> f64 {
        let Sight { normals, light, view, spread: scattered } = sight;
        let near = light.angle + view.angle;
        let between = angle(view.axis, light.axis);
        let direct = [cosine(between + near), cosine(between - near)];
        let n = normals.axis;
        let mirrored = n.scale(2.0 * n.dot(view.axis)) - view.axis;
        let (middle, spread) = (angle(mirrored, light.axis), 2.0 * normals.angle + near);
        let reflected = [cosine(middle + spread), cosine(middle - spread)];
        let mut base = 0.0_f64;
        for direct in direct {
            for reflected in reflected {
                for cz in cz {
                    for cxy in cxy {
                        let s = 0.5 * cz.mul_add(direct + reflected, cxy * (direct - reflected));
                        base = base.max(s);
                    }
                }
            }
        }
        // Normals are of unit length to 5e-7, and single precision knows the base to some 1e-6 of its
        // largest value; the kernel takes 1e-26 for darkness.
        let largest = cxy.iter().chain(cz).fold(1.0_f64, |most, value| most.max(value.abs()));
        let base = base + 4e-6 * largest;
        let [least, most] = exponent.map(|n| n / n.mul_add(*scattered, 1.0));
        let spread_out = (exponent[1] - most) * largest.ln();
        let exponent = if base > 1.0 { most } else { least };
        exponent.mul_add(base.ln(), spread_out).exp().max(1e-25) * normals.cosines(light)[1]
    }
}
