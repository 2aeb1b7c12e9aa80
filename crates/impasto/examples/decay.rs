//! Fifty thousand exponential decays `a exp(-b t)`, fitted on all threads.
//!
//! `cargo run --release --example decay --no-default-features --features lm`
//!
//! One problem per vector lane, one batch per thread. The solver needs no thread pool of its own: a
//! batch is an ordinary value, and the standard library's scoped threads divide the problems.
#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_methods,
    reason = "an example prints and times"
)]

use std::num::NonZero;
use std::thread;
use std::time::Instant;

use impasto::lm::{Batch, Bounds, Column, Normal, Options, Outcome, Rows, fit};
use impasto::math::elementary::exp;
use impasto::math::{Level, Real};

const PROBLEMS: usize = 50_000;
const SAMPLES: usize = 16;
const NOISE: f32 = 0.01;

/// Samples of some decays, and room for what is found of each: `[a, b, deviation of b]`.
struct Decays<'a> {
    samples: &'a [[f32; SAMPLES]],
    found: &'a mut [[f32; 3]],
}

fn time(sample: usize) -> f64 {
    0.25 * sample as f64
}

impl Batch<f32, 2> for Decays<'_> {
    const COVARIANCE: bool = true;

    fn rows(&self) -> usize {
        SAMPLES
    }

    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 2] {
        column.fill(self.samples[problem]);
        [self.samples[problem][0].max(0.1), 1.0]
    }

    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, [a, b]: [R; 2]) -> Normal<R, 2> {
        let mut normal = Normal::zero();
        for sample in 0..SAMPLES {
            let t = R::of(time(sample));
            let decay = exp(-(b * t));
            normal.add([decay, -(t * a * decay)], rows.get(sample) - a * decay);
        }
        normal
    }

    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 2>) {
        let [a, b] = outcome.parameters;
        let deviation = outcome.covariance(NOISE * NOISE)[1][1].sqrt();
        self.found[problem] =
            if outcome.reason.converged() { [a, b, deviation] } else { [f32::NAN; 3] };
    }
}

fn main() {
    let truth = |problem: usize| {
        let share = problem as f32 / PROBLEMS as f32;
        [1.0 + share, 0.2 + 1.8 * share]
    };
    let mut noise = noise();
    let samples: Vec<[f32; SAMPLES]> = (0..PROBLEMS)
        .map(|problem| {
            let [a, b] = truth(problem);
            core::array::from_fn(|i| a * (-b * time(i) as f32).exp() + NOISE * noise())
        })
        .collect();
    let mut found = vec![[0.0; 3]; PROBLEMS];

    let threads = thread::available_parallelism().map_or(1, NonZero::get);
    let share = PROBLEMS.div_ceil(threads);
    let bounds = Bounds { lower: [0.0, 0.0], upper: [100.0, 50.0] };
    let begin = Instant::now();
    thread::scope(|scope| {
        for (samples, found) in samples.chunks(share).zip(found.chunks_mut(share)) {
            scope.spawn(move || {
                let problems = 0..samples.len();
                let mut decays = Decays { samples, found };
                fit(Level::detect(), &mut decays, problems, &bounds, &Options::single())
            });
        }
    });
    let seconds = begin.elapsed().as_secs_f64();

    let within = (found.iter().enumerate())
        .filter(|&(problem, &[_, b, deviation])| (b - truth(problem)[1]).abs() < deviation)
        .count();
    println!("{PROBLEMS} decays on {threads} threads in {:.1} ms", 1e3 * seconds);
    println!("{:.2} million fits per second", 1e-6 * PROBLEMS as f64 / seconds);
    println!(
        "{:.1} % of the rates within one deviation (normal noise: 68.3 %)",
        100.0 * within as f64 / PROBLEMS as f64
    );
}

/// Numbers of mean 0 and variance 1, nearly normal: sums of twelve uniform ones.
fn noise() -> impl FnMut() -> f32 {
    let mut state = 1_u64;
    let mut uniform = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    };
    move || (0..12).map(|_| uniform()).sum::<f32>() - 6.0
}
