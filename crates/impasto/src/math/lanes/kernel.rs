//! What a kernel is: a computation over the registers of one instruction set.

use crate::math::real::{Real, Scalar};

/// Registers of one instruction set.
pub trait Isa: Copy + Send + Sync + 'static {
    /// Single-precision lanes.
    type F32: Real<Scalar = f32>;
    /// Double-precision lanes.
    type F64: Real<Scalar = f64>;

    /// The lower three bytes of each word, lowest first, one word after another.
    ///
    /// # Panics
    /// If there are not three bytes per word.
    #[inline(always)]
    fn three_bytes(words: &[u32], bytes: &mut [u8]) {
        assert_eq!(bytes.len(), 3 * words.len());
        for (bytes, word) in bytes.chunks_exact_mut(3).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes()[..3]);
        }
    }
}

/// A scalar that comes in registers of every instruction set.
pub trait Element: Scalar {
    /// The registers of one instruction set.
    type Lanes<I: Isa>: Real<Scalar = Self>;
}

impl Element for f32 {
    type Lanes<I: Isa> = I::F32;
}

impl Element for f64 {
    type Lanes<I: Isa> = I::F64;
}

/// A computation that is compiled once per instruction set.
///
/// `run`, and every generic function that it calls, must be `#[inline(always)]`: only inlined
/// code is compiled with the instruction set that [`Level::run`](super::Level::run) enables.
pub trait Kernel {
    /// What the computation returns.
    type Output;
    /// The computation.
    fn run<I: Isa>(self) -> Self::Output;
}
