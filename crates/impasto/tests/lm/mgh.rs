//! Unconstrained least-squares problems of More, Garbow and Hillstrom [@more1981testing], from their
//! standard starts and from ten and a hundred times those.
//!
//! The reference is MINPACK, run on the same formulas in the same test (crate
//! `levenberg-marquardt`): whatever it solves, the search must solve. Solved: the cost is within
//! 1e-4 of the published minimum, or below 1e-16 of the start's
//! (of 1e8 at most) where that is zero. As a second opinion the cautious options are tried.

use impasto::lm::{Bounds, Normal, Options, Outcome, Problem, Reason, minimise};
use impasto::math::{Real, Scalar};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use peer_nalgebra::{Dyn, OMatrix, OVector, Owned, SVector, U1};

use super::dual::Dual;

/// A vector of residuals as formulas.
trait Residuals<const N: usize>: Copy {
    const NAME: &'static str;
    const COUNT: usize;
    const START: [f64; N];
    /// Published minima of the sum of squares, the global one first.
    const MINIMA: &'static [f64];
    fn at<R: Real>(x: [Dual<R, N>; N], i: usize) -> Dual<R, N>;
}

fn c<R: Real, const N: usize>(value: f64) -> Dual<R, N> {
    Dual::of(value)
}

macro_rules! problem {
    ($name:ident, $n:literal, $count:expr, $start:expr, $minima:expr, |$x:ident, $i:ident| $body:expr) => {
        #[derive(Clone, Copy)]
        struct $name;
        impl Residuals<$n> for $name {
            const NAME: &'static str = stringify!($name);
            const COUNT: usize = $count;
            const START: [f64; $n] = $start;
            const MINIMA: &'static [f64] = &$minima;
            fn at<R: Real>($x: [Dual<R, $n>; $n], $i: usize) -> Dual<R, $n> {
                $body
            }
        }
    };
}

problem!(Rosenbrock, 2, 2, [-1.2, 1.0], [0.0], |x, i| match i {
    0 => c(10.0) * (x[1] - x[0].square()),
    _ => c(1.0) - x[0],
});
problem!(FreudensteinRoth, 2, 2, [0.5, -2.0], [0.0, 48.984_253_679_24], |x, i| match i {
    0 => c(-13.0) + x[0] + ((c(5.0) - x[1]) * x[1] - c(2.0)) * x[1],
    _ => c(-29.0) + x[0] + ((x[1] + c(1.0)) * x[1] - c(14.0)) * x[1],
});
problem!(PowellBadlyScaled, 2, 2, [0.0, 1.0], [0.0], |x, i| match i {
    0 => c(1e4) * x[0] * x[1] - c(1.0),
    _ => (-x[0]).exp() + (-x[1]).exp() - c(1.0001),
});
problem!(BrownBadlyScaled, 2, 3, [1.0, 1.0], [0.0], |x, i| match i {
    0 => x[0] - c(1e6),
    1 => x[1] - c(2e-6),
    _ => x[0] * x[1] - c(2.0),
});
problem!(Beale, 2, 3, [1.0, 1.0], [0.0], |x, i| {
    let power = [x[1], x[1].square(), x[1] * x[1].square()][i];
    c([1.5, 2.25, 2.625][i]) - x[0] * (c(1.0) - power)
});
problem!(JennrichSampson, 2, 10, [0.3, 0.4], [124.362_182_355_6], |x, i| {
    let k = i as f64 + 1.0;
    c(2.0 + 2.0 * k) - ((c(k) * x[0]).exp() + (c(k) * x[1]).exp())
});
problem!(HelicalValley, 3, 3, [-1.0, 0.0, 0.0], [0.0], |x, i| match i {
    0 => {
        let turn = (x[1] / x[0]).atan() / c(core::f64::consts::TAU);
        // Half a turn more left of the axis, in the lanes that stand there.
        let left = R::keep(x[0].value.lt(R::zero()), R::of(0.5));
        let turn = Dual { value: turn.value + left, ..turn };
        c(10.0) * (x[2] - c(10.0) * turn)
    }
    1 => c(10.0) * ((x[0].square() + x[1].square()).sqrt() - c(1.0)),
    _ => x[2],
});
problem!(Bard, 3, 15, [1.0, 1.0, 1.0], [8.214_877_306_578e-3, 17.428_693_333_33], |x, i| {
    let y =
        [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39];
    let u = i as f64 + 1.0;
    let v = 16.0 - u;
    c(y[i]) - (x[0] + c(u) / (c(v) * x[1] + c(u.min(v)) * x[2]))
});
problem!(Gaussian, 3, 15, [0.4, 1.0, 0.0], [1.127_932_769_618e-8], |x, i| {
    let y = [0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989];
    let t = (7.0 - i as f64) / 2.0;
    x[0] * (-x[1] * (c(t) - x[2]).square() / c(2.0)).exp() - c(y[i.min(14 - i)])
});
problem!(Meyer, 3, 16, [0.02, 4000.0, 250.0], [87.945_855_170_64], |x, i| {
    let y = [
        34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0, 8261.0, 7030.0,
        6005.0, 5147.0, 4427.0, 3820.0, 3307.0, 2872.0,
    ];
    x[0] * (x[1] / (c(50.0 + 5.0 * i as f64) + x[2])).exp() - c(y[i])
});
problem!(Box3, 3, 10, [0.0, 10.0, 20.0], [0.0, 0.075_588_738_0], |x, i| {
    let t = 0.1 * (i as f64 + 1.0);
    (c(-t) * x[0]).exp() - (c(-t) * x[1]).exp() - x[2] * c((-t).exp() - (-10.0 * t).exp())
});
problem!(PowellSingular, 4, 4, [3.0, -1.0, 0.0, 1.0], [0.0], |x, i| match i {
    0 => x[0] + c(10.0) * x[1],
    1 => c(5.0_f64.sqrt()) * (x[2] - x[3]),
    2 => (x[1] - c(2.0) * x[2]).square(),
    _ => c(10.0_f64.sqrt()) * (x[0] - x[3]).square(),
});
problem!(Wood, 4, 6, [-3.0, -1.0, -3.0, -1.0], [0.0], |x, i| match i {
    0 => c(10.0) * (x[1] - x[0].square()),
    1 => c(1.0) - x[0],
    2 => c(90.0_f64.sqrt()) * (x[3] - x[2].square()),
    3 => c(1.0) - x[2],
    4 => c(10.0_f64.sqrt()) * (x[1] + x[3] - c(2.0)),
    _ => (x[1] - x[3]) / c(10.0_f64.sqrt()),
});
problem!(
    KowalikOsborne,
    4,
    11,
    [0.25, 0.39, 0.415, 0.39],
    [3.075_056_038_492e-4, 1.027_34e-3, 1.793_5e-3],
    |x, i| {
        let y = [
            0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246,
        ];
        let u = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625][i];
        c(y[i]) - x[0] * (c(u * u) + c(u) * x[1]) / (c(u * u) + c(u) * x[2] + x[3])
    }
);
problem!(BrownDennis, 4, 20, [25.0, 5.0, -5.0, -1.0], [85_822.201_626_36], |x, i| {
    let t = (i as f64 + 1.0) / 5.0;
    (x[0] + c(t) * x[1] - c(t.exp())).square() + (x[2] + c(t.sin()) * x[3] - c(t.cos())).square()
});
problem!(Osborne1, 5, 33, [0.5, 1.5, -1.0, 0.01, 0.02], [5.464_894_697_483e-5], |x, i| {
    let y = [
        0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685,
        0.658, 0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448,
        0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406,
    ];
    let t = 10.0 * i as f64;
    c(y[i]) - (x[0] + x[1] * (c(-t) * x[3]).exp() + x[2] * (c(-t) * x[4]).exp())
});
problem!(BiggsExp6, 6, 13, [1.0, 2.0, 1.0, 1.0, 1.0, 1.0], [0.0, 5.655_65e-3], |x, i| {
    let t = 0.1 * (i as f64 + 1.0);
    let y = (-t).exp() - 5.0 * (-10.0 * t).exp() + 3.0 * (-4.0 * t).exp();
    x[2] * (c(-t) * x[0]).exp() - x[3] * (c(-t) * x[1]).exp() + x[5] * (c(-t) * x[4]).exp() - c(y)
});
// One column is twice the other; in the second a column is zero as well (hard cases 5 and 14).
problem!(LinearRank1, 3, 10, [1.0, 1.0, 1.0], [1.0 * 90.0 / 42.0], |x, i| {
    c(i as f64 + 1.0) * (x[0] + c(2.0) * x[1] + c(3.0) * x[2]) - c(1.0)
});
problem!(LinearRank1ZeroColumn, 3, 10, [1.0, 1.0, 1.0], [124.0 / 34.0], |x, i| match i {
    0 | 9 => c(-1.0),
    _ => c(i as f64) * c(2.0) * x[1] - c(1.0),
});

#[derive(Clone, Copy)]
struct Ours<P>(P);

impl<P: Residuals<N>, S: Scalar, const N: usize> Problem<S, N> for Ours<P> {
    fn normal(&self, at: [S; N]) -> Normal<S, N> {
        let x = Dual::parameters(at);
        let mut normal = Normal::zero();
        for i in 0..P::COUNT {
            let residual = P::at(x, i);
            // Residuals here are f - y: downhill is the other way.
            normal.add(residual.slope.map(|s| -s), residual.value);
        }
        normal
    }
}

struct Theirs<P, const N: usize>(P, [f64; N]);

impl<P: Residuals<N>, const N: usize> Theirs<P, N> {
    fn all(&self) -> Vec<Dual<f64, N>> {
        let x = Dual::parameters(self.1);
        (0..P::COUNT).map(|i| P::at(x, i)).collect()
    }
}

impl<P: Residuals<N>, const N: usize> LeastSquaresProblem<f64, Dyn, peer_nalgebra::Const<N>>
    for Theirs<P, N>
{
    type ParameterStorage = Owned<f64, peer_nalgebra::Const<N>>;
    type ResidualStorage = Owned<f64, Dyn, U1>;
    type JacobianStorage = Owned<f64, Dyn, peer_nalgebra::Const<N>>;

    fn set_params(&mut self, x: &SVector<f64, N>) {
        self.1 = (*x).into();
    }
    fn params(&self) -> SVector<f64, N> {
        self.1.into()
    }
    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        Some(OVector::<f64, Dyn>::from_iterator(P::COUNT, self.all().iter().map(|d| d.value)))
    }
    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, peer_nalgebra::Const<N>>> {
        let rows = self.all();
        Some(OMatrix::from_fn_generic(Dyn(P::COUNT), peer_nalgebra::Const, |i, j| rows[i].slope[j]))
    }
}

/// Whether a cost is a published minimum; `start` is the cost where the search began.
fn solved<P: Residuals<N>, const N: usize>(cost: f64, start: f64) -> bool {
    P::MINIMA.iter().any(|&minimum| {
        if minimum == 0.0 {
            cost <= 1e-16 * start.min(1e8)
        } else {
            (cost / minimum - 1.0).abs() <= 1e-4
        }
    })
}

/// Checks the problem's three starts; returns how many either solves (MINPACK, here).
fn race<P: Residuals<N>, const N: usize>(problem: P) -> [usize; 2] {
    let mut count = [0; 2];
    for scale in [1.0, 10.0, 100.0] {
        let start = P::START.map(|v| v * scale);
        let report = LevenbergMarquardt::new().minimize(Theirs(problem, start)).1;
        let first = Problem::<f64, N>::normal(&Ours(problem), start).cost;
        let theirs = solved::<P, N>(2.0 * report.objective_function, first);
        // Meyer's valley from a hundred times its start takes 5000 steps.
        let options = [Options::default(), Options::cautious()]
            .map(|options| Options { max_iterations: 10_000, ..options });
        let costs: [f64; 2] = options
            .map(|options| minimise(&Ours(problem), start, &Bounds::none(), &options).normal.cost);
        let ours = costs.iter().any(|&cost| solved::<P, N>(cost, first));
        assert!(ours || !theirs, "{} x{scale}: {costs:?}", P::NAME);
        count[0] += usize::from(theirs);
        count[1] += usize::from(ours);
    }
    count
}

/// What single precision makes of the three starts: digits (7 at most), and the search's word.
///
/// Digits are those of the residuals' norm, in double precision where single precision ended,
/// against the nearest published minimum's; where that is 0, relative to the start's.
fn single<P: Residuals<N>, const N: usize>(problem: P) -> (&'static str, [(f64, Reason); 3]) {
    let options = Options { max_iterations: 1000, ..Options::single() };
    let found = [1.0, 10.0, 100.0].map(|scale| {
        let start = P::START.map(|v| (v * scale) as f32);
        let outcome: Outcome<f32, N> = minimise(&Ours(problem), start, &Bounds::none(), &options);
        // No start makes it return nonsense.
        assert!(outcome.parameters.iter().all(|p| p.is_finite()), "{} x{scale}", P::NAME);
        if outcome.reason == Reason::NotFinite {
            // At such a start the sum of squares is beyond all numbers: that must be true.
            let cost: Normal<f32, N> = Ours(problem).normal(start);
            let sum: f32 = cost.matrix.iter().flatten().chain(&cost.descent).sum();
            assert!(!(cost.cost + sum).is_finite(), "{} x{scale}", P::NAME);
            return (0.0, outcome.reason);
        }
        assert!(outcome.normal.cost.is_finite(), "{} x{scale}", P::NAME);
        let place = outcome.parameters.map(f64::from);
        let cost = |at: [f64; N]| Problem::<f64, N>::normal(&Ours(problem), at).cost.sqrt();
        let (ends, begins) = (cost(place), cost(start.map(f64::from)));
        let error = P::MINIMA
            .iter()
            .map(|minimum| {
                let unit = if *minimum > 0.0 { minimum.sqrt() } else { begins };
                (ends - minimum.sqrt()).abs() / unit
            })
            .fold(f64::INFINITY, f64::min);
        (-error.clamp(1e-7, 1.0).log10(), outcome.reason)
    });
    (P::NAME, found)
}

/// Digits from the three starts, and how the search says it ended: `+` converged, `-` out of
/// patience or (Osborne1, from afar) stalled, `x` beyond all numbers at the start. Without digits it
/// has ended in another valley, or where single precision sees no further fall: Brown and Dennis'
/// squares of squares, Meyer's valley.
const SINGLE: [(&str, [f64; 3], &str); 19] = [
    ("Rosenbrock", [5.9, 7.0, 7.0], "+++"),
    ("FreudensteinRoth", [7.0, 7.0, 7.0], "+++"),
    ("PowellBadlyScaled", [7.0, 4.7, 4.0], "+++"),
    ("BrownBadlyScaled", [7.0, 5.1, 5.5], "+++"),
    ("Beale", [6.2, 7.0, 7.0], "+++"),
    ("JennrichSampson", [7.0, 0.0, 0.0], "++x"),
    ("HelicalValley", [7.0, 7.0, 7.0], "+++"),
    ("Bard", [7.0, 7.0, 7.0], "+++"),
    ("Gaussian", [5.9, 5.5, 0.0], "+++"),
    ("Meyer", [3.9, 3.4, 0.0], "+++"),
    ("Box3", [7.0, 7.0, 7.0], "+++"),
    ("PowellSingular", [7.0, 7.0, 7.0], "---"),
    ("Wood", [7.0, 7.0, 7.0], "+++"),
    ("KowalikOsborne", [7.0, 7.0, 6.9], "+++"),
    ("BrownDennis", [0.0, 3.6, 0.0], "-+-"),
    ("Osborne1", [7.0, 0.7, 0.0], "++-"),
    ("BiggsExp6", [6.6, 7.0, 0.8], "+++"),
    ("LinearRank1", [7.0, 5.4, 3.4], "+++"),
    ("LinearRank1ZeroColumn", [7.0, 7.0, 7.0], "+++"),
];

#[test]
fn single_precision_keeps_the_digits_that_are_recorded() {
    let all = [
        single(Rosenbrock),
        single(FreudensteinRoth),
        single(PowellBadlyScaled),
        single(BrownBadlyScaled),
        single(Beale),
        single(JennrichSampson),
        single(HelicalValley),
        single(Bard),
        single(Gaussian),
        single(Meyer),
        single(Box3),
        single(PowellSingular),
        single(Wood),
        single(KowalikOsborne),
        single(BrownDennis),
        single(Osborne1),
        single(BiggsExp6),
        single(LinearRank1),
        single(LinearRank1ZeroColumn),
    ];
    for ((name, found), (recorded_name, digits, endings)) in all.into_iter().zip(SINGLE) {
        assert_eq!(name, recorded_name);
        for ((found, reason), recorded) in found.into_iter().zip(digits) {
            // Other roundings on the way may cost half a digit, no more.
            assert!(found >= recorded - 0.5, "{name}: {found:.2} ({reason:?}), not {recorded}");
        }
        let ending = |(_, reason): (f64, Reason)| match reason {
            Reason::NotFinite => 'x',
            reason if reason.converged() => '+',
            _ => '-',
        };
        assert_eq!(found.map(ending).iter().collect::<String>(), endings, "{name}");
    }
}

#[test]
fn what_minpack_solves_is_solved() {
    let counts = [
        race(Rosenbrock),
        race(FreudensteinRoth),
        race(PowellBadlyScaled),
        race(BrownBadlyScaled),
        race(Beale),
        race(JennrichSampson),
        race(HelicalValley),
        race(Bard),
        race(Gaussian),
        race(Meyer),
        race(Box3),
        race(PowellSingular),
        race(Wood),
        race(KowalikOsborne),
        race(BrownDennis),
        race(Osborne1),
        race(BiggsExp6),
        race(LinearRank1),
        race(LinearRank1ZeroColumn),
    ];
    let total = |i: usize| counts.iter().map(|count| count[i]).sum::<usize>();
    // Of 57 starts MINPACK solves 48; the four that nobody solves lead to other minima or to
    // numbers beyond double precision.
    assert!(total(1) >= total(0).max(53), "{counts:?}");
}
