//! The most operations that one thread of this machine can do in a second: independent fused
//! multiply-adds, in the registers that the numerics use.
//!
//! `cargo bench -p impasto-benches --bench peak` prints the instruction set and the rate, of numbers
//! and not of registers: the roof of `benches/python/passes.py`.

#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_methods,
    reason = "a benchmark reads clocks and prints what they say"
)]

use std::hint::black_box;
use std::time::Instant;

use impasto::math::{Isa, Kernel, Level, Real};

/// Chains side by side: more than latency times ports, and with two constants as many as the
/// narrowest vectors have registers.
const CHAINS: usize = 12;
const TURNS: usize = 2_000_000;
const ROUNDS: usize = 20;

/// Chains of fused multiply-adds; returns how many numbers they made.
struct MultiplyAdds;

impl Kernel for MultiplyAdds {
    type Output = f64;

    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let [factor, summand] = [0.999, 0.001].map(|value| I::F32::of(black_box(value)));
        let mut chains = [I::F32::of(black_box(1.0)); CHAINS];
        for _ in 0..TURNS {
            for chain in &mut chains {
                *chain = chain.mul_add(factor, summand);
            }
        }
        black_box(chains);
        (CHAINS * TURNS * I::F32::WIDTH) as f64
    }
}

fn main() {
    let level = Level::detect();
    let most = (0..ROUNDS)
        .map(|_| {
            let begin = Instant::now();
            let made = level.run(MultiplyAdds);
            made / begin.elapsed().as_secs_f64()
        })
        .fold(0.0, f64::max);
    println!("{} {most}", level.name());
}
