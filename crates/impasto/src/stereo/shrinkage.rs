//! From least squares to the robust estimate as far as the evidence goes, and a predicted error that
//! contains what the model cannot describe.
//!
//! Residuals of noise alone are independent from light to light. Where a lobe, interreflection or a wrong curve is
//! left in them they are alike under neighbouring lights, no number of photographs averages them out, and
//! the covariance of least squares is far too small. The correlation of the painting's residuals
//! ([`Learned::correlation`](super::Learned)) tells the two apart. Such residuals are mostly symmetric about the
//! view, and so are the lights: they tilt a normal the more the further it points away from it. With
//! the used samples' standard deviation `s` and the angle `t` between normal and view,
//! `sigma^2 = S^2 + (kappa rho sin(t) s / |b|)^2`, where `S` is the deviation of the covariance
//! `f s^2 A^-1 + (1 - f) s_LS^2 (L'L)^-1`.

use crate::math::{Mask, Real, Vec3};

use super::lanes::{NormalLanes, NormalSolution};
use super::learning::{Neighbours, PixelStatistics};
use super::lights::Lights;
use super::mm_estimation::{LeastSquares, MmEstimate, MmSamples};
use super::rejection::RejectionOutcome;
use super::rows::PlaneRows;
use super::solve::{Solution, Symmetric, SymmetricInverse};
use super::sums::{Accumulate, Squares};

/// `kappa`, calibrated on path-traced objects of known normals (docs/numerics.md).
const CORRELATED: f64 = 7.0;

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
        let spread = (least.squares * self.share.per_freedom).sqrt() / least.length;
        least.sigma = self.with_correlated(least.sigma, spread, least.normal);
        let Some(estimate) = estimate else {
            self.follow::<ALL>(bands, least.normal, least.length, None);
            return least;
        };
        self.towards::<ALL>(least, &estimate, signal, bands)
    }

    /// Adds what correlated residuals do to the error.
    #[inline(always)]
    fn with_correlated(&self, sigma: R, spread: R, normal: Vec3<R>) -> R {
        let correlation = self.learned.correlation;
        if correlation <= 0.0 {
            return sigma;
        }
        let tilt = normal.x.mul_add(normal.x, normal.y * normal.y).sqrt();
        let systematic = spread * tilt * R::of(CORRELATED * correlation);
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
        let all = (least.squares * self.share.per_freedom).sqrt() * self.share.quantile;
        self.count(estimate.used);

        let length = b.length();
        let per_length = length.recip();
        let normal = b.scale(per_length);
        let (by_all, by_weights) = (&least.start.inverse, &estimate.information.inverse());
        // Relative to the brightness, whose square is within the range of numbers, but not its fourth power.
        let all = all * per_length;
        let spread = (squares * self.share.per_freedom).sqrt() * per_length;
        let share = estimate.share;
        let covariance = Symmetric::zero()
            .plus(share * spread * spread * by_weights.per_determinant, &by_weights.adjugate)
            .plus((R::one() - share) * all * all * by_all.per_determinant, &by_all.adjugate);
        let worst = covariance.largest_tangent_eigenvalue(normal);
        let sigma = self.with_correlated(worst.sqrt(), spread, normal);

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
