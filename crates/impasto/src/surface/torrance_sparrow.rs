//! Torrance-Sparrow lobes [@torrance1967theory] of one parameter, the half-width gamma.

use crate::brdf::torrance_sparrow::{Facet, sharpness};
use crate::math::{Real, Scalar, Vec3};

use super::lobe_model::{LobeModel, MAX_PARAMETERS};

/// Lobes of facets under an interface of one index of refraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorranceSparrow {
    /// Index of refraction.
    pub index: f64,
}

impl LobeModel for TorranceSparrow {
    type Pair<R: Real> = Facet<R>;
    /// `k = ln 2 / gamma^2`.
    type Lobe<R: Real> = R;
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
    fn value<R: Real>(&self, sharpness: &R, pair: &Facet<R>, normal: Vec3<R>) -> R {
        pair.on(normal).value(R::one(), *sharpness)
    }
}
