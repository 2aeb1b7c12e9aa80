//! The fit of one register of pixels: rejection, least squares, reweighting, albedo.

use crate::math::{Mask, Real, Vec3};

use super::irls::StereoIrls;
use super::learning::{LightNeighbours, PixelStatistics};
use super::lights::Lights;
use super::m_estimators::{Absolute, Cauchy, ErrorScale, Huber, LossFunction, Tukey};
use super::mm_estimation::MmEstimation;
use super::model_errors::Views;
use super::problem::{Learned, Method, StereoProblem};
use super::rejection::{Ranks, RejectionOutcome, RejectionRule, threshold};
use super::rows::{MAX_LANES, PlaneRows, any};
use super::samples::{RegisterSamples, ScreenedSamples};
use super::solve::{Solution, Symmetric, SymmetricInverse};
use super::sums::{Accumulate, Multiply, Squares, TOGETHER, WeightedSamples};

/// The solution for one register of pixels; the albedo stays in [`NormalLanes`].
pub(super) struct NormalSolution<R: Real> {
    pub(super) rejection: RejectionOutcome<R>,
    /// Least squares over the kept samples.
    pub(super) start: Solution<R>,
    /// After reweighting.
    pub(super) normal: Vec3<R>,
    /// Of the normal times the albedo.
    pub(super) length: R,
    /// Sum of the residuals' squares.
    pub(super) squares: R,
    /// Variance of `b` along its worst tangent for noise of variance 1.
    pub(super) worst: R,
    /// Predicted deviation of the normal along it, rad.
    pub(super) sigma: R,
}

pub(super) struct NormalLanes<R: Real, L> {
    rule: RejectionRule,
    loss: LossFunction,
    steps: usize,
    ranks: Option<Ranks<R>>,
    pub(super) irls: StereoIrls<R>,
    pub(super) mm: Option<MmEstimation<R>>,
    pub(super) learned: Learned,
    /// Only where the painting is learned from these pixels, and then what they say.
    pub(super) neighbours: Option<LightNeighbours>,
    pub(super) statistics: PixelStatistics<R>,
    pub(super) lights: L,
    pub(super) views: Views<R>,
    /// Of all lights, where that is the same for every pixel; without `b` and `total`.
    pub(super) uniform: Option<Solution<R>>,
    /// Rows of the pseudoinverse of all lights.
    pub(super) pseudoinverse: Vec<Vec3<f32>>,
    /// Which samples a rule kept.
    pub(super) kept: Vec<R::Mask>,
    /// Number of valid samples, and of clipped ones.
    pub(super) valid: R,
    pub(super) saturated: R,
    /// Of as many samples as the last pixels kept.
    pub(super) share: ErrorScale<R>,
    /// Cosines of the lights with the normal, 0 where a sample does not count.
    cosines: Vec<R>,
    /// Every band's albedo; empty where nobody asked for it.
    pub(super) albedo: Vec<R>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> NormalLanes<R, L> {
    #[inline(always)]
    pub(super) fn new(problem: &StereoProblem<'_>) -> Self {
        let shape = problem.stack.shape();
        let (zero, count) = (R::zero(), shape.observations);
        let mut pixels = Self {
            rule: problem.rule,
            loss: problem.loss,
            steps: problem.options.steps,
            ranks: match problem.rule {
                RejectionRule::Rank { low, high } => Some(Ranks::new(&[(low, high)], count)),
                _ => None,
            },
            irls: StereoIrls::new(count),
            mm: (problem.options.method == Method::Robust)
                .then(|| MmEstimation::new(count, &problem.options)),
            learned: problem.options.learned,
            neighbours: problem.learns.then(|| LightNeighbours::new(problem.rig)),
            statistics: PixelStatistics::none(),
            lights: L::new(problem.rig),
            views: Views::new(problem),
            uniform: None,
            pseudoinverse: Vec::new(),
            kept: vec![Mask::splat(false); count],
            valid: zero,
            saturated: zero,
            share: ErrorScale::of(zero, problem.loss),
            cosines: vec![zero; count],
            albedo: vec![zero; if problem.albedo { shape.bands } else { 0 }],
        };
        if let Some(uniform) = &problem.uniform {
            pixels.pseudoinverse = uniform.pseudoinverse.iter().map(|row| row.splat()).collect();
            pixels.uniform = Some(Solution {
                b: Vec3::new(zero, zero, zero),
                total: zero,
                matrix: uniform.matrix.splat(),
                inverse: SymmetricInverse {
                    adjugate: uniform.inverse.adjugate.splat(),
                    per_determinant: R::of(uniform.inverse.per_determinant),
                },
                squared: R::of(uniform.squared),
                condition: R::of(uniform.squared.sqrt()),
            });
        }
        pixels
    }

    /// Everything about pixels whose samples are all valid; `sum` is that of the means.
    #[inline(always)]
    pub(super) fn fit_all(
        &mut self,
        samples: &RegisterSamples<'_>,
        mut sum: R,
        screened: &mut ScreenedSamples,
    ) -> NormalSolution<R> {
        self.valid = R::of(self.kept.len() as f64);
        self.saturated = R::zero();
        let mut relative = samples.means;
        if !L::DISTANT && (self.rule != RejectionRule::All || self.mm.is_some()) {
            sum = R::zero();
            for k in 0..self.kept.len() {
                let mean = samples.means.at::<R>(k) * self.lights.per_irradiance(k);
                sum = sum + mean;
                mean.store(&mut screened.relative[k * MAX_LANES..]);
            }
            relative = PlaneRows::new(&screened.relative, MAX_LANES);
        }
        self.fit::<true>(relative, sum, samples.signal, samples.bands)
    }

    /// Everything about pixels, after a look at each sample.
    #[inline(always)]
    pub(super) fn fit_some(
        &mut self,
        samples: &RegisterSamples<'_>,
        screened: &mut ScreenedSamples,
    ) -> NormalSolution<R> {
        let (zero, one, nan) = (R::zero(), R::one(), R::splat(f32::NAN));
        let largest = R::splat(f32::MAX);
        (self.valid, self.saturated) = (zero, zero);
        let mut sum = zero;
        for k in 0..self.kept.len() {
            let mean: R = samples.means.at(k);
            let valid = mean.is_finite();
            self.kept[k] = valid;
            self.valid = self.valid + R::keep(valid, one);
            self.saturated = self.saturated + R::keep(mean.gt(largest), one);
            let relative = mean * self.lights.per_irradiance(k);
            sum = sum + R::keep(valid, relative);
            R::select(valid, relative, nan).store(&mut screened.relative[k * MAX_LANES..]);
            R::keep(valid, samples.signal.at(k)).store(&mut screened.signal[k * MAX_LANES..]);
        }
        let relative = PlaneRows::new(&screened.relative, MAX_LANES);
        self.fit::<false>(relative, sum, PlaneRows::new(&screened.signal, MAX_LANES), samples.bands)
    }

    /// With `ALL` every sample is valid; `sum` is that of the `relative` samples that are.
    #[inline(always)]
    fn fit<const ALL: bool>(
        &mut self,
        relative: PlaneRows<'_>,
        sum: R,
        signal: PlaneRows<'_>,
        bands: PlaneRows<'_>,
    ) -> NormalSolution<R> {
        let mut rejection = self.select::<ALL>(relative, sum);
        let start = self.start::<ALL>(signal);
        let mut b = start.b;
        if self.loss != LossFunction::Squares && self.steps > 0 {
            let steps = self.steps;
            let (lights, kept, irls) = (&self.lights, &self.kept, &mut self.irls);
            let left = match self.loss {
                LossFunction::Absolute => {
                    irls.run::<Absolute, L>(lights, kept, signal, steps, &mut b)
                }
                LossFunction::Huber => irls.run::<Huber, L>(lights, kept, signal, steps, &mut b),
                LossFunction::Cauchy => irls.run::<Cauchy, L>(lights, kept, signal, steps, &mut b),
                LossFunction::Tukey => irls.run::<Tukey, L>(lights, kept, signal, steps, &mut b),
                LossFunction::Squares => Mask::splat(true),
            };
            rejection.relaxed = rejection.relaxed | !left;
        }
        let squares = self.squares::<ALL>(signal, b);
        self.count(rejection.kept);
        let length = b.length();
        let per_length = length.recip();
        let normal = b.scale(per_length);
        let worst = start.matrix.worst_tangent_variance(&start.inverse, normal);
        let sigma =
            (squares * worst * self.share.per_freedom).sqrt() * per_length * self.share.quantile;
        let least = NormalSolution { rejection, start, normal, length, squares, worst, sigma };
        if self.mm.is_some() {
            return self.shrunk::<ALL>(least, relative, signal, bands);
        }
        self.follow::<ALL>(bands, normal, length, None);
        least
    }

    /// The kept samples' squared residuals.
    #[inline(always)]
    fn squares<const ALL: bool>(&self, signal: PlaneRows<'_>, b: Vec3<R>) -> R {
        let (lights, kept) = (&self.lights, &self.kept[..]);
        if ALL && self.rule == RejectionRule::All {
            R::apart(Squares::<_, _, _, true> { lights, kept, signal, b })
        } else {
            R::apart(Squares::<_, _, _, false> { lights, kept, signal, b })
        }
    }

    /// Dividing takes time, and the number of kept samples is mostly that of the neighbours.
    #[inline(always)]
    pub(super) fn count(&mut self, kept: R) {
        if any(kept - self.share.count) {
            self.share = ErrorScale::of(kept, self.loss);
        }
    }

    /// Which samples the rule keeps.
    #[inline(always)]
    fn select<const ALL: bool>(&mut self, relative: PlaneRows<'_>, sum: R) -> RejectionOutcome<R> {
        match (&mut self.ranks, self.rule) {
            (Some(ranks), _) => {
                ranks.sort::<ALL>(relative);
                ranks.keep::<ALL>(0, relative, &mut self.kept, self.valid)
            }
            (None, RejectionRule::Threshold { w1, w2 }) => {
                let mean = sum / self.valid;
                threshold::<R, ALL>((w1, w2), relative, mean, &mut self.kept, self.valid)
            }
            _ => {
                if ALL {
                    self.kept.fill(Mask::splat(true));
                }
                RejectionOutcome::all(self.valid)
            }
        }
    }

    /// Least squares over the kept samples. Pixels all of whose samples count, under distant
    /// lights, are multiplied by the one pseudoinverse.
    #[inline(always)]
    fn start<const ALL: bool>(&self, signal: PlaneRows<'_>) -> Solution<R> {
        let (lights, kept) = (&self.lights, &self.kept[..]);
        let mut all = None;
        if let Some(uniform) = self.uniform {
            let pseudoinverse = &self.pseudoinverse[..];
            let (b, total) = R::apart(Multiply { pseudoinverse, signal });
            if ALL {
                return Solution { b, total, ..uniform };
            }
            all = Some((uniform, b));
        }
        let (matrix, right, total) = R::apart(Accumulate { lights, kept, signal });
        let inverse = matrix.inverse();
        let squared = matrix.squared_condition(&inverse);
        let condition = squared.sqrt();
        let some = Solution { b: inverse.times(right), total, matrix, inverse, squared, condition };
        let Some((uniform, all)) = all else { return some };
        let whole = self.valid.ge(R::of(self.kept.len() as f64));
        Solution {
            b: Vec3::new(
                R::select(whole, all.x, some.b.x),
                R::select(whole, all.y, some.b.y),
                R::select(whole, all.z, some.b.z),
            ),
            total,
            matrix: Symmetric::select(whole, &uniform.matrix, &some.matrix),
            inverse: SymmetricInverse::select(whole, &uniform.inverse, &some.inverse),
            squared: R::select(whole, uniform.squared, some.squared),
            condition: R::select(whole, uniform.condition, some.condition),
        }
    }

    /// Every band's albedo along the normal, with the weights of `b`: those of the loss, or for
    /// MM-estimation a mixture by its `share`.
    #[inline(always)]
    pub(super) fn follow<const ALL: bool>(
        &mut self,
        bands: PlaneRows<'_>,
        normal: Vec3<R>,
        length: R,
        share: Option<R>,
    ) {
        let (zero, one) = (R::zero(), R::one());
        match (&mut self.albedo[..], share) {
            ([], _) => return,
            // The same number: the normal is the direction of the least-squares solution.
            ([albedo], None) => {
                *albedo = length;
                return;
            }
            _ => {}
        }
        let by_rule = self.loss == LossFunction::Squares || self.steps == 0;
        if by_rule && share.is_none() {
            return self.follow_by_rule::<ALL>(bands, normal);
        }
        let mixture = match (&self.mm, share) {
            (Some(mm), Some(share)) => {
                Some((&mm.weights[..], share.gt(zero), self.mixture(mm, normal, share)))
            }
            _ => None,
        };
        self.albedo.fill(zero);
        let mut squares = zero;
        let count = self.albedo.len();
        for (k, &kept) in self.kept.iter().enumerate() {
            let cosine = normal.dot(self.lights.at(k));
            let weight = if let Some((weights, robust, (by_weights, by_all))) = mixture {
                let mixed = weights[k].mul_add(by_weights, by_all);
                R::keep(kept, R::select(robust, mixed, one))
            } else {
                self.irls.weights()[k]
            };
            let weighted = cosine * weight;
            squares = weighted.mul_add(cosine, squares);
            for (band, albedo) in self.albedo.iter_mut().enumerate() {
                let sample: R = bands.at(k * count + band);
                let sample = if ALL { sample } else { R::keep(weight.gt(zero), sample) };
                *albedo = weighted.mul_add(sample, *albedo);
            }
        }
        let per_square = squares.recip();
        for albedo in &mut self.albedo {
            *albedo = *albedo * per_square;
        }
        if let ([albedo], Some(share)) = (&mut self.albedo[..], share) {
            *albedo = R::select(share.gt(zero), *albedo, length);
        }
    }

    /// [`Self::follow`] where every kept sample has the same weight.
    #[inline(always)]
    fn follow_by_rule<const ALL: bool>(&mut self, bands: PlaneRows<'_>, normal: Vec3<R>) {
        let whole = ALL && self.rule == RejectionRule::All;
        let mut squares = R::zero();
        for k in 0..self.kept.len() {
            let cosine = normal.dot(self.lights.at(k));
            let weighted = if whole { cosine } else { R::keep(self.kept[k], cosine) };
            squares = weighted.mul_add(cosine, squares);
            self.cosines[k] = weighted;
        }
        let per_square = squares.recip();
        let kept = if ALL { None } else { Some(&self.kept[..]) };
        let count = self.albedo.len();
        let samples = WeightedSamples { weights: &self.cosines, kept, bands, count };
        let mut first = 0;
        while first < count {
            if count - first >= TOGETHER {
                let sums = samples.sums::<TOGETHER>(first);
                for (band, &sum) in sums.iter().enumerate() {
                    self.albedo[first + band] = sum * per_square;
                }
                first += TOGETHER;
            } else {
                let [sum] = samples.sums::<1>(first);
                self.albedo[first] = sum * per_square;
                first += 1;
            }
        }
    }

    /// Factors of the weights and of one, so that each of both fits has its share in the albedo.
    #[inline(always)]
    fn mixture(&self, mm: &MmEstimation<R>, normal: Vec3<R>, share: R) -> (R, R) {
        let (zero, one) = (R::zero(), R::one());
        let (mut all, mut weighted) = (zero, zero);
        for (k, &kept) in self.kept.iter().enumerate() {
            let cosine = normal.dot(self.lights.at(k));
            let square = R::keep(kept, cosine * cosine);
            all = all + square;
            weighted = mm.weights[k].mul_add(square, weighted);
        }
        (share * all / weighted, one - share)
    }
}
