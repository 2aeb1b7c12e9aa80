//! MM-estimation [@yohai1987mm] of a normal, shrunk to least squares by a Hausman test
//! [@hausman1978specification], for one register of pixels.
//!
//! 1. Four starts: least squares over all samples and over three ranges of ranks, two of them one-sided, for
//!    outliers are mostly highlights alone or shadows alone; each is improved by steps of least
//!    absolute residuals.
//! 2. The start whose residuals over *all* samples have the least M-scale wins, as in S-estimation
//!    [@rousseeuw1984s] by concentrated starts [@salibianbarrera2006fasts]. The model explains no pixel better than
//!    [`FLOOR`] of its brightness: that is added in squares.
//! 3. Steps of Tukey's biweight at this scale give `b` and the information `A = sum w l l'`.
//! 4. The scale is raised to the painting's typical one where the pixel's few samples fake a smaller one:
//!    empirical Bayes [@morris1983empirical], a weighted mean of both squares.
//! 5. With `d` the difference to least squares, `q = d' A d / s^2` tests whether least squares is consistent. Where `q` is
//!    below [`EVIDENCE`] it stays, bit by bit, and above the result approaches the robust one:
//!    `b = b_LS + f d`, `f = 1 - (EVIDENCE / q)^2`. A matte pixel so loses no efficiency, and neighbours that
//!    differ in noise only do not part.

use crate::math::real::Part;
use crate::math::{Mask, Real, Vec3};

use super::irls::StereoIrls;
use super::lights::Lights;
use super::m_estimators::Absolute;
use super::m_scale::ResidualScale;
use super::problem::{Learned, StereoOptions};
use super::rejection::Ranks;
use super::rows::PlaneRows;
use super::solve::{ENOUGH, Symmetric};
use super::sums::{Accumulate, residual};

/// Limits of the ranks that a start begins with; the first start begins with all.
const WINDOWS: [(f64, f64); 3] = [(0.2, 0.8), (0.0, 0.65), (0.35, 1.0)];

/// Steps of least absolute residuals of each start.
const START_STEPS: usize = 3;

/// Relative error of the model itself: interreflections, small lamps, an albedo that is not quite Lambert's.
const FLOOR: f64 = 0.01;

/// Scales beyond which a sample has no weight.
const TUNING: f64 = 2.0;

/// Degrees of freedom that the painting's scale counts for.
const PRIOR: f64 = 20.0;

/// Least `q` that is evidence: the 90 % quantile of `chi^2` with three degrees of freedom.
const EVIDENCE: f64 = 6.25;

/// `q` from which on the result is the robust one: `f` is within `1e-4` of 1.
const CERTAIN: f64 = 100.0 * EVIDENCE;

/// Mean square of least squares' residuals, relative to the painting's typical, up to which one step may
/// settle a pixel.
const QUIET: f64 = 2.25;

/// Samples without which there is no majority to follow: two more than unknowns.
const LEAST: f64 = 5.0;

pub(super) struct MmEstimation<R: Real> {
    learned: Learned,
    steps: usize,
    ranks: Ranks<R>,
    scale: ResidualScale<R>,
    /// Samples of a start.
    chosen: Vec<R::Mask>,
    /// The last step's weights.
    pub(super) weights: Vec<R>,
    /// Samples that the result uses.
    pub(super) used: Vec<R::Mask>,
}

/// One register of pixels; `relative` samples are NaN where invalid.
pub(super) struct MmSamples<'a, R: Real, L> {
    pub(super) lights: &'a L,
    pub(super) kept: &'a [R::Mask],
    pub(super) relative: PlaneRows<'a>,
    pub(super) signal: PlaneRows<'a>,
    pub(super) valid: R,
}

/// What least squares says of the same samples.
#[derive(Clone, Copy)]
pub(super) struct LeastSquares<R> {
    pub(super) b: Vec3<R>,
    /// Sum of the residuals' squares.
    pub(super) squares: R,
}

#[derive(Clone, Copy)]
pub(super) struct MmEstimate<R> {
    pub(super) b: Vec3<R>,
    /// How far the result went from least squares (0) to the robust one (1).
    pub(super) share: R,
    /// Weighted sum of `l l'`.
    pub(super) information: Symmetric<R>,
    /// Scale of the residuals relative to the brightness by least squares.
    pub(super) scale: R,
    pub(super) used: R,
    pub(super) shadow: R,
    pub(super) highlight: R,
}

impl<R: Real<Scalar = f32>> MmEstimation<R> {
    pub(super) fn new(observations: usize, options: &StereoOptions) -> Self {
        Self {
            learned: options.learned,
            steps: options.steps,
            ranks: Ranks::new(&WINDOWS, observations),
            scale: ResidualScale::new(observations),
            chosen: vec![Mask::splat(false); observations],
            weights: vec![R::zero(); observations],
            used: vec![Mask::splat(false); observations],
        }
    }

    /// Variance of the noise, from that of the pixel's own residuals: both relative to its brightness.
    #[inline(always)]
    fn pooled(&self, own: R, freedom: R) -> R {
        let typical = R::of(PRIOR * self.learned.scale * self.learned.scale);
        let pooled = freedom.mul_add(own, typical) / (freedom + R::of(PRIOR));
        own.max(pooled)
    }

    /// Pixels that keep least squares before any start is tried: those with too few samples, and those whose
    /// residuals are no larger than is typical of the painting and in which one step of the biweight
    /// from least squares finds nothing either.
    #[inline(always)]
    pub(super) fn consistent<L: Lights<R>>(
        &mut self,
        samples: &MmSamples<'_, R, L>,
        least: &LeastSquares<R>,
    ) -> R::Mask {
        let brightness = least.b.length();
        let few = samples.valid.lt(R::of(LEAST)) | !brightness.gt(R::zero());
        let few = few | Mask::splat(self.steps == 0);
        let freedom = samples.valid - R::of(3.0);
        let own = least.squares / (freedom * brightness * brightness);
        let typical = R::of(QUIET * self.learned.scale * self.learned.scale);
        let quiet = own.le(typical) & !few;
        if !quiet.any() {
            return few;
        }
        let noise = self.pooled(own + R::of(FLOOR * FLOOR), freedom).sqrt() * brightness;
        let (steps, per_tuned) = (1, (noise * R::of(TUNING)).recip());
        let step = Biweight { weights: &mut self.weights, samples, steps, per_tuned, b: least.b };
        let (b, information) = R::apart(step);
        let way = (b - least.b).scale(noise.recip());
        few | (quiet & way.dot(information.times(way)).le(R::one()))
    }

    /// The estimate, of pixels that are not `consistent`; `used` and `weights` are set for all.
    #[inline(always)]
    pub(super) fn run<L: Lights<R>>(
        &mut self,
        irls: &mut StereoIrls<R>,
        samples: &MmSamples<'_, R, L>,
        least: &LeastSquares<R>,
        consistent: R::Mask,
    ) -> MmEstimate<R> {
        let (zero, one) = (R::zero(), R::one());
        let brightness = least.b.length();
        let (mut b, scale) = self.start(irls, samples, least.b);
        let relative = scale / brightness;
        let variance = relative.mul_add(relative, R::of(FLOOR * FLOOR));
        let per_tuned = (variance.sqrt() * brightness * R::of(TUNING)).recip();
        let (steps, weights) = (self.steps, &mut self.weights);
        let information;
        (b, information) = R::apart(Biweight { weights, samples, steps, per_tuned, b });

        let noise = self.pooled(variance, samples.valid - R::of(3.0)).sqrt() * brightness;
        let way = b - least.b;
        let deviations = way.scale(noise.recip());
        let evidence = deviations.dot(information.times(deviations));
        let left = R::of(EVIDENCE) / evidence;
        let share = (-left).mul_add(left, one).max(zero);
        // What is left of least squares would be rounding, where a sample is a million times the others.
        let certain = evidence.ge(R::of(CERTAIN));
        let share = R::select(certain, one, share);
        let share = R::keep(!consistent & evidence.gt(R::of(EVIDENCE)), share);
        let mut robust = share.gt(zero);

        let (mut shadow, mut highlight) = (zero, zero);
        for (k, &kept) in samples.kept.iter().enumerate() {
            let off = residual(samples.signal.at(k), samples.lights.at(k), b) * per_tuned;
            let (dark, bright) = (kept & off.le(-one), kept & off.ge(one));
            shadow = shadow + R::keep(dark, one);
            highlight = highlight + R::keep(bright, one);
            self.used[k] = kept & !(dark | bright);
        }
        robust = robust & (samples.valid - shadow - highlight).ge(R::of(ENOUGH as f64));
        let share = R::keep(robust, share);
        (shadow, highlight) = (R::keep(robust, shadow), R::keep(robust, highlight));
        for (used, &kept) in self.used.iter_mut().zip(samples.kept) {
            *used = *used | (kept & !robust);
        }
        MmEstimate {
            b: Vec3::select(robust, Vec3::select(certain, b, way.mul_add(share, least.b)), least.b),
            share,
            information,
            scale: variance.sqrt(),
            used: samples.valid - shadow - highlight,
            shadow,
            highlight,
        }
    }

    /// Steps 1 and 2: the best start, and the scale of its residuals.
    #[inline(always)]
    fn start<L: Lights<R>>(
        &mut self,
        irls: &mut StereoIrls<R>,
        samples: &MmSamples<'_, R, L>,
        least: Vec3<R>,
    ) -> (Vec3<R>, R) {
        let MmSamples { lights, kept, relative, signal, valid } = *samples;
        let mut best = least;
        irls.run::<Absolute, L>(lights, kept, signal, START_STEPS, &mut best);
        let mut scale = self.scale.of(lights, kept, signal, valid, best);
        let whole = valid.ge(R::of(kept.len() as f64)).all();
        if whole {
            self.ranks.sort::<true>(relative);
        } else {
            self.ranks.sort::<false>(relative);
        }
        for window in 0..WINDOWS.len() {
            if whole {
                self.ranks.keep::<true>(window, relative, &mut self.chosen, valid);
            } else {
                self.ranks.keep::<false>(window, relative, &mut self.chosen, valid);
            }
            let chosen = &self.chosen[..];
            let (matrix, right, _) = R::apart(Accumulate { lights, kept: chosen, signal });
            let found = matrix.inverse().times(right);
            let solvable = matrix.solvable();
            let mut b = Vec3::select(solvable, found, least);
            irls.run::<Absolute, L>(lights, chosen, signal, START_STEPS, &mut b);
            let other = self.scale.of(lights, kept, signal, valid, b);
            let better = other.lt(scale);
            best = Vec3::select(better, b, best);
            scale = R::select(better, other, scale);
        }
        (best, scale)
    }
}

/// Step 3, and the information of its last weights; nothing where they left no determinant.
struct Biweight<'a, R: Real, L> {
    weights: &'a mut [R],
    samples: &'a MmSamples<'a, R, L>,
    steps: usize,
    /// One over the residual from which on a sample has no weight.
    per_tuned: R,
    b: Vec3<R>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Part<R> for Biweight<'_, R, L> {
    type Output = (Vec3<R>, Symmetric<R>);

    #[inline(always)]
    fn compute(self) -> Self::Output {
        let Self { weights, samples, steps, per_tuned, mut b } = self;
        let &MmSamples { lights, kept, signal, .. } = samples;
        let (zero, one) = (R::zero(), R::one());
        let mut information = Symmetric::zero();
        let mut followed = zero.le(zero);
        for _ in 0..steps {
            let mut matrix = Symmetric::zero();
            let mut right = Vec3::new(zero, zero, zero);
            for (k, &kept) in kept.iter().enumerate() {
                let (residual, light) = (residual(signal.at(k), lights.at(k), b), lights.at(k));
                let u = residual * per_tuned;
                let inside = (-u).mul_add(u, one).max(zero);
                let weight = R::keep(kept, inside * inside);
                weights[k] = weight;
                let weighted = light.scale(weight);
                matrix.add(light, weighted);
                right = weighted.mul_add(residual, right);
            }
            followed = followed & matrix.solvable();
            information = matrix;
            let step = matrix.inverse().times(right);
            b = Vec3::select(followed, b + step, b);
        }
        (b, Symmetric::select(followed, &information, &Symmetric::zero()))
    }
}
