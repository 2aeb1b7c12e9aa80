//! Diffuse reflection under a smooth dielectric interface, by Wolff's model of the light that
//! crosses it [@wolff1994diffuse]: the first term of eq. 1 and 9 for paint under varnish.
//!
//! ```text
//! Y_d  = (N.L) t(N.L) t(N.V) S
//! t(c) = (1 - F(c, n)) / (1 - F(1, n))
//! F    = unpolarised Fresnel reflectance of a dielectric of index n at the cosine of incidence c
//! ```
//!
//! Light is refracted on its way into the varnish and, scattered by the paint, on its way out: the
//! interface transmits `1 - F` each time, on the way out as on the way in (reciprocity). `t` is
//! relative to normal incidence, so that `S` is what a frontal light shows to a frontal view. It is 0.95 at 60 degrees and 0.78 at 75 for `n = 1.45`,
//! and falls to 0 at grazing incidence: flanks are darker than by Lambert's law, which a fit without
//! `t` takes for tilt. Light that the interface reflects back into the paint is part of `S`: its
//! share depends on no direction.
//!
//! | parameter | meaning | range |
//! |---|---|---|
//! | `n` | index of refraction, 1.45 in both papers | >= 1; at 1 there is no interface, `t = 1` |
//!
//! With `q = sqrt(n^2 + c^2 - 1)`, `a = 1 / (q + c)` and `b = n / (n^2 c + q)` the transmittance is
//! `1 - F = 2 q c (a^2 + b^2)`: no difference of numbers near 1, exact down to grazing incidence,
//! where it vanishes as `c` does.

use crate::math::{Real, Vec3};

/// Least cosine of incidence: 0.006 degrees above the surface, where `N.L` alone is 1e-4.
const GRAZING: f64 = 1e-4;

/// A smooth interface above the diffuse part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatedDiffuse {
    /// Index of refraction.
    index: f64,
    /// Its reciprocal.
    inverse: f64,
    /// `2 / (1 - F(1))`.
    scale: f64,
}

/// The diffuse term of a surface of reflectance 1, and its derivative by the normal (to be projected
/// on the tangent plane by whoever steps there).
#[derive(Clone, Copy, Debug)]
pub struct Slope<R: Real> {
    /// `(N.L) t(N.L) t(N.V)`.
    pub value: R,
    /// Its derivative.
    pub normal: Vec3<R>,
}

impl CoatedDiffuse {
    /// An interface of an index of refraction.
    #[must_use]
    pub fn new(index: f64) -> Self {
        // 1 - F(1) = 4 n / (n + 1)^2.
        Self { index, inverse: index.recip(), scale: (index + 1.0).powi(2) / (2.0 * index) }
    }

    /// Index of refraction.
    #[must_use]
    pub fn index(&self) -> f64 {
        self.index
    }

    /// `2 / (1 - F(1))`.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// `t(c)` and its derivative.
    #[inline(always)]
    fn transmission<R: Real>(&self, cosine: R) -> [R; 2] {
        let (one, index) = (R::one(), R::of(self.index));
        // Hard case 22, grazing: quotients by `c` and `q` stay finite, also of index 1.
        let c = cosine.max(R::of(GRAZING));
        let q = index.mul_add(index, c.mul_add(c, -one)).sqrt().max(c);
        let a = (q + c).recip();
        let b = (index.mul_add(c, q * R::of(self.inverse))).recip();
        let squares = a.mul_add(a, b * b);
        let scale = R::of(self.scale);
        // -F' = 2 / q ((q - c)^2 a^2 - (n^2 - 1) b^3 (n c - q / n)).
        let parallel = index.mul_add(c, -(q * R::of(self.inverse)));
        let denser = index.mul_add(index, -one);
        let perpendicular = (q - c) * a;
        let bent = perpendicular.mul_add(perpendicular, -(denser * b * b * (b * parallel)));
        [scale * (q * c) * squares, scale * bent / q]
    }

    /// `(N.L) t(N.L) t(N.V)`, 0 where the surface turns away from light or view.
    ///
    /// NaN in the normal gives 0, as in [`lambert::cosine`](super::lambert::cosine).
    #[must_use]
    #[inline(always)]
    pub fn value<R: Real>(&self, normal: Vec3<R>, light: Vec3<R>, view: Vec3<R>) -> R {
        self.slope(normal, light, view).value
    }

    /// [`Self::value`] with its derivative.
    #[must_use]
    #[inline(always)]
    pub fn slope<R: Real>(&self, normal: Vec3<R>, light: Vec3<R>, view: Vec3<R>) -> Slope<R> {
        let (n_l, n_v) = (normal.dot(light), normal.dot(view));
        let ([entering, by_light], [leaving, by_view]) =
            (self.transmission(n_l), self.transmission(n_v));
        // Hard case 24: no light from behind, no sight from behind (false for NaN).
        let faces = n_l.gt(R::zero()) & n_v.gt(R::zero());
        let refracted = n_l * entering;
        let along_light = R::keep(faces, n_l.mul_add(by_light, entering) * leaving);
        let along_view = R::keep(faces, refracted * by_view);
        Slope {
            value: R::keep(faces, refracted * leaving),
            normal: light.mul_add(along_light, view.scale(along_view)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::lambert;
    use crate::brdf::torrance_sparrow::fresnel;

    const VARNISH: f64 = 1.45;

    fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
        Vec3::new(x, y, z).normalised()
    }

    #[test]
    fn it_transmits_what_fresnel_does_not_reflect() {
        for index in [1.0, 1.1, VARNISH, 2.4] {
            let coat = CoatedDiffuse::new(index);
            for step in 1..=1000 {
                let c = f64::from(step) * 1e-3;
                let expected = (1.0 - fresnel(c, index)) / (1.0 - fresnel(1.0, index));
                // A dozen roundings of 1e-16 in either; 1 - F is as large as 0.005 at c = 0.001.
                let found = coat.transmission(c)[0];
                assert!((found - expected).abs() < 5e-15, "{index} {c}: {found} {expected}");
            }
        }
        // Snel's law and Fresnel's amplitudes at 60 degrees, as for the lobe.
        let [found, _] = CoatedDiffuse::new(VARNISH).transmission(0.5);
        assert!((found - (1.0 - 0.080_740) / (1.0 - 0.033_736)).abs() < 3e-6);
    }

    #[test]
    fn without_an_interface_it_is_lamberts_law() {
        let coat = CoatedDiffuse::new(1.0);
        let (light, view) = (unit(0.3, 0.2, 0.5), unit(-0.4, 0.1, 0.9));
        let normal = unit(0.05, 0.1, 1.0);
        let slope = coat.slope(normal, light, view);
        assert!((slope.value - lambert::cosine(normal, light)).abs() < 1e-15);
        assert!((slope.normal - light).length_squared() < 1e-28);
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let mut checked = 0;
        for i in 0..400 {
            let t = f64::from(i);
            let coat = CoatedDiffuse::new(1.0 + 0.9 * (t * 0.19).sin().abs());
            let normal = unit(0.9 * (t * 0.7).sin(), 0.9 * (t * 1.3).cos(), 1.0);
            let light = unit((t * 0.37).cos(), (t * 0.53).sin(), 0.1 + (t * 0.11).sin().abs());
            let view = unit(0.8 * (t * 0.21).sin(), 0.3, 0.4 + 0.6 * (t * 0.17).cos().abs());
            let (n_l, n_v) = (normal.dot(light), normal.dot(view));
            let tangent = normal.cross(unit(0.3, -0.5, 0.2)).normalised();
            let h = 1e-6;
            let at = |h: f64| coat.value((normal + tangent.scale(h)).normalised(), light, view);
            let slope = coat.slope(normal, light, view);
            if n_l < 0.0 || n_v < 0.0 {
                assert_eq!(slope.value, 0.0);
                continue;
            }
            if n_l.min(n_v) < 0.02 {
                continue;
            }
            let difference = (at(h) - at(-h)) / (2.0 * h);
            // Differences of a value near 1 to 1e-16 over 2e-6 carry 1e-10. Near grazing incidence
            // of an index near 1, t rises within q / n of the surface: its third derivative is below
            // 1 / c^3, which makes h^2 / 6 / 0.02^3 = 2e-8.
            assert!((difference - slope.normal.dot(tangent)).abs() < 1e-7, "{i}");
            checked += 1;
        }
        assert!(checked > 250, "{checked}");
    }

    #[test]
    fn hard_cases_22_24_awkward_geometry_stays_finite() {
        let up = Vec3::new(0.0_f32, 0.0, 1.0);
        let cases = [
            (Vec3::new(1.0_f32, 0.0, 1e-30), up),
            (Vec3::new(1.0, 0.0, 0.0), up),
            (up, Vec3::new(1.0, 0.0, 1e-30)),
            (Vec3::new(1.0, 0.0, 1e-12), Vec3::new(-1.0, 0.0, 1e-12)),
            (up, Vec3::new(0.0, 0.0, -1.0)),
            (up, up),
        ];
        for (light, view) in cases {
            for index in [1.0, 1.0 + 1e-7, VARNISH, 100.0] {
                let Slope { value, normal } = CoatedDiffuse::new(index).slope(up, light, view);
                let parts = [value, normal.x, normal.y, normal.z];
                assert!(parts.iter().all(|part| part.is_finite()), "{light:?} {view:?} {index}");
                assert!((0.0..=1.0 + 1e-6).contains(&value));
            }
        }
        let unknown = Vec3::new(f32::NAN, 0.0, 1.0);
        assert_eq!(CoatedDiffuse::new(VARNISH).value(unknown, up, up), 0.0);
    }

    #[test]
    fn light_and_view_change_places_as_the_formula_says() {
        // Reciprocity: the term without its N.L is the same both ways.
        let coat = CoatedDiffuse::new(VARNISH);
        let (light, view) = (unit(0.3, 0.2, 0.5), unit(-0.4, 0.1, 0.9));
        let normal = unit(0.05, 0.1, 1.0);
        let there = coat.value(normal, light, view) / normal.dot(light);
        let back = coat.value(normal, view, light) / normal.dot(view);
        assert!((there / back - 1.0).abs() < 1e-14);
    }
}
