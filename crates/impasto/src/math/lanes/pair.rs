//! Two registers that go side by side: while one waits for a result, the other computes.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use crate::math::real::{Mask, Part, Real};

/// Twice the lanes of `R`, for computations that are chains of dependent sums.
#[derive(Clone, Copy, Debug)]
pub struct Pair<R>(R, R);

/// Answers of [`Pair`] lanes.
#[derive(Clone, Copy, Debug)]
pub struct PairMask<M>(M, M);

macro_rules! pair_operator {
    ($name:ident, $bound:ident, $trait:ident, $method:ident) => {
        impl<T: $bound> $trait for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0), self.1.$method(other.1))
            }
        }
    };
}
pair_operator!(Pair, Real, Add, add);
pair_operator!(Pair, Real, Sub, sub);
pair_operator!(Pair, Real, Mul, mul);
pair_operator!(Pair, Real, Div, div);
pair_operator!(PairMask, Mask, BitAnd, bitand);
pair_operator!(PairMask, Mask, BitOr, bitor);

impl<R: Real> Neg for Pair<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<M: Mask> Not for PairMask<M> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0, !self.1)
    }
}

impl<R: Real> Real for Pair<R> {
    type Mask = PairMask<R::Mask>;
    type Scalar = R::Scalar;
    const WIDTH: usize = 2 * R::WIDTH;

    #[inline(always)]
    fn splat(value: R::Scalar) -> Self {
        Self(R::splat(value), R::splat(value))
    }
    #[inline(always)]
    fn load(values: &[R::Scalar]) -> Self {
        let (first, second) = values[..Self::WIDTH].split_at(R::WIDTH);
        Self(R::load(first), R::load(second))
    }
    #[inline(always)]
    fn store(self, values: &mut [R::Scalar]) {
        let (first, second) = values[..Self::WIDTH].split_at_mut(R::WIDTH);
        self.0.store(first);
        self.1.store(second);
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        Self(self.0.mul_add(factor.0, summand.0), self.1.mul_add(factor.1, summand.1))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(self.0.round(), self.1.round())
    }
    #[inline(always)]
    fn exp2_integral(self) -> Self {
        Self(self.0.exp2_integral(), self.1.exp2_integral())
    }
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let ((m, e), (n, f)) = (self.0.split(), self.1.split());
        (Self(m, n), Self(e, f))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        PairMask(self.0.lt(other.0), self.1.lt(other.1))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        PairMask(self.0.le(other.0), self.1.le(other.1))
    }
    #[inline(always)]
    fn apart<P: Part<Self>>(part: P) -> P::Output {
        R::apart(Whole(part))
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(R::select(mask.0, yes.0, no.0), R::select(mask.1, yes.1, no.1))
    }
}

/// A part over pairs, entered as one over registers.
struct Whole<P>(P);

impl<R, P: Part<Pair<R>>> Part<R> for Whole<P> {
    type Output = P::Output;

    #[inline(always)]
    fn compute(self) -> P::Output {
        self.0.compute()
    }
}

impl<M: Mask> Mask for PairMask<M> {
    const WIDTH: usize = 2 * M::WIDTH;

    #[inline(always)]
    fn splat(value: bool) -> Self {
        Self(M::splat(value), M::splat(value))
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.any() | self.1.any()
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0.all() & self.1.all()
    }
    #[inline(always)]
    fn lane(self, index: usize) -> bool {
        if index < M::WIDTH { self.0.lane(index) } else { self.1.lane(index - M::WIDTH) }
    }
}
