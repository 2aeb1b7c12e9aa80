//! An exponential decay through 16 points: ours against `levenberg-marquardt`, a port of MINPACK.
//!
//! Both see the same data, start and tolerance, and find the same parameters; a problem is made
//! anew for each fit, as each pixel's is.

use divan::{Bencher, black_box};
use impasto::lm::{Bounds, Normal, Options, Problem, minimise};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Matrix, Owned, SMatrix, SVector, U2, Vector2};

const POINTS: usize = 16;
const START: [f64; 2] = [1.0, 0.1];
const TOLERANCE: f64 = 1e-10;

/// `y = 5 exp(-0.7 t)` and an error that no parameter explains.
fn data() -> [(f64, f64); POINTS] {
    core::array::from_fn(|i| {
        let t = 0.25 * i as f64;
        (t, 5.0 * (-0.7 * t).exp() + 0.01 * (7.0 * t).sin())
    })
}

struct Ours([(f64, f64); POINTS]);

impl Problem<f64, 2> for Ours {
    fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
        let mut normal = Normal::zero();
        for (t, y) in self.0 {
            let decay = (-b * t).exp();
            normal.add([decay, -t * a * decay], y - a * decay);
        }
        normal
    }
}

struct Port {
    data: [(f64, f64); POINTS],
    place: Vector2<f64>,
}

type Residuals = nalgebra::Const<POINTS>;

impl LeastSquaresProblem<f64, Residuals, U2> for Port {
    type ResidualStorage = Owned<f64, Residuals>;
    type JacobianStorage = Owned<f64, Residuals, U2>;
    type ParameterStorage = Owned<f64, U2>;

    fn set_params(&mut self, place: &Vector2<f64>) {
        self.place = *place;
    }

    fn params(&self) -> Vector2<f64> {
        self.place
    }

    fn residuals(&self) -> Option<SVector<f64, POINTS>> {
        let [a, b] = [self.place.x, self.place.y];
        Some(SVector::from_fn(|i, _| a * (-b * self.data[i].0).exp() - self.data[i].1))
    }

    fn jacobian(&self) -> Option<Matrix<f64, Residuals, U2, Self::JacobianStorage>> {
        let [a, b] = [self.place.x, self.place.y];
        Some(SMatrix::from_fn(|i, j| {
            let t = self.data[i].0;
            let decay = (-b * t).exp();
            if j == 0 { decay } else { -t * a * decay }
        }))
    }
}

fn ours(data: [(f64, f64); POINTS]) -> [f64; 2] {
    let options = Options { cost: TOLERANCE, step: TOLERANCE, ..Options::default() };
    minimise(&Ours(data), START, &Bounds::none(), &options).parameters
}

fn port(data: [(f64, f64); POINTS]) -> [f64; 2] {
    let problem = Port { data, place: Vector2::from(START) };
    let solver = LevenbergMarquardt::new().with_ftol(TOLERANCE).with_xtol(TOLERANCE);
    solver.minimize(problem).0.place.into()
}

#[divan::bench]
fn impasto(bencher: Bencher<'_, '_>) {
    let (mine, theirs) = (ours(data()), port(data()));
    let agree = mine.iter().zip(theirs).all(|(a, b)| (a / b - 1.0).abs() < 1e-6);
    assert!(agree, "both find one minimum: {mine:?}, {theirs:?}");
    bencher.bench(|| ours(black_box(data())));
}

#[divan::bench]
fn minpack_port(bencher: Bencher<'_, '_>) {
    bencher.bench(|| port(black_box(data())));
}
