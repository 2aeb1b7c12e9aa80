//! A diffuse term and one mirror lobe about a free normal: the model of Snel's first pass [@snel].
//!
//! ```text
//! Y = (N.L) (rho_d + rho_s d^n)        d = 2 (N.L)(N.V) - L.V = R.V
//! ```
//!
//! | parameter | meaning | range |
//! |---|---|---|
//! | `rho_d`, `rho_s` | diffuse and specular strength | >= 0 |
//! | `ln n` | sharpness; Snel starts from n = 20 | 0 .. 10 |
//! | `p`, `q` | slopes of the surface: `N = (-p, -q, 1) / sqrt(1 + p^2 + q^2)` | any |
//!
//! Both terms depend on the normal: a matte surface shows it by the cosine alone, a glossy one by the
//! lobe.
//! The factor (N.L) belongs to the model; samples are not divided by it (hard case 22).

use crate::math::{Real, Vec3};

use super::lafortune::{Lobe, Pair};

/// Parameters of the model.
pub const PARAMETERS: usize = 5;

/// The model at some parameters.
#[derive(Clone, Copy, Debug)]
pub struct CosineLobe<R> {
    diffuse: R,
    lobe: Lobe<R>,
    /// Unit normal.
    pub normal: Vec3<R>,
    /// Cosine of the surface's tilt, `1 / sqrt(1 + p^2 + q^2)`.
    upright: R,
}

impl<R: Real> CosineLobe<R> {
    /// The model from `[rho_d, rho_s, ln n, p, q]`.
    #[must_use]
    #[inline(always)]
    pub fn new([diffuse, specular, log_exponent, p, q]: [R; PARAMETERS]) -> Self {
        let upright = q.mul_add(q, p.mul_add(p, R::one())).sqrt().recip();
        Self {
            diffuse,
            lobe: Lobe::new(specular, R::zero(), log_exponent),
            normal: Vec3::new(-(p * upright), -(q * upright), upright),
            upright,
        }
    }

    /// Radiance under a light of unit irradiance, and its derivatives in the order of the
    /// parameters; all 0 where the surface turns away from light or view.
    #[must_use]
    #[inline(always)]
    pub fn gradient(&self, light: Vec3<R>, view: Vec3<R>, light_view: R) -> (R, [R; PARAMETERS]) {
        let pair = Pair::against(self.normal, light, view, light_view);
        let lit = pair.cosine.gt(R::zero());
        let lobe = self.lobe.gradient(&pair);
        let reflectance = self.diffuse + lobe.value;
        // d/dN = f L + (N.L) df/dN, along (N.V) L + (N.L) V.
        let bend = pair.cosine * lobe.normal;
        let along_light = bend.mul_add(self.normal.dot(view), reflectance);
        let along_view = bend * pair.cosine;
        let slope = view.mul_add(along_view, light.scale(along_light));
        // dN/dp = -(x + p N cos(tilt)) cos(tilt), and -p cos(tilt) is N's own x.
        let inward = slope.dot(self.normal);
        let by_p = self.normal.x.mul_add(inward, -slope.x) * self.upright;
        let by_q = self.normal.y.mul_add(inward, -slope.y) * self.upright;
        (
            pair.cosine * reflectance,
            [
                pair.cosine,
                pair.cosine * lobe.amplitude,
                pair.cosine * lobe.log_exponent,
                R::keep(lit, by_p),
                R::keep(lit, by_q),
            ],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
        Vec3::new(x, y, z).normalised()
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let mut checked = 0;
        for i in 0..200 {
            let t = f64::from(i);
            let light =
                unit((t * 0.37).cos(), (t * 0.53).sin(), 0.4 + 0.8 * (t * 0.11).sin().abs());
            let view = unit(0.5 * (t * 0.21).sin(), 0.3, 0.7 + 0.6 * (t * 0.17).cos().abs());
            let p = [0.4, 0.8, 2.5, 0.3 * (t * 0.7).sin(), 0.3 * (t * 1.3).cos()];
            let at = |p| CosineLobe::new(p).gradient(light, view, light.dot(view)).0;
            let (value, slope) = CosineLobe::new(p).gradient(light, view, light.dot(view));
            if value <= 0.0 {
                continue;
            }
            checked += 1;
            for (j, &slope) in slope.iter().enumerate() {
                let h = 1e-6;
                let (mut above, mut below) = (p, p);
                above[j] += h;
                below[j] -= h;
                // Rounding 2e-10, third derivatives (n / width^3, some 1e3) times h^2 1e-9.
                let difference = (at(above) - at(below)) / (2.0 * h);
                assert!((difference - slope).abs() < 1e-8, "{i} {j}: {difference} {slope}");
            }
        }
        assert!(checked > 100);
    }

    #[test]
    fn a_surface_that_faces_away_is_dark() {
        let model = CosineLobe::new([0.4, 0.8, 2.5, 3.0, 0.0]);
        let (value, slope) = model.gradient(unit(0.9, 0.0, 0.1), unit(0.0, 0.0, 1.0), 0.1);
        assert_eq!((value, slope), (0.0, [0.0; PARAMETERS]));
    }
}
