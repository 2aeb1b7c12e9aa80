//! Levenberg-Marquardt on plain numbers, one problem at a time.

use super::search::{LmSearch, Outcomes};
use super::{Bounds, Normal, Options, Outcome};
use crate::math::{Mask, Scalar};

/// A sum of squares to be minimised over N parameters: the one trait that a model of your own
/// implements for [`minimise`].
pub trait Problem<S: Scalar, const N: usize> {
    /// The normal equations at some parameters: start from [`Normal::zero`] and call
    /// [`add`](Normal::add) once per sample, with the derivatives of the model by its parameters and
    /// the residual `sample - model`. For a weight `w`, multiply both by `sqrt(w)`.
    ///
    /// [`Normal::descent`] is `J' r`, minus half the derivative of [`Normal::cost`]: a central
    /// difference of the cost tests the derivatives.
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
    let mut search = LmSearch::<S, N>::idle(options);
    search.begin(Mask::splat(true), start, S::one(), bounds, options);
    while search.running() {
        let next = problem.normal(search.trial);
        search.accept(search.trial, &next, options);
        search.step(bounds, options);
    }
    let mut outcomes = Outcomes::blank();
    search.write(&mut outcomes, false);
    outcomes.lane(0, bounds, options)
}
