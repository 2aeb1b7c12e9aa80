//! Numbers that count the operations made of them: what a kernel computes, whatever the registers.
//!
//! With the feature `operations` the baseline is made of these, for benchmarks.

use core::cell::Cell;
use core::ops::{Add, Div, Mul, Neg, Sub};

use crate::math::real::{Real, Scalar};

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

/// Operations of this thread so far: every operation of [`Real`] but loads, stores and copies is
/// one, a fused multiply-add too.
#[must_use]
pub fn operations() -> u64 {
    OPERATIONS.get()
}

#[inline(always)]
fn one_more() {
    OPERATIONS.set(OPERATIONS.get() + 1);
}

/// A number that counts its operations.
#[derive(Clone, Copy, Debug)]
pub struct Counted<S>(S);

macro_rules! operator {
    ($trait:ident, $name:ident) => {
        impl<S: Scalar> $trait for Counted<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                one_more();
                Self(self.0.$name(other.0))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl<S: Scalar> Neg for Counted<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        one_more();
        Self(-self.0)
    }
}

impl<S: Scalar> Real for Counted<S> {
    type Mask = bool;
    type Scalar = S;
    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat(value: S) -> Self {
        Self(value)
    }
    #[inline(always)]
    fn load(values: &[S]) -> Self {
        Self(values[0])
    }
    #[inline(always)]
    fn store(self, values: &mut [S]) {
        values[0] = self.0;
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        one_more();
        Self(self.0.mul_add(factor.0, summand.0))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        one_more();
        Self(self.0.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        one_more();
        Self(self.0.abs())
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        one_more();
        Self(self.0.min(other.0))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        one_more();
        Self(self.0.max(other.0))
    }
    #[inline(always)]
    fn round(self) -> Self {
        one_more();
        Self(self.0.round())
    }
    #[inline(always)]
    fn exp2_integral(self) -> Self {
        one_more();
        Self(self.0.exp2_integral())
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        one_more();
        let (mantissa, exponent) = self.0.split();
        (Self(mantissa), Self(exponent))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        one_more();
        self.0.lt(other.0)
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        one_more();
        self.0.le(other.0)
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        one_more();
        Self(S::select(mask, yes.0, no.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A product-sum, a root, a division, a comparison and a selection.
    fn formula<R: Real>(x: R) -> R {
        let bent = x.mul_add(x, R::one()).sqrt().recip();
        R::select(bent.lt(x), bent, x)
    }

    #[test]
    fn every_operation_counts_once_and_has_the_bits_of_plain_numbers() {
        for x in [-0.3_f32, 0.0, 0.4, 7.0, f32::INFINITY] {
            let before = operations();
            let Counted(found) = formula(Counted(x));
            assert_eq!(operations() - before, 5);
            assert_eq!(found.to_bits(), formula(x).to_bits(), "{x}");
        }
    }
}
