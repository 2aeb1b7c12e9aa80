//! The one kind of number that models and solvers are written in.
//!
//! A [`Real`] is an `f32`, an `f64` or a vector register full of either. A formula written once
//! over `R: Real` is the double-precision reference and the SIMD kernel at the same time.

use core::fmt::Debug;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// A number, or several that go through the same computation side by side (lanes).
///
/// Every operation acts lane by lane and is exactly rounded, so a lane's result never depends on
/// how wide the vector is or on what its neighbours hold.
pub trait Real:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// One yes or no per lane.
    type Mask: Mask;
    /// The number in one lane.
    type Scalar: Scalar;
    /// How many lanes there are.
    const WIDTH: usize;

    /// The same value in every lane.
    fn splat(value: Self::Scalar) -> Self;
    /// The first [`Self::WIDTH`] values of a slice.
    ///
    /// # Panics
    /// If the slice is shorter.
    fn load(values: &[Self::Scalar]) -> Self;
    /// Writes the lanes to the first [`Self::WIDTH`] places of a slice.
    ///
    /// # Panics
    /// If the slice is shorter.
    fn store(self, values: &mut [Self::Scalar]);
    /// `self * factor + summand` with one rounding.
    #[must_use]
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// Absolute value.
    #[must_use]
    fn abs(self) -> Self;
    /// `self` where it is smaller, else `other`; NaN in either gives `other`.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// `self` where it is larger, else `other`; NaN in either gives `other`.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Nearest integer, ties to even.
    #[must_use]
    fn round(self) -> Self;
    /// `2^self` for an integral `self` within the normal exponents.
    #[must_use]
    fn exp2_integral(self) -> Self;
    /// `(m, e)` with `self = m 2^e`, e integral and m between the roots of 1/2 and 2, for a
    /// positive normal number; some finite pair for any other.
    #[must_use]
    fn split(self) -> (Self, Self);
    /// `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `yes` where the mask is set, else `no`: a selection, so that NaN in the lane not taken
    /// stays out.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// Computes a part of a kernel in a function of its own.
    #[inline(always)]
    fn apart<P: Part<Self>>(part: P) -> P::Output {
        part.compute()
    }
    /// A constant, rounded to the lanes' precision.
    #[must_use]
    #[inline(always)]
    fn of(value: f64) -> Self {
        Self::splat(Self::Scalar::from_f64(value))
    }
    /// Zero.
    #[must_use]
    #[inline(always)]
    fn zero() -> Self {
        Self::of(0.0)
    }
    /// One.
    #[must_use]
    #[inline(always)]
    fn one() -> Self {
        Self::of(1.0)
    }
    /// `self > other`; false for NaN.
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// `self >= other`; false for NaN.
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// Whether the lane is neither NaN nor infinite.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().le(Self::splat(Self::Scalar::MAX))
    }
    /// Reciprocal, exactly rounded.
    #[must_use]
    #[inline(always)]
    fn recip(self) -> Self {
        Self::one() / self
    }
    /// `value` where the mask is set, else zero.
    #[inline(always)]
    fn keep(mask: Self::Mask, value: Self) -> Self {
        Self::select(mask, value, Self::zero())
    }
}

/// An inner loop that wants all registers to itself: what the kernel around it keeps in registers
/// is put away by [`Real::apart`], once, and not by every turn of the loop.
pub trait Part<R> {
    /// What it returns.
    type Output;
    /// The loop; `#[inline(always)]`, as all of a kernel.
    fn compute(self) -> Self::Output;
}

/// One yes or no per lane.
pub trait Mask:
    Copy + Debug + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    /// How many lanes there are.
    const WIDTH: usize;

    /// The same answer in every lane.
    fn splat(value: bool) -> Self;
    /// Whether any lane is true.
    fn any(self) -> bool;
    /// Whether every lane is true.
    fn all(self) -> bool;
    /// The answer of one lane.
    fn lane(self, index: usize) -> bool;
    /// The answers as bits, that of the first lane lowest.
    #[must_use]
    #[inline(always)]
    fn bits(self) -> u32 {
        (0..Self::WIDTH).fold(0, |bits, index| bits | u32::from(self.lane(index)) << index)
    }
}

/// `f32` or `f64`: what one lane holds.
pub trait Scalar: Real<Mask = bool, Scalar = Self> + PartialOrd + Default {
    /// Largest finite value.
    const MAX: Self;
    /// Not a number.
    const NAN: Self;
    /// Spacing of numbers just above one.
    const EPSILON: Self;
    /// Below this argument `exp` is flushed to zero.
    const EXP_UNDERFLOW: Self;
    /// Polynomial of [`exp`](crate::math::elementary::exp) on `|r| <= ln 2 / 2`, from the highest
    /// power down to `r^2 / 2`.
    const EXP_TAIL: &'static [f64];
    /// Smallest positive normal value.
    const MIN_POSITIVE: Self;
    /// Polynomial in `f` of [`ln`](crate::math::elementary::ln), from the highest power down to
    /// `1 / 3`; empty where the precision asks for the other form.
    const LN_DIRECT: &'static [f64];
    /// Polynomial in `s^2` of [`ln`](crate::math::elementary::ln), from the highest power down to
    /// `2 / 3`.
    const LN_TAIL: &'static [f64];

    /// Nearest representable value.
    fn from_f64(value: f64) -> Self;
    /// The value in double precision.
    fn to_f64(self) -> f64;
}

impl Mask for bool {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat(value: bool) -> Self {
        value
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn all(self) -> bool {
        self
    }
    #[inline(always)]
    fn lane(self, _index: usize) -> bool {
        self
    }
}

/// Bits of the root of 1/2.
pub(super) const SQRT_HALF_32: u32 = core::f32::consts::FRAC_1_SQRT_2.to_bits();
/// Bits of the root of 1/2.
pub(super) const SQRT_HALF_64: u64 = core::f64::consts::FRAC_1_SQRT_2.to_bits();

macro_rules! scalar_real {
    ($type:ty, $bits:ty, $mantissa:expr, $bias:expr, $root:expr) => {
        impl Real for $type {
            type Mask = bool;
            type Scalar = $type;
            const WIDTH: usize = 1;

            #[inline(always)]
            fn splat(value: $type) -> Self {
                value
            }
            #[inline(always)]
            fn load(values: &[$type]) -> Self {
                values[0]
            }
            #[inline(always)]
            fn store(self, values: &mut [$type]) {
                values[0] = self;
            }
            #[inline(always)]
            fn mul_add(self, factor: Self, summand: Self) -> Self {
                <$type>::mul_add(self, factor, summand)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$type>::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$type>::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn round(self) -> Self {
                <$type>::round_ties_even(self)
            }
            #[inline(always)]
            fn exp2_integral(self) -> Self {
                <$type>::from_bits(((self as i64 + $bias) as $bits) << $mantissa)
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // Exponent counted from the root of 1/2, so that it changes there.
                let bits = self.to_bits();
                let shifted = bits.wrapping_sub($root).wrapping_add($bias << $mantissa);
                let exponent = shifted >> $mantissa;
                let unbiased = exponent.wrapping_sub($bias) << $mantissa;
                (
                    <$type>::from_bits(bits.wrapping_sub(unbiased)),
                    exponent as $type - $bias as $type,
                )
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(never)]
            fn apart<P: Part<Self>>(part: P) -> P::Output {
                part.compute()
            }
        }
    };
}

scalar_real!(f32, u32, 23, 127, SQRT_HALF_32);
scalar_real!(f64, u64, 52, 1023, SQRT_HALF_64);

impl Scalar for f32 {
    const MAX: f32 = f32::MAX;
    const NAN: f32 = f32::NAN;
    const EPSILON: f32 = f32::EPSILON;
    const EXP_UNDERFLOW: f32 = -87.0;
    const MIN_POSITIVE: f32 = f32::MIN_POSITIVE;
    // Minimax coefficients of the Cephes single-precision logarithm (public domain numbers).
    const LN_DIRECT: &'static [f64] = &[
        7.037_683_629_2e-2,
        -1.151_461_031_0e-1,
        1.167_699_874_0e-1,
        -1.242_014_084_6e-1,
        1.424_932_278_7e-1,
        -1.666_805_766_5e-1,
        2.000_071_476_5e-1,
        -2.499_999_399_3e-1,
        3.333_333_117_4e-1,
    ];
    // The series of atanh: the first term left out is 2/11 s^10, 4e-9 at s = 0.1716.
    const LN_TAIL: &'static [f64] = &[2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0];
    // Minimax coefficients of the Cephes single-precision exponential (public domain numbers).
    const EXP_TAIL: &'static [f64] = &[
        1.987_569_15e-4,
        1.398_199_95e-3,
        8.333_451_9e-3,
        4.166_579_6e-2,
        1.666_666_55e-1,
        5.000_000_12e-1,
    ];

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Scalar for f64 {
    const MAX: f64 = f64::MAX;
    const NAN: f64 = f64::NAN;
    const EPSILON: f64 = f64::EPSILON;
    const EXP_UNDERFLOW: f64 = -708.0;
    const MIN_POSITIVE: f64 = f64::MIN_POSITIVE;
    const LN_DIRECT: &'static [f64] = &[];
    // The series of atanh: the first term left out is 2/23 s^22, 1e-18 at s = 0.1716.
    const LN_TAIL: &'static [f64] = &[
        2.0 / 21.0,
        2.0 / 19.0,
        2.0 / 17.0,
        2.0 / 15.0,
        2.0 / 13.0,
        2.0 / 11.0,
        2.0 / 9.0,
        2.0 / 7.0,
        2.0 / 5.0,
        2.0 / 3.0,
    ];
    // Taylor series to r^13 / 13!: the first term left out is below 5e-18 at |r| = ln 2 / 2.
    const EXP_TAIL: &'static [f64] = &[
        1.0 / 6_227_020_800.0,
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        1.0 / 2.0,
    ];

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}
