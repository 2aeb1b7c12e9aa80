//! The specular lobe of Torrance and Sparrow [@torrance1967theory], the interface term of eq. 1
//! (six-band paper) and eq. 9 (RGB-camera paper):
//!
//! ```text
//! Y_s = beta D(phi, gamma) F(theta_H, n) G / (N.V)
//! D   = exp(-ln 2 phi^2 / gamma^2) = exp(-k phi^2)        phi = angle(N, H), unnormalised
//! G   = min(1, 2 (N.H)(N.V) / (V.H), 2 (N.H)(N.L) / (V.H))    V-grooves
//! F   = unpolarised Fresnel reflectance of a dielectric of index n at cos theta_H = V.H
//! ```
//!
//! | parameter | meaning | range |
//! |---|---|---|
//! | `beta` | strength; the lobe peaks near `beta F / (N.V)` of a white board | >= 0 |
//! | `gamma` | tilt of the facets at which their number has halved, radians | 5e-4 .. 1.25 |
//! | `n` | index of refraction, 1.45 in both papers | >= 1 |
//!
//! A highlight is `2 gamma` wide (half-width, in the light's or the viewer's angle), and its energy
//! goes with `beta gamma^2`: the two anti-correlate in every fit.
//!
//! Samples are never divided by `F`, `G` or `N.V`; the model is multiplied by them instead, so that
//! noise stays what it was. `G / (N.V)` is formed as one quotient, which stays finite at grazing
//! views where `G` and `N.V` both vanish.

use crate::math::elementary::{exp, phi_squared, phi_squared_slope};
use crate::math::{Mask, Real, Scalar, Vec3};

/// Narrowest lobe: hard case 6, a mirror-like varnish, whose `k` would overflow.
pub const GAMMA_MIN: f64 = 5e-4;

/// Widest lobe: beyond it the interface cannot be separated from the diffuse part (hard case 7).
pub const GAMMA_MAX: f64 = 1.25;

/// `k = ln 2 / gamma^2`, with gamma kept inside [`GAMMA_MIN`] .. [`GAMMA_MAX`].
#[must_use]
#[inline(always)]
pub fn sharpness<R: Real>(gamma: R) -> R {
    let gamma = gamma.max(R::of(GAMMA_MIN)).min(R::of(GAMMA_MAX));
    R::of(core::f64::consts::LN_2) / (gamma * gamma)
}

/// Unpolarised Fresnel reflectance of a dielectric at the cosine of incidence `c`.
///
/// With `q = sqrt(n^2 + c^2 - 1)`: `F = 1/2 ((q-c)/(q+c))^2 (1 + ((c(q+c)-1)/(c(q-c)+1))^2)`. No
/// angle is formed, and the value is exact from normal (`((n-1)/(n+1))^2`) to grazing (1) incidence.
#[must_use]
#[inline(always)]
pub fn fresnel<R: Real>(c: R, index: R) -> R {
    let one = R::one();
    let q = index.mul_add(index, c.mul_add(c, -one)).sqrt();
    let (sum, difference) = (q + c, q - c);
    let perpendicular = difference / sum;
    let parallel = c.mul_add(sum, -one) / c.mul_add(difference, one);
    R::of(0.5) * perpendicular * perpendicular * parallel.mul_add(parallel, one)
}

/// The facet that mirrors a light into a view: all that the model needs to know of both.
#[derive(Clone, Copy, Debug)]
pub struct Facet<R: Real> {
    light: Vec3<R>,
    view: Vec3<R>,
    half: Vec3<R>,
    /// `2 / (V.H)`.
    twice_over_v_h: R,
    /// Fresnel reflectance; 0 where light and view oppose each other.
    fresnel: R,
}

/// A facet against a surface normal.
#[derive(Clone, Copy, Debug)]
pub struct Glint<R: Real> {
    /// `F G / (N.V)`; 0 where the surface turns away from light or view.
    pub weight: R,
    /// Squared angle between normal and half vector, rad^2.
    pub phi_squared: R,
    /// `1 / (N.V)`: infinite at grazing views, negative from behind.
    pub open: R,
}

/// Derivatives of [`Glint::value`] where the surface faces light and view, else 0.
#[derive(Clone, Copy, Debug)]
pub struct Gradient<R: Real> {
    /// With respect to `beta`.
    pub beta: R,
    /// With respect to `log k`; with respect to `log gamma` it is -2 times that.
    pub log_sharpness: R,
    /// With respect to the normal (to be projected on the tangent plane by whoever steps there).
    pub normal: Vec3<R>,
}

impl<R: Real> Facet<R> {
    /// The facet between two unit vectors that point away from the surface.
    #[must_use]
    #[inline(always)]
    pub fn between(light: Vec3<R>, view: Vec3<R>, index: R) -> Self {
        let sum = light + view;
        let squared = sum.length_squared();
        // Hard case 23, L = -V: there is no half vector, and nothing is mirrored.
        let opposed = squared.lt(R::of(1e-6));
        let length = R::select(opposed, R::one(), squared).sqrt();
        // V.H = |L + V| / 2 for unit vectors: no cancellation at grazing incidence.
        let v_h = (length * R::of(0.5)).min(R::one());
        Self {
            light,
            view,
            half: sum.scale(length.recip()),
            twice_over_v_h: R::of(2.0) / v_h,
            fresnel: R::select(opposed, R::zero(), fresnel(v_h, index)),
        }
    }

    /// The facet against a unit normal.
    #[must_use]
    #[inline(always)]
    pub fn on(&self, normal: Vec3<R>) -> Glint<R> {
        let (n_l, n_v) = (normal.dot(self.light), normal.dot(self.view));
        let n_h = normal.dot(self.half);
        // Hard case 22, grazing: the smallest of the three quotients is finite even where N.V is 0.
        let open = n_v.recip();
        let masked = self.twice_over_v_h * n_h;
        let shadowed = masked * n_l * open;
        let attenuation = masked.min(open).min(shadowed);
        // Hard case 24: no light from behind, no sight from behind (false for NaN).
        let faces = n_l.gt(R::zero()) & n_v.gt(R::zero());
        // Hard case 8: the chord, not the arc cosine.
        let chord = (normal - self.half).length_squared();
        Glint {
            weight: R::keep(faces, self.fresnel * attenuation),
            phi_squared: phi_squared(chord * R::of(0.5)),
            open,
        }
    }

    /// Derivatives of `beta weight exp(-k phi^2)`.
    ///
    /// G is a minimum of three smooth functions: its derivative is that of the smallest (hard case
    /// 25; at a kink either side serves).
    #[must_use]
    #[inline(always)]
    pub fn gradient(&self, normal: Vec3<R>, beta: R, sharpness: R) -> Gradient<R> {
        let glint = self.on(normal);
        self.slope(normal, glint, glint.lobe(sharpness), beta, sharpness)
    }

    /// [`Self::gradient`] where the glint and its lobe are known.
    #[must_use]
    #[inline(always)]
    pub fn slope(
        &self,
        normal: Vec3<R>,
        glint: Glint<R>,
        lobe: R,
        beta: R,
        sharpness: R,
    ) -> Gradient<R> {
        let value = beta * glint.weight * lobe;
        let (n_l, n_h, open) = (normal.dot(self.light), normal.dot(self.half), glint.open);
        let masked = self.twice_over_v_h * n_h;
        let shadowed = masked * n_l * open;
        // d log(G / N.V) / dN of each branch, as multiples of V, H and L.
        let open_wins = open.le(masked) & open.le(shadowed);
        let slope =
            -(sharpness * phi_squared_slope((normal - self.half).length_squared() * R::of(0.5)));
        // d phi^2 / dN = slope(e) (N - H), up to a multiple of N that the tangent plane drops.
        let mut direction = (normal - self.half).scale(slope);
        if open_wins.all() {
            // Nothing is masked or shadowed: two divisions less, and the same bits.
            direction = self.view.mul_add(-open, direction);
        } else {
            let shadow_wins = shadowed.lt(masked) & shadowed.lt(open);
            let along_half = R::select(open_wins, R::zero(), n_h.recip());
            let along_light = R::keep(shadow_wins, n_l.recip());
            let along_view = R::keep(open_wins | shadow_wins, -open);
            direction = self.half.mul_add(along_half, direction);
            direction = self.light.mul_add(along_light, direction);
            direction = self.view.mul_add(along_view, direction);
        }
        // The selection keeps the infinities of unlit lanes out (hard case 26).
        let lit = value.gt(R::zero());
        let component = |v: R| R::keep(lit, v * value);
        Gradient {
            beta: glint.weight * lobe,
            log_sharpness: -(sharpness * glint.phi_squared * value),
            normal: Vec3::new(
                component(direction.x),
                component(direction.y),
                component(direction.z),
            ),
        }
    }

    /// Unit direction to the eye.
    #[must_use]
    #[inline(always)]
    pub fn view(&self) -> Vec3<R> {
        self.view
    }

    /// Unit half vector `H`.
    #[must_use]
    #[inline(always)]
    pub fn half(&self) -> Vec3<R> {
        self.half
    }

    /// `2 / (V.H)`.
    #[must_use]
    #[inline(always)]
    pub fn twice_over_v_h(&self) -> R {
        self.twice_over_v_h
    }

    /// Fresnel reflectance; 0 where light and view oppose each other.
    #[must_use]
    #[inline(always)]
    pub fn fresnel(&self) -> R {
        self.fresnel
    }
}

impl<S: Scalar> Facet<S> {
    /// The same facet in every lane.
    #[must_use]
    #[inline(always)]
    pub fn splat<R: Real>(&self) -> Facet<R> {
        Facet {
            light: self.light.broadcast(),
            view: self.view.broadcast(),
            half: self.half.broadcast(),
            twice_over_v_h: R::of(self.twice_over_v_h.to_f64()),
            fresnel: R::of(self.fresnel.to_f64()),
        }
    }
}

impl<R: Real> Glint<R> {
    /// `D = exp(-k phi^2)`.
    #[must_use]
    #[inline(always)]
    pub fn lobe(&self, sharpness: R) -> R {
        exp(-(sharpness * self.phi_squared))
    }

    /// `beta D F G / (N.V)`.
    ///
    /// A `beta` of 0 gives 0 whatever gamma is: a surface without varnish has none.
    #[must_use]
    #[inline(always)]
    pub fn value(&self, beta: R, sharpness: R) -> R {
        let value = beta * self.weight * self.lobe(sharpness);
        R::select(beta.le(R::zero()), R::zero(), value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
        Vec3::new(x, y, z).normalised()
    }

    #[test]
    fn fresnel_is_exact_at_both_ends_and_tabulated_between() {
        let normal = (0.45_f64 / 2.45).powi(2);
        assert!((fresnel(1.0, 1.45_f64) - normal).abs() < 1e-16);
        assert!((fresnel(0.0, 1.45_f64) - 1.0).abs() < 1e-15);
        // Snel's law and Fresnel's amplitudes at 60 degrees, n = 1.45, by hand: cos t = 0.802049,
        // r_s = -0.398666, r_p = -0.050456 -> (0.158935 + 0.002546) / 2.
        assert!((fresnel(0.5, 1.45_f64) - 0.080_740).abs() < 2e-6);
    }

    #[test]
    fn the_lobe_halves_at_gamma() {
        let facet = Facet::between(unit(0.0, 0.0, 1.0), unit(0.0, 0.0, 1.0), 1.45);
        let tilted = unit(0.12_f64.sin(), 0.0, 0.12_f64.cos());
        let glint = facet.on(tilted);
        assert!((glint.lobe(sharpness(0.12)) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn hard_case_8_facet_angle_near_0() {
        let up = Vec3::new(0.0_f32, 0.0, 1.0);
        let facet = Facet::between(up, up, 1.45);
        for i in 1..3000 {
            let phi = f64::from(i) * 1e-4;
            let (x, z) = (phi.sin() as f32, phi.cos() as f32);
            let exact = f64::from(x).atan2(f64::from(z)).powi(2);
            let found = f64::from(facet.on(Vec3::new(x, 0.0, z)).phi_squared);
            // A handful of roundings of 6e-8, and the square of one, that of the normal's length,
            // over the smallest phi^2. With `acos` it is 100 % at 1e-4.
            assert!((found / exact - 1.0).abs() < 1e-6, "{phi}: {found} {exact}");
        }
    }

    /// Central differences over a grid of surfaces, lights and views, both sides of each kink.
    #[test]
    fn derivatives_agree_with_differences() {
        let (beta, k) = (3.0, sharpness(0.3_f64));
        let mut checked = 0;
        for i in 0..200 {
            let t = f64::from(i);
            let normal = unit(0.4 * (t * 0.7).sin(), 0.4 * (t * 1.3).cos(), 1.0);
            let light =
                unit((t * 0.37).cos(), (t * 0.53).sin(), 0.15 + 0.8 * (t * 0.11).sin().abs());
            let view = unit(0.8 * (t * 0.21).sin(), 0.3, 0.4 + 0.6 * (t * 0.17).cos().abs());
            let facet = Facet::between(light, view, 1.45);
            let at = |normal: Vec3<f64>, beta: f64, k: f64| facet.on(normal).value(beta, k);
            let gradient = facet.gradient(normal, beta, k);
            let h = 1e-6;
            let by_beta = (at(normal, beta + h, k) - at(normal, beta - h, k)) / (2.0 * h);
            let by_k = (at(normal, beta, k * h.exp()) - at(normal, beta, k / h.exp())) / (2.0 * h);
            // Differences of a value near 1 to 1e-16 over 2e-6 carry 1e-10; third derivatives of a
            // lobe of 0.3 rad times h^2 carry less.
            let scale = at(normal, beta, k).abs() + 1.0;
            assert!((by_beta - gradient.beta).abs() < 1e-8 * scale);
            assert!((by_k - gradient.log_sharpness).abs() < 1e-8 * scale);
            let tangent = normal.cross(unit(0.3, -0.5, 0.2)).normalised();
            let plus = (normal + tangent.scale(h)).normalised();
            let minus = (normal - tangent.scale(h)).normalised();
            if at(normal, beta, k) > 0.0 && at(plus, beta, k) > 0.0 && at(minus, beta, k) > 0.0 {
                let by_normal = (at(plus, beta, k) - at(minus, beta, k)) / (2.0 * h);
                let expected = gradient.normal.dot(tangent);
                assert!((by_normal - expected).abs() < 1e-7 * scale, "{i}: {by_normal} {expected}");
                checked += 1;
            }
        }
        assert!(checked > 100);
    }

    #[test]
    fn hard_cases_6_22_23_awkward_geometry_stays_finite() {
        let up = unit(0.0, 0.0, 1.0);
        let cases = [
            (unit(0.0, 0.0, 1.0), unit(0.0, 0.0, -1.0)),
            (unit(1.0, 0.0, 0.0), unit(-1.0, 0.0, 1e-4)),
            (unit(1.0, 0.0, 1e-30), unit(0.0, 0.0, 1.0)),
            (unit(0.0, 0.0, 1.0), unit(1.0, 0.0, 1e-30)),
            (unit(1.0, 0.0, 1e-12), unit(-1.0, 0.0, 1e-12)),
            (unit(1.0, 0.0, 0.0), unit(0.0, 1.0, 0.0)),
        ];
        for (light, view) in cases {
            for gamma in [0.0, GAMMA_MIN, 0.1, 1e9] {
                let single = |v: Vec3<f64>| Vec3::new(v.x as f32, v.y as f32, v.z as f32);
                let facet = Facet::between(single(light), single(view), 1.45_f32);
                let k = sharpness(gamma as f32);
                assert!(facet.on(single(up)).value(200.0, k).is_finite(), "{light:?} {view:?}");
                let gradient = facet.gradient(single(up), 200.0, k);
                let parts = [gradient.beta, gradient.log_sharpness, gradient.normal.x];
                assert!(parts.iter().all(|part| f32::is_finite(*part)), "{light:?} {view:?}");
            }
        }
    }

    #[test]
    fn light_and_view_change_places_as_the_formula_says() {
        // D, F and G are symmetric in L and V, so Y_s(L, V) (N.V) = Y_s(V, L) (N.L).
        let (light, view) = (unit(0.3, 0.2, 0.5), unit(-0.4, 0.1, 0.9));
        let normal = unit(0.05, 0.1, 1.0);
        let k = sharpness(0.3);
        let there = Facet::between(light, view, 1.45).on(normal).value(1.0, k) * normal.dot(view);
        let back = Facet::between(view, light, 1.45).on(normal).value(1.0, k) * normal.dot(light);
        assert!((there / back - 1.0).abs() < 1e-13);
    }
}
