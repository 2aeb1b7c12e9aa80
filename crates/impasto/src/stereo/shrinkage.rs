//! From least squares to the robust estimate as far as the evidence goes, and a predicted error that
//! contains what the model cannot describe.
//!
//! Residuals of noise alone are independent from light to light. Where a lobe, interreflection or a wrong curve is
//! left in them they are alike under neighbouring lights, no number of photographs averages them out, and
//! the covariance of least squares is far too small. The correlation of the painting's residuals
//! ([`Learned::correlation`](super::Learned)) tells the two apart:
//! `sigma^2 = S^2 + (kappa max(rho, 0) s / |b|)^2`, with `S` from the covariance
//! `f g s^2 A^-1 + (1 - f) s_LS^2 (L'L)^-1`, and `s` the used samples' standard deviation.

use crate::math::{Mask, Real, Vec3};

use super::lanes::{NormalLanes, NormalSolution};
use super::learning::{Neighbours, PixelStatistics};
use super::lights::Lights;
use super::mm_estimation::{LeastSquares, MmEstimate, MmSamples};
use super::rejection::RejectionOutcome;
use super::rows::PlaneRows;
use super::solve::{Solution, Symmetric, SymmetricInverse};
use super::sums::{Accumulate, Squares};

/// Deviation of a normal per correlated deviation of the used samples, relative to the brightness.
const CORRELATED: f64 = 6.5;

/// Variance of the biweight's estimate over that of weighted least squares with its weights, for normal
/// noise between one half of the scale and all of it.
const REWEIGHTED: f64 = 1.15;

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
        let settled = mm.settled(self.valid, &found);
        let mut estimate = None;
        self.statistics.known = R::zero();
        if !settled.all() {
            let (lights, kept, valid) = (&self.lights, &self.kept[..], self.valid);
            let samples = MmSamples { lights, kept, relative, signal, valid };
            let some = mm.run(&mut self.irls, &samples, &found, settled);
            if some.share.gt(R::zero()).any() {
                estimate = Some(some);
            }
            if let Some(pairs) = &self.neighbours {
                let used = &mm.used[..];
                let known = R::keep(!settled, R::one());
                let sums = R::apart(Neighbours { pairs, lights, used, signal, b: some.b });
                self.statistics = PixelStatistics { known, scale: some.scale, sums };
            }
        }
        let spread = (least.squares * self.share.per_freedom).sqrt() / least.length;
        least.sigma = self.with_correlated(least.sigma, spread);
        let Some(estimate) = estimate else {
            self.follow::<ALL>(bands, least.normal, least.length, None);
            return least;
        };
        self.towards::<ALL>(least, &estimate, signal, bands)
    }

    /// Adds what correlated residuals do to the error.
    #[inline(always)]
    fn with_correlated(&self, sigma: R, spread: R) -> R {
        let correlation = self.learned.correlation;
        if correlation <= 0.0 {
            return sigma;
        }
        let systematic = spread * R::of(CORRELATED * correlation);
        sigma.mul_add(sigma, systematic * systematic).sqrt()
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
        let Some(mm) = &self.mm else { return least };
        let (lights, used, b) = (&self.lights, &mm.used[..], estimate.b);
        let (matrix, _, _) = R::apart(Accumulate { lights, kept: used, signal });
        let squares = R::apart(Squares::<_, _, _, false> { lights, kept: used, signal, b });
        let inverse = matrix.inverse();
        let squared = matrix.squared_condition(&inverse);
        // Of least squares, before the number of samples changes.
        let own = least.squares * self.share.per_freedom * self.share.quantile;
        let own = own * self.share.quantile;
        self.count(estimate.used);

        let length = b.length();
        let per_length = length.recip();
        let normal = b.scale(per_length);
        let all = &least.start.inverse;
        let weighted = estimate.information.inverse();
        let variance = squares * self.share.per_freedom;
        let by_weights = estimate.share * variance * R::of(REWEIGHTED) * weighted.per_determinant;
        let by_all = (R::one() - estimate.share) * own * all.per_determinant;
        let covariance =
            Symmetric::zero().plus(by_weights, &weighted.adjugate).plus(by_all, &all.adjugate);
        let worst = covariance.largest_tangent_eigenvalue(normal);
        let sigma = worst.sqrt() * per_length;
        let sigma = self.with_correlated(sigma, variance.sqrt() * per_length);

        let normal = Vec3::select(robust, normal, least.normal);
        let length = R::select(robust, length, least.length);
        self.follow::<ALL>(bands, normal, length, Some(estimate.share));
        let start = least.start;
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
            sigma: R::select(robust, sigma, least.sigma),
        }
    }
}
