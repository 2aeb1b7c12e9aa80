//! The Levenberg-Marquardt search [@levenberg1944; @marquardt1963; @more1978levenberg] on any kind of
//! number, with Nielsen's damping [@nielsen1999damping]: its state, the test of a trial, and the step.

use super::cholesky::factor_damped;
use super::ending::MinimumCheck;
use super::outcome::Inverse;
use super::{Bounds, Normal, Options, Outcome, Reason};
use crate::math::lanes::MAX_LANES;
use crate::math::{Mask, Real, Scalar};

/// Damping beyond which no step is left to try (hard case 32).
const DAMPING_MAX: f64 = 1e10;

/// One search per lane.
#[derive(Clone, Copy, Debug)]
pub(super) struct LmSearch<R: Real, const N: usize> {
    /// Where the next pass is to be taken.
    pub(super) trial: [R; N],
    place: [R; N],
    normal: Normal<R, N>,
    /// What the damping multiplies: the matrix's diagonal, and what is remembered of earlier ones.
    diagonal: [R; N],
    damping: R,
    growth: R,
    /// Decrease of the cost that the quadratic model predicts for the trial.
    gain: R,
    /// Share of the cost below which nothing is left that is worth a pass.
    worth: R,
    /// Passes so far; the first is that of the start.
    passes: R,
    /// Cost at the start.
    first: R,
    /// Code of the reason, 0 while the lane is searching.
    reason: R,
}

/// Damping of the step whose gain says what is left: a direction in which samples tell a hundredth of
/// what its parameters tell alone counts in full, one that rounding leaves open does not.
const OPEN: f64 = 1e-4;

/// A tolerance, no finer than the numbers' rounding.
#[inline(always)]
fn tolerance<R: Real>(value: f64) -> R {
    R::of(value).max(R::splat(R::Scalar::EPSILON))
}

/// Damping of the first step, within its limits.
#[inline(always)]
#[allow(clippy::manual_clamp, reason = "what is not a number is no damping")]
fn damping<R: Real>(options: &Options) -> R {
    R::of(options.damping.max(0.0).min(DAMPING_MAX))
}

impl<R: Real, const N: usize> LmSearch<R, N> {
    /// No lane has anything to search.
    #[inline(always)]
    pub(super) fn idle(options: &Options) -> Self {
        let zero = R::zero();
        Self {
            trial: [zero; N],
            place: [zero; N],
            normal: Normal::zero(),
            diagonal: [zero; N],
            damping: damping(options),
            growth: R::of(2.0),
            gain: zero,
            worth: zero,
            passes: zero,
            first: zero,
            reason: Reason::Step.code(),
        }
    }

    /// Gives the lanes of the mask a new start, of problems of so many samples.
    #[inline(always)]
    pub(super) fn begin(
        &mut self,
        fresh: R::Mask,
        start: [R; N],
        samples: R,
        bounds: &Bounds<R::Scalar, N>,
        options: &Options,
    ) {
        let start = bounds.project(start);
        for (i, &start) in start.iter().enumerate() {
            self.trial[i] = R::select(fresh, start, self.trial[i]);
            self.place[i] = R::select(fresh, start, self.place[i]);
            self.diagonal[i] = R::select(fresh, R::zero(), self.diagonal[i]);
        }
        let worth = R::of(options.offset * options.offset) / samples;
        self.worth = R::select(fresh, worth, self.worth);
        self.damping = R::select(fresh, damping(options), self.damping);
        self.growth = R::select(fresh, R::of(2.0), self.growth);
        self.passes = R::select(fresh, R::zero(), self.passes);
        self.reason = R::select(fresh, R::zero(), self.reason);
    }

    /// Whether any lane is still searching.
    #[inline(always)]
    pub(super) fn running(&self) -> bool {
        self.reason.le(R::zero()).any()
    }

    /// Accepts or rejects the trials of the last pass, and ends the lanes that have converged.
    #[inline(always)]
    pub(super) fn accept(&mut self, place: [R; N], next: &Normal<R, N>, options: &Options) {
        let (zero, one, two) = (R::zero(), R::one(), R::of(2.0));
        let open = self.reason.le(zero);
        let first = self.passes.le(zero);
        // A place counts only with usable derivatives: no later step may start from Inf or NaN. Not
        // every model reads every parameter.
        let mut sum = next.cost;
        for (i, place) in place.iter().enumerate() {
            sum = place.mul_add(zero, sum + next.matrix[i][i] + next.descent[i].abs());
        }
        let finite = sum.is_finite();
        let fall = self.normal.cost - next.cost;
        let better = finite & fall.gt(zero);
        let taken = open & finite & (first | better);
        let tolerance = tolerance::<R>(options.cost) * self.normal.cost;
        // MINPACK's test: neither the actual nor the predicted decrease is worth another step.
        let converged = finite & fall.abs().le(tolerance) & self.gain.le(tolerance);
        self.normal.replace(taken, next);
        for (own, place) in self.place.iter_mut().zip(place) {
            *own = R::select(taken, place, *own);
        }
        // Nielsen [@nielsen1999damping]: damping follows how well the quadratic model predicted the
        // decrease. For a step cut short by bounds the model may have predicted an increase: the damping
        // is eased no more than after a large predicted decrease.
        let surprise = two * fall / self.gain - one;
        let factor = (one - surprise * surprise * surprise).max(R::of(1.0 / 3.0)).min(two);
        let eased = (self.damping * factor).max(R::splat(R::Scalar::EPSILON));
        // Hard case 32: the clamp keeps the damping finite; the old matrix is still clean.
        let stuck = self.damping.ge(R::of(DAMPING_MAX));
        let raised = (self.damping * self.growth).min(R::of(DAMPING_MAX));
        let damping = R::select(better, eased, raised);
        self.damping = R::select(first, self.damping, damping);
        let growth = R::select(better, two, self.growth * two);
        self.growth = R::select(first, two, growth);
        self.passes = self.passes + one;
        self.first = R::select(first, next.cost, self.first);

        self.end(first & !finite, Reason::NotFinite);
        // Rare enough for a branch: without it the search would continue on a cost of 0.
        let lost = first & next.cost.lt(R::splat(R::Scalar::MIN_POSITIVE));
        if lost.any() {
            self.end(lost & next.underflows(), Reason::Underflow);
        }
        self.end(!first & converged, Reason::Cost);
        self.end(!first & !better & stuck, Reason::NoProgress);
    }

    /// Solves for the next trials, and ends the lanes that need none.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub(super) fn step(&mut self, bounds: &Bounds<R::Scalar, N>, options: &Options) {
        let zero = R::zero();
        let Normal { cost, descent, matrix } = &self.normal;
        // A parameter at a bound whose descent leads outside stays where it is.
        let mut held = [R::Mask::splat(false); N];
        let mut level = R::Mask::splat(true);
        for i in 0..N {
            let (lower, upper) = (R::splat(bounds.lower[i]), R::splat(bounds.upper[i]));
            held[i] = (self.place[i].le(lower) & descent[i].lt(zero))
                | (self.place[i].ge(upper) & descent[i].gt(zero));
            let reach = (matrix[i][i] * *cost).sqrt();
            level =
                level & (held[i] | descent[i].abs().le(tolerance::<R>(options.gradient) * reach));
        }
        for i in 0..N {
            self.diagonal[i] = matrix[i][i].max(self.diagonal[i] * R::of(options.memory));
        }
        let wish = factor_damped(matrix, &self.diagonal, self.damping, &held).solve(descent);
        let mut trial = self.place;
        for i in 0..N {
            trial[i] = self.place[i] + wish[i];
        }
        let trial = bounds.project(trial);
        let (mut moved, mut size, mut gain) = (zero, zero, zero);
        for i in 0..N {
            let step = trial[i] - self.place[i];
            moved = (matrix[i][i] * step).mul_add(step, moved);
            size = (matrix[i][i] * self.place[i]).mul_add(self.place[i], size);
            // 2 s.g - s'Hs, row by row.
            let mut row = descent[i] + descent[i];
            for j in 0..N {
                let other = trial[j] - self.place[j];
                row = (-self.normal.entry(i, j)).mul_add(other, row);
            }
            gain = row.mul_add(step, gain);
        }
        let near = tolerance::<R>(options.step);
        let short = moved.le(near * near * size);
        self.trial = trial;
        self.gain = gain;
        // What the damped step promises says little of what is left along weak directions.
        let mut negligible = R::Mask::splat(false);
        if options.offset > 0.0 {
            let full = factor_damped(matrix, &self.diagonal, R::of(OPEN), &held).solve(descent);
            let mut left = zero;
            for i in 0..N {
                left = full[i].mul_add(descent[i], left);
            }
            negligible = left.le(self.worth * *cost);
        }
        self.end(level, Reason::Gradient);
        self.end(negligible, Reason::Cost);
        self.end(self.passes.gt(R::of(options.max_iterations as f64)), Reason::MaxIterations);
        self.end(short, Reason::Step);
    }

    /// Ends the searches of the mask that have not ended before.
    #[inline(always)]
    fn end(&mut self, mask: R::Mask, reason: Reason) {
        self.reason = R::select(mask & self.reason.le(R::zero()), reason.code(), self.reason);
    }

    /// Whether any lane has ended.
    #[inline(always)]
    pub(super) fn ended(&self) -> bool {
        self.reason.gt(R::zero()).any()
    }

    /// Writes the state as plain numbers, from which finished lanes are read.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    pub(super) fn write(&self, out: &mut Outcomes<R::Scalar, N>, covariance: bool) {
        let Normal { cost, descent, matrix } = &self.normal;
        cost.store(&mut out.cost);
        self.passes.store(&mut out.passes);
        self.reason.store(&mut out.reason);
        self.first.store(&mut out.first);
        self.damping.store(&mut out.damping);
        // Loops, not `map`, which compilers leave as calls.
        for i in 0..N {
            self.place[i].store(&mut out.place[i]);
            descent[i].store(&mut out.descent[i]);
            for j in 0..=i {
                matrix[i][j].store(&mut out.matrix[i][j]);
            }
        }
        out.inverted = covariance;
        if covariance {
            let own = Inverse::of(matrix);
            for i in 0..N {
                R::keep(own.deficient[i], R::one()).store(&mut out.deficient[i]);
                for j in 0..N {
                    own.matrix[i][j].store(&mut out.inverse[i][j]);
                }
            }
        }
    }
}

/// All lanes' states as plain numbers.
pub(super) struct Outcomes<S, const N: usize> {
    place: [[S; MAX_LANES]; N],
    descent: [[S; MAX_LANES]; N],
    matrix: Matrices<S, N>,
    cost: [S; MAX_LANES],
    passes: [S; MAX_LANES],
    reason: [S; MAX_LANES],
    first: [S; MAX_LANES],
    damping: [S; MAX_LANES],
    /// Whether the next two hold anything.
    inverted: bool,
    inverse: Matrices<S, N>,
    /// 1 for every parameter in doubt.
    deficient: [[S; MAX_LANES]; N],
}

type Matrices<S, const N: usize> = [[[S; MAX_LANES]; N]; N];

impl<S: Scalar, const N: usize> Outcomes<S, N> {
    /// Nothing written yet.
    pub(super) fn blank() -> Self {
        let zero = [S::zero(); MAX_LANES];
        Self {
            place: [zero; N],
            descent: [zero; N],
            matrix: [[zero; N]; N],
            cost: zero,
            passes: zero,
            reason: zero,
            first: zero,
            damping: zero,
            inverted: false,
            inverse: [[zero; N]; N],
            deficient: [zero; N],
        }
    }

    /// A bit for every lane that has ended: a loop over bits is predicted better than a branch per
    /// lane.
    #[inline(always)]
    pub(super) fn ended(&self, width: usize) -> u32 {
        let ends = self.reason[..width].iter().enumerate();
        ends.fold(0, |bits, (lane, reason)| bits | u32::from(*reason > S::zero()) << lane)
    }

    /// One lane's outcome. In line, as most callers read a part of it.
    #[inline(always)]
    pub(super) fn lane(
        &self,
        lane: usize,
        bounds: &Bounds<S, N>,
        options: &Options,
    ) -> Outcome<S, N> {
        let (parameters, mut normal) = self.at(lane);
        let mut reason = Reason::of_code(self.reason[lane].to_f64());
        let doubtful = normal.cost < S::MIN_POSITIVE || self.damping[lane] > S::one();
        if doubtful && reason.converged() {
            reason = self.unconverged(lane, bounds, options).unwrap_or(reason);
        }
        if reason == Reason::NotFinite {
            // Nothing was taken: what the lane holds is another problem's.
            normal = Normal { cost: S::NAN, ..Normal::zero() };
        }
        let inverted = self.inverted && reason != Reason::NotFinite;
        Outcome {
            parameters,
            normal,
            reason,
            iterations: (self.passes[lane].to_f64() as usize).saturating_sub(1),
            inverse: inverted.then(|| self.inverse_at(lane)),
        }
    }

    /// A lane's inverse. Loops, as in [`LmSearch::write`].
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "a matrix is written with its indices")]
    fn inverse_at(&self, lane: usize) -> Inverse<S, bool, N> {
        let mut inverse = Inverse { matrix: [[S::zero(); N]; N], deficient: [false; N] };
        for i in 0..N {
            inverse.deficient[i] = self.deficient[i][lane] > S::zero();
            for j in 0..N {
                inverse.matrix[i][j] = self.inverse[i][j][lane];
            }
        }
        inverse
    }

    /// A lane's parameters, and the equations there.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn at(&self, lane: usize) -> ([S; N], Normal<S, N>) {
        let mut normal = Normal { cost: self.cost[lane], ..Normal::zero() };
        let mut parameters = [S::zero(); N];
        for i in 0..N {
            parameters[i] = self.place[i][lane];
            normal.descent[i] = self.descent[i][lane];
            for j in 0..=i {
                normal.matrix[i][j] = self.matrix[i][j][lane];
            }
        }
        (parameters, normal)
    }

    /// Why a lane that passed a test has not converged, if so.
    #[cold]
    #[inline(never)]
    fn unconverged(&self, lane: usize, bounds: &Bounds<S, N>, options: &Options) -> Option<Reason> {
        let (parameters, normal) = self.at(lane);
        let ending = MinimumCheck { normal: &normal, parameters: &parameters, bounds, options };
        ending.doubt(self.first[lane], self.damping[lane])
    }
}
