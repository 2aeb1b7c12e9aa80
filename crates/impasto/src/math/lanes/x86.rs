//! AVX2 and AVX-512 registers.
//!
//! SAFETY of every block below: values of these types are made only inside `run_avx2` and
//! `run_avx512`, which [`Level::run`](super::Level::run) enters after finding the features; the
//! pointers of loads and stores come from slices whose length has just been checked.

#[allow(clippy::wildcard_imports, reason = "eighty intrinsics, all of one name space")]
use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::kernel::{Isa, Kernel};
use crate::math::real::{Mask, Part, Real, SQRT_HALF_32, SQRT_HALF_64};

#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2;
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx512;

impl Isa for Avx2 {
    type F32 = F32x8;
    type F64 = F64x4;

    #[inline(always)]
    fn three_bytes(words: &[u32], bytes: &mut [u8]) {
        three_bytes(words, bytes);
    }
}
impl Isa for Avx512 {
    type F32 = F32x16;
    type F64 = F64x8;

    #[inline(always)]
    fn three_bytes(words: &[u32], bytes: &mut [u8]) {
        three_bytes(words, bytes);
    }
}

/// [`Isa::three_bytes`] of either: eight words at a time become 24 bytes of a register of 32, whose
/// last eight the next eight words replace.
#[inline(always)]
fn three_bytes(words: &[u32], bytes: &mut [u8]) {
    const WORDS: usize = 8;
    assert_eq!(bytes.len(), 3 * words.len());
    // As long as there is room for a whole register.
    let whole = bytes.len().saturating_sub(WORDS) / (3 * WORDS);
    for (index, words) in words.chunks_exact(WORDS).take(whole).enumerate() {
        let bytes = &mut bytes[3 * WORDS * index..][..4 * WORDS];
        // SAFETY: see the head of this module; both slices have just been cut to 32 bytes.
        unsafe {
            let kept = _mm256_setr_epi8(
                0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1, 0, 1, 2, 4, 5, 6, 8, 9, 10,
                12, 13, 14, -1, -1, -1, -1,
            );
            let together = _mm256_setr_epi32(0, 1, 2, 4, 5, 6, 7, 7);
            let eight = _mm256_loadu_si256(words.as_ptr().cast());
            let halves = _mm256_shuffle_epi8(eight, kept);
            let shown = _mm256_permutevar8x32_epi32(halves, together);
            _mm256_storeu_si256(bytes.as_mut_ptr().cast(), shown);
        }
    }
    let done = whole.min(words.len() / WORDS) * WORDS;
    for (bytes, word) in bytes[3 * done..].chunks_exact_mut(3).zip(&words[done..]) {
        bytes.copy_from_slice(&word.to_le_bytes()[..3]);
    }
}

#[target_feature(enable = "avx2,fma,f16c")]
pub(super) unsafe fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2>()
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,f16c")]
pub(super) unsafe fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx512>()
}

#[inline(never)]
#[target_feature(enable = "avx2,fma,f16c")]
unsafe fn apart_avx2<R, P: Part<R>>(part: P) -> P::Output {
    part.compute()
}

#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,f16c")]
unsafe fn apart_avx512<R, P: Part<R>>(part: P) -> P::Output {
    part.compute()
}

macro_rules! intrinsic {
    ($function:ident($($argument:expr),*)) => {{
        // SAFETY: see the head of this module.
        unsafe { $function($($argument),*) }
    }};
}

macro_rules! operator {
    ($name:ident, $trait:ident, $method:ident, $function:ident) => {
        impl $trait for $name {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(intrinsic!($function(self.0, other.0)))
            }
        }
    };
}

/// The operations that AVX2 and AVX-512 name alike.
macro_rules! common {
    ($name:ident, $scalar:ty, $register:ty, $width:literal, $mask:ident,
     $set:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident,
     $fma:ident, $sqrt:ident, $min:ident, $max:ident, $apart:ident,
     { $($rest:tt)* }) => {
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name($register);

        operator!($name, Add, add, $add);
        operator!($name, Sub, sub, $sub);
        operator!($name, Mul, mul, $mul);
        operator!($name, Div, div, $div);

        impl Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self::splat(-0.0) - self
            }
        }

        impl Real for $name {
            type Mask = $mask;
            type Scalar = $scalar;
            const WIDTH: usize = $width;

            #[inline(always)]
            fn splat(value: $scalar) -> Self {
                Self(intrinsic!($set(value)))
            }
            #[inline(always)]
            fn load(values: &[$scalar]) -> Self {
                let values = &values[..$width];
                Self(intrinsic!($load(values.as_ptr())))
            }
            #[inline(always)]
            fn store(self, values: &mut [$scalar]) {
                let values = &mut values[..$width];
                intrinsic!($store(values.as_mut_ptr(), self.0));
            }
            #[inline(always)]
            fn mul_add(self, factor: Self, summand: Self) -> Self {
                Self(intrinsic!($fma(self.0, factor.0, summand.0)))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(intrinsic!($sqrt(self.0)))
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self(intrinsic!($min(self.0, other.0)))
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self(intrinsic!($max(self.0, other.0)))
            }
            #[inline(always)]
            fn apart<P: Part<Self>>(part: P) -> P::Output {
                intrinsic!($apart(part))
            }
            $($rest)*
        }
    };
}

const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

common!(
    F32x8,
    f32,
    __m256,
    8,
    Mask32x8,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_div_ps,
    _mm256_fmadd_ps,
    _mm256_sqrt_ps,
    _mm256_min_ps,
    _mm256_max_ps,
    apart_avx2,
    {
        #[inline(always)]
        fn abs(self) -> Self {
            Self(intrinsic!(_mm256_andnot_ps(Self::splat(-0.0).0, self.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe { _mm256_round_ps::<NEAREST>(self.0) })
        }
        #[inline(always)]
        fn exp2_integral(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe {
                let exponent = _mm256_add_epi32(_mm256_cvtps_epi32(self.0), _mm256_set1_epi32(127));
                _mm256_castsi256_ps(_mm256_slli_epi32::<23>(exponent))
            })
        }
        #[inline(always)]
        fn split(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let bits = _mm256_castps_si256(self.0);
                let base = _mm256_set1_epi32((SQRT_HALF_32.wrapping_sub(127 << 23)).cast_signed());
                let shifted = _mm256_sub_epi32(bits, base);
                let biased = _mm256_srli_epi32::<23>(shifted);
                let exponent = _mm256_sub_epi32(biased, _mm256_set1_epi32(127));
                let m = _mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(exponent));
                (Self(_mm256_castsi256_ps(m)), Self(_mm256_cvtepi32_ps(exponent)))
            }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Mask32x8 {
            // SAFETY: see the head of this module.
            Mask32x8(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn le(self, other: Self) -> Mask32x8 {
            // SAFETY: see the head of this module.
            Mask32x8(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn select(mask: Mask32x8, yes: Self, no: Self) -> Self {
            Self(intrinsic!(_mm256_blendv_ps(no.0, yes.0, mask.0)))
        }
    }
);

common!(
    F64x4,
    f64,
    __m256d,
    4,
    Mask64x4,
    _mm256_set1_pd,
    _mm256_loadu_pd,
    _mm256_storeu_pd,
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_div_pd,
    _mm256_fmadd_pd,
    _mm256_sqrt_pd,
    _mm256_min_pd,
    _mm256_max_pd,
    apart_avx2,
    {
        #[inline(always)]
        fn abs(self) -> Self {
            Self(intrinsic!(_mm256_andnot_pd(Self::splat(-0.0).0, self.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe { _mm256_round_pd::<NEAREST>(self.0) })
        }
        #[inline(always)]
        fn exp2_integral(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe {
                let integer = _mm256_cvtepi32_epi64(_mm256_cvtpd_epi32(self.0));
                let exponent = _mm256_add_epi64(integer, _mm256_set1_epi64x(1023));
                _mm256_castsi256_pd(_mm256_slli_epi64::<52>(exponent))
            })
        }
        #[inline(always)]
        fn split(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let bits = _mm256_castpd_si256(self.0);
                let base = (SQRT_HALF_64.wrapping_sub(1023 << 52)).cast_signed();
                let shifted = _mm256_sub_epi64(bits, _mm256_set1_epi64x(base));
                let biased = _mm256_srli_epi64::<52>(shifted);
                let exponent = _mm256_sub_epi64(biased, _mm256_set1_epi64x(1023));
                let m = _mm256_sub_epi64(bits, _mm256_slli_epi64::<52>(exponent));
                // An integer below 2^52 under the exponent of 2^52 is that integer plus 2^52.
                let magic = _mm256_set1_pd(4_503_599_627_370_496.0);
                let sum = _mm256_castsi256_pd(_mm256_or_si256(biased, _mm256_castpd_si256(magic)));
                let e = _mm256_sub_pd(_mm256_sub_pd(sum, magic), _mm256_set1_pd(1023.0));
                (Self(_mm256_castsi256_pd(m)), Self(e))
            }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Mask64x4 {
            // SAFETY: see the head of this module.
            Mask64x4(unsafe { _mm256_cmp_pd::<_CMP_LT_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn le(self, other: Self) -> Mask64x4 {
            // SAFETY: see the head of this module.
            Mask64x4(unsafe { _mm256_cmp_pd::<_CMP_LE_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn select(mask: Mask64x4, yes: Self, no: Self) -> Self {
            Self(intrinsic!(_mm256_blendv_pd(no.0, yes.0, mask.0)))
        }
    }
);

common!(
    F32x16,
    f32,
    __m512,
    16,
    Mask16,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    _mm512_div_ps,
    _mm512_fmadd_ps,
    _mm512_sqrt_ps,
    _mm512_min_ps,
    _mm512_max_ps,
    apart_avx512,
    {
        #[inline(always)]
        fn abs(self) -> Self {
            Self(intrinsic!(_mm512_abs_ps(self.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe { _mm512_roundscale_ps::<NEAREST>(self.0) })
        }
        #[inline(always)]
        fn exp2_integral(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe {
                let exponent = _mm512_add_epi32(_mm512_cvtps_epi32(self.0), _mm512_set1_epi32(127));
                _mm512_castsi512_ps(_mm512_slli_epi32::<23>(exponent))
            })
        }
        #[inline(always)]
        fn split(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let bits = _mm512_castps_si512(self.0);
                let base = _mm512_set1_epi32((SQRT_HALF_32.wrapping_sub(127 << 23)).cast_signed());
                let shifted = _mm512_sub_epi32(bits, base);
                let biased = _mm512_srli_epi32::<23>(shifted);
                let exponent = _mm512_sub_epi32(biased, _mm512_set1_epi32(127));
                let m = _mm512_sub_epi32(bits, _mm512_slli_epi32::<23>(exponent));
                (Self(_mm512_castsi512_ps(m)), Self(_mm512_cvtepi32_ps(exponent)))
            }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Mask16 {
            // SAFETY: see the head of this module.
            Mask16(unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn le(self, other: Self) -> Mask16 {
            // SAFETY: see the head of this module.
            Mask16(unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn select(mask: Mask16, yes: Self, no: Self) -> Self {
            Self(intrinsic!(_mm512_mask_blend_ps(mask.0, no.0, yes.0)))
        }
    }
);

common!(
    F64x8,
    f64,
    __m512d,
    8,
    Mask8,
    _mm512_set1_pd,
    _mm512_loadu_pd,
    _mm512_storeu_pd,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_fmadd_pd,
    _mm512_sqrt_pd,
    _mm512_min_pd,
    _mm512_max_pd,
    apart_avx512,
    {
        #[inline(always)]
        fn abs(self) -> Self {
            Self(intrinsic!(_mm512_abs_pd(self.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe { _mm512_roundscale_pd::<NEAREST>(self.0) })
        }
        #[inline(always)]
        fn exp2_integral(self) -> Self {
            // SAFETY: see the head of this module.
            Self(unsafe {
                let exponent =
                    _mm512_add_epi64(_mm512_cvtpd_epi64(self.0), _mm512_set1_epi64(1023));
                _mm512_castsi512_pd(_mm512_slli_epi64::<52>(exponent))
            })
        }
        #[inline(always)]
        fn split(self) -> (Self, Self) {
            // SAFETY: see the head of this module.
            unsafe {
                let bits = _mm512_castpd_si512(self.0);
                let base = (SQRT_HALF_64.wrapping_sub(1023 << 52)).cast_signed();
                let shifted = _mm512_sub_epi64(bits, _mm512_set1_epi64(base));
                let biased = _mm512_srli_epi64::<52>(shifted);
                let exponent = _mm512_sub_epi64(biased, _mm512_set1_epi64(1023));
                let m = _mm512_sub_epi64(bits, _mm512_slli_epi64::<52>(exponent));
                // An integer below 2^52 under the exponent of 2^52 is that integer plus 2^52.
                let magic = _mm512_set1_pd(4_503_599_627_370_496.0);
                let sum = _mm512_castsi512_pd(_mm512_or_si512(biased, _mm512_castpd_si512(magic)));
                let e = _mm512_sub_pd(_mm512_sub_pd(sum, magic), _mm512_set1_pd(1023.0));
                (Self(_mm512_castsi512_pd(m)), Self(e))
            }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Mask8 {
            // SAFETY: see the head of this module.
            Mask8(unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn le(self, other: Self) -> Mask8 {
            // SAFETY: see the head of this module.
            Mask8(unsafe { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0) })
        }
        #[inline(always)]
        fn select(mask: Mask8, yes: Self, no: Self) -> Self {
            Self(intrinsic!(_mm512_mask_blend_pd(mask.0, no.0, yes.0)))
        }
    }
);

macro_rules! register_mask {
    ($name:ident, $register:ty, $and:ident, $or:ident, $xor:ident, $bits:ident, $ones:expr,
     $zero:ident, $all:literal, $width:literal) => {
        /// A full register: every lane all ones (yes) or all zeros (no).
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name($register);
        operator!($name, BitAnd, bitand, $and);
        operator!($name, BitOr, bitor, $or);
        impl Not for $name {
            type Output = Self;
            #[inline(always)]
            fn not(self) -> Self {
                Self(intrinsic!($xor(self.0, Self::splat(true).0)))
            }
        }
        impl Mask for $name {
            const WIDTH: usize = $width;

            #[inline(always)]
            fn splat(value: bool) -> Self {
                // SAFETY: see the head of this module.
                Self(unsafe { if value { $ones } else { $zero() } })
            }
            #[inline(always)]
            fn any(self) -> bool {
                intrinsic!($bits(self.0)) != 0
            }
            #[inline(always)]
            fn all(self) -> bool {
                intrinsic!($bits(self.0)) == $all
            }
            #[inline(always)]
            fn lane(self, index: usize) -> bool {
                intrinsic!($bits(self.0)) >> index & 1 == 1
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                intrinsic!($bits(self.0)).cast_unsigned()
            }
        }
    };
}

register_mask!(
    Mask32x8,
    __m256,
    _mm256_and_ps,
    _mm256_or_ps,
    _mm256_xor_ps,
    _mm256_movemask_ps,
    _mm256_castsi256_ps(_mm256_set1_epi32(-1)),
    _mm256_setzero_ps,
    0xFF,
    8
);
register_mask!(
    Mask64x4,
    __m256d,
    _mm256_and_pd,
    _mm256_or_pd,
    _mm256_xor_pd,
    _mm256_movemask_pd,
    _mm256_castsi256_pd(_mm256_set1_epi32(-1)),
    _mm256_setzero_pd,
    0xF,
    4
);

macro_rules! bit_mask {
    ($name:ident, $bits:ty) => {
        /// A mask register: one bit per lane.
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name($bits);
        impl BitAnd for $name {
            type Output = Self;
            #[inline(always)]
            fn bitand(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }
        }
        impl BitOr for $name {
            type Output = Self;
            #[inline(always)]
            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }
        impl Not for $name {
            type Output = Self;
            #[inline(always)]
            fn not(self) -> Self {
                Self(!self.0)
            }
        }
        impl Mask for $name {
            const WIDTH: usize = <$bits>::BITS as usize;

            #[inline(always)]
            fn splat(value: bool) -> Self {
                Self(if value { <$bits>::MAX } else { 0 })
            }
            #[inline(always)]
            fn any(self) -> bool {
                self.0 != 0
            }
            #[inline(always)]
            fn all(self) -> bool {
                self.0 == <$bits>::MAX
            }
            #[inline(always)]
            fn lane(self, index: usize) -> bool {
                self.0 >> index & 1 == 1
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                self.0.into()
            }
        }
    };
}
bit_mask!(Mask16, u16);
bit_mask!(Mask8, u8);
