//! Torrance-Sparrow's lobe, `beta exp(-k phi^2)`, through 16 observations per pixel.
//!
//! Either side is handed the samples and `phi^2`, starts from the largest sample and gamma = 0.15,
//! and fits (beta, ln k).

use core::f64::consts::LN_2;

use impasto::lm::{Batch, Column, Normal, Outcome, Rows};
use impasto::math::elementary::{exp, exp_in_range};
use impasto::math::{Real, Scalar};
use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::{Const, OMatrix, Owned, SVector, U2, Vector2};

use crate::random::Random;

pub(crate) const OBSERVATIONS: usize = 16;

/// Pixels that are read together: a few lines of the cache from every plane.
const LINE: usize = 64;

/// One pixel: samples and squared angles.
#[derive(Clone)]
pub(crate) struct Pixel {
    pub(crate) y: [f64; OBSERVATIONS],
    pub(crate) phi_squared: [f64; OBSERVATIONS],
}

/// Lobes of beta 50 .. 200 and gamma 0.06 .. 0.36, angles to 0.57, noise of 1 % of beta.
pub(crate) fn pixels(count: usize) -> Vec<Pixel> {
    let mut random = Random(17);
    (0..count)
        .map(|_| {
            let beta = random.between(50.0, 200.0);
            let k = LN_2 / random.between(0.06, 0.36).powi(2);
            let phi_squared = core::array::from_fn(|_| random.between(0.0, 0.57).powi(2));
            let y = phi_squared.map(|p: f64| beta * ((-k * p).exp() + 0.01 * random.normal()));
            Pixel { y, phi_squared }
        })
        .collect()
}

impl Pixel {
    pub(crate) fn start(&self) -> [f64; 2] {
        let top = self.y.iter().fold(f64::MIN_POSITIVE, |a, &b| a.max(b));
        [top, (LN_2 / 0.15_f64.powi(2)).ln()]
    }

    pub(crate) fn cost(&self, [beta, log_k]: [f64; 2]) -> f64 {
        let k = log_k.exp();
        let residual = |(y, p): (&f64, &f64)| (beta * (-k * p).exp() - y).powi(2);
        self.y.iter().zip(&self.phi_squared).map(residual).sum()
    }
}

/// With `PROJECTED` the strength follows the width in every pass, else both are searched for.
pub(crate) struct Lanes<const PROJECTED: bool> {
    /// Samples, then angles, in single precision, observation by observation, as a stack lies.
    planes: Vec<f32>,
    /// A line of every plane, the brightest samples, and the pixel that they begin with.
    stage: ([[f32; LINE]; 2 * OBSERVATIONS], [f32; LINE], usize),
    pub(crate) found: Vec<[f32; 2]>,
}

impl<const PROJECTED: bool> Lanes<PROJECTED> {
    pub(crate) fn new(pixels: &[Pixel]) -> Self {
        let numbers = |of: fn(&Pixel) -> &[f64; OBSERVATIONS]| {
            (0..OBSERVATIONS).flat_map(move |i| pixels.iter().map(move |p| of(p)[i] as f32))
        };
        let planes = numbers(|p| &p.y).chain(numbers(|p| &p.phi_squared)).collect();
        let stage = ([[0.0; LINE]; 2 * OBSERVATIONS], [0.0; LINE], usize::MAX);
        Self { planes, stage, found: vec![[0.0; 2]; pixels.len()] }
    }
}

impl<const PROJECTED: bool> Batch<f32, 2> for Lanes<PROJECTED> {
    const INTERLEAVE: bool = true;

    fn rows(&self) -> usize {
        2 * OBSERVATIONS
    }
    #[inline]
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 2] {
        let (first, lane) = (problem / LINE * LINE, problem % LINE);
        let (lines, tops, staged) = &mut self.stage;
        if *staged != first {
            *staged = first;
            let planes = self.planes.chunks_exact(self.found.len());
            for (line, plane) in lines.iter_mut().zip(planes) {
                match plane[first..].first_chunk() {
                    Some(whole) => *line = *whole,
                    None => line[..plane.len() - first].copy_from_slice(&plane[first..]),
                }
            }
            *tops = lines[0];
            for line in &lines[1..OBSERVATIONS] {
                for (top, &y) in tops.iter_mut().zip(line) {
                    *top = if y > *top { y } else { *top };
                }
            }
        }
        column.fill(lines.iter().map(|line| line[lane]));
        let top = tops[lane].max(f32::MIN_POSITIVE);
        [top, (LN_2 / (0.15 * 0.15)).ln() as f32]
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; 2]) -> Normal<R, 2> {
        equations(rows, at, at[0])
    }
    #[inline(always)]
    fn visit<R: Real<Scalar = f32>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; 2],
    ) -> ([R; 2], Normal<R, 2>) {
        if PROJECTED {
            return equations(rows, at, R::one()).project(at, R::zero());
        }
        (at, self.normal(rows, at))
    }
    #[inline]
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 2>) {
        self.found[problem] = outcome.parameters;
    }
}

/// Slopes of a lobe of the given strength, and residuals of one of strength `beta`.
#[inline(always)]
pub(crate) fn equations<R: Real>(
    rows: Rows<'_, R>,
    [beta, log_k]: [R; 2],
    strength: R,
) -> Normal<R, 2> {
    let (k, floor) = (-exp(log_k), R::splat(R::Scalar::EXP_UNDERFLOW));
    let mut normal = Normal::zero();
    for i in 0..OBSERVATIONS {
        let exponent = (k * rows.get(OBSERVATIONS + i)).max(floor);
        let lobe = exp_in_range(exponent);
        let residual = (-beta).mul_add(lobe, rows.get(i));
        normal.add([lobe, exponent * (strength * lobe)], residual);
    }
    normal
}

/// The same for MINPACK.
pub(crate) struct Port<'a> {
    pub(crate) pixel: &'a Pixel,
    pub(crate) place: Vector2<f64>,
}

impl LeastSquaresProblem<f64, Const<OBSERVATIONS>, U2> for Port<'_> {
    type ResidualStorage = Owned<f64, Const<OBSERVATIONS>>;
    type JacobianStorage = Owned<f64, Const<OBSERVATIONS>, U2>;
    type ParameterStorage = Owned<f64, U2>;

    fn set_params(&mut self, place: &Vector2<f64>) {
        self.place = *place;
    }
    fn params(&self) -> Vector2<f64> {
        self.place
    }
    fn residuals(&self) -> Option<SVector<f64, OBSERVATIONS>> {
        let (beta, k) = (self.place.x, self.place.y.exp());
        let Pixel { y, phi_squared } = self.pixel;
        Some(SVector::from_fn(|i, _| beta * (-k * phi_squared[i]).exp() - y[i]))
    }
    fn jacobian(&self) -> Option<OMatrix<f64, Const<OBSERVATIONS>, U2>> {
        let (beta, k) = (self.place.x, self.place.y.exp());
        let mut jacobian = OMatrix::<f64, Const<OBSERVATIONS>, U2>::zeros();
        for (i, p) in self.pixel.phi_squared.iter().enumerate() {
            let lobe = (-k * p).exp();
            jacobian[(i, 0)] = lobe;
            jacobian[(i, 1)] = -(k * p * beta * lobe);
        }
        Some(jacobian)
    }
}
