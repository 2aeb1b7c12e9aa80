//! The results of one register of pixels: statuses, errors, and how they are written to the maps.

use crate::maps::{Rejection, Status};
use crate::math::{Mask, Real, Vec3};

use super::lanes::{NormalLanes, NormalSolution};
use super::rejection::RejectionOutcome;
use super::rows::{any, store, store_codes, store_counts};
use super::solve::{Solution, determined, well_determined};
use super::tile::NormalTile;

/// A register's results; the albedo stays in [`NormalLanes`].
pub(super) struct NormalResults<R: Real> {
    normal: Vec3<R>,
    residual: R,
    condition: R,
    sigma: R,
    status: R,
    used: R,
    shadow: R,
    highlight: R,
}

#[inline(always)]
fn code<R: Real>(status: Status) -> R {
    R::of(f64::from(status.code()))
}

impl<R: Real<Scalar = f32>> NormalResults<R> {
    #[inline(always)]
    pub(super) fn new<L>(pixels: &NormalLanes<R, L>, estimate: &NormalSolution<R>) -> Self {
        let NormalSolution { ref rejection, ref start, normal, length, squares, worst, sigma } =
            *estimate;
        Self {
            normal,
            residual: (squares * pixels.share.per_count).sqrt(),
            condition: start.condition,
            sigma,
            status: status(pixels, rejection, start, &Magnitudes { length, squares, worst, sigma }),
            used: rejection.kept,
            shadow: rejection.shadow,
            highlight: rejection.highlight,
        }
    }

    #[inline(always)]
    pub(super) fn write<L>(
        &self,
        pixels: &NormalLanes<R, L>,
        tile: &mut NormalTile<'_>,
        at: usize,
    ) {
        let nan = R::splat(f32::NAN);
        if let Some(used) = &mut tile.used {
            store_counts(self.used, used, at);
        }
        let all = R::of(pixels.kept.len() as f64);
        let counted = !tile.rejected.is_empty();
        let rejected = if counted && any(all - self.used) { Rejection::COUNT } else { 0 };
        let invalid = all - pixels.valid - pixels.saturated;
        for (reason, count) in [
            (Rejection::Saturated, pixels.saturated),
            (Rejection::Invalid, invalid),
            (Rejection::Shadow, self.shadow),
            (Rejection::Highlight, self.highlight),
        ]
        .into_iter()
        .take(rejected)
        {
            if any(count) {
                store_counts(count, tile.rejected[reason as usize], at);
            }
        }
        let maps = [
            (&mut tile.residual, self.residual),
            (&mut tile.condition, self.condition),
            (&mut tile.sigma, self.sigma),
        ];
        if !any(self.status) {
            for (plane, value) in tile.normal.iter_mut().zip(self.normal.array()) {
                store(value, plane, at);
            }
            for (plane, &value) in tile.albedo.iter_mut().zip(&pixels.albedo) {
                store(value, plane, at);
            }
            for (plane, value) in maps {
                if let Some(plane) = plane {
                    store(value, plane, at);
                }
            }
            return;
        }
        store_codes(self.status, tile.status, at);
        let estimated = self.status.lt(code(Status::Dark));
        let dark = self.status.le(code(Status::Dark)) & !estimated;
        // One sample more than unknowns.
        let spare = estimated & self.used.gt(R::of(3.0));
        for (plane, value) in tile.normal.iter_mut().zip(self.normal.array()) {
            store(R::select(estimated, value, nan), plane, at);
        }
        for (plane, &value) in tile.albedo.iter_mut().zip(&pixels.albedo) {
            let value = R::select(estimated, value, nan);
            store(R::select(dark, R::zero(), value), plane, at);
        }
        for ((plane, value), known) in maps.into_iter().zip([spare, estimated, spare]) {
            if let Some(plane) = plane {
                store(R::select(known, value, nan), plane, at);
            }
        }
    }
}

/// Least length whose square single precision holds with all its digits: its least normal number is
/// 2^-126. A shorter albedo's direction is no unit vector, and its pixel as good as black.
pub(super) const SHORTEST: f64 = 1.0 / 9_223_372_036_854_775_808.0;

/// Numbers that must lie within the range of single precision.
struct Magnitudes<R> {
    /// Of the albedo times the normal.
    length: R,
    /// Sum of the residuals' squares.
    squares: R,
    /// Variance along the worst tangent.
    worst: R,
    /// Deviation of the normal: squares and variance at once.
    sigma: R,
}

/// Why the pixels are what they are. The first that holds: too few samples; dark; coplanar
/// lights; beyond single precision; no inverse; no spare sample; lights nearly coplanar; samples
/// taken back.
#[inline(always)]
fn status<R: Real<Scalar = f32>, L>(
    pixels: &NormalLanes<R, L>,
    rejection: &RejectionOutcome<R>,
    &Solution { squared, total, .. }: &Solution<R>,
    &Magnitudes { length, squares, worst, sigma }: &Magnitudes<R>,
) -> R {
    let zero = R::zero();
    let three = R::of(3.0);
    let solved = determined(squared);
    let lit = total.gt(zero) & (length.ge(R::of(SHORTEST)) | !solved);
    // Irradiances so unlike that rounding leaves no inverse have a condition that is rounding, too.
    let certain = worst.ge(zero);
    let spare = rejection.kept.gt(three);
    let sigma_known = sigma.is_finite() | !(spare & certain);
    let finite = length.is_finite() & squares.is_finite() & sigma_known;
    let plain = lit & solved & well_determined(squared) & finite & certain;
    if (plain & spare & !rejection.relaxed).all() {
        return zero;
    }
    let mut status = R::select(rejection.relaxed, code(Status::Relaxed), code(Status::Fitted));
    status = R::select(well_determined(squared), status, code(Status::IllConditioned));
    status = R::select(spare, status, code(Status::Exact));
    status = R::select(certain, status, code(Status::RankDeficient));
    // Squares of samples beyond 1e19 are infinite in single precision; where lights tell little of a
    // normal, what noise does to it is from fewer on.
    status = R::select(finite, status, code(Status::InvalidInput));
    status = R::select(solved, status, code(Status::RankDeficient));
    status = R::select(lit, status, code(Status::Dark));
    let seen = pixels.valid + pixels.saturated;
    let clipped = seen.ge(three) & pixels.saturated.gt(zero);
    let few = R::select(clipped, code(Status::Saturated), code(Status::TooFewSamples));
    let few = R::select(seen.gt(zero), few, code(Status::InvalidInput));
    R::select(pixels.valid.ge(three), status, few)
}
