//! What the study of accuracy against time asks of the solver, as one JSON object a line: steps
//! and precision, bad pixels by strategy, and the share of the machine's limits.
//!
//! `benches/python/kernels.py` records it.

use std::hint::black_box;

use impasto::lm::{
    Batch, Bounds, Column, Normal, Occupancy, Options, Outcome, Rows, fit, fit_polished,
};
use impasto::math::{Element, Isa, Kernel, Level, Real, Scalar};

use crate::lafortune::{Photographs, Port, Scene, joint, sequential, start};
use crate::random::Random;
use crate::torrance_sparrow::{Lanes, OBSERVATIONS, Pixel, equations, pixels};
use crate::{near, options, port, timed};

/// Steps that a search may take.
const CAPS: [usize; 8] = [1, 2, 3, 5, 8, 13, 20, 40];

const ROUNDS: usize = 3;

/// Least seconds of some rounds.
fn least(mut work: impl FnMut()) -> f64 {
    (0..ROUNDS).map(|_| timed(&mut work)).fold(f64::INFINITY, f64::min)
}

pub(crate) fn study() {
    precision(20_000);
    strategies(2_000, 100);
    roofline(limits());
}

/// One lobe through 16 samples, in either precision.
struct Searches<'a> {
    pixels: &'a [Pixel],
    found: Vec<[f64; 2]>,
}

impl<S: Element> Batch<S, 2> for Searches<'_> {
    fn rows(&self) -> usize {
        2 * OBSERVATIONS
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, S>) -> [S; 2] {
        let pixel = &self.pixels[problem];
        column.fill(pixel.y.iter().chain(&pixel.phi_squared).map(|&value| S::from_f64(value)));
        pixel.start().map(S::from_f64)
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; 2]) -> Normal<R, 2> {
        equations(rows, at, at[0])
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<S, 2>) {
        self.found[problem] = outcome.parameters.map(Scalar::to_f64);
    }
}

fn bounds<S: Element>() -> Bounds<S, 2> {
    Bounds { lower: [S::zero(), S::from_f64(-0.8)], upper: [S::from_f64(1e9), S::from_f64(15.0)] }
}

/// Nothing but the cap ends a search.
fn capped(max_iterations: usize) -> Options {
    Options { max_iterations, cost: 0.0, step: 0.0, gradient: 0.0, ..near() }
}

/// What a cap on the steps leaves of the cost, in single precision, in double, and in single
/// polished in double by three steps; against double precision without a cap.
fn precision(count: usize) {
    let pixels = pixels(count);
    let level = Level::detect();
    let mut searches = Searches { pixels: &pixels, found: vec![[0.0; 2]; count] };
    fit::<f64, 2>(level, &mut searches, 0..count, &bounds(), &capped(200));
    let best = searches.found.clone();
    for cap in CAPS {
        let report = |name: &str, seconds: f64, found: &[[f64; 2]]| {
            let mut excess = Vec::new();
            let mut off = Vec::new();
            for ((pixel, best), found) in pixels.iter().zip(&best).zip(found) {
                excess.push((pixel.cost(*found) / pixel.cost(*best) - 1.0).max(0.0));
                off.push((found[1] - best[1]).abs() / spread(pixel, *best));
            }
            excess.sort_by(f64::total_cmp);
            off.sort_by(f64::total_cmp);
            let at = |values: &[f64], share: f64| values[((count - 1) as f64 * share) as usize];
            println!(
                "{{\"kind\": \"steps\", \"precision\": \"{name}\", \"steps\": {cap}, \"ns\": {:.1}, \
                 \"excess_median\": {:.3e}, \"excess_p99\": {:.3e}, \"bounds_p99\": {:.3e}}}",
                1e9 * seconds / count as f64,
                at(&excess, 0.5),
                at(&excess, 0.99),
                at(&off, 0.99)
            );
        };
        let single = least(|| {
            fit::<f32, 2>(level, &mut searches, 0..count, &bounds(), &capped(cap));
        });
        report("f32", single, &searches.found);
        let double = least(|| {
            fit::<f64, 2>(level, &mut searches, 0..count, &bounds(), &capped(cap));
        });
        report("f64", double, &searches.found);
        let both = (&capped(cap), &capped(3));
        let polished = least(|| {
            fit_polished(level, &mut searches, 0..count, &bounds(), both, |_| true);
        });
        report("f32, polished", polished, &searches.found);
    }
}

/// The Cramer-Rao bound of `ln k`, for a noise that the residuals at the optimum tell.
fn spread(pixel: &Pixel, [beta, log_k]: [f64; 2]) -> f64 {
    let k = log_k.exp();
    let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
    for p in pixel.phi_squared {
        let lobe = (-k * p).exp();
        let slope = k * p * beta * lobe;
        a += lobe * lobe;
        b += lobe * slope;
        c += slope * slope;
    }
    let variance = pixel.cost([beta, log_k]) / (OBSERVATIONS - 2) as f64;
    (variance * a / (a * c - b * b).max(f64::MIN_POSITIVE)).sqrt()
}

/// Time and bad pixels of ways to find three lobes.
fn strategies(count: usize, observations: usize) {
    let scene = Scene::new(count, observations, 3, 1000);
    let photographs = Photographs::of(&scene);
    let best = joint::<f64, 10>(&scene, &scene.truth, &Options::default()).0;
    let report = |name: &str, seconds: f64, costs: &[f64]| {
        let bad = costs.iter().zip(&best).filter(|(cost, best)| **cost > 1.01 * **best).count();
        println!(
            "{{\"kind\": \"strategy\", \"strategy\": \"{name}\", \"us\": {:.2}, \"bad\": {:.3}}}",
            1e6 * seconds / costs.len() as f64,
            100.0 * bad as f64 / costs.len() as f64
        );
    };
    let mut costs = Vec::new();
    for starts in [1, 2, 4, 8] {
        let seconds = least(|| costs = several(&scene, starts));
        report(&format!("all at once, starts: {starts}"), seconds, &costs);
    }
    let seconds = least(|| costs = joint::<f64, 10>(&scene, &vec![start(); count], &options()).0);
    report("all at once, f64", seconds, &costs);
    for (name, select) in [("one at a time", false), ("one at a time, BIC", true)] {
        let seconds = least(|| {
            let (found, _) = sequential(&photographs, select, &options());
            costs = found.iter().map(|found| found.cost).collect();
        });
        report(name, seconds, &costs);
    }
    let some = count / 10;
    let seconds = least(|| {
        costs = (0..some)
            .map(|pixel| {
                let problem = Port::<10>::new(&scene, pixel, start());
                2.0 * port().minimize(problem).1.objective_function
            })
            .collect();
    });
    report("MINPACK, all at once", seconds, &costs);
}

/// The best of fits of three lobes at once, from exponents that differ.
fn several(scene: &Scene, starts: usize) -> Vec<f64> {
    let mut random = Random(5);
    let mut best = vec![f64::INFINITY; scene.normals.len()];
    for turn in 0..starts {
        let mut at: [f64; 10] = start();
        for lobe in 0..3 {
            let spread = if turn == 0 { 0.0 } else { 1.0 };
            at[3 + 3 * lobe] += spread * random.between(-1.0, 1.0);
        }
        let found = joint::<f32, 10>(scene, &vec![at; best.len()], &options()).0;
        for (best, found) in best.iter_mut().zip(found) {
            *best = best.min(found);
        }
    }
    best
}

/// What one thread can do at most.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    /// Floating-point operations a second, fused multiply-adds of single precision counted twice.
    flops: f64,
    /// Bytes read a second, from far more than the caches hold.
    bytes: f64,
}

/// Registers that no product-sum has to wait for.
const CHAINS: usize = 12;

struct Multiply(u32);

impl Kernel for Multiply {
    type Output = f64;
    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let (factor, summand) = (I::F32::of(black_box(0.999_9)), I::F32::of(black_box(1e-4)));
        let mut chains = [I::F32::of(black_box(1.0)); CHAINS];
        for _ in 0..self.0 {
            for chain in &mut chains {
                *chain = chain.mul_add(factor, summand);
            }
        }
        black_box(chains);
        2.0 * CHAINS as f64 * I::F32::WIDTH as f64 * f64::from(self.0)
    }
}

struct Read<'a>(&'a [f32]);

impl Kernel for Read<'_> {
    type Output = ();
    #[inline(always)]
    fn run<I: Isa>(self) {
        let mut sums = [I::F32::of(0.0); CHAINS];
        for values in self.0.chunks_exact(CHAINS * I::F32::WIDTH) {
            for (sum, values) in sums.iter_mut().zip(values.chunks_exact(I::F32::WIDTH)) {
                *sum = *sum + I::F32::load(values);
            }
        }
        black_box(sums);
    }
}

pub(crate) fn limits() -> Limits {
    let level = Level::detect();
    let mut made = 0.0;
    let seconds = least(|| made = level.run(Multiply(20_000_000)));
    let flops = made / seconds;
    let far = vec![1.0_f32; 1 << 26];
    let bytes = size_of_val(far.as_slice()) as f64 / least(|| level.run(Read(&far)));
    println!("{{\"kind\": \"limit\", \"what\": \"GFLOP/s\", \"value\": {:.2}}}", 1e-9 * flops);
    println!("{{\"kind\": \"limit\", \"what\": \"GB/s\", \"value\": {:.2}}}", 1e-9 * bytes);
    Limits { flops, bytes }
}

/// Operations per observation and pass, counted in the models and their normal equations: a
/// product-sum is two, an exponential 22, a logarithm 28.
const OPERATIONS: [(usize, f64); 3] = [(0, 38.0), (1, 105.0), (3, 330.0)];

/// How much of the machine's limits the fits use: operations of the passes that lanes needed over
/// time, and bytes of samples read once and results written.
fn roofline(limits: Limits) {
    let operations = |lobes: usize| OPERATIONS.iter().find(|o| o.0 == lobes).map_or(0.0, |o| o.1);
    let report = |name: String, each: f64, bytes: f64, seconds: f64, passes: f64| {
        let made = each * passes;
        println!(
            "{{\"kind\": \"kernel\", \"kernel\": \"{name}\", \"fits_per_s\": {:.0}, \
             \"passes\": {passes:.1}, \"flops_per_byte\": {:.2}, \"gflops\": {:.2}, \
             \"share\": {:.1}}}",
            1.0 / seconds,
            made / bytes,
            1e-9 * made / seconds,
            100.0 * (made / seconds) / limits.flops.min(limits.bytes * made / bytes)
        );
    };
    let count = 100_000;
    let data = pixels(count);
    let mut lanes = Lanes::<true>::new(&data);
    let mut busy = Occupancy::default();
    let seconds = least(|| busy = fit(Level::detect(), &mut lanes, 0..count, &bounds(), &near()));
    let values = OBSERVATIONS as f64;
    report(
        format!("Torrance-Sparrow, {OBSERVATIONS}"),
        values * operations(0),
        4.0 * (2.0 * values + 2.0),
        seconds / count as f64,
        busy.useful as f64 / count as f64,
    );
    lobes::<4>(10_000, 100, &report, operations(1));
    lobes::<4>(3_000, 690, &report, operations(1));
    lobes::<10>(2_000, 100, &report, operations(3));
    lobes::<10>(500, 690, &report, operations(3));
}

fn lobes<const N: usize>(
    count: usize,
    observations: usize,
    report: &impl Fn(String, f64, f64, f64, f64),
    operations: f64,
) {
    let lobes = (N - 1) / 3;
    let scene = Scene::new(count, observations, lobes, 0);
    let mut busy = Occupancy::default();
    let starts = vec![start::<N>(); count];
    let seconds = least(|| busy = joint::<f32, N>(&scene, &starts, &options()).1);
    let values = observations as f64;
    report(
        format!("Lafortune {lobes}, {observations}"),
        values * operations,
        4.0 * (values + 3.0 + N as f64),
        seconds / count as f64,
        busy.useful as f64 / count as f64,
    );
}
