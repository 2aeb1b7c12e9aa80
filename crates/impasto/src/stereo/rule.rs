//! Which samples are highlight or shadow, by their size among the pixel's samples.

use crate::error::{Error, Result};
use crate::math::{Mask, Real};

use super::ENOUGH;
use super::sort::Network;
use super::tile::lanes;

/// See [`Method`](super::Method).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    All,
    Threshold { w1: f64, w2: f64 },
    Rank { low: f64, high: f64 },
}

impl Rule {
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

/// Ranks `first <= rank < end` that a rule keeps of so many samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kept {
    pub(super) first: usize,
    pub(super) end: usize,
    pub(super) relaxed: bool,
}

impl Kept {
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

/// What a rule needs at every pixel.
pub(super) struct Selection<R> {
    rule: Rule,
    network: Network,
    /// For every number of valid samples.
    kept: Vec<Kept>,
    sorted: Vec<R>,
}

/// What a rule says of one register of pixels.
pub(super) struct Verdict<R: Real> {
    pub(super) kept: R,
    pub(super) shadow: R,
    pub(super) highlight: R,
    pub(super) relaxed: R::Mask,
}

impl<R: Real<Scalar = f32>> Selection<R> {
    #[inline(always)]
    pub(super) fn new(rule: Rule, observations: usize) -> Self {
        let kept = match rule {
            Rule::Rank { low, high } => {
                (0..=observations).map(|n| Kept::of(n, low, high)).collect()
            }
            _ => Vec::new(),
        };
        Self {
            rule,
            network: Network::new(observations),
            kept,
            sorted: vec![R::zero(); observations],
        }
    }

    /// Clears the weights of samples that are highlight or shadow.
    ///
    /// `values` are the samples relative to their lights' irradiance, `weights` 1 where they are
    /// valid and 0 elsewhere (where the value is NaN), `count` how many are valid.
    #[inline(always)]
    pub(super) fn apply(&mut self, values: &[R], weights: &mut [R], count: R) -> Verdict<R> {
        let zero = R::zero();
        match self.rule {
            Rule::All => {
                Verdict { kept: count, shadow: zero, highlight: zero, relaxed: zero.lt(zero) }
            }
            Rule::Threshold { w1, w2 } => Self::threshold((w1, w2), values, weights, count),
            Rule::Rank { .. } => self.rank(values, weights, count),
        }
    }

    #[inline(always)]
    fn threshold((w1, w2): (f64, f64), values: &[R], weights: &mut [R], count: R) -> Verdict<R> {
        let (zero, one) = (R::zero(), R::one());
        let mut sum = zero;
        for (&value, &weight) in values.iter().zip(&*weights) {
            sum = sum + R::keep(weight.gt(zero), value);
        }
        let mean = sum / count;
        let (upper, lower) = (mean * R::of(w1), mean * R::of(w2));
        let (mut shadow, mut highlight) = (zero, zero);
        for (&value, weight) in values.iter().zip(&mut *weights) {
            let valid = weight.gt(zero);
            let dark = value.lt(lower) & valid;
            let bright = value.gt(upper) & valid;
            shadow = shadow + R::keep(dark, one);
            highlight = highlight + R::keep(bright, one);
            *weight = R::select(dark | bright, zero, *weight);
        }
        let kept = count - shadow - highlight;
        let enough = R::of(ENOUGH as f64);
        let relaxed = kept.lt(enough) & count.ge(enough);
        let mut verdict = Verdict { kept, shadow, highlight, relaxed };
        if relaxed.any() {
            readmit(values, weights, &mut verdict, (lower, upper));
        }
        verdict
    }

    #[inline(always)]
    fn rank(&mut self, values: &[R], weights: &mut [R], count: R) -> Verdict<R> {
        let zero = R::zero();
        let infinity = R::splat(f32::INFINITY);
        for ((sorted, &value), &weight) in self.sorted.iter_mut().zip(values).zip(&*weights) {
            *sorted = R::select(weight.gt(zero), value, infinity);
        }
        self.network.sort(&mut self.sorted);
        let limits = self.limits(count);
        let (mut below_lower, mut below_upper) = (zero, zero);
        for (&value, &weight) in values.iter().zip(&*weights) {
            below_lower = below_lower + R::keep(value.lt(limits.lower), weight);
            below_upper = below_upper + R::keep(value.lt(limits.upper), weight);
        }
        // Of equal samples, so many of the first lights have a rank below the limit.
        let skip = limits.first - below_lower;
        let take = limits.end - below_upper;
        let (mut seen_lower, mut seen_upper) = (zero, zero);
        let mut shadow = zero;
        for (&value, weight) in values.iter().zip(&mut *weights) {
            let at_lower = value.le(limits.lower) & value.ge(limits.lower);
            let at_upper = value.le(limits.upper) & value.ge(limits.upper);
            let dark = value.lt(limits.lower) | (at_lower & seen_lower.lt(skip));
            let bright = value.gt(limits.upper) | (at_upper & seen_upper.ge(take));
            seen_lower = seen_lower + R::keep(at_lower, *weight);
            seen_upper = seen_upper + R::keep(at_upper, *weight);
            shadow = shadow + R::keep(dark, *weight);
            *weight = R::select(dark | bright, zero, *weight);
        }
        let kept = limits.end - limits.first;
        let highlight = (count - kept - shadow).max(zero);
        Verdict { kept, shadow, highlight, relaxed: limits.relaxed.gt(zero) }
    }

    /// The lowest and highest kept values and their ranks.
    #[inline(always)]
    fn limits(&self, count: R) -> Limits<R> {
        let all = R::of(self.sorted.len() as f64);
        if (count.le(all) & count.ge(all)).all() {
            let kept = self.kept[self.sorted.len()];
            return Limits {
                lower: self.sorted[kept.first],
                upper: self.sorted[kept.end - 1],
                first: R::of(kept.first as f64),
                end: R::of(kept.end as f64),
                relaxed: R::of(f64::from(u8::from(kept.relaxed))),
            };
        }
        let mut limits = [[0.0_f32; 16]; 5];
        let counts = lanes(count);
        for lane in 0..R::WIDTH {
            let kept = self.kept[counts[lane] as usize];
            let last = kept.end.saturating_sub(1);
            limits[0][lane] = lanes(self.sorted[kept.first.min(last)])[lane];
            limits[1][lane] = lanes(self.sorted[last])[lane];
            limits[2][lane] = kept.first as f32;
            limits[3][lane] = kept.end as f32;
            limits[4][lane] = f32::from(u8::from(kept.relaxed));
        }
        Limits {
            lower: R::load(&limits[0]),
            upper: R::load(&limits[1]),
            first: R::load(&limits[2]),
            end: R::load(&limits[3]),
            relaxed: R::load(&limits[4]),
        }
    }
}

/// Takes rejected samples back, lane by lane: rare, and no place for clever code.
#[inline(always)]
fn readmit<R: Real<Scalar = f32>>(
    values: &[R],
    weights: &mut [R],
    verdict: &mut Verdict<R>,
    (lower, upper): (R, R),
) {
    let mut changed = [[0.0_f32; 16]; 3];
    verdict.kept.store(&mut changed[0]);
    verdict.shadow.store(&mut changed[1]);
    verdict.highlight.store(&mut changed[2]);
    let (lower, upper) = (lanes(lower), lanes(upper));
    let mut order: Vec<(f32, usize)> = Vec::with_capacity(values.len());
    for lane in (0..R::WIDTH).filter(|&lane| verdict.relaxed.lane(lane)) {
        // Valid samples are the kept ones and those beyond the thresholds; an invalid sample
        // was set to zero weight before, and its value is NaN or infinite.
        order.clear();
        for (index, &value) in values.iter().enumerate() {
            let value = lanes(value)[lane];
            if value.is_finite() {
                order.push((value, index));
            }
        }
        order.sort_by(|a, b| a.partial_cmp(b).unwrap_or(core::cmp::Ordering::Equal));
        let middle = order.len() - 1;
        let mut candidates: Vec<usize> = (0..order.len()).collect();
        candidates.sort_by_key(|&rank| ((2 * rank).abs_diff(middle), rank));
        for rank in candidates {
            let (value, index) = order[rank];
            let mut weight = lanes(weights[index]);
            if weight[lane] > 0.0 || changed[0][lane] >= ENOUGH as f32 {
                continue;
            }
            weight[lane] = 1.0;
            weights[index] = R::load(&weight);
            changed[0][lane] += 1.0;
            let side = if value < lower[lane] { 1 } else { 2 };
            debug_assert!(side == 1 || value > upper[lane]);
            changed[side][lane] -= 1.0;
        }
    }
    verdict.kept = R::load(&changed[0]);
    verdict.shadow = R::load(&changed[1]);
    verdict.highlight = R::load(&changed[2]);
}

struct Limits<R> {
    lower: R,
    upper: R,
    first: R,
    end: R,
    relaxed: R,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_samples_keep_ranks_3_to_12() {
        assert_eq!(Kept::of(16, 0.2, 0.8), Kept { first: 3, end: 13, relaxed: false });
    }

    #[test]
    fn four_samples_are_kept_wherever_there_are_four() {
        for n in 0..40 {
            for (low, high) in [(0.2, 0.8), (0.45, 0.55), (0.0, 0.01), (0.9, 1.0), (0.99, 1.0)] {
                let kept = Kept::of(n, low, high);
                assert!(kept.first <= kept.end && kept.end <= n);
                assert!(kept.end - kept.first >= ENOUGH.min(n), "{n} {low} {high} {kept:?}");
            }
        }
        assert_eq!(Kept::of(5, 0.2, 0.8), Kept { first: 0, end: 4, relaxed: true });
    }
}
