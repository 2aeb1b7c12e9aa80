//! Many fits, one thread: the lanes in single precision against MINPACK (crate
//! `levenberg-marquardt`) in double, on the same data from the same starts with the same tolerance.
//!
//! `cargo bench -p impasto-benches --bench fits` prints one line per problem, with `-- kernel` only
//! the rate of the first (`benches/python/fits.py` runs either), with `-- basins` the share of bad
//! pixels in other samples of three lobes, with `-- study` what `study.rs` says, with `-- limits` what one thread can do at most. Rounds of both sides alternate and the round with the
//! median ratio counts, in processor time where the system tells it. "Bad" is the share of pixels
//! whose cost is above 1.01 times that of a double-precision fit started from the truth: a better
//! minimum was there.

#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_methods,
    reason = "a benchmark reads clocks and prints what they say"
)]

mod lafortune;
mod random;
mod study;
mod torrance_sparrow;

use std::hint::black_box;
use std::sync::OnceLock;
use std::time::Instant;

use impasto::lm::{Bounds, Occupancy, Options, fit};
use impasto::math::Level;
use levenberg_marquardt::LevenbergMarquardt;
use nalgebra::Vector2;

const TOLERANCE: f64 = 1e-5;
const ROUNDS: usize = 5;

/// Starts are near enough for long first steps.
const DAMPING: f64 = 1e-2;

fn options() -> Options {
    Options {
        cost: TOLERANCE,
        step: TOLERANCE,
        gradient: TOLERANCE,
        damping: 1.0,
        max_iterations: 200,
        ..Options::default()
    }
}

fn near() -> Options {
    Options { damping: DAMPING, ..options() }
}

fn port() -> LevenbergMarquardt<f64> {
    LevenbergMarquardt::new().with_tol(TOLERANCE)
}

/// Seconds of a turn at least: what is quicker is done over and over.
const ENOUGH: f64 = 0.1;

/// Seconds that a side computes each time it is requested.
fn timed(side: &mut dyn FnMut()) -> f64 {
    let epoch = Instant::now();
    let start = clock(epoch);
    let mut times = 0.0;
    loop {
        side();
        times += 1.0;
        let spent = clock(epoch) - start;
        if spent >= ENOUGH {
            return spent / times;
        }
    }
}

/// Seconds that this thread has computed, where the system tells; else seconds since `epoch`.
fn clock(epoch: Instant) -> f64 {
    #[cfg(target_os = "linux")]
    {
        use rustix::time::{ClockId, clock_gettime};
        let _ = epoch;
        let spent = clock_gettime(ClockId::ThreadCPUTime);
        spent.tv_sec as f64 + 1e-9 * spent.tv_nsec as f64
    }
    #[cfg(not(target_os = "linux"))]
    epoch.elapsed().as_secs_f64()
}

/// The arguments `count SIDE PROBLEM`: which side runs, once, for `benches/python/instructions.py`.
static COUNTED: OnceLock<String> = OnceLock::new();

/// Fewer problems where instructions are counted: it is slow, and a few hundred say it all.
fn scaled(count: usize) -> usize {
    if COUNTED.get().is_some() { count / 50 } else { count }
}

/// Seconds of either side in the round whose ratio is the median; `fits` is how many each makes.
fn race(fits: [usize; 2], mut ours: impl FnMut(), mut theirs: impl FnMut()) -> [f64; 2] {
    if let Some(side) = COUNTED.get() {
        println!("{} {}", fits[0], fits[1]);
        match side.as_str() {
            "lanes" => ours(),
            "minpack" => theirs(),
            _ => {}
        }
        std::process::exit(0);
    }
    let mut rounds: Vec<_> = (0..ROUNDS).map(|_| [timed(&mut ours), timed(&mut theirs)]).collect();
    rounds.sort_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
    rounds[ROUNDS / 2]
}

fn report(name: &str, rates: [f64; 2], occupancy: Occupancy, count: usize, bad: [f64; 2]) {
    println!(
        "| {name} | {:.0} | {:.0} | {:.1} | {:.1} | {:.1} % | {:.1} % | {:.1} % |",
        rates[0],
        rates[1],
        rates[0] / rates[1],
        occupancy.useful as f64 / count as f64,
        100.0 * occupancy.efficiency(),
        100.0 * bad[0],
        100.0 * bad[1]
    );
}

fn torrance_sparrow<const PROJECTED: bool>(name: &str, count: usize) {
    use torrance_sparrow::{Lanes, Port, pixels};
    let count = scaled(count);
    let pixels = pixels(count);
    let some = &pixels[..count / 40];
    let bounds = Bounds { lower: [0.0, -0.8], upper: [1e9, 15.0] };
    let mut lanes = Lanes::<PROJECTED>::new(&pixels);
    let mut occupancy = Occupancy::default();
    let mut places = vec![Vector2::zeros(); some.len()];
    let minimise = |pixel, start| port().minimize(Port { pixel, place: Vector2::from(start) });
    let seconds = race(
        [count, some.len()],
        || {
            let all = 0..pixels.len();
            occupancy = fit(Level::detect(), black_box(&mut lanes), all, &bounds, &near());
        },
        || {
            for (pixel, place) in some.iter().zip(&mut places) {
                *place = minimise(black_box(pixel), pixel.start()).0.place;
            }
        },
    );
    let mut bad = [0.0; 2];
    for (i, pixel) in some.iter().enumerate() {
        let best = LevenbergMarquardt::new().with_tol(1e-12);
        let best = best.minimize(Port { pixel, place: places[i] }).1.objective_function;
        let [beta, log_k] = lanes.found[i].map(f64::from);
        for (bad, at) in bad.iter_mut().zip([Vector2::new(beta, log_k), places[i]]) {
            let cost = pixel.cost(at.into()) / 2.0;
            *bad += f64::from(u8::from(cost > 1.01 * best)) / some.len() as f64;
        }
    }
    let rates = [pixels.len() as f64 / seconds[0], some.len() as f64 / seconds[1]];
    report(name, rates, occupancy, pixels.len(), bad);
}

/// Fits per second of the bare lanes, at the median of some rounds.
fn kernel(count: usize) -> f64 {
    let pixels = torrance_sparrow::pixels(count);
    let bounds = Bounds { lower: [0.0, -0.8], upper: [1e9, 15.0] };
    let mut lanes = torrance_sparrow::Lanes::<true>::new(&pixels);
    let mut fits = || {
        fit(Level::detect(), black_box(&mut lanes), 0..count, &bounds, &near());
    };
    let mut seconds: Vec<_> = (0..ROUNDS).map(|_| timed(&mut fits)).collect();
    seconds.sort_by(f64::total_cmp);
    count as f64 / seconds[ROUNDS / 2]
}

fn lafortune<const N: usize>(count: usize, observations: usize) {
    use lafortune::{Costs, Photographs, Port, Scene, joint, sequential, start};
    let count = scaled(count);
    let lobes = (N - 1) / 3;
    let scene = Scene::new(count, observations, lobes, 0);
    let photographs = Photographs::of(&scene);
    let some = (count / if lobes == 1 { 10 } else { 20 }).max(20);
    let mut found = Costs::default();
    let mut costs = vec![0.0; some];
    let seconds = race(
        [count, some],
        || {
            found = if lobes == 1 {
                joint::<f32, N>(black_box(&scene), &vec![start(); count], &options())
            } else {
                let (found, occupancy) = sequential(black_box(&photographs), false, &options());
                (found.iter().map(|found| found.cost).collect(), occupancy)
            };
        },
        || {
            for (pixel, cost) in costs.iter_mut().enumerate() {
                let problem = Port::<N>::new(black_box(&scene), pixel, start());
                *cost = 2.0 * port().minimize(problem).1.objective_function;
            }
        },
    );
    let (found, occupancy) = found;
    let truth: Vec<[f64; N]> =
        scene.truth.iter().map(|all| core::array::from_fn(|i| all[i])).collect();
    let best = joint::<f64, N>(&scene, &truth, &Options::default()).0;
    let share = |costs: &[f64]| {
        let bad = costs.iter().zip(&best).filter(|&(cost, best)| *cost > 1.01 * best).count();
        bad as f64 / costs.len() as f64
    };
    let rates = [count as f64 / seconds[0], some as f64 / seconds[1]];
    let bad = [share(&found), share(&costs)];
    report(&format!("Lafortune {lobes}, {observations}"), rates, occupancy, count, bad);
}

/// How many lobes the criterion chooses where there is one, and where there are three.
fn selection(count: usize, observations: usize) {
    use lafortune::{Photographs, Scene, sequential};
    for lobes in [1, 3] {
        let photographs = Photographs::of(&Scene::new(count, observations, lobes, 0));
        let (found, _) = sequential(&photographs, true, &options());
        let share = |lobes: usize| {
            let chosen = found.iter().filter(|found| found.lobes == lobes).count();
            100.0 * chosen as f64 / count as f64
        };
        println!(
            "{lobes} true, {observations} observations: {:.1} % one lobe, {:.1} % two, {:.1} % three",
            share(1),
            share(2),
            share(3)
        );
    }
}

/// One problem after the other, or the one that is named.
fn problems(only: Option<&str>) {
    let requested = |name: &str| only.is_none_or(|only| only == name);
    if requested("torrance-sparrow") {
        torrance_sparrow::<true>("Torrance-Sparrow, 16", 200_000);
    }
    if requested("unprojected") {
        torrance_sparrow::<false>("the same, strength not projected", 200_000);
    }
    if requested("lafortune-1") {
        lafortune::<4>(10_000, 100);
    }
    if requested("lafortune-1-690") {
        lafortune::<4>(3_000, 690);
    }
    if requested("lafortune-3") {
        lafortune::<10>(4_000, 100);
    }
    if requested("lafortune-3-690") {
        lafortune::<10>(1_000, 690);
    }
}

/// The share of pixels in a bad basin where three lobes are true, in one sample after the other:
/// the search must not be tuned to the one that is raced.
fn basins(count: usize, observations: usize) {
    use lafortune::{Photographs, Scene, joint, sequential};
    for seed in 1..=8 {
        let scene = Scene::new(count, observations, 3, 1000 * seed);
        let (found, _) = sequential(&Photographs::of(&scene), false, &options());
        let best = joint::<f64, 10>(&scene, &scene.truth, &Options::default()).0;
        let bad = found.iter().zip(&best).filter(|(found, best)| found.cost > 1.01 * **best);
        let share = 100.0 * bad.count() as f64 / count as f64;
        println!("{observations} observations, sample {seed}: {share:.2} % of {count} bad");
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|first| first == "kernel") {
        println!("{:.0}", kernel(200_000));
        return;
    }
    if arguments.first().is_some_and(|first| first == "limits") {
        study::limits();
        return;
    }
    if arguments.first().is_some_and(|first| first == "study") {
        return study::study();
    }
    if arguments.first().is_some_and(|first| first == "basins") {
        basins(4_000, 100);
        basins(1_000, 690);
        return;
    }
    if let [first, side, problem, ..] = arguments.as_slice()
        && first == "count"
    {
        COUNTED.get_or_init(|| side.clone());
        return problems(Some(problem));
    }
    println!("one thread, {}, tolerance {TOLERANCE:e}", Level::detect().name());
    println!(
        "| problem | lanes, fits/s | MINPACK | ratio | passes | lanes busy | bad | bad, MINPACK |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    problems(None);
    println!("lobes chosen one at a time:");
    selection(1_000, 100);
    selection(300, 690);
}
