//! Hard cases that belong to the search; their numbers are those of `docs/numerics.md`.

use impasto::lm::{
    Batch, Bounds, Column, Normal, Options, Outcome, Problem, Reason, Rows, fit, minimise,
};
use impasto::math::{Level, Real};

use super::batch::{bits, same};

/// `a exp(-k x)` at some places.
struct Lobe<'a>(&'a [(f64, f64)]);

impl Problem<f64, 2> for Lobe<'_> {
    fn normal(&self, [a, log_k]: [f64; 2]) -> Normal<f64, 2> {
        let mut normal = Normal::zero();
        for &(x, y) in self.0 {
            let lobe = (-log_k.exp() * x).exp();
            normal.add([lobe, -log_k.exp() * x * a * lobe], y - a * lobe);
        }
        normal
    }
}

const BOUNDS: Bounds<f64, 2> = Bounds { lower: [0.0, -1.0], upper: [1e9, 15.0] };

fn lobe(samples: &[(f64, f64)]) -> Outcome<f64, 2> {
    let outcome = minimise(&Lobe(samples), [1.0, 2.0], &BOUNDS, &Options::default());
    assert!(outcome.normal.cost.is_finite());
    for i in 0..2 {
        assert!((BOUNDS.lower[i]..=BOUNDS.upper[i]).contains(&outcome.parameters[i]));
    }
    outcome
}

#[test]
fn hard_case_1_black() {
    let outcome = lobe(&[(0.0, 0.0), (0.1, 0.0), (0.4, 0.0)]);
    assert!(outcome.reason.converged());
    // Without strength nothing depends on the shape.
    assert!(outcome.parameters[0] < 1e-6);
    assert!(lobe(&[(0.0, 0.0); 3]).deficient()[1]);
}

#[test]
fn hard_case_4_no_sample_of_the_lobe() {
    // At x = 1e4 any lobe within the bounds has vanished: nothing depends on either parameter.
    let outcome = lobe(&[(1e4, 0.01), (2e4, -0.01), (3e4, 0.02)]);
    assert_eq!(outcome.deficient(), [true, true]);
}

#[test]
fn hard_cases_5_and_30_fewer_samples_than_parameters() {
    let outcome = lobe(&[(0.1, 0.8)]);
    // One sample fixes a curve of strength and width; the second parameter is named.
    assert_eq!(outcome.deficient(), [false, true]);
    assert!(outcome.normal.cost < 1e-12);
    assert_eq!(lobe(&[]).deficient(), [true, true]);
}

#[test]
fn hard_case_6_a_mirror_ends_at_its_bound() {
    let outcome = lobe(&[(0.0, 1.0), (1e-3, 0.0), (2e-3, 0.0), (0.1, 0.0)]);
    assert!(outcome.reason.converged());
    assert!((outcome.parameters[0] - 1.0).abs() < 1e-3 && outcome.parameters[1] > 8.0);
}

/// Two decays that start, and stay, alike.
struct Twins<'a>(&'a [(f64, f64)]);

impl Problem<f64, 4> for Twins<'_> {
    fn normal(&self, [a, k, b, l]: [f64; 4]) -> Normal<f64, 4> {
        let mut normal = Normal::zero();
        for &(x, y) in self.0 {
            let (one, two) = ((-k * x).exp(), (-l * x).exp());
            normal.add([one, -x * a * one, two, -x * b * two], y - a * one - b * two);
        }
        normal
    }
}

#[test]
fn hard_case_14_equal_lobes_do_not_split_and_are_named() {
    let samples: Vec<_> =
        (0..10).map(|i| f64::from(i) * 0.3).map(|x| (x, 2.0 * (-0.8 * x).exp())).collect();
    let bounds = Bounds::none();
    let outcome = minimise(&Twins(&samples), [0.5, 0.3, 0.5, 0.3], &bounds, &Options::default());
    assert!(outcome.reason.converged() && outcome.normal.cost < 1e-12);
    // Between the two only the sum of strengths and one rate are known.
    assert!(outcome.deficient()[3]);
    let [a, k, b, l] = outcome.parameters;
    assert!((a + b - 2.0).abs() < 1e-4 && (a * k + b * l - 1.6).abs() < 1e-4);
}

/// `y = a + b z x + c x` where z is 0: nothing depends on b.
struct Frozen(f64);

impl Problem<f64, 3> for Frozen {
    fn normal(&self, [a, b, c]: [f64; 3]) -> Normal<f64, 3> {
        let mut normal = Normal::zero();
        for (x, y) in [(0.0, 1.0), (1.0, 3.1), (2.0, 4.9), (3.0, 7.0)] {
            normal.add([1.0, self.0 * x, x], y - a - b * self.0 * x - c * x);
        }
        normal
    }
}

#[test]
fn hard_case_17_a_column_of_zeros_is_named_and_stays_where_it_started() {
    let outcome = minimise(&Frozen(0.0), [0.0, 5.0, 0.0], &Bounds::none(), &Options::default());
    assert!(outcome.reason.converged());
    assert_eq!((outcome.deficient(), outcome.parameters[1]), ([false, true, false], 5.0));
    // The line through the points: slope sum (x - 1.5) y / 5, through (1.5, 4).
    let (slope, height) = (9.9 / 5.0, 4.0 - 1.5 * 9.9 / 5.0);
    assert!((outcome.parameters[2] - slope).abs() < 1e-9);
    assert!((outcome.parameters[0] - height).abs() < 1e-9);
    // Variances of a straight line over 0 .. 3: 1 / 5 for the slope, 1/4 + 1.5^2 / 5 for a.
    let covariance = outcome.covariance(1.0);
    assert!((covariance[2][2] - 0.2).abs() < 1e-9 && (covariance[0][0] - 0.7).abs() < 1e-9);
    assert!(covariance[1].iter().chain(covariance.iter().map(|row| &row[1])).all(|v| v.is_nan()));
}

#[test]
fn hard_case_18_parameters_that_trade_off_are_named() {
    // Now b z and c multiply the same x.
    let outcome = minimise(&Frozen(0.5), [0.0, 0.0, 0.0], &Bounds::none(), &Options::default());
    assert!(outcome.reason.converged());
    assert_eq!(outcome.deficient(), [false, false, true]);
    assert!((0.5 * outcome.parameters[1] + outcome.parameters[2] - 9.9 / 5.0).abs() < 1e-9);
    // Their variances are large and finite.
    let covariance = outcome.covariance(1.0);
    assert!(covariance[2][2] > 1e9 && covariance.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn hard_case_27_constant_samples_end_at_once() {
    // The flattest lobe within the bounds, exp(-0.37 x), is not constant: strength alone is left.
    let outcome = lobe(&[(0.0, 0.5), (0.0, 0.5), (0.0, 0.5)]);
    assert!(outcome.reason.converged() && outcome.iterations < 20);
    assert!((outcome.parameters[0] - 0.5).abs() < 1e-9);
}

/// Parabolas about 3, among which one has a gradient of the wrong sign: no step of it ever helps.
struct Parabolas {
    liar: usize,
    found: Vec<Option<Outcome<f32, 1>>>,
}

impl Batch<f32, 1> for Parabolas {
    fn rows(&self) -> usize {
        1
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 1] {
        // So steep that no damping makes the foretold fall small.
        column.set(0, if problem == self.liar { -1e4 } else { 1.0 });
        [0.1 * problem as f32]
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, [x]: [R; 1]) -> Normal<R, 1> {
        let away = R::of(3.0) - x;
        Normal {
            cost: away.mul_add(away, R::one()),
            descent: [away * rows.get(0)],
            matrix: [[R::one()]],
        }
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 1>) {
        self.found[problem] = Some(*outcome);
    }
}

#[test]
fn hard_case_32_many_rejected_steps() {
    let run = |level: Level, problems: &[usize]| {
        let mut parabolas = Parabolas { liar: 7, found: vec![None; 21] };
        let problems = problems.iter().copied();
        fit(level, &mut parabolas, problems, &Bounds::none(), &Options::single());
        parabolas.found
    };
    let all: Vec<usize> = (0..21).collect();
    let others: Vec<usize> = (0..21).filter(|&problem| problem != 7).collect();
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        let mut found = run(level, &all);
        let outcome = found[7].take().expect("every problem is stored");
        // Damping is bounded, the equations are those of the start, and it says so.
        assert_eq!(outcome.reason, Reason::Stalled, "{outcome:?}");
        assert!(!outcome.reason.converged());
        assert_eq!((outcome.parameters, outcome.normal.matrix), ([0.7], [[1.0]]));
        assert!((1..30).contains(&outcome.iterations));
        same(&bits(&found), &bits(&run(level, &others)), level.name());
        let ends = found.iter().flatten().map(|outcome| outcome.parameters[0]);
        assert!(ends.into_iter().all(|x| (x - 3.0).abs() < 1e-3));
    }
}

/// Steps into a region without values.
struct Cliff;

impl Problem<f64, 1> for Cliff {
    fn normal(&self, [x]: [f64; 1]) -> Normal<f64, 1> {
        let mut normal = Normal::zero();
        // The root of what is left of the cliff, whose best place is its edge.
        normal.add([-0.5 / (1.0 - x).sqrt()], -(1.0 - x).sqrt());
        normal
    }
}

#[test]
fn hard_case_26_a_step_without_a_finite_cost_is_not_taken() {
    let outcome = minimise(&Cliff, [0.5], &Bounds::none(), &Options::default());
    assert!(outcome.parameters[0] <= 1.0 && outcome.normal.cost.is_finite());
    assert!(outcome.normal.cost < 1e-3);
}
