//! Nielsen's damping, bounds by projection, relative stopping tests.

use super::{Normal, Problem, factor};
use crate::math::Scalar;

/// Box within which parameters stay.
#[derive(Clone, Copy, Debug)]
pub struct Bounds<S, const N: usize> {
    /// Smallest values.
    pub lower: [S; N],
    /// Largest values.
    pub upper: [S; N],
}

impl<S: Scalar, const N: usize> Bounds<S, N> {
    /// No bounds.
    #[must_use]
    pub fn none() -> Self {
        Self { lower: [-S::MAX; N], upper: [S::MAX; N] }
    }

    fn project(&self, p: [S; N]) -> [S; N] {
        core::array::from_fn(|i| p[i].max(self.lower[i]).min(self.upper[i]))
    }
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Steps tried at most.
    pub max_iterations: usize,
    /// Relative decrease of the cost below which nothing is left to gain.
    pub cost: f64,
    /// Step relative to the parameters, both in the matrix's diagonal norm.
    pub step: f64,
    /// Largest cosine between residuals and any column of derivatives.
    pub gradient: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { max_iterations: 100, cost: 1e-12, step: 1e-10, gradient: 1e-12 }
    }
}

/// Why the search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// The cost no longer falls.
    Cost,
    /// The steps have become too small.
    Step,
    /// The residuals are orthogonal to every column.
    Gradient,
    /// All iterations are used up.
    MaxIterations,
    /// No damping finds a smaller cost: the last place is as good as the numbers allow.
    NoProgress,
    /// The cost at the start is not finite.
    NotFinite,
}

impl Reason {
    /// Whether the parameters are a minimum, as far as the numbers can tell.
    #[must_use]
    pub fn converged(self) -> bool {
        !matches!(self, Self::MaxIterations | Self::NotFinite)
    }
}

/// Where the search ended, and why.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<S, const N: usize> {
    /// The best parameters.
    pub parameters: [S; N],
    /// Cost, gradient and matrix there.
    pub normal: Normal<S, N>,
    /// Why it ended.
    pub reason: Reason,
    /// Steps tried.
    pub iterations: usize,
    /// Parameters that the data do not determine.
    pub deficient: [bool; N],
}

impl<S: Scalar, const N: usize> Outcome<S, N> {
    /// Covariance of the parameters for residuals of the given variance: `variance (J'J)^-1`.
    #[must_use]
    pub fn covariance(&self, variance: S) -> [[S; N]; N] {
        let inverse = factor(&self.normal.matrix, S::zero(), &[false; N]).inverse();
        inverse.map(|row| row.map(|v| v * variance))
    }
}

/// Minimises a sum of squares from `start`, within bounds.
pub fn minimise<S: Scalar, const N: usize>(
    problem: &impl Problem<S, N>,
    start: [S; N],
    bounds: &Bounds<S, N>,
    options: &Options,
) -> Outcome<S, N> {
    let (zero, one, two) = (S::zero(), S::one(), S::of(2.0));
    let mut place = bounds.project(start);
    let mut normal = problem.normal(place);
    let (mut damping, mut growth) = (S::of(1e-2), two);
    let mut iterations = 0;
    let end = |place, normal: Normal<S, N>, reason, iterations| Outcome {
        parameters: place,
        deficient: factor(&normal.matrix, zero, &[false; N]).deficient,
        normal,
        reason,
        iterations,
    };
    if !normal.cost.is_finite() {
        return end(place, normal, Reason::NotFinite, 0);
    }
    loop {
        // A parameter at a bound whose descent leads outside stays where it is.
        let held: [bool; N] = core::array::from_fn(|i| {
            (place[i] <= bounds.lower[i] && normal.descent[i] < zero)
                || (place[i] >= bounds.upper[i] && normal.descent[i] > zero)
        });
        let level = (0..N).all(|i| {
            let reach = (normal.matrix[i][i] * normal.cost).sqrt();
            held[i] || normal.descent[i].abs() <= S::of(options.gradient) * reach
        });
        if level {
            return end(place, normal, Reason::Gradient, iterations);
        }
        if iterations == options.max_iterations {
            return end(place, normal, Reason::MaxIterations, iterations);
        }
        iterations += 1;
        let wish = factor(&normal.matrix, damping, &held).solve(&normal.descent);
        let trial = bounds.project(core::array::from_fn(|i| place[i] + wish[i]));
        let step: [S; N] = core::array::from_fn(|i| trial[i] - place[i]);
        let (mut moved, mut size, mut gain) = (zero, zero, zero);
        for i in 0..N {
            let d = normal.matrix[i][i];
            moved = (d * step[i]).mul_add(step[i], moved);
            size = (d * place[i]).mul_add(place[i], size);
            gain = (two * step[i]).mul_add(normal.descent[i], gain);
            for j in 0..N {
                let h = if i >= j { normal.matrix[i][j] } else { normal.matrix[j][i] };
                gain = (-(h * step[i])).mul_add(step[j], gain);
            }
        }
        if moved.sqrt() <= S::of(options.step) * size.sqrt() {
            return end(place, normal, Reason::Step, iterations);
        }
        let next = problem.normal(trial);
        let fall = normal.cost - next.cost;
        if next.cost.is_finite() && fall > zero {
            let done = fall <= S::of(options.cost) * normal.cost;
            (place, normal) = (trial, next);
            if done {
                return end(place, normal, Reason::Cost, iterations);
            }
            // Nielsen: damping follows how well the quadratic model foretold the gain.
            let surprise = two * fall / gain - one;
            let factor = (one - surprise * surprise * surprise).max(S::of(1.0 / 3.0));
            damping = (damping * factor).max(S::of(1e-7));
            growth = two;
        } else {
            // Hard case 32: the clamp keeps the damping finite; the old matrix is still clean.
            if damping >= S::of(1e10) {
                return end(place, normal, Reason::NoProgress, iterations);
            }
            damping = (damping * growth).min(S::of(1e10));
            growth = growth * two;
        }
    }
}
