//! Rejection of highlights and shadows by threshold [@tominaga-rgb-camera] or by rank (trimming), from the
//! size of a sample among the pixel's samples.

use core::cmp::Ordering;

use crate::error::{Error, Result};
use crate::math::{Mask, Real};

use super::rows::{MAX_LANES, PlaneRows, lanes};
use super::solve::ENOUGH;
use super::sorting_network::SortingNetwork;

/// See [`Method`](super::Method).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum RejectionRule {
    All,
    Threshold { w1: f64, w2: f64 },
    Rank { low: f64, high: f64 },
}

impl RejectionRule {
    pub(super) fn check(self) -> Result<()> {
        match self {
            Self::All => Ok(()),
            Self::Threshold { w1, w2 } => {
                if !(w1.is_finite() && w1 > 0.0) {
                    return Err(Error::argument(
                        "w1",
                        format!("expected a positive number, found {w1}"),
                    ));
                }
                if !(0.0..w1).contains(&w2) {
                    let problem =
                        format!("expected at least 0 and less than w1 = {w1}, found {w2}");
                    return Err(Error::argument("w2", problem));
                }
                Ok(())
            }
            Self::Rank { low, high } => {
                if !(0.0..1.0).contains(&low) {
                    let problem = format!("expected at least 0 and less than 1, found {low}");
                    return Err(Error::argument("low", problem));
                }
                if !(low < high && high <= 1.0) {
                    let problem =
                        format!("expected more than low = {low} and at most 1, found {high}");
                    return Err(Error::argument("high", problem));
                }
                Ok(())
            }
        }
    }
}

/// Ranks `first <= rank < end` that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RankRange {
    pub(super) first: usize,
    pub(super) end: usize,
    pub(super) relaxed: bool,
}

impl RankRange {
    /// `int(low n) <= rank < round(high n)`, and more in rank order where that leaves too few.
    pub(super) fn of(n: usize, low: f64, high: f64) -> Self {
        let count = n as f64;
        let first = (low * count) as usize;
        let end = ((high * count).round_ties_even() as usize).clamp(first, n);
        Self { first, end, relaxed: false }.widened(n)
    }

    /// At least [`ENOUGH`] ranks, or all there are: the rank nearest to the middle is added
    /// next, the darker of two, for a shadow is wrong by at most what it lacks and a highlight by
    /// any factor.
    fn widened(mut self, n: usize) -> Self {
        while self.end - self.first < ENOUGH.min(n) {
            // Twice the distance from the middle, (n - 1) / 2, of the ranks on either side.
            let above = (2 * self.end + 1).abs_diff(n);
            let below = (2 * self.first).abs_diff(n + 1);
            if self.first > 0 && (below <= above || self.end == n) {
                self.first -= 1;
            } else {
                self.end += 1;
            }
            self.relaxed = true;
        }
        self
    }
}

/// Counts of kept and rejected samples of one register of pixels.
pub(super) struct RejectionOutcome<R: Real> {
    pub(super) kept: R,
    pub(super) shadow: R,
    pub(super) highlight: R,
    pub(super) relaxed: R::Mask,
}

impl<R: Real> RejectionOutcome<R> {
    /// No rule: everything valid is kept.
    #[inline(always)]
    pub(super) fn all(valid: R) -> Self {
        let zero = R::zero();
        Self { kept: valid, shadow: zero, highlight: zero, relaxed: zero.lt(zero) }
    }
}

/// The papers' thresholds: clears `kept` where a sample is highlight or shadow.
///
/// `relative` are the samples relative to their lights' irradiance, NaN where invalid, `mean` is
/// their mean and `valid` their number. With `ALL` every sample is valid, and `kept` only written.
#[inline(always)]
pub(super) fn threshold<R: Real<Scalar = f32>, const ALL: bool>(
    (w1, w2): (f64, f64),
    relative: PlaneRows<'_>,
    mean: R,
    kept: &mut [R::Mask],
    valid: R,
) -> RejectionOutcome<R> {
    let (zero, one) = (R::zero(), R::one());
    let (upper, lower) = (mean * R::of(w1), mean * R::of(w2));
    let (mut shadow, mut highlight) = (zero, zero);
    for (k, kept) in kept.iter_mut().enumerate() {
        let value = relative.at::<R>(k);
        // Comparisons are false for NaN.
        let (dark, bright) = (value.lt(lower), value.gt(upper));
        shadow = shadow + R::keep(dark, one);
        highlight = highlight + R::keep(bright, one);
        let inside = !(dark | bright);
        *kept = if ALL { inside } else { *kept & inside };
    }
    let count = valid - shadow - highlight;
    let relaxed = count.lt(valid.min(R::of(ENOUGH as f64)));
    let mut rejection = RejectionOutcome { kept: count, shadow, highlight, relaxed };
    if relaxed.any() {
        readmit(relative, kept, &mut rejection, lower);
    }
    rejection
}

/// Accepts rejected samples again, lane by lane: rare, so simple code is fast enough.
#[inline(always)]
fn readmit<R: Real<Scalar = f32>>(
    relative: PlaneRows<'_>,
    kept: &mut [R::Mask],
    rejection: &mut RejectionOutcome<R>,
    lower: R,
) {
    let mut count = lanes(rejection.kept);
    let (mut shadow, mut highlight) = (lanes(rejection.shadow), lanes(rejection.highlight));
    let lower = lanes(lower);
    for lane in (0..R::WIDTH).filter(|&lane| rejection.relaxed.lane(lane)) {
        let samples = (0..kept.len()).map(|k| (relative.lane(k, lane), k)).collect();
        for (value, k) in from_the_middle(samples) {
            if kept[k].lane(lane) || count[lane] >= ENOUGH as f32 {
                continue;
            }
            let mut back = [0.0; MAX_LANES];
            back[lane] = 1.0;
            kept[k] = kept[k] | R::load(&back).gt(R::zero());
            count[lane] += 1.0;
            let reason = if value < lower[lane] { &mut shadow } else { &mut highlight };
            reason[lane] -= 1.0;
        }
    }
    rejection.kept = R::load(&count);
    rejection.shadow = R::load(&shadow);
    rejection.highlight = R::load(&highlight);
}

/// The finite samples, those whose ranks are nearest to the middle first. Not generic: sorting is
/// compiled once, not for every instruction set.
fn from_the_middle(mut samples: Vec<(f32, usize)>) -> impl Iterator<Item = (f32, usize)> {
    samples.retain(|(value, _)| value.is_finite());
    samples.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
    let mut ranks: Vec<usize> = (0..samples.len()).collect();
    ranks.sort_by_key(|&rank| ((2 * rank).abs_diff(samples.len() - 1), rank));
    ranks.into_iter().map(move |rank| samples[rank])
}

/// Rank trimming: what it needs at every pixel.
pub(super) struct Ranks<R> {
    network: SortingNetwork,
    /// For every pair of limits, and every number of valid samples.
    kept: Vec<Vec<RankRange>>,
    sorted: Vec<R>,
}

/// The lowest and highest kept values, their ranks, and whether the rule was widened.
struct RankLimits<R: Real> {
    lower: R,
    upper: R,
    first: R,
    end: R,
    relaxed: R::Mask,
}

impl<R: Real<Scalar = f32>> Ranks<R> {
    pub(super) fn new(limits: &[(f64, f64)], observations: usize) -> Self {
        let ranges = |&(low, high): &(f64, f64)| {
            (0..=observations).map(|n| RankRange::of(n, low, high)).collect()
        };
        Self {
            network: SortingNetwork::new(observations),
            kept: limits.iter().map(ranges).collect(),
            sorted: vec![R::zero(); observations],
        }
    }

    /// Ranks the samples; arguments as for [`threshold`].
    #[inline(always)]
    pub(super) fn sort<const ALL: bool>(&mut self, relative: PlaneRows<'_>) {
        let infinity = R::splat(f32::INFINITY);
        for (k, sorted) in self.sorted.iter_mut().enumerate() {
            let value = relative.at::<R>(k);
            *sorted = if ALL { value } else { R::select(value.is_finite(), value, infinity) };
        }
        self.network.sort(&mut self.sorted);
    }

    /// Keeps the samples within one pair of limits, of those that [`Self::sort`] ranked.
    #[inline(always)]
    pub(super) fn keep<const ALL: bool>(
        &self,
        pair: usize,
        relative: PlaneRows<'_>,
        kept: &mut [R::Mask],
        valid: R,
    ) -> RejectionOutcome<R> {
        let (zero, one) = (R::zero(), R::one());
        let ranges = &self.kept[pair];
        let limits = if ALL { self.limits_of_all(ranges) } else { self.limits(ranges, valid) };
        let expected = limits.end - limits.first;
        let mut count = zero;
        for (k, kept) in kept.iter_mut().enumerate() {
            let value = relative.at::<R>(k);
            *kept = value.ge(limits.lower) & value.le(limits.upper);
            count = count + R::keep(*kept, one);
        }
        if count.gt(expected).any() {
            Self::split_ties(relative, kept, &limits);
        }
        let highlight = valid - limits.end;
        RejectionOutcome {
            kept: expected,
            shadow: limits.first,
            highlight,
            relaxed: limits.relaxed,
        }
    }

    /// Of samples that equal a limit, those of the first lights have the lower ranks.
    #[inline(always)]
    fn split_ties(relative: PlaneRows<'_>, kept: &mut [R::Mask], limits: &RankLimits<R>) {
        let (zero, one) = (R::zero(), R::one());
        let (mut below_lower, mut below_upper) = (zero, zero);
        for k in 0..kept.len() {
            let value = relative.at::<R>(k);
            below_lower = below_lower + R::keep(value.lt(limits.lower), one);
            below_upper = below_upper + R::keep(value.lt(limits.upper), one);
        }
        let skip = limits.first - below_lower;
        let take = limits.end - below_upper;
        let (mut at_lower, mut at_upper) = (zero, zero);
        for (k, kept) in kept.iter_mut().enumerate() {
            let value = relative.at::<R>(k);
            let lower = value.ge(limits.lower) & value.le(limits.lower);
            let upper = value.ge(limits.upper) & value.le(limits.upper);
            let out = (lower & at_lower.lt(skip)) | (upper & at_upper.ge(take));
            at_lower = at_lower + R::keep(lower, one);
            at_upper = at_upper + R::keep(upper, one);
            *kept = *kept & !out;
        }
    }

    #[inline(always)]
    fn limits_of_all(&self, ranges: &[RankRange]) -> RankLimits<R> {
        let kept = ranges[self.sorted.len()];
        RankLimits {
            lower: self.sorted[kept.first],
            upper: self.sorted[kept.end - 1],
            first: R::of(kept.first as f64),
            end: R::of(kept.end as f64),
            relaxed: Mask::splat(kept.relaxed),
        }
    }

    /// Lane by lane, for every lane has its own number of valid samples.
    #[inline(always)]
    fn limits(&self, ranges: &[RankRange], valid: R) -> RankLimits<R> {
        let mut found = [[0.0_f32; MAX_LANES]; 5];
        let valid = lanes(valid);
        for (lane, &valid) in valid.iter().enumerate().take(R::WIDTH) {
            let kept = ranges[valid as usize];
            let last = kept.end.saturating_sub(1);
            found[0][lane] = lanes(self.sorted[kept.first.min(last)])[lane];
            found[1][lane] = lanes(self.sorted[last])[lane];
            found[2][lane] = kept.first as f32;
            found[3][lane] = kept.end as f32;
            found[4][lane] = f32::from(u8::from(kept.relaxed));
        }
        RankLimits {
            lower: R::load(&found[0]),
            upper: R::load(&found[1]),
            first: R::load(&found[2]),
            end: R::load(&found[3]),
            relaxed: R::load(&found[4]).gt(R::zero()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_samples_keep_ranks_3_to_12() {
        assert_eq!(RankRange::of(16, 0.2, 0.8), RankRange { first: 3, end: 13, relaxed: false });
    }

    #[test]
    fn four_samples_are_kept_wherever_there_are_four() {
        for n in 0..40 {
            for (low, high) in [(0.2, 0.8), (0.45, 0.55), (0.0, 0.01), (0.9, 1.0), (0.99, 1.0)] {
                let kept = RankRange::of(n, low, high);
                assert!(kept.first <= kept.end && kept.end <= n);
                assert!(kept.end - kept.first >= ENOUGH.min(n), "{n} {low} {high} {kept:?}");
            }
        }
        assert_eq!(RankRange::of(5, 0.2, 0.8), RankRange { first: 0, end: 4, relaxed: true });
    }
}
