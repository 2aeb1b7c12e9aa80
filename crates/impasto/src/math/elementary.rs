//! Elementary functions as polynomials of our own: the same bits on every processor.

use super::real::{Real, Scalar};

/// `exp(x)`, flushed to zero below the smallest normal number's logarithm; NaN stays NaN.
///
/// Cody-Waite reduction and a polynomial: relative error below 1 ulp (2e-7 single precision
/// measured over the whole range, 3e-16 double). Arguments above 88 (single) or 709 (double)
/// saturate at the largest power: lobes never ask for them.
#[must_use]
#[inline(always)]
pub fn exp<R: Real>(x: R) -> R {
    let floor = R::splat(R::Scalar::EXP_UNDERFLOW);
    // The bounds come first: for NaN, `max` and `min` answer with their argument.
    let value = exp_in_range((-floor).min(floor.max(x)));
    // The comparison is false for NaN, so the flush must be the branch that needs a "yes".
    R::select(x.lt(floor), R::zero(), value)
}

/// [`exp`] for arguments that are known to lie between its bounds.
#[must_use]
#[inline(always)]
pub fn exp_in_range<R: Real>(x: R) -> R {
    let k = (x * R::of(core::f64::consts::LOG2_E)).round();
    // ln 2 in two parts: k times the upper part is exact.
    let r = k.mul_add(R::of(-0.693_359_375), x);
    let r = k.mul_add(R::of(2.121_944_400_546_905_8e-4), r);
    let mut tail = R::of(R::Scalar::EXP_TAIL[0]);
    for &coefficient in &R::Scalar::EXP_TAIL[1..] {
        tail = tail.mul_add(r, R::of(coefficient));
    }
    let value = tail.mul_add(r * r, r) + R::one();
    value * k.exp2_integral()
}

/// Natural logarithm of a positive normal number; of the smallest one for anything below it and
/// for NaN, of the largest for infinity. Never NaN, so that a caller may select afterwards.
///
/// `x = m 2^e`, `f = m - 1`. In double precision `s = f / (2 + f)` and
/// `ln m = f - (f^2/2 - s (f^2/2 + R(s^2)))`; in single precision a polynomial in f alone, without
/// the division, is as good. Either keeps full relative accuracy near one, where lobes peak:
/// within 1 or 2 ulp.
#[must_use]
#[inline(always)]
pub fn ln<R: Real>(x: R) -> R {
    ln_in_range(x.max(R::splat(R::Scalar::MIN_POSITIVE)).min(R::splat(R::Scalar::MAX)))
}

/// [`ln`] for arguments that are known to be positive, normal and finite.
#[must_use]
#[inline(always)]
pub fn ln_in_range<R: Real>(x: R) -> R {
    let (m, e) = x.split();
    let f = m - R::one();
    let square = f * f;
    // ln 2 in two parts: e times the upper part is exact.
    let low = e * R::of(-2.121_944_400_546_905_8e-4);
    let direct = R::Scalar::LN_DIRECT;
    let tail = if let [first, rest @ ..] = direct {
        let mut tail = R::of(*first);
        for &coefficient in rest {
            tail = tail.mul_add(f, R::of(coefficient));
        }
        (tail * f).mul_add(square, low)
    } else {
        let s = f / (f + R::of(2.0));
        let series = ln_series(s * s);
        // s (f^2/2 + R) in the place of the polynomial.
        s.mul_add(series.mul_add(s * s, square * R::of(0.5)), low)
    };
    e.mul_add(R::of(0.693_359_375), square.mul_add(R::of(-0.5), tail) + f)
}

/// `R(s^2) / s^2` of [`ln`].
#[inline(always)]
pub(super) fn ln_series<R: Real>(square: R) -> R {
    let mut tail = R::of(R::Scalar::LN_TAIL[0]);
    for &coefficient in &R::Scalar::LN_TAIL[1..] {
        tail = tail.mul_add(square, R::of(coefficient));
    }
    tail
}

/// The power of two at a magnitude, and the same for any power of two of it. Neither it nor its
/// reciprocal is subnormal: twice and half the range's ends are near enough.
#[must_use]
#[inline(always)]
pub fn power_of_two(size: f32) -> f32 {
    const EXPONENT: u32 = 0x7f80_0000;
    const ONE: u32 = 1 << 23;
    f32::from_bits((size.to_bits() & EXPONENT).clamp(ONE, EXPONENT - 2 * ONE))
}

/// `phi^2` from `e = |n - h|^2 / 2 = 1 - cos(phi)`, for angles up to about 1.3 rad.
///
/// The series `sum 2 (2e)^k / (k^2 C(2k, k))` loses nothing near `phi = 0`, where `acos(n.h)` has
/// no correct digit in single precision (hard case 8 of `docs/numerics`). Eight terms: truncation
/// 4.4e-6 relative at 1.2 rad, below 1e-8 at 0.8.
#[must_use]
#[inline(always)]
pub fn phi_squared<R: Real>(e: R) -> R {
    let mut sum = R::of(PHI_SERIES[7]);
    for &term in PHI_SERIES[..7].iter().rev() {
        sum = sum.mul_add(e, R::of(term));
    }
    sum * e
}

/// Derivative of [`phi_squared`]: `2 phi / sin(phi)`, from the same series.
#[must_use]
#[inline(always)]
pub fn phi_squared_slope<R: Real>(e: R) -> R {
    let mut sum = R::of(8.0 * PHI_SERIES[7]);
    for (power, &term) in PHI_SERIES[..7].iter().enumerate().rev() {
        sum = sum.mul_add(e, R::of((power + 1) as f64 * term));
    }
    sum
}

/// `2^(k+1) / (k^2 C(2k, k))` for k = 1 .. 8.
const PHI_SERIES: [f64; 8] = [
    2.0,
    1.0 / 3.0,
    4.0 / 45.0,
    1.0 / 35.0,
    16.0 / 1575.0,
    8.0 / 2079.0,
    32.0 / 21_021.0,
    4.0 / 6435.0,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_within_an_ulp_or_two_of_the_library() {
        for i in -870..870 {
            let x = f64::from(i) * 0.1;
            let single = exp(x as f32);
            // Two roundings (r and the product) of 6e-8 each, doubled for the polynomial.
            assert!((f64::from(single) / f64::from(x as f32).exp() - 1.0).abs() < 2.4e-7, "{x}");
            assert!((exp(x) / x.exp() - 1.0).abs() < 9e-16, "{x}");
        }
    }

    #[test]
    fn ln_is_within_an_ulp_or_two_of_the_library() {
        for i in 1..40_000 {
            for x in [f64::from(i) * 1e-4, f64::from(i).powi(7), f64::from(i).powi(-6)] {
                let single = f64::from(x as f32).ln();
                // Two ulps; next to 1 the value itself is small and so is its ulp.
                assert!((f64::from(ln(x as f32)) - single).abs() <= 2.4e-7 * single.abs(), "{x}");
                assert!((ln(x) - x.ln()).abs() <= 4.5e-16 * x.ln().abs(), "{x}");
            }
        }
    }

    #[test]
    fn ln_is_finite_for_every_argument() {
        for x in [0.0, -1.0, 1e-42, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(ln(x).is_finite(), "{x}");
        }
    }

    #[test]
    fn exp_flushes_underflow_and_keeps_nan() {
        assert!(exp(-88.0_f32).abs() < f32::MIN_POSITIVE);
        assert!(exp(f32::NEG_INFINITY).abs() < f32::MIN_POSITIVE);
        assert!(exp(f32::NAN).is_nan());
    }

    #[test]
    fn the_slope_of_phi_squared_matches_the_definition() {
        for i in 1..800 {
            let phi = f64::from(i) * 1e-3;
            let e = 2.0 * (phi / 2.0).sin().powi(2);
            // The first term left out of the derivative is 9 c_9 e^8, 1e-6 of it at 0.8 rad.
            assert!((phi_squared_slope(e) * phi.sin() / (2.0 * phi) - 1.0).abs() < 1e-6, "{phi}");
        }
    }

    #[test]
    fn phi_squared_matches_the_definition() {
        for i in 0..1200 {
            let phi = f64::from(i) * 1e-3;
            // 1 - cos(phi) without cancellation.
            let e = 2.0 * (phi / 2.0).sin().powi(2);
            // The terms left out sum to 6.2e-6 at e = 1 - cos(1.2), 4.4e-6 of phi^2.
            assert!((phi_squared(e) - phi * phi).abs() <= 4.4e-6 * phi * phi, "{phi}");
        }
    }
}
