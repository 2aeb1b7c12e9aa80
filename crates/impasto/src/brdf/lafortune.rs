//! Isotropic lobes after Lafortune et al. [@lafortune1997nonlinear], with an arbitrary normal (Snel's
//! extension [@snel]):
//!
//! ```text
//! f = rho_d + sum over lobes of  A d^n          d = Cxy tau + Cz b, 0 where d <= 0
//! b = (N.L)(N.V)        tau = L.V - b           radiance = f (N.L)
//! ```
//!
//! `tau` is what the tangent plane sees of light and view; that no tangent frame is needed follows
//! from `Cx = Cy`. The mirror lobe `Cxy = -1, Cz = 1` is Phong's, `d = R.V`; `Cxy < 0` reflects
//! forward, `Cxy > 0` back to the light.
//!
//! | parameter | meaning | range |
//! |---|---|---|
//! | `A` | strength in the mirror direction of a Phong lobe | >= 0 |
//! | `turn` | direction of (Cxy, Cz); 0 is Phong's, 1 the retro-reflecting (1, 1) | any |
//! | `n` | sharpness; the lobe has halved where `d^n` has | > 0, measured 2.3 .. 16,600 |
//!
//! (A, C, n) and (A s^-n, s C, n) are the same lobe. The gauge `Cxy^2 + Cz^2 = 2` settles that
//! (hard case 16), so that one number is left of C: with `t = tan(psi / 2)` for the angle `psi`
//! from (-1, 1), `Cxy = sin psi - cos psi` and `Cz = sin psi + cos psi` are rational in t. Unlike
//! `Cz = 1` it allows `Cz <= 0`, which measured lobes have.
//!
//! `d^n` is `exp(n ln d)`. Sharp lobes (n in the thousands) lose single precision to the rounding
//! of `d` alone: [`Sharp`] carries `d` and its logarithm in two parts.

use crate::math::elementary::{exp, exp_in_range, ln_in_range};
use crate::math::{Real, Two, Vec3};

/// Where a lobe ends: `ln d` below -20 is darkness for any lobe, and `d^(n-1)` stays finite for
/// any n (hard cases 9 and 10).
const BASE_MIN: f64 = 2.061_153_622_438_558e-9;

/// Where a lobe ceases to grow: a search that turns a sharp lobe off the diagonal would overflow
/// (hard case 11); 2e17 times the mirror's strength is no lobe.
const LOG_POWER_MAX: f64 = 40.0;

/// What is as good as dark: 1e-26, whose square vanishes without passing through numbers that
/// processors are slow at.
const LOG_POWER_MIN: f64 = -60.0;

/// A light and a view against a normal: all that an isotropic lobe sees of them. From behind the
/// surface no lobe shows: both products are then 0.
#[derive(Clone, Copy, Debug)]
pub struct Pair<R> {
    /// `(N.L)(N.V)`.
    pub upright: R,
    /// `L.V - (N.L)(N.V)`.
    pub tangential: R,
    /// `N.L`, 0 where the light stands behind the surface.
    pub cosine: R,
}

impl<R: Real> Pair<R> {
    /// A pair of unit vectors that point away from the surface; `light_view` is their product.
    #[must_use]
    #[inline(always)]
    pub fn against(normal: Vec3<R>, light: Vec3<R>, view: Vec3<R>, light_view: R) -> Self {
        let (n_l, n_v) = (normal.dot(light), normal.dot(view));
        let upright = n_l * n_v;
        // Hard case 24: no light from behind, no highlight seen from behind (false for NaN).
        let (lit, seen) = (n_l.gt(R::zero()), n_v.gt(R::zero()));
        Self {
            upright: R::keep(seen, upright),
            tangential: R::keep(seen, light_view - upright),
            cosine: R::keep(lit, n_l),
        }
    }
}

/// (Cxy, Cz) of a turn, and what a change of the turn does to the angle.
#[must_use]
#[inline(always)]
fn direction<R: Real>(turn: R) -> ([R; 2], R) {
    let scale = R::one() / turn.mul_add(turn, R::one());
    let cosine = (-turn).mul_add(turn, R::one()) * scale;
    let sine = (turn + turn) * scale;
    ([sine - cosine, sine + cosine], scale + scale)
}

/// The turn of (Cxy, Cz), and `ln(|C| / sqrt 2)`: what the gauge takes out of C goes, times n,
/// into the logarithm of the strength.
///
/// The direction opposite to Phong's, (1, -1), has no finite turn.
#[must_use]
pub fn turn_and_log_length(cxy: f64, cz: f64) -> [f64; 2] {
    let length = cxy.hypot(cz) / core::f64::consts::SQRT_2;
    let (cosine, sine) = ((cz - cxy) / (2.0 * length), (cz + cxy) / (2.0 * length));
    [sine / (1.0 + cosine), length.ln()]
}

/// (Cxy, Cz) of a turn, in the gauge of this file.
#[must_use]
pub fn coefficients(turn: f64) -> [f64; 2] {
    direction(turn).0
}

/// Logarithm of the most light that a lobe of unit strength reflects from anywhere to anywhere,
/// `(N.L) d^n`.
///
/// Of all views with the light at `N.L = a` the best shows `d^2 = Cxy^2 (1 - a^2) + Cz^2 a^2`, with
/// 0 for a `Cz` below 0. Where `Cz` is the longer one, the best light stands upright; else it stands
/// lower, the lower the sharper the lobe: `a^2 = Cxy^2 / ((n + 1) (Cxy^2 - Cz^2))`.
#[must_use]
pub fn log_peak(turn: f64, log_exponent: f64) -> f64 {
    let ([cxy, cz], n) = (coefficients(turn), log_exponent.exp());
    let (flat, upright) = (cxy * cxy, cz.max(0.0) * cz.max(0.0));
    let steep = (n + 1.0) * (flat - upright);
    // a^2; 1 for a lobe that is strongest upright.
    let light = if steep > flat { flat / steep } else { 1.0 };
    let base = (upright - flat).mul_add(light, flat);
    0.5 * n.mul_add(base.ln(), light.ln())
}

/// A lobe in the form that is fast to evaluate.
#[derive(Clone, Copy, Debug)]
pub struct Lobe<R> {
    amplitude: R,
    cxy: R,
    cz: R,
    /// `d psi / d turn`.
    rate: R,
    exponent: R,
}

/// A lobe's value and its derivatives; all 0 where the lobe is dark.
#[derive(Clone, Copy, Debug)]
pub struct Gradient<R> {
    /// `A d^n`.
    pub value: R,
    /// With respect to the amplitude: `d^n`.
    pub amplitude: R,
    /// With respect to the turn.
    pub turn: R,
    /// With respect to `ln n`.
    pub log_exponent: R,
    /// With respect to the normal, as the factor of `(N.V) L + (N.L) V` (to be projected on the
    /// tangent plane by whoever steps there).
    pub normal: R,
}

impl<R: Real> Lobe<R> {
    /// A lobe from its parameters as a fit varies them.
    #[must_use]
    #[inline(always)]
    pub fn new(amplitude: R, turn: R, log_exponent: R) -> Self {
        let ([cxy, cz], rate) = direction(turn);
        Self { amplitude, cxy, cz, rate, exponent: exp(log_exponent) }
    }

    /// A lobe from the coefficients that maps hold, in the gauge of this file.
    #[must_use]
    #[inline(always)]
    pub fn of_coefficients(amplitude: R, cxy: R, cz: R, exponent: R) -> Self {
        // 2 / (1 + t^2) is 1 + cos psi.
        let rate = (cz - cxy).mul_add(R::of(0.5), R::one());
        Self { amplitude, cxy, cz, rate, exponent }
    }

    /// `d`.
    #[inline(always)]
    fn base(&self, pair: &Pair<R>) -> R {
        self.cxy.mul_add(pair.tangential, self.cz * pair.upright)
    }

    /// `d^n`, its logarithm and d, kept from 0 so that one may divide by it.
    #[inline(always)]
    fn power(&self, pair: &Pair<R>) -> [R; 3] {
        let base = self.base(pair);
        let smallest = R::of(BASE_MIN);
        // False for NaN (hard case 26).
        let lit = base.gt(smallest);
        let base = base.max(smallest);
        let log = self.exponent * ln_in_range(base);
        let log = log.max(R::of(LOG_POWER_MIN)).min(R::of(LOG_POWER_MAX));
        [R::keep(lit, exp_in_range(log)), log, base]
    }

    /// `A d^n`.
    #[must_use]
    #[inline(always)]
    pub fn value(&self, pair: &Pair<R>) -> R {
        self.amplitude * self.power(pair)[0]
    }

    /// The value where light scatters about its direction by a variance of `spread` radians squared
    /// along each axis; `seen` is `N.V`.
    ///
    /// With the vector p of length `|p|^2 = Cxy^2 (1 - (N.V)^2) + Cz^2 (N.V)^2`, d is `|p| cos(angle
    /// from p)`: the power of the cosine becomes `n / (1 + n spread)`, and `cos^n` keeps its total,
    /// `2 pi / (n + 1)`.
    #[must_use]
    #[inline(always)]
    pub fn spread_value(&self, pair: &Pair<R>, seen: R, spread: R) -> R {
        let (base, smallest) = (self.base(pair), R::of(BASE_MIN));
        let lit = base.gt(smallest);
        let one = R::one();
        // An infinite exponent over itself would be no number; the lobe of either is dark.
        let most = R::of(1e30);
        let sharp = R::select(self.exponent.gt(most), most, self.exponent);
        let exponent = sharp / sharp.mul_add(spread, one);
        let flat = self.cxy * self.cxy;
        let square = self.cz.mul_add(self.cz, -flat).mul_add(seen * seen, flat);
        let length = R::of(0.5) * ln_in_range(square.max(smallest));
        let log = exponent * ln_in_range(base.max(smallest));
        let log = (sharp - exponent).mul_add(length, log);
        let log = log.max(R::of(LOG_POWER_MIN)).min(R::of(LOG_POWER_MAX));
        let share = (exponent + one) / (sharp + one);
        self.amplitude * share * R::keep(lit, exp_in_range(log))
    }

    /// The value and its derivatives.
    #[must_use]
    #[inline(always)]
    pub fn gradient(&self, pair: &Pair<R>) -> Gradient<R> {
        let [power, log_power, base] = self.power(pair);
        let value = self.amplitude * power;
        // n A d^(n-1).
        let steep = self.exponent * value / base;
        let turning = self.cz.mul_add(pair.tangential, -(self.cxy * pair.upright));
        Gradient {
            value,
            amplitude: power,
            turn: steep * turning * self.rate,
            log_exponent: value * log_power,
            normal: steep * (self.cz - self.cxy),
        }
    }
}

/// A lobe in the form that keeps its digits at any sharpness: relative error 1e-6 in single
/// precision for n up to 20,000, against 1e-3 of `exp(n ln d)` from a rounded `d`.
#[derive(Clone, Copy, Debug)]
pub struct Sharp<R> {
    log_amplitude: Two<R>,
    cxy: Two<R>,
    cz: Two<R>,
    exponent: Two<R>,
}

impl<R: Real> Sharp<R> {
    /// `exp(log_amplitude) (Cxy tau + Cz b)^n`, in any gauge.
    #[must_use]
    #[inline(always)]
    pub fn new(log_amplitude: f64, cxy: f64, cz: f64, exponent: f64) -> Self {
        // The longer coefficient is made 1: the powers of any gauge overflow (hard case 11).
        let length = cxy.abs().max(cz.abs());
        Self {
            log_amplitude: Two::of(exponent.mul_add(length.ln(), log_amplitude)),
            cxy: Two::of(cxy / length),
            cz: Two::of(cz / length),
            exponent: Two::of(exponent),
        }
    }

    /// The lobe's value for directions that are exact as they are.
    #[must_use]
    #[inline(always)]
    pub fn value(&self, normal: Vec3<R>, light: Vec3<R>, view: Vec3<R>) -> R {
        let upright = dot(normal, light).times(dot(normal, view));
        let tangential = dot(light, view).plus(upright.negated());
        let base = self.cxy.times(tangential).plus(self.cz.times(upright));
        let power = self.exponent.times(base.ln()).plus(self.log_amplitude).exp();
        R::keep(base.hi.gt(R::of(BASE_MIN)), power)
    }
}

/// Inner product in two parts.
#[inline(always)]
fn dot<R: Real>(a: Vec3<R>, b: Vec3<R>) -> Two<R> {
    Two::product(a.x, b.x).plus(Two::product(a.y, b.y)).plus(Two::product(a.z, b.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
        Vec3::new(x, y, z).normalised()
    }

    fn scenes() -> impl Iterator<Item = (Vec3<f64>, Vec3<f64>, Vec3<f64>)> {
        (0..300).map(|i| {
            let t = f64::from(i);
            (
                unit(0.4 * (t * 0.7).sin(), 0.4 * (t * 1.3).cos(), 1.0),
                unit((t * 0.37).cos(), (t * 0.53).sin(), 0.15 + 0.8 * (t * 0.11).sin().abs()),
                unit(0.8 * (t * 0.21).sin(), 0.3, 0.4 + 0.6 * (t * 0.17).cos().abs()),
            )
        })
    }

    fn pair((normal, light, view): (Vec3<f64>, Vec3<f64>, Vec3<f64>)) -> Pair<f64> {
        Pair::against(normal, light, view, light.dot(view))
    }

    #[test]
    fn a_turn_of_0_is_phong() {
        for scene in scenes() {
            let (n, l, v) = scene;
            let mirrored = n.scale(2.0 * n.dot(l)) - l;
            let expected = mirrored.dot(v).max(0.0).powf(7.0);
            let found = Lobe::new(1.0, 0.0, 7.0_f64.ln()).value(&pair(scene));
            assert!((found - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn a_tangent_frame_gives_the_same() {
        // Lafortune's own form: the products of components in a frame on the surface.
        let [cxy, cz] = coefficients(0.3);
        for scene in scenes() {
            let (n, l, v) = scene;
            let x = n.cross(unit(0.1, 1.0, 0.2)).normalised();
            let y = n.cross(x);
            let base = cxy * (x.dot(l) * x.dot(v) + y.dot(l) * y.dot(v)) + cz * n.dot(l) * n.dot(v);
            let expected = if base > 0.0 { 0.7 * base.powf(3.0) } else { 0.0 };
            let found = Lobe::new(0.7, 0.3, 3.0_f64.ln()).value(&pair(scene));
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let mut lit = 0;
        for scene in scenes() {
            for p in [[0.5, 0.0, 3.0], [0.2, 0.7, 1.5], [1.5, -0.3, 0.2], [0.3, 1.3, 2.0]] {
                let at = |scene, [a, t, n]: [f64; 3]| Lobe::new(a, t, n).value(&pair(scene));
                let found = Lobe::new(p[0], p[1], p[2]).gradient(&pair(scene));
                let h = 1e-6;
                // Differences of a value v carry 2e-16 v / 1e-6, and h^2 times a third derivative
                // (n^3 v / d^3) / 6; bases below 0.05 are left to the value's own test.
                let base = Lobe::new(p[0], p[1], p[2]).base(&pair(scene));
                if base < 0.05 {
                    continue;
                }
                lit += 1;
                let scale = 1e-7 * (1.0 + found.value / base.powi(3));
                for (i, expected) in
                    [found.amplitude, found.turn, found.log_exponent].into_iter().enumerate()
                {
                    let (mut above, mut below) = (p, p);
                    above[i] += h;
                    below[i] -= h;
                    let difference = (at(scene, above) - at(scene, below)) / (2.0 * h);
                    assert!((difference - expected).abs() < scale, "{i}: {difference} {expected}");
                }
                let (n, l, v) = scene;
                let tangent = n.cross(unit(0.3, -0.5, 0.2)).normalised();
                let moved = |h: f64| ((n + tangent.scale(h)).normalised(), l, v);
                let difference = (at(moved(h), p) - at(moved(-h), p)) / (2.0 * h);
                let along = l.scale(n.dot(v)) + v.scale(n.dot(l));
                assert!((difference - found.normal * along.dot(tangent)).abs() < scale);
            }
        }
        assert!(lit > 400, "{lit}");
    }

    #[test]
    fn no_light_and_view_show_more_than_the_peak() {
        // Mirror lobes and others, towards the light, off the normal and below the surface.
        for turning in [0.0, -0.5, -3.0, 2.0, 8.0, -8.0] {
            for exponent in [0.7_f64, 5.0, 20.0, 900.0] {
                let turn = turning / exponent;
                let lobe = Lobe::new(1.0, turn, exponent.ln());
                let mut most = 0.0_f64;
                // The best view stands in the light's plane, on either side.
                for i in 0..401 * 401 * 2 {
                    let [a, b] = [i / 2 % 401, i / 802].map(|k| f64::from(k) / 400.0);
                    let side = f64::from(i % 2 * 2 - 1) * ((1.0 - a * a) * (1.0 - b * b)).sqrt();
                    let pair = Pair { upright: a * b, tangential: side, cosine: a };
                    most = most.max(a * lobe.value(&pair));
                }
                let peak = log_peak(turn, exponent.ln()).exp();
                assert!(most <= peak * (1.0 + 1e-12), "{turning} {exponent}: {most} {peak}");
                // A grid of 1 / 400 misses the peak by (n + 1) / 400^2 / 2 of its square.
                assert!(most > 0.99 * peak, "{turning} {exponent}: {most} {peak}");
            }
        }
    }

    #[test]
    fn any_direction_has_a_turn() {
        for i in 1..360 {
            let angle = f64::from(i) * core::f64::consts::TAU / 360.0;
            // From (-1, 1) clockwise; 180 degrees on is the direction without a turn.
            let (cxy, cz) = (3.0 * (angle.sin() - angle.cos()), 3.0 * (angle.sin() + angle.cos()));
            if i == 180 {
                continue;
            }
            let [turn, log_length] = turn_and_log_length(cxy, cz);
            let [x, z] = coefficients(turn);
            assert!((log_length - 3.0_f64.ln()).abs() < 1e-14);
            assert!((3.0 * x - cxy).abs() < 1e-12 && (3.0 * z - cz).abs() < 1e-12, "{i}");
            let [a, b] =
                [Lobe::new(0.4, turn, 1.5), Lobe::of_coefficients(0.4, x, z, 1.5_f64.exp())];
            assert!((a.rate - b.rate).abs() < 1e-15);
            let pair = Pair { upright: 0.3, tangential: -0.2, cosine: 0.5 };
            assert!((a.value(&pair) - b.value(&pair)).abs() < 1e-15);
        }
    }

    #[test]
    fn hard_case_16_scale_of_the_axes() {
        let scene = (unit(0.1, 0.2, 1.0), unit(0.3, -0.2, 0.8), unit(-0.2, 0.1, 0.9));
        let (n, l, v) = scene;
        for (cxy, cz, exponent) in [(0.87, -2.71, 4.0), (-0.66, 0.4, 27.0), (-1.0, 1.0, 900.0)] {
            for (scale, power) in [(1.0, 0.0), (3.0, 3.0_f64.ln()), (0.2, 0.2_f64.ln())] {
                let sharp = Sharp::<f64>::new(-exponent * power, scale * cxy, scale * cz, exponent);
                let [turn, length] = turn_and_log_length(cxy, cz);
                let lobe = Lobe::new((exponent * length).exp(), turn, exponent.ln());
                let (a, b) = (sharp.value(n, l, v), lobe.value(&pair(scene)));
                // Below exp(-60) the fast form is dark.
                assert!((a - b).abs() <= 1e-12 * b.max(1e-13), "{a} {b}");
            }
        }
    }

    #[test]
    fn hard_cases_9_and_10_dark_and_grazing_bases_stay_finite() {
        let (zero, tiny) = (0.0_f32, f32::MIN_POSITIVE);
        for upright in [zero, tiny, 1e-9, 3e-9, 1e-4, 1.0, -1.0] {
            for tangential in [zero, -tiny, 1e-9, 0.3, -0.3] {
                for log_exponent in [-3.0, 0.0, 5.0, 9.7] {
                    let pair = Pair { upright, tangential, cosine: 0.5 };
                    let lobe = Lobe::new(0.3, 0.2, log_exponent);
                    let g = lobe.gradient(&pair);
                    assert!(lobe.base(&pair) > 0.0 || (g.value == 0.0 && g.turn == 0.0));
                    for part in [g.value, g.amplitude, g.turn, g.log_exponent, g.normal] {
                        assert!(part.is_finite(), "{upright} {tangential} {log_exponent}: {g:?}");
                    }
                }
            }
        }
    }
}
