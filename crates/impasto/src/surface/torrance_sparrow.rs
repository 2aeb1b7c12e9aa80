//! Torrance-Sparrow lobes [@torrance1967theory] of one parameter, the half-width gamma.

use crate::brdf::torrance_sparrow::{Facet, GAMMA_MAX, GAMMA_MIN, Glint, fresnel, sharpness};
use crate::math::{Real, Scalar, Vec3};

use super::lobe_model::{LobeModel, MAX_PARAMETERS, Shape};
use super::sight::{Sight, angle};

/// Lobes of facets under an interface of one index of refraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorranceSparrow {
    /// Index of refraction.
    pub index: f64,
}

/// What a spread of light leaves of a lobe's sharpness, and of its height.
#[inline(always)]
fn spread_share<R: Real>(sharpness: R, spread: R) -> R {
    (sharpness * R::of(0.5)).mul_add(spread, R::one()).recip()
}

impl LobeModel for TorranceSparrow {
    type Pair<R: Real> = Facet<R>;
    /// `k = ln 2 / gamma^2`.
    type Lobe<R: Real> = R;
    type Seen<R: Real> = Glint<R>;
    const NAMES: &'static [&'static str] = &["gamma"];

    #[inline(always)]
    fn pair<R: Real>(&self, light: Vec3<R>, view: Vec3<R>) -> Facet<R> {
        Facet::between(light, view, R::of(self.index))
    }
    #[inline(always)]
    fn splat<S: Scalar, R: Real>(&self, pair: &Facet<S>) -> Facet<R> {
        pair.splat()
    }
    #[inline(always)]
    fn view<R: Real>(&self, pair: &Facet<R>) -> Vec3<R> {
        pair.view()
    }
    #[inline(always)]
    fn lobe_from_parameters<R: Real>(&self, [gamma, ..]: [R; MAX_PARAMETERS]) -> R {
        sharpness(gamma)
    }
    #[inline(always)]
    fn seen<R: Real>(&self, pair: &Facet<R>, normal: Vec3<R>) -> Glint<R> {
        pair.on(normal)
    }
    #[inline(always)]
    fn shown<R: Real>(&self, sharpness: &R, glint: &Glint<R>) -> R {
        glint.value(R::one(), *sharpness)
    }
    /// The half vector moves by half of what the light does, so that the variance `1 / (2 k)` of the
    /// lobe's Gaussian grows by a quarter of the spread.
    #[inline(always)]
    fn spread_value<R: Real>(
        &self,
        sharpness: &R,
        pair: &Facet<R>,
        normal: Vec3<R>,
        spread: R,
    ) -> R {
        let share = spread_share(*sharpness, spread);
        share * pair.on(normal).value(R::one(), *sharpness * share)
    }

    /// `exp(-ln 2 (phi / gamma)^2)` has the variance `gamma^2 / (2 ln 2)`.
    fn total(&self, [gamma, ..]: [f64; MAX_PARAMETERS]) -> f64 {
        1.0 / sharpness(gamma)
    }
    fn variance(&self, [gamma, ..]: [f64; MAX_PARAMETERS]) -> f64 {
        0.5 / sharpness(gamma)
    }
    fn widened(&self, _: [f64; MAX_PARAMETERS], variance: f64) -> [f64; MAX_PARAMETERS] {
        [(2.0 * core::f64::consts::LN_2 * variance).sqrt().clamp(GAMMA_MIN, GAMMA_MAX), 0.0, 0.0]
    }

    /// `exp(-k phi^2) F min(2 / (V.H), 1 / (N.V))`, from `G / (N.V) <= 2 (N.H) / (V.H)` and
    /// `G <= 1`.
    fn most(&self, shape: &Shape, sight: &Sight) -> f64 {
        let Sight { normals, light, view, spread: scattered } = sight;
        let near = light.angle + view.angle;
        // Half the angle between light and view, at most.
        let half = 0.5 * (angle(light.axis, view.axis) + near);
        if half >= core::f64::consts::FRAC_PI_2 {
            return f64::INFINITY;
        }
        let v_h = half.cos();
        // Where light or view move by an angle, the half vector between them moves by at most half
        // of it over the cosine of half the angle between them. Single precision knows the chord
        // between normal and half vector to some 1e-7.
        let spread = normals.angle + 0.5 * near / v_h + 1e-6;
        let middle = (light.axis + view.axis).normalised();
        let phi = (angle(normals.axis, middle) - spread).max(0.0);
        let widest = sharpness(shape[0][1]);
        let power = widest * spread_share(widest, *scattered) * phi * phi;
        let open = normals.cosines(view)[0].max(1e-30);
        // The kernel's exponential is exactly 0 from here on.
        if power > 90.0 {
            return 0.0;
        }
        (-power).exp() * fresnel(v_h, self.index) * (2.0 / v_h).min(1.0 / open)
    }
}
