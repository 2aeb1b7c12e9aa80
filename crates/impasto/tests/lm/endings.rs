//! A search that has found nothing must not say that it has converged.

use impasto::lm::{
    Batch, Bounds, Column, Normal, Options, Outcome, Problem, Reason, Rows, fit, minimise,
};
use impasto::math::elementary::exp;
use impasto::math::{Level, Real, Scalar};

const TIMES: [f64; 4] = [0.0, 1.0, 2.0, 3.0];

/// `a exp(-b t)` through points of `5 exp(-0.7 t)`, as in the module's documentation, times a
/// scale, and factors that spoil the derivatives.
struct Decay<S> {
    scale: S,
    spoilt: [S; 2],
    /// What no decay explains.
    noise: [f64; 4],
}

impl<S: Scalar> Problem<S, 2> for Decay<S> {
    fn normal(&self, [a, b]: [S; 2]) -> Normal<S, 2> {
        let mut normal = Normal::zero();
        for (t, noise) in TIMES.into_iter().zip(self.noise) {
            let decay = exp(-b * S::from_f64(t));
            let truth = S::from_f64(5.0 * (-0.7 * t).exp() + noise) * self.scale;
            let slopes = [decay, -(S::from_f64(t) * a * decay)];
            let slopes = [slopes[0] * self.spoilt[0], slopes[1] * self.spoilt[1]];
            normal.add(slopes, truth - a * decay);
        }
        normal
    }
}

fn options<S: Scalar>() -> Options {
    if S::EPSILON.to_f64() > 1e-10 { Options::single() } else { Options::default() }
}

fn decay<S: Scalar>(scale: f64, spoilt: [f64; 2], noise: f64) -> Outcome<S, 2> {
    let problem = Decay {
        scale: S::from_f64(scale),
        spoilt: spoilt.map(S::from_f64),
        noise: [noise, -noise, -noise, noise],
    };
    let start = [S::from_f64(scale), S::from_f64(0.1)];
    minimise(&problem, start, &Bounds::none(), &options::<S>())
}

#[test]
fn derivatives_of_the_wrong_sign_stall() {
    fn stalls<S: Scalar>() {
        // Of both parameters: it never moves. Of one: it moves along the other, then no more.
        for spoilt in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]] {
            let outcome = decay::<S>(1.0, spoilt, 0.1);
            assert_eq!(outcome.reason, Reason::Stalled, "{spoilt:?} {outcome:?}");
            assert!(!outcome.reason.converged());
        }
        // Too long or too short slopes lead downhill all the same.
        for spoilt in [[1.0, 0.5], [1.0, 3.0]] {
            let outcome = decay::<S>(1.0, spoilt, 0.1);
            assert!(outcome.reason.converged(), "{spoilt:?} {outcome:?}");
        }
    }
    stalls::<f64>();
    stalls::<f32>();
}

/// `|x - 1| + 1` as one residual: slopes promise on either side of the kink.
struct Kink;

impl Problem<f64, 1> for Kink {
    fn normal(&self, [x]: [f64; 1]) -> Normal<f64, 1> {
        let mut normal = Normal::zero();
        normal.add([-(x - 1.0).signum()], (x - 1.0).abs() + 1.0);
        normal
    }
}

#[test]
fn a_kink_that_slopes_led_to_is_an_end() {
    let bounds = Bounds { lower: [1.0], upper: [5.0] };
    for bounds in [Bounds::none(), bounds] {
        let outcome = minimise(&Kink, [3.0], &bounds, &Options::default());
        assert!(outcome.reason.converged(), "{outcome:?}");
        assert!((outcome.parameters[0] - 1.0).abs() < 1e-6);
    }
}

#[test]
fn an_exact_start_converges_at_every_damping() {
    for damping in [0.0, 1e-2, 1e3, 1e10, f64::INFINITY] {
        let options = Options { damping, ..Options::single() };
        for scale in [1.0_f32, 1e-6, 1e6] {
            let problem = Decay { scale, spoilt: [1.0; 2], noise: [0.0; 4] };
            let outcome = minimise(&problem, [5.0 * scale, 0.7], &Bounds::none(), &options);
            assert!(outcome.reason.converged(), "{damping} {scale} {outcome:?}");
        }
    }
}

#[test]
fn damping_beyond_its_limit_is_no_end() {
    let best = decay::<f64>(1.0, [1.0; 2], 0.1).parameters[1];
    for damping in [1e10, f64::INFINITY, f64::NAN, -1.0] {
        let options = Options { damping, ..Options::default() };
        let noise = [0.1, -0.1, -0.1, 0.1];
        let problem = Decay { scale: 1.0, spoilt: [1.0; 2], noise };
        let outcome = minimise(&problem, [1.0, 0.1], &Bounds::none(), &options);
        let there = (outcome.parameters[1] / best - 1.0).abs() < 1e-6;
        assert!(there || !outcome.reason.converged(), "{damping} {outcome:?}");
    }
}

#[test]
fn a_step_that_noise_hides_is_left_out() {
    const SHARE: f64 = 0.05;
    let noise = [0.1, -0.1, -0.1, 0.1];
    let problem = Decay { scale: 1.0, spoilt: [1.0; 2], noise };
    for start in [[1.0, 0.1], [5.0, 0.7], [20.0, 2.0]] {
        // Strong damping makes the first steps short for another reason.
        for damping in [1e-2, 1e6] {
            let options = Options { damping, ..Options::default() };
            let run = |options: &Options| minimise(&problem, start, &Bounds::none(), options);
            let (all, some) = (run(&options), run(&Options { offset: SHARE, ..options }));
            assert!(some.reason.converged(), "{start:?} {some:?}");
            assert!(some.iterations < all.iterations, "{start:?} {some:?} {all:?}");
            // So near, costs are quadratic up to a tenth of what lies between them.
            let left = some.normal.cost / all.normal.cost - 1.0;
            assert!(left <= 1.1 * SHARE * SHARE, "{start:?} {left:e}");
        }
    }
}

/// A line whose two columns are nearly parallel: damped steps promise little along their difference.
struct Parallel;

impl Problem<f64, 2> for Parallel {
    fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
        let mut normal = Normal::zero();
        for i in 0..8 {
            let (sign, noise) = ([1.0, -1.0][i % 2], [0.1, 0.1, -0.1, -0.1][i % 4]);
            let columns = [1.0, 1.0 + 0.05 * sign];
            let sample = 1.0 + 0.5 * sign + noise;
            normal.add(columns, sample - a * columns[0] - b * columns[1]);
        }
        normal
    }
}

#[test]
fn a_weak_direction_is_followed_to_where_noise_hides_it() {
    const SHARE: f64 = 0.05;
    // The noise is orthogonal to both columns: what is left of it is the least cost.
    let least = 8.0 * 0.1 * 0.1;
    for start in [[0.0, 0.0], [-4.0, 5.0], [-9.0, 9.9]] {
        let options = Options { offset: SHARE, ..Options::default() };
        let outcome = minimise(&Parallel, start, &Bounds::none(), &options);
        let left = outcome.normal.cost / least - 1.0;
        // The damping of the step that says what is left hides a hundredth of it.
        assert!(outcome.reason.converged() && left <= 1.02 * SHARE * SHARE, "{left:e} {outcome:?}");
    }
}

#[test]
fn what_has_converged_is_there_at_every_scale() {
    fn sweep<S: Scalar>(powers: impl Iterator<Item = i32>, digits: f64) -> [bool; 2] {
        let mut reported = [false; 2];
        for power in powers {
            for noise in [0.0, 0.1] {
                let plain = decay::<S>(1.0, [1.0; 2], noise).parameters[1].to_f64();
                let outcome = decay::<S>(2.0_f64.powi(power), [1.0; 2], noise);
                let lost = matches!(outcome.reason, Reason::Underflow | Reason::NotFinite);
                assert_eq!(outcome.reason.converged(), !lost, "{power} {outcome:?}");
                let off = (outcome.parameters[1].to_f64() / plain - 1.0).abs();
                assert!(lost || off < digits, "2^{power}, noise {noise}: {off:e} {outcome:?}");
                reported[0] |= outcome.reason == Reason::Underflow;
                reported[1] |= outcome.reason == Reason::NotFinite;
            }
        }
        reported
    }
    // Both ends of the numbers' range are met, and named.
    assert_eq!(sweep::<f64>((-1022..=1020).step_by(7), 1e-6), [true; 2]);
    assert_eq!(sweep::<f32>(-126..=124, 1e-3), [true; 2]);
}

#[test]
fn a_start_that_is_not_a_number_says_so_whether_the_model_reads_it_or_not() {
    /// A constant; nothing depends on the second parameter.
    struct Constant;
    impl Problem<f64, 2> for Constant {
        fn normal(&self, [a, _]: [f64; 2]) -> Normal<f64, 2> {
            let mut normal = Normal::zero();
            normal.add([1.0, 0.0], 2.0 - a);
            normal
        }
    }
    let within = Bounds { lower: [0.0; 2], upper: [9.0; 2] };
    for bounds in [Bounds::none(), within] {
        for start in [[f64::NAN, 1.0], [1.0, f64::NAN]] {
            let outcome = minimise(&Constant, start, &bounds, &Options::default());
            assert_eq!((outcome.reason, outcome.iterations), (Reason::NotFinite, 0));
            assert_eq!(outcome.parameters.map(f64::to_bits), start.map(f64::to_bits));
        }
    }
    // An infinite one is moved to the bound, as is any that lies outside.
    let outcome = minimise(&Constant, [1.0, f64::INFINITY], &within, &Options::default());
    assert!(outcome.reason.converged() && outcome.parameters[1] == 9.0, "{outcome:?}");
}

#[test]
fn crossed_bounds_are_named_and_the_start_is_given_back() {
    let problem = Decay { scale: 1.0, spoilt: [1.0; 2], noise: [0.0; 4] };
    let crossed = [
        Bounds { lower: [2.0, 0.0], upper: [1.0, 9.0] },
        Bounds { lower: [0.0, f64::NAN], upper: [9.0, 9.0] },
        Bounds { lower: [0.0, 0.0], upper: [f64::NAN, 9.0] },
    ];
    for bounds in crossed {
        let outcome = minimise(&problem, [1.0, 0.1], &bounds, &Options::default());
        assert_eq!(outcome.reason, Reason::CrossedBounds, "{bounds:?}");
        assert!(!outcome.reason.converged() && outcome.normal.cost.is_nan());
        assert_eq!(outcome.parameters, [1.0, 0.1]);
        assert_eq!(outcome.deficient(), [true; 2]);
    }
    // Equal bounds hold a parameter; infinite ones are none.
    let held = Bounds { lower: [f64::NEG_INFINITY, 0.5], upper: [f64::INFINITY, 0.5] };
    let outcome = minimise(&problem, [1.0, 0.1], &held, &Options::default());
    assert!(outcome.reason.converged() && outcome.parameters[1] == 0.5, "{outcome:?}");
    // The best strength of a decay whose rate is given.
    let [above, below] = TIMES.into_iter().fold([0.0; 2], |[above, below], t| {
        let decay = (-0.5 * t).exp();
        [above + decay * 5.0 * (-0.7 * t).exp(), below + decay * decay]
    });
    assert!((outcome.parameters[0] / (above / below) - 1.0).abs() < 1e-9);
}

#[test]
fn nothing_to_search_for_ends_at_once() {
    struct Nothing;
    impl Problem<f64, 0> for Nothing {
        fn normal(&self, []: [f64; 0]) -> Normal<f64, 0> {
            let mut normal = Normal::zero();
            normal.add([], 3.0);
            normal
        }
    }
    let outcome = minimise(&Nothing, [], &Bounds::none(), &Options::default());
    assert!(outcome.reason.converged() && outcome.normal.cost == 9.0, "{outcome:?}");
    assert!(outcome.covariance(1.0).is_empty());
}

/// The same decays in lanes, each with its own scale and spoilt derivatives.
struct Decays(Vec<Option<Outcome<f32, 2>>>);

/// One of every ending among what converges: scale, factor of the derivatives, start's rate.
fn case(problem: usize) -> (f32, f32, f32) {
    match problem % 7 {
        2 => (1.0, -1.0, 0.1),
        3 => (1e-25, 1.0, 0.1),
        5 => (1.0, 1.0, f32::NAN),
        6 => (1e25, 1.0, 0.1),
        _ => (1.0 + problem as f32, 1.0, 0.1),
    }
}

impl Batch<f32, 2> for Decays {
    fn rows(&self) -> usize {
        2 + TIMES.len()
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 2] {
        let (scale, spoilt, rate) = case(problem);
        let samples = TIMES.map(|t| (5.0 * (-0.7 * t).exp()) as f32 * scale);
        column.fill([scale, spoilt].into_iter().chain(samples));
        [scale, rate]
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, [a, b]: [R; 2]) -> Normal<R, 2> {
        let mut normal = Normal::zero();
        for (i, t) in TIMES.into_iter().enumerate() {
            let (decay, spoilt) = (exp(-b * R::of(t)), rows.get(1));
            normal.add(
                [decay * spoilt, -(R::of(t) * a * decay) * spoilt],
                rows.get(2 + i) - a * decay,
            );
        }
        normal
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 2>) {
        self.0[problem] = Some(*outcome);
    }
}

#[test]
fn every_ending_stays_in_its_lane() {
    let run = |level, problems: &[usize], bounds: Bounds<f32, 2>| {
        let mut decays = Decays(vec![None; 70]);
        fit(level, &mut decays, problems.iter().copied(), &bounds, &Options::single());
        decays.0
    };
    let all: Vec<usize> = (0..70).collect();
    let good: Vec<usize> = (0..70).filter(|n| matches!(n % 7, 0 | 1 | 4)).collect();
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        let found = run(level, &all, Bounds::none());
        for (n, outcome) in found.iter().enumerate() {
            let reason = outcome.expect("every problem is stored").reason;
            let expected = match n % 7 {
                2 => reason == Reason::Stalled,
                3 => reason == Reason::Underflow,
                5 | 6 => reason == Reason::NotFinite,
                _ => reason.converged(),
            };
            assert!(expected, "{n}: {reason:?} on {}", level.name());
        }
        let alone = run(level, &good, Bounds::none());
        for &n in &good {
            let bits = |found: &[Option<Outcome<f32, 2>>]| {
                found[n].expect("stored").parameters.map(f32::to_bits)
            };
            assert_eq!(bits(&found), bits(&alone), "{n} on {}", level.name());
        }
        // Bounds are the call's: no problem is left without an outcome.
        let crossed = Bounds { lower: [1.0, 1.0], upper: [0.0, 1.0] };
        let reasons = run(level, &all, crossed).into_iter().map(|o| o.expect("stored").reason);
        assert!(reasons.into_iter().all(|reason| reason == Reason::CrossedBounds));
    }
}
