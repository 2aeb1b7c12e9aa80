//! The search on plain numbers.

use super::search::{Outcomes, Search};
use super::{Bounds, Normal, Options, Outcome};
use crate::math::{Mask, Scalar};

/// A sum of squares to be minimised over N parameters.
pub trait Problem<S: Scalar, const N: usize> {
    /// Cost and its first derivatives at some parameters.
    fn normal(&self, parameters: [S; N]) -> Normal<S, N>;
}

/// Minimises a sum of squares from `start`, within bounds.
pub fn minimise<S: Scalar, const N: usize>(
    problem: &impl Problem<S, N>,
    start: [S; N],
    bounds: &Bounds<S, N>,
    options: &Options,
) -> Outcome<S, N> {
    if bounds.crossed() {
        return Outcome::nowhere(start);
    }
    let mut search = Search::<S, N>::idle(options);
    search.begin(Mask::splat(true), start, bounds, options);
    while search.running() {
        let next = problem.normal(search.trial);
        search.judge(search.trial, &next, options);
        search.step(bounds, options);
    }
    let mut outcomes = Outcomes::blank();
    search.write(&mut outcomes, false);
    outcomes.lane(0, bounds, options)
}
