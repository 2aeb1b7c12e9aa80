//! From least squares to the robust estimate as far as the evidence goes.

use crate::math::{Mask, Real, Vec3};

use super::lanes::{NormalLanes, NormalSolution};
use super::learning::{Neighbours, PixelStatistics};
use super::lights::Lights;
use super::mm_estimation::{LeastSquares, MmEstimate, MmSamples};
use super::model_errors::{Equations, ModelErrors, RobustWeights};
use super::rejection::RejectionOutcome;
use super::rows::PlaneRows;
use super::solve::{Solution, Symmetric, SymmetricInverse};
use super::sums::{Accumulate, Squares};

impl<R: Real<Scalar = f32>, L: Lights<R>> NormalLanes<R, L> {
    /// The estimate that starts from `least` squares over all valid samples.
    #[inline(always)]
    pub(super) fn shrunk<const ALL: bool>(
        &mut self,
        mut least: NormalSolution<R>,
        relative: PlaneRows<'_>,
        signal: PlaneRows<'_>,
        bands: PlaneRows<'_>,
    ) -> NormalSolution<R> {
        let Some(mm) = &mut self.mm else { return least };
        let found = LeastSquares { b: least.start.b, squares: least.squares };
        let (lights, kept, valid) = (&self.lights, &self.kept[..], self.valid);
        let samples = MmSamples { lights, kept, relative, signal, valid };
        let consistent = mm.consistent(&samples, &found);
        let mut estimate = None;
        self.statistics.known = R::zero();
        if !consistent.all() {
            let some = mm.run(&mut self.irls, &samples, &found, consistent);
            if some.share.gt(R::zero()).any() {
                estimate = Some(some);
            }
            if let Some(pairs) = &self.neighbours {
                let used = &mm.used[..];
                let known = R::keep(!consistent, R::one());
                let sums = R::apart(Neighbours { pairs, lights, used, valid, signal, b: some.b });
                self.statistics = PixelStatistics { known, scale: some.scale, sums };
            }
        }
        let Some(estimate) = estimate else {
            let (start, count) = (&least.start, self.valid);
            least.sigma = self.with_model_errors(least.sigma, None, signal, start, start.b, count);
            self.follow::<ALL>(bands, least.normal, least.length, None);
            return least;
        };
        self.towards::<ALL>(least, &estimate, signal, bands)
    }

    /// The predicted error of `b`, from the equations whose weights it has. `noise` is that of
    /// independent residuals: where squares leave the range of single precision it stays.
    #[inline(always)]
    fn with_model_errors(
        &self,
        noise: R,
        robust: Option<RobustWeights<'_, R>>,
        signal: PlaneRows<'_>,
        &Solution { matrix, inverse, .. }: &Solution<R>,
        b: Vec3<R>,
        count: R,
    ) -> R {
        if self.neighbours.is_some() {
            return noise;
        }
        let (lights, views, kept) = (&self.lights, &self.views, &self.kept[..]);
        let correlation = self.learned.correlation;
        let equations = Equations { matrix, inverse, b, count };
        let samples = (kept, signal);
        let found =
            R::apart(ModelErrors { lights, views, samples, robust, equations, correlation });
        R::select(noise.is_finite() & found.is_finite(), found, noise)
    }

    /// The shrunk estimate; lanes without evidence keep least squares bit by bit.
    #[inline(always)]
    fn towards<const ALL: bool>(
        &mut self,
        least: NormalSolution<R>,
        estimate: &MmEstimate<R>,
        signal: PlaneRows<'_>,
        bands: PlaneRows<'_>,
    ) -> NormalSolution<R> {
        let robust = estimate.share.gt(R::zero());
        self.count(estimate.used);
        let Some(mm) = &self.mm else { return least };
        let (lights, used, b) = (&self.lights, &mm.used[..], estimate.b);
        let (matrix, _, _) = R::apart(Accumulate { lights, kept: used, signal });
        let squares = R::apart(Squares::<_, _, _, false> { lights, kept: used, signal, b });
        let inverse = matrix.inverse();
        let squared = matrix.squared_condition(&inverse);

        let length = b.length();
        let per_length = length.recip();
        let normal = b.scale(per_length);
        let start = least.start;
        let weighted = Solution {
            matrix: Symmetric::select(robust, &estimate.information, &start.matrix),
            inverse: SymmetricInverse::select(
                robust,
                &estimate.information.inverse(),
                &start.inverse,
            ),
            ..start
        };
        let worst = weighted.matrix.worst_tangent_variance(&weighted.inverse, normal);
        let rough = (squares * worst * self.share.per_freedom).sqrt() * per_length;
        let samples = RobustWeights { robust, weights: &mm.weights };
        let sigma = R::select(robust, rough, least.sigma);
        let count = estimate.used;
        let sigma = self.with_model_errors(sigma, Some(samples), signal, &weighted, b, count);

        let normal = Vec3::select(robust, normal, least.normal);
        let length = R::select(robust, length, least.length);
        self.follow::<ALL>(bands, normal, length, Some(estimate.share));
        NormalSolution {
            rejection: RejectionOutcome {
                kept: estimate.used,
                shadow: estimate.shadow,
                highlight: estimate.highlight,
                relaxed: least.rejection.relaxed,
            },
            start: Solution {
                matrix: Symmetric::select(robust, &matrix, &start.matrix),
                inverse: SymmetricInverse::select(robust, &inverse, &start.inverse),
                squared: R::select(robust, squared, start.squared),
                condition: R::select(robust, squared.sqrt(), start.condition),
                ..start
            },
            normal,
            length,
            squares: R::select(robust, squares, least.squares),
            worst: R::select(robust, worst, least.worst),
            sigma,
        }
    }
}
