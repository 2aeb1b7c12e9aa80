//! Lanes are closed computations: no width, order, neighbour or batch size changes a bit.

use impasto::lm::{
    Batch, Bounds, Column, Columns, Normal, Options, Outcome, Problem, ROWS, Reason, Rows, fit,
    fit_polished, minimise,
};
use impasto::math::elementary::exp;
use impasto::math::{Element, Level, Real, Scalar};
use proptest::prelude::*;

const SAMPLES: usize = 24;

/// `a exp(-b t) + c exp(-d t)`: easy to start, slow to end where the rates are alike.
fn pass<R: Real>(y: impl Fn(usize) -> R, at: [R; 4], blocked: bool) -> Normal<R, 4> {
    let mut normal = Normal::zero();
    let mut slopes = [[R::zero(); 4]; ROWS];
    let mut residuals = [R::zero(); ROWS];
    for i in 0..SAMPLES {
        let t = R::of(0.2 * i as f64);
        let (fast, slow) = (exp(-(at[1] * t)), exp(-(at[3] * t)));
        let slope = [fast, -(t * at[0] * fast), slow, -(t * at[2] * slow)];
        let residual = y(i) - at[0].mul_add(fast, at[2] * slow);
        if blocked {
            (slopes[i % ROWS], residuals[i % ROWS]) = (slope, residual);
            if i % ROWS == ROWS - 1 {
                normal.add_rows(&slopes, &residuals);
            }
        } else {
            normal.add(slope, residual);
        }
    }
    normal
}

const BOUNDS: ([f64; 4], [f64; 4]) = ([0.0, 0.01, 0.0, 0.01], [1e6, 20.0, 1e6, 20.0]);

fn bounds<S: Scalar>() -> Bounds<S, 4> {
    Bounds { lower: BOUNDS.0.map(S::from_f64), upper: BOUNDS.1.map(S::from_f64) }
}

/// Decays in either precision.
struct Decays<'a> {
    samples: &'a [[f64; SAMPLES]],
    single: Vec<Option<Outcome<f32, 4>>>,
    double: Vec<Option<Outcome<f64, 4>>>,
    blocked: bool,
    /// Whether samples are loaded row by row.
    by_rows: bool,
    /// How many samples a problem says that it has.
    count: fn(usize) -> usize,
}

impl<'a> Decays<'a> {
    fn new(samples: &'a [[f64; SAMPLES]]) -> Self {
        let count = samples.len();
        let (single, double) = (vec![None; count], vec![None; count]);
        Self { samples, single, double, blocked: false, by_rows: false, count: |_| 1 }
    }
}

fn start<S: Scalar>(samples: &[f64; SAMPLES]) -> [S; 4] {
    [0.6 * samples[0], 3.0, 0.3 * samples[0], 0.3].map(S::from_f64)
}

macro_rules! decays {
    ($scalar:ty, $out:ident) => {
        impl Batch<$scalar, 4> for Decays<'_> {
            fn rows(&self) -> usize {
                SAMPLES
            }
            fn samples(&self, problem: usize) -> usize {
                (self.count)(problem)
            }
            fn load(&mut self, problem: usize, column: &mut Column<'_, $scalar>) -> [$scalar; 4] {
                if !self.by_rows {
                    column.fill(self.samples[problem].map(<$scalar>::from_f64));
                }
                start(&self.samples[problem])
            }
            fn load_rows(&mut self, columns: &mut Columns<'_, $scalar>) {
                if self.by_rows {
                    let samples = self.samples;
                    let number = |row: &usize, problem: usize| samples[problem][*row] as $scalar;
                    columns.fill_from(0, 0..SAMPLES, number);
                }
            }
            #[inline(always)]
            fn normal<R: Real<Scalar = $scalar>>(
                &self,
                rows: Rows<'_, R>,
                at: [R; 4],
            ) -> Normal<R, 4> {
                pass(|i| rows.get(i), at, self.blocked)
            }
            fn store(&mut self, problem: usize, outcome: &Outcome<$scalar, 4>) {
                self.$out[problem] = Some(*outcome);
            }
        }
    };
}
decays!(f32, single);
decays!(f64, double);

/// The same on plain numbers.
struct Decay<'a>(&'a [f64; SAMPLES]);

impl<S: Scalar> Problem<S, 4> for Decay<'_> {
    fn normal(&self, at: [S; 4]) -> Normal<S, 4> {
        pass(|i| S::from_f64(self.0[i]), at, false)
    }
}

/// Noisy decays, a few of them hopeless.
fn samples(count: usize) -> Vec<[f64; SAMPLES]> {
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..count)
        .map(|n| {
            let truth = [1.0 + random(), 1.0 + 4.0 * random(), random(), 0.1 + random()];
            let mut y = [0.0; SAMPLES];
            for (i, y) in y.iter_mut().enumerate() {
                let t = 0.2 * i as f64;
                *y = truth[0] * exp(-truth[1] * t) + truth[2] * exp(-truth[3] * t);
                *y += 0.01 * (random() - 0.5);
                match n % 41 {
                    7 => *y = 0.0,
                    13 if i == 5 => *y = f64::NAN,
                    19 if i == 3 => *y = f64::INFINITY,
                    23 => *y = -1.0,
                    _ => {}
                }
            }
            y
        })
        .collect()
}

pub(crate) type Bits = Vec<(Vec<u64>, Reason, usize)>;

pub(crate) fn bits<S: Scalar, const N: usize>(outcomes: &[Option<Outcome<S, N>>]) -> Bits {
    let of = |outcome: &Outcome<S, N>| {
        let normal = &outcome.normal;
        let numbers = outcome.parameters.iter().chain([&normal.cost]).chain(&normal.descent);
        let numbers = numbers.chain(normal.matrix.iter().flatten());
        numbers.map(|v| v.to_f64().to_bits()).collect()
    };
    outcomes.iter().flatten().map(|o| (of(o), o.reason, o.iterations)).collect()
}

/// Compares without printing thousands of numbers.
pub(crate) fn same(found: &Bits, expected: &Bits, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (n, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert_eq!(found, expected, "{what}, problem {n}");
    }
}

fn run<S: Element>(level: Level, samples: &[[f64; SAMPLES]], order: &[usize]) -> Bits
where
    for<'a> Decays<'a>: Batch<S, 4> + Outcomes<S>,
{
    let mut decays = Decays::new(samples);
    fit(level, &mut decays, order.iter().copied(), &bounds::<S>(), &Options::single());
    bits(decays.outcomes())
}

trait Outcomes<S> {
    fn outcomes(&self) -> &[Option<Outcome<S, 4>>];
}
impl Outcomes<f32> for Decays<'_> {
    fn outcomes(&self) -> &[Option<Outcome<f32, 4>>] {
        &self.single
    }
}
impl Outcomes<f64> for Decays<'_> {
    fn outcomes(&self) -> &[Option<Outcome<f64, 4>>] {
        &self.double
    }
}

fn every_level<S: Element>()
where
    for<'a> Decays<'a>: Batch<S, 4> + Outcomes<S>,
{
    let samples = samples(203);
    let forward: Vec<usize> = (0..samples.len()).collect();
    let shuffled: Vec<usize> = (0..samples.len()).map(|i| i * 89 % samples.len()).collect();
    let alone: Vec<_> = samples
        .iter()
        .map(|y| Some(minimise(&Decay(y), start(y), &bounds::<S>(), &Options::single())))
        .collect();
    let expected = bits(&alone);
    assert_eq!(expected.len(), samples.len());
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        same(&run::<S>(level, &samples, &forward), &expected, level.name());
        same(&run::<S>(level, &samples, &shuffled), &expected, "shuffled");
        for size in [1, 3, 16, 17, 64] {
            let tiles = samples.chunks(size);
            let tiled: Bits = tiles.flat_map(|t| run::<S>(level, t, &forward[..t.len()])).collect();
            same(&tiled, &expected, "tiles");
        }
    }
}

#[test]
fn single_precision_is_the_same_at_every_level_order_and_tile_and_alone() {
    every_level::<f32>();
}

#[test]
fn double_precision_is_the_same_at_every_level_order_and_tile_and_alone() {
    every_level::<f64>();
}

#[test]
fn every_processor_finds_the_bits_that_are_recorded() {
    // Made by the library's own exponential: no platform's own enters.
    let samples = samples(203);
    let order: Vec<usize> = (0..203).collect();
    let single = run::<f32>(Level::detect(), &samples, &order);
    let double = run::<f64>(Level::detect(), &samples, &order);
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for (numbers, reason, steps) in single.iter().chain(&double) {
        // Fowler, Noll and Vo's hash; what a lane without an outcome holds, NaN, has any bits.
        let known = numbers.iter().filter(|&&bits| !f64::from_bits(bits).is_nan());
        for &word in known.chain(&[*reason as u64, *steps as u64]) {
            hash = (hash ^ word).wrapping_mul(0x0100_0000_01b3);
        }
    }
    assert_eq!(hash, 0x0279_6ce4_508d_4ccf, "{hash:#x}");
}

#[test]
fn hard_case_26_what_is_not_finite_is_named_and_stays_in_its_lane() {
    let samples = samples(203);
    let mut decays = Decays::new(&samples);
    fit(Level::detect(), &mut decays, 0..203, &bounds::<f32>(), &Options::single());
    for (n, outcome) in decays.single.iter().enumerate() {
        let outcome = outcome.expect("every problem is stored");
        assert_eq!(outcome.reason == Reason::NotFinite, matches!(n % 41, 13 | 19), "{n}");
        assert!(outcome.parameters.iter().all(|p| p.is_finite()), "{n}");
    }
}

#[test]
fn rows_added_together_have_the_bits_of_rows_added_one_by_one() {
    let samples = samples(50);
    let order: Vec<usize> = (0..50).collect();
    let mut decays = Decays::new(&samples);
    decays.blocked = true;
    fit(Level::detect(), &mut decays, 0..50, &bounds::<f32>(), &Options::single());
    assert_eq!(bits(&decays.single), run::<f32>(Level::detect(), &samples, &order));
}

#[test]
fn samples_loaded_row_by_row_are_those_of_their_problems() {
    let samples = samples(203);
    let order: Vec<usize> = (0..203).map(|i| i * 89 % 203).collect();
    let (single, options) = (bounds::<f32>(), Options::single());
    let double = Options::default();
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        let [by_column, by_rows] = [false, true].map(|by_rows| {
            let mut decays = Decays { by_rows, ..Decays::new(&samples) };
            fit(level, &mut decays, order.iter().copied(), &single, &options);
            let alone = bits(&decays.single);
            // Those that are polished have other numbers than the problems.
            let doubtful = |outcome: &Outcome<f32, 4>| !outcome.reason.converged();
            let both = (&options, &double);
            fit_polished(level, &mut decays, order.iter().copied(), &bounds(), both, doubtful);
            (alone, bits(&decays.single), bits(&decays.double))
        });
        same(&by_rows.0, &by_column.0, level.name());
        same(&by_rows.1, &by_column.1, "single");
        same(&by_rows.2, &by_column.2, "polished");
        assert!(!by_rows.2.is_empty());
    }
}

#[test]
fn every_lane_ends_at_the_offset_of_its_own_samples() {
    const OFFSET: f64 = 0.25;
    let samples = samples(100);
    let mut decays = Decays::new(&samples);
    // Squares of powers of two: their roots, and what is divided by them, are exact.
    decays.count = |n| [1, 16, 4096][n % 3];
    let options = Options { offset: OFFSET, ..Options::single() };
    fit(Level::detect(), &mut decays, 0..100, &bounds::<f32>(), &options);
    let alone: Vec<_> = (0..100)
        .map(|n| {
            let offset = OFFSET / ((decays.count)(n) as f64).sqrt();
            let options = Options { offset, ..options };
            let problem = Decay(&samples[n]);
            Some(minimise(&problem, start::<f32>(&samples[n]), &bounds(), &options))
        })
        .collect();
    assert_eq!(bits(&decays.single), bits(&alone));
    // They differ in where they end.
    let mut uncounted = Decays::new(&samples);
    fit(Level::detect(), &mut uncounted, 0..100, &bounds::<f32>(), &options);
    assert_ne!(bits(&decays.single), bits(&uncounted.single));
}

#[test]
fn lanes_are_busy() {
    // 125 for each of the 32 lanes that two groups of the widest registers have.
    let samples = samples(4000);
    let mut decays = Decays::new(&samples);
    let occupancy =
        fit(Level::detect(), &mut decays, 0..4000, &bounds::<f32>(), &Options::single());
    // What is lost is the end, when fewer problems than lanes are left.
    assert!(occupancy.efficiency() > 0.95, "{occupancy:?}");
    let passes: usize = decays.single.iter().flatten().map(|o| o.iterations + 1).sum();
    // A search may end without a last pass (its next step is too short), but not take one more.
    assert!(occupancy.useful >= passes as u64 && occupancy.useful <= occupancy.lanes);
}

#[test]
fn what_single_precision_doubts_is_polished_in_double() {
    let samples = samples(100);
    let mut decays = Decays::new(&samples);
    let bounds = bounds::<f64>();
    let options = (&Options::single(), &Options::default());
    let doubtful = |outcome: &Outcome<f32, 4>| {
        outcome.deficient().contains(&true) || !outcome.reason.converged()
    };
    fit_polished(Level::detect(), &mut decays, 0..100, &bounds, options, doubtful);
    for (single, double) in decays.single.iter().zip(&decays.double) {
        let single = single.expect("every problem is stored");
        assert_eq!(double.is_some(), doubtful(&single));
        if let Some(double) = double.filter(|double| double.reason.converged()) {
            // The polish starts where single precision ended: it can only go down, up to the
            // rounding of a cost summed in single precision.
            assert!(double.normal.cost <= f64::from(single.normal.cost) * (1.0 + 1e-5));
        }
    }
    assert!(decays.double.iter().flatten().count() > 0);
}

/// Decays whose lanes invert their matrices.
struct Inverted<'a>(Decays<'a>);

impl Batch<f32, 4> for Inverted<'_> {
    const COVARIANCE: bool = true;

    fn rows(&self) -> usize {
        SAMPLES
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 4] {
        self.0.load(problem, column)
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; 4]) -> Normal<R, 4> {
        self.0.normal(rows, at)
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 4>) {
        self.0.store(problem, outcome);
    }
}

#[test]
fn covariances_have_the_same_bits_in_lanes_and_alone() {
    let samples = samples(203);
    let alone = {
        let mut decays = Decays::new(&samples);
        fit(Level::Baseline, &mut decays, 0..203, &bounds::<f32>(), &Options::single());
        decays.single
    };
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        let mut inverted = Inverted(Decays::new(&samples));
        fit(level, &mut inverted, 0..203, &bounds::<f32>(), &Options::single());
        for (n, (one, other)) in inverted.0.single.iter().zip(&alone).enumerate() {
            let [one, other] = [one, other].map(|o| o.expect("every problem is stored"));
            assert_eq!(one.deficient(), other.deficient(), "{n}");
            let bits =
                |outcome: &Outcome<f32, 4>| outcome.covariance(0.5).map(|r| r.map(f32::to_bits));
            let same =
                bits(&one).iter().flatten().zip(bits(&other).iter().flatten()).all(|(&a, &b)| {
                    a == b || f32::from_bits(a).is_nan() && f32::from_bits(b).is_nan()
                });
            assert!(same, "{n}");
        }
    }
}

/// One decay each; the amplitude follows the rate in every pass.
struct Projected<'a> {
    samples: &'a [[f64; SAMPLES]],
    project: bool,
    found: Vec<Option<Outcome<f64, 2>>>,
}

impl Batch<f64, 2> for Projected<'_> {
    fn rows(&self) -> usize {
        SAMPLES
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f64>) -> [f64; 2] {
        column.fill(self.samples[problem]);
        [self.samples[problem][0].max(0.1), 1.0]
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f64>>(&self, rows: Rows<'_, R>, at: [R; 2]) -> Normal<R, 2> {
        Self::pass(rows, at, at[0])
    }
    #[inline(always)]
    fn visit<R: Real<Scalar = f64>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; 2],
    ) -> ([R; 2], Normal<R, 2>) {
        if self.project {
            return Self::pass(rows, at, R::one()).project(at, R::zero());
        }
        (at, self.normal(rows, at))
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f64, 2>) {
        self.found[problem] = Some(*outcome);
    }
}

impl Projected<'_> {
    #[inline(always)]
    fn pass<R: Real<Scalar = f64>>(rows: Rows<'_, R>, at: [R; 2], scale: R) -> Normal<R, 2> {
        let mut normal = Normal::zero();
        for i in 0..SAMPLES {
            let t = R::of(0.2 * i as f64);
            let decay = exp(-(at[1] * t));
            normal.add([decay, -(t * scale * decay)], rows.get(i) - at[0] * decay);
        }
        normal
    }
}

#[test]
fn a_projected_amplitude_leads_to_the_same_minimum_in_fewer_passes() {
    let samples: Vec<_> =
        samples(203).into_iter().filter(|y| y.iter().all(|y| y.is_finite())).collect();
    let run = |project: bool| {
        let mut batch = Projected { samples: &samples, project, found: vec![None; samples.len()] };
        let bounds = Bounds { lower: [0.0, 0.01], upper: [f64::MAX, 20.0] };
        fit(Level::detect(), &mut batch, 0..samples.len(), &bounds, &Options::default());
        batch.found.into_iter().map(|o| o.expect("every problem is stored")).collect::<Vec<_>>()
    };
    let (one, other) = (run(true), run(false));
    let passes = |found: &[Outcome<f64, 2>]| found.iter().map(|o| o.iterations).sum::<usize>();
    assert!(passes(&one) < passes(&other), "{} {}", passes(&one), passes(&other));
    for (n, (one, other)) in one.iter().zip(&other).enumerate() {
        // Cost to 1e-12 by the options; places to its root.
        assert!(one.normal.cost <= other.normal.cost * (1.0 + 1e-9) + 1e-20, "{n}");
        if one.parameters[0] > 0.0 && other.parameters[0] > 0.0 {
            for i in 0..2 {
                let (one, other) = (one.parameters[i], other.parameters[i]);
                assert!((one / other - 1.0).abs() < 1e-5, "{n}: {one} {other}");
            }
            // The equations that it ends with are those of the whole model.
            let [a, b] = one.parameters;
            let mut whole = Normal::<f64, 2>::zero();
            for (i, y) in samples[n].iter().enumerate() {
                let t = 0.2 * i as f64;
                let decay = (-b * t).exp();
                whole.add([decay, -t * a * decay], y - a * decay);
            }
            for (one, whole) in
                one.normal.matrix.iter().flatten().zip(whole.matrix.iter().flatten())
            {
                assert!((one - whole).abs() <= 1e-9 * whole.abs(), "{n}: {one} {whole}");
            }
        }
    }
}

#[test]
fn an_empty_batch_is_no_trouble() {
    let mut decays = Decays::new(&[]);
    let occupancy = fit(Level::detect(), &mut decays, [], &bounds::<f32>(), &Options::single());
    assert_eq!(occupancy.lanes, 0);
    assert_eq!(occupancy.efficiency(), 1.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// A power of two in the samples changes amplitudes by it and nothing else.
    #[test]
    fn hard_case_28_a_power_of_two_changes_no_bit_of_a_shape(seed in 0_usize..150, power in -30_i32..30) {
        let plain = samples(150)[seed];
        prop_assume!(plain.iter().all(|y| y.is_finite()));
        let factor = 2.0_f64.powi(power);
        let scaled = plain.map(|y| y * factor);
        let fit = |y: &[f64; SAMPLES]| {
            minimise::<f32, 4>(&Decay(y), start(y), &Bounds {
                upper: [f32::MAX, 20.0, f32::MAX, 20.0], ..bounds()
            }, &Options::single())
        };
        let (one, other) = (fit(&plain), fit(&scaled));
        prop_assert_eq!((one.reason, one.iterations), (other.reason, other.iterations));
        prop_assert_eq!(one.parameters[0] * factor as f32, other.parameters[0]);
        prop_assert_eq!(one.parameters[1].to_bits(), other.parameters[1].to_bits());
        prop_assert_eq!(one.parameters[3].to_bits(), other.parameters[3].to_bits());
    }

    /// Whatever the samples are, what comes out is finite and within bounds.
    #[test]
    fn nothing_but_finite_parameters_within_bounds(
        values in proptest::array::uniform24(proptest::num::f64::ANY)
    ) {
        let outcome = minimise::<f64, 4>(
            &Decay(&values), [1.0, 3.0, 0.5, 0.3], &bounds(), &Options::default(),
        );
        for (i, p) in outcome.parameters.iter().enumerate() {
            prop_assert!((BOUNDS.0[i]..=BOUNDS.1[i]).contains(p));
        }
        prop_assert!(outcome.reason == Reason::NotFinite || outcome.normal.cost.is_finite());
    }
}
