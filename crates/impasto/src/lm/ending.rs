//! A second check of searches that passed a test of convergence.

use super::{Bounds, Normal, Options, Reason};
use crate::math::Scalar;

/// Rounding of a residual, in units of the sample's: what exponentials and short sums leave.
const ROUNDING: f64 = 16.0;

/// The place where one of the search's tests was passed.
pub(super) struct MinimumCheck<'a, S, const N: usize> {
    pub(super) normal: &'a Normal<S, N>,
    pub(super) parameters: &'a [S; N],
    pub(super) bounds: &'a Bounds<S, N>,
    pub(super) options: &'a Options,
}

impl<S: Scalar, const N: usize> MinimumCheck<'_, S, N> {
    /// Why the place is no minimum, if so; `first` is the start's cost, `damping` that of
    /// the step that would be next.
    pub(super) fn doubt(&self, first: S, damping: S) -> Option<Reason> {
        if self.loses(first) {
            return Some(Reason::Underflow);
        }
        // Up to here a step along any column is half of what its slope wishes for, or more: the
        // tests have looked far enough.
        let kept = first.to_f64() - self.normal.cost.to_f64();
        (damping > S::one() && self.promises(kept)).then_some(Reason::Stalled)
    }

    /// Whether the squares were lost before the residuals could fall to rounding of the start's.
    fn loses(&self, first: S) -> bool {
        self.normal.cost < S::MIN_POSITIVE
            && first * S::EPSILON * S::EPSILON < S::MIN_POSITIVE
            && self.normal.underflows()
            && self.share() > self.near()
    }

    /// Whether some parameter alone would lower the cost, if the slopes were right, by more than the
    /// tolerances, than half the digits of a sum, and than all that has been `kept` of their
    /// promises so far: at a kink to which they have led a search they need not hold (hard case 25).
    fn promises(&self, kept: f64) -> bool {
        let Options { cost, gradient, .. } = *self.options;
        let least = S::EPSILON.to_f64().sqrt().max(cost).max(gradient * gradient);
        let share = self.share();
        share > self.near() && share * share > kept.max(least * self.normal.cost.to_f64())
    }

    /// The residuals' largest share in a column of derivatives that no bound holds.
    fn share(&self) -> f64 {
        let mut largest = 0.0_f64;
        for i in 0..N {
            let [own, descent, place, lower, upper] = [
                self.normal.matrix[i][i],
                self.normal.descent[i],
                self.parameters[i],
                self.bounds.lower[i],
                self.bounds.upper[i],
            ]
            .map(Scalar::to_f64);
            let held = (place <= lower && descent < 0.0) || (place >= upper && descent > 0.0);
            if own > 0.0 && !held {
                largest = largest.max(descent.abs() / own.sqrt());
            }
        }
        largest
    }

    /// What is no step, in the same units: the step's tolerance, or the model's own rounding.
    fn near(&self) -> f64 {
        let mut size = 0.0;
        for (i, place) in self.parameters.iter().enumerate() {
            let reach = self.normal.matrix[i][i].to_f64().sqrt() * place.to_f64();
            size = reach.mul_add(reach, size);
        }
        (ROUNDING * S::EPSILON.to_f64()).max(2.0 * self.options.step) * size.sqrt()
    }
}
