//! Double-word arithmetic [@dekker1971], for the few sums where one number is not enough.
//!
//! A [`Two`] is the unevaluated sum of a number and what rounding left of it: twice the digits at
//! some ten times the cost (products by fused multiply-add).

use super::elementary::{exp, ln_series};
use super::real::{Real, Scalar};

/// `hi + lo`, with `lo` below half a unit of the last place of `hi`.
#[derive(Clone, Copy, Debug)]
pub struct Two<R> {
    /// The number, rounded.
    pub hi: R,
    /// What rounding left.
    pub lo: R,
}

impl<R: Real> Two<R> {
    /// A constant in as many digits as two parts hold.
    #[must_use]
    #[inline(always)]
    pub fn of(value: f64) -> Self {
        let hi = R::Scalar::from_f64(value);
        Self { hi: R::splat(hi), lo: R::of(value - hi.to_f64()) }
    }

    /// A number that is exact as it is.
    #[must_use]
    #[inline(always)]
    pub fn exact(hi: R) -> Self {
        Self { hi, lo: R::zero() }
    }

    /// `a b` without rounding.
    #[must_use]
    #[inline(always)]
    pub fn product(a: R, b: R) -> Self {
        let hi = a * b;
        Self { hi, lo: a.mul_add(b, -hi) }
    }

    /// `a + b` without rounding (Knuth).
    #[must_use]
    #[inline(always)]
    pub fn sum(a: R, b: R) -> Self {
        let hi = a + b;
        let back = hi - a;
        Self { hi, lo: (a - (hi - back)) + (b - back) }
    }

    /// `self + other`.
    #[must_use]
    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        let (high, low) = (Self::sum(self.hi, other.hi), Self::sum(self.lo, other.lo));
        let first = Self::renormalise(high.hi, high.lo + low.hi);
        Self::renormalise(first.hi, first.lo + low.lo)
    }

    /// `-self`.
    #[must_use]
    #[inline(always)]
    pub fn negated(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }

    /// `self other`.
    #[must_use]
    #[inline(always)]
    pub fn times(self, other: Self) -> Self {
        let product = Self::product(self.hi, other.hi);
        let cross = self.hi.mul_add(other.lo, self.lo * other.hi);
        Self::renormalise(product.hi, product.lo + cross)
    }

    /// `self / other`.
    #[must_use]
    #[inline(always)]
    pub fn over(self, other: Self) -> Self {
        let hi = self.hi / other.hi;
        let rest = self.plus(other.times(Self::exact(-hi)));
        Self::renormalise(hi, rest.hi / other.hi)
    }

    /// `ln(self)` for a positive normal number, finite for any other; the relative error is below
    /// 5e-9 in single precision even where the logarithm itself is 1e-4.
    ///
    /// `f = m - 1`, `s = f / (2 + f)`, `ln m = 2 s + s R(s^2)`: the last term is below 1 % of the
    /// first, one part is enough for it.
    #[must_use]
    #[inline(always)]
    pub fn ln(self) -> Self {
        let smallest = R::splat(R::Scalar::MIN_POSITIVE);
        let normal = self.hi.ge(smallest) & self.hi.is_finite();
        let hi = R::select(normal, self.hi, R::one());
        let (m, e) = hi.split();
        // The lower part goes through the same power of two; exponents of cosines are small.
        let lo = R::keep(normal, self.lo) * (-e).exp2_integral();
        let f = Self::sum(m, -R::one()).plus(Self::exact(lo));
        let s = f.over(f.plus(Self::exact(R::of(2.0))));
        let square = s.hi * s.hi;
        let mantissa = s.plus(s).plus(Self::exact(s.hi * square * ln_series(square)));
        Self::of(core::f64::consts::LN_2).times(Self::exact(e)).plus(mantissa)
    }

    /// `exp(self)`, rounded to one part; flushed to zero as [`exp`] is.
    #[must_use]
    #[inline(always)]
    pub fn exp(self) -> R {
        let value = exp(self.hi);
        value.mul_add(self.lo, value)
    }

    #[inline(always)]
    fn renormalise(hi: R, lo: R) -> Self {
        let sum = hi + lo;
        Self { hi: sum, lo: lo - (sum - hi) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_singles_are_nearly_a_double() {
        for i in 1..5000 {
            let (a, b) = (f64::from(i) * 0.000_31, 1.7 - f64::from(i) * 0.000_3);
            let (x, y) = (Two::<f32>::of(a), Two::<f32>::of(b));
            let value = |two: Two<f32>| f64::from(two.hi) + f64::from(two.lo);
            // Two parts of 24 bits each: 2^-46 relative to the terms, two roundings more.
            assert!((value(x.plus(y)) - (a + b)).abs() < 2e-13 * (a.abs() + b.abs()));
            assert!((value(x.times(y)) - a * b).abs() < 2e-13 * (a * b).abs());
            assert!((value(x.over(y)) - a / b).abs() < 4e-13 * (a / b).abs());
            // The last term of ln, below 1 % of it, carries some 2e-7, and the series' end 2e-9.
            assert!((value(x.ln()) - a.ln()).abs() <= 5e-9 * a.ln().abs(), "{a}");
        }
    }

    #[test]
    fn logarithms_next_to_one_keep_their_digits() {
        for i in 1..1000 {
            let t = f64::from(i) * 1e-7;
            let found = Two::<f32>::of(1.0 - t).ln();
            // 1 - t itself is kept to 2^-48, 3.6e-8 of the smallest t.
            let expected = (1.0 - t).ln();
            let error = f64::from(found.hi) + f64::from(found.lo) - expected;
            assert!(error.abs() < 1e-9 * t + 8e-15, "{t}: {error}");
        }
    }

    #[test]
    fn logarithms_are_finite_for_every_argument() {
        for x in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::MIN_POSITIVE] {
            let ln = Two::exact(x).ln();
            assert!(ln.hi.is_finite() && ln.lo.is_finite(), "{x}");
        }
    }
}
