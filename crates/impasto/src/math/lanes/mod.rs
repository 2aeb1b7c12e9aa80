//! Vector registers as numbers, and the choice of instruction set at run time.
//!
//! [`Level::run`] enters a [`Kernel`] compiled for one instruction set. All levels give the same
//! bits: operations are exactly rounded and every product-sum is a fused multiply-add (emulated,
//! slowly, where the processor has none).
//!
//! This module and its children are the only place of the crate that may use `unsafe`.
#![allow(
    unsafe_code,
    reason = "vector intrinsics are unsafe to call; each use states why it holds"
)]

#[cfg(any(test, not(any(target_arch = "x86_64", feature = "operations"))))]
#[cfg_attr(
    target_arch = "x86_64",
    allow(unreachable_pub, reason = "public where it is the baseline; here for its tests")
)]
mod array;
#[cfg(feature = "operations")]
mod counted;
mod kernel;
mod pair;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(feature = "operations")]
pub use counted::{Counted, operations};
pub use kernel::{Element, Isa, Kernel};
pub use pair::Pair;

use super::real::Scalar;

/// Writes one number, by an instruction of its own: where neighbours lie apart, compilers would
/// gather many and scatter them, which takes three times as long.
#[inline(always)]
pub(crate) fn put<S: Scalar>(place: &mut S, value: S) {
    // SAFETY: a reference is aligned, and valid for a write; numbers have nothing to drop.
    unsafe { core::ptr::write_volatile(place, value) };
}

/// Lanes of the widest register (single precision, AVX-512).
pub const MAX_LANES: usize = 16;

/// Bytes of a line of the cache.
pub const LINE: usize = 64;

/// Prefetches the memory that holds some values; it arrives while other work goes on.
#[inline(always)]
pub fn prefetch<T>(values: &[T]) {
    #[cfg(target_arch = "x86_64")]
    for line in values.chunks(LINE / size_of::<T>()) {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: SSE is part of x86-64, and a prefetch reads nothing that the program sees.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}

/// An instruction set that this build knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What every processor of the target has (SSE2 on x86-64, NEON on aarch64).
    Baseline,
    /// AVX2 with fused multiply-add: 8 single-precision lanes.
    Avx2,
    /// AVX-512 F: 16 single-precision lanes.
    Avx512,
}

impl Level {
    /// All levels, narrowest first.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// The widest level that this processor has.
    #[must_use]
    pub fn detect() -> Self {
        Self::ALL.into_iter().rev().find(|level| level.available()).unwrap_or(Self::Baseline)
    }

    /// Whether this processor has the level.
    #[must_use]
    pub fn available(self) -> bool {
        match self {
            Self::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
        }
    }

    /// `"baseline"`, `"avx2"` or `"avx512"`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Runs a kernel with this level's registers (with the baseline's where the processor does not
    /// have the level).
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if self != Self::Baseline && self.available() {
            // SAFETY: `available` has just found every feature that the entry points enable.
            return unsafe {
                match self {
                    Self::Avx512 => x86::run_avx512(kernel),
                    _ => x86::run_avx2(kernel),
                }
            };
        }
        kernel.run::<Baseline>()
    }
}

/// One number at a time on x86-64, where this level has no fused multiply-add: each product-sum is
/// a call, and vectors would make code that is four times as large and no faster. Elsewhere arrays
/// of four or two: the compiler turns them into the target's own registers.
#[derive(Clone, Copy, Debug)]
pub struct Baseline;

#[cfg(all(target_arch = "x86_64", not(feature = "operations")))]
impl Isa for Baseline {
    type F32 = f32;
    type F64 = f64;
}

#[cfg(feature = "operations")]
impl Isa for Baseline {
    type F32 = Counted<f32>;
    type F64 = Counted<f64>;
}

#[cfg(not(any(target_arch = "x86_64", feature = "operations")))]
impl Isa for Baseline {
    type F32 = array::Array<f32, 4>;
    type F64 = array::Array<f64, 2>;
}

#[cfg(test)]
mod tests {
    use super::array::Array;
    use super::*;
    use crate::math::real::{Mask, Real};

    /// The baseline of targets other than x86-64.
    #[derive(Clone, Copy)]
    struct Arrays;

    impl Isa for Arrays {
        type F32 = Array<f32, 4>;
        type F64 = Array<f64, 2>;
    }

    /// Every operation over awkward values, as bits, in the order of the input.
    struct EveryOperation<'a>(&'a [f32]);

    impl Kernel for EveryOperation<'_> {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<I: Isa>(self) -> Vec<u32> {
            let width = I::F32::WIDTH;
            let mut bits = Vec::new();
            for values in self.0.chunks_exact(width) {
                let a = I::F32::load(values);
                let b = a.mul_add(I::F32::of(0.7), I::F32::of(-0.3));
                let integral = (a * I::F32::of(0.01)).round().min(I::F32::of(90.0));
                let results = [
                    a + b,
                    a - b,
                    a * b,
                    a / b,
                    -a,
                    b.abs(),
                    a.abs().sqrt(),
                    a.min(b),
                    a.max(b),
                    a.round(),
                    integral.max(I::F32::of(-90.0)).exp2_integral(),
                    (b.abs() + I::F32::of(1e-30)).split().0,
                    (b.abs() + I::F32::of(1e-30)).split().1,
                    I::F32::select(a.lt(b) | !a.le(b) & b.is_finite(), a, b),
                ];
                // Lane-major, so that the width leaves no trace in the order.
                let mut out = [[0.0; MAX_LANES]; 14];
                for (out, result) in out.iter_mut().zip(results) {
                    result.store(out);
                }
                for lane in 0..width {
                    bits.extend(out.iter().map(|out| out[lane].to_bits()));
                }
            }
            bits
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let values: Vec<f32> = (0..4096)
            .map(|i| match i % 37 {
                0 => f32::INFINITY,
                1 => 0.0,
                2 => -0.0,
                3 => f32::MIN_POSITIVE,
                4 => 2.5,
                _ => (i as f32 - 2000.0) * 1.234_567,
            })
            .collect();
        let expected = Level::Baseline.run(EveryOperation(&values));
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            assert_eq!(level.run(EveryOperation(&values)), expected, "{level:?}");
        }
        assert_eq!(EveryOperation(&values).run::<Arrays>(), expected);
    }

    /// Double precision has its own registers; its splitting has its own arithmetic.
    struct SplitDoubles;
    impl Kernel for SplitDoubles {
        type Output = ();
        #[inline(always)]
        fn run<I: Isa>(self) {
            let mut out = [[0.0; 8]; 3];
            for i in 0..600 {
                let value = 2.0_f64.powf(f64::from(i) - 300.3);
                for (lane, out) in out[0].iter_mut().enumerate() {
                    *out = value * (1.0 + 0.1 * lane as f64);
                }
                let (m, e) = I::F64::load(&out[0]).split();
                m.store(&mut out[1]);
                e.store(&mut out[2]);
                let [values, m, e] = out;
                for ((value, m), e) in values.iter().zip(m).zip(e).take(I::F64::WIDTH) {
                    assert!((0.5..2.0).contains(&(m * m)));
                    assert_eq!(m * e.exp2(), *value);
                }
            }
        }
    }

    #[test]
    fn doubles_split_exactly_at_every_level() {
        for level in Level::ALL {
            level.run(SplitDoubles);
        }
        SplitDoubles.run::<Arrays>();
    }

    struct ThreeBytes<'a>(&'a [u32], &'a mut [u8]);
    impl Kernel for ThreeBytes<'_> {
        type Output = ();
        #[inline(always)]
        fn run<I: Isa>(self) {
            I::three_bytes(self.0, self.1);
        }
    }

    #[test]
    fn words_become_their_lower_three_bytes_at_every_level() {
        let words: Vec<u32> = (0..300_u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        for count in (0..40).chain([255, 256, 299]) {
            let expected = words[..count].iter().flat_map(|word| {
                let [one, two, three, _] = word.to_le_bytes();
                [one, two, three]
            });
            let expected: Vec<u8> = expected.collect();
            for level in Level::ALL {
                let mut bytes = vec![0xaa; 3 * count];
                level.run(ThreeBytes(&words[..count], &mut bytes));
                assert_eq!(bytes, expected, "{level:?} {count}");
            }
        }
    }

    struct Masks;
    impl Kernel for Masks {
        type Output = ();
        #[inline(always)]
        fn run<I: Isa>(self) {
            let ramp: Vec<f32> = (0..I::F32::WIDTH).map(|i| i as f32).collect();
            let first = I::F32::load(&ramp).lt(I::F32::one());
            assert!(first.any() && first.lane(0));
            if I::F32::WIDTH > 1 {
                assert!(!first.all() && !first.lane(1));
            }
            assert!((!first | first).all() && !(!first & first).any());
            let nan = I::F32::of(f64::NAN);
            assert!(!nan.le(nan).any() && !nan.is_finite().any());
        }
    }

    #[test]
    fn masks_answer_per_lane() {
        for level in Level::ALL {
            level.run(Masks);
        }
        Masks.run::<Arrays>();
    }
}
