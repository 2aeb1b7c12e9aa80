//! Lanes without intrinsics: the compiler turns small arrays into the target's own registers.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use crate::math::real::{Mask, Real, Scalar};

/// Lanes without intrinsics.
#[derive(Clone, Copy, Debug)]
pub struct Array<T, const N: usize>([T; N]);

/// Answers of [`Array`] lanes.
#[derive(Clone, Copy, Debug)]
pub struct ArrayMask<const N: usize>([bool; N]);

macro_rules! array_operator {
    ($trait:ident, $method:ident) => {
        impl<T: Scalar, const N: usize> $trait for Array<T, N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(core::array::from_fn(|i| self.0[i].$method(other.0[i])))
            }
        }
    };
}
array_operator!(Add, add);
array_operator!(Sub, sub);
array_operator!(Mul, mul);
array_operator!(Div, div);

impl<T: Scalar, const N: usize> Neg for Array<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|v| -v))
    }
}

impl<T: Scalar, const N: usize> Real for Array<T, N> {
    type Mask = ArrayMask<N>;
    type Scalar = T;
    const WIDTH: usize = N;

    #[inline(always)]
    fn splat(value: T) -> Self {
        Self([value; N])
    }
    #[inline(always)]
    fn load(values: &[T]) -> Self {
        let values = &values[..N];
        Self(core::array::from_fn(|i| values[i]))
    }
    #[inline(always)]
    fn store(self, values: &mut [T]) {
        values[..N].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        Self(core::array::from_fn(|i| self.0[i].mul_add(factor.0[i], summand.0[i])))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(Real::sqrt))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(Real::abs))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(core::array::from_fn(|i| Real::min(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(core::array::from_fn(|i| Real::max(self.0[i], other.0[i])))
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(self.0.map(Real::round))
    }
    #[inline(always)]
    fn exp2_integral(self) -> Self {
        Self(self.0.map(Real::exp2_integral))
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let parts = self.0.map(Real::split);
        (Self(parts.map(|(m, _)| m)), Self(parts.map(|(_, e)| e)))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> ArrayMask<N> {
        ArrayMask(core::array::from_fn(|i| self.0[i] < other.0[i]))
    }
    #[inline(always)]
    fn le(self, other: Self) -> ArrayMask<N> {
        ArrayMask(core::array::from_fn(|i| self.0[i] <= other.0[i]))
    }
    #[inline(always)]
    fn select(mask: ArrayMask<N>, yes: Self, no: Self) -> Self {
        Self(core::array::from_fn(|i| if mask.0[i] { yes.0[i] } else { no.0[i] }))
    }
}

impl<const N: usize> BitAnd for ArrayMask<N> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(core::array::from_fn(|i| self.0[i] & other.0[i]))
    }
}
impl<const N: usize> BitOr for ArrayMask<N> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(core::array::from_fn(|i| self.0[i] | other.0[i]))
    }
}
impl<const N: usize> Not for ArrayMask<N> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.map(|v| !v))
    }
}
impl<const N: usize> Mask for ArrayMask<N> {
    const WIDTH: usize = N;

    #[inline(always)]
    fn splat(value: bool) -> Self {
        Self([value; N])
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.contains(&true)
    }
    #[inline(always)]
    fn all(self) -> bool {
        !self.0.contains(&false)
    }
    #[inline(always)]
    fn lane(self, index: usize) -> bool {
        self.0[index]
    }
}
