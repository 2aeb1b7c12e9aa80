//! Rejection of outliers: samples that do not show the surface (hard case 31), by the median absolute
//! deviation of the residuals.

use crate::geometry::Rig;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Real};

use super::colours::{COLUMNS, LaneLobes, gather};
use super::estimate::{LafortuneEstimate, OUTLIER_DEVIATIONS, OUTLIER_SHARE};
use super::scratch::{LafortuneScratch, STRIDE};

/// A normal deviation over the median size.
const PER_MEDIAN: f64 = 1.4826;

/// Weights the samples of some pixels anew: 0 for outliers, else 1. Returns per pixel whether its
/// choice of samples changed; its cost is then that of the new choice.
pub(super) struct Outliers<'a> {
    pub(super) rig: &'a Rig,
    pub(super) scratch: &'a mut LafortuneScratch,
    pub(super) pixels: &'a [usize],
    pub(super) found: &'a mut [LafortuneEstimate],
}

impl Kernel for Outliers<'_> {
    type Output = Vec<bool>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<bool> {
        let Self { rig, scratch, pixels, found } = self;
        let width = I::F32::WIDTH;
        let mut off = vec![[[0.0_f32; MAX_LANES]; 2]; rig.observations()];
        let mut sizes = Vec::with_capacity(rig.observations());
        let mut changed = Vec::with_capacity(pixels.len());
        for (pixels, found) in pixels.chunks(width).zip(found.chunks_mut(width)) {
            let facets = LaneLobes::<I::F32>::new(scratch, pixels, found);
            let strengths: [I::F32; COLUMNS] = core::array::from_fn(|column| {
                gather(pixels, |place, _| found[place].strength(column) as f32)
            });
            for (photograph, [residuals, shares]) in off.iter_mut().enumerate() {
                let plane = &scratch.means[photograph * STRIDE..];
                let sample: I::F32 = gather(pixels, |_, pixel| plane[pixel]);
                let mut shown = I::F32::zero();
                for (column, strength) in facets.columns(rig, photograph).into_iter().zip(strengths)
                {
                    shown = column.mul_add(strength, shown);
                }
                (sample - shown).store(residuals);
                (I::F32::splat(OUTLIER_SHARE) * sample.max(shown)).store(shares);
            }
            for (lane, (&pixel, found)) in pixels.iter().zip(found).enumerate() {
                sizes.clear();
                sizes.extend(off.iter().map(|[r, _]| r[lane].abs()).filter(|r| r.is_finite()));
                let limit = limit(&mut sizes, found);
                let (mut cost, mut samples, mut new) = (0.0_f64, 0, false);
                for (photograph, [residuals, shares]) in off.iter().enumerate() {
                    let residual = residuals[lane];
                    let outlier = residual.abs() > limit && residual.abs() > shares[lane];
                    let place = photograph * STRIDE + pixel;
                    let sample = if outlier { f32::NAN } else { scratch.means[place] };
                    new |= sample.is_finite() != scratch.kept[place].is_finite();
                    scratch.kept[place] = sample;
                    if sample.is_finite() {
                        cost = f64::from(residual).mul_add(f64::from(residual), cost);
                        samples += 1;
                    }
                }
                if new {
                    (found.cost, found.samples) = (cost, samples);
                }
                changed.push(new);
            }
        }
        changed
    }
}

/// Residuals above this are outliers; `sizes` are in any order afterwards.
fn limit(sizes: &mut [f32], found: &LafortuneEstimate) -> f32 {
    // Rounding is no outlier where there is no noise.
    six_deviations(sizes).max(found.floor.sqrt() as f32)
}

/// Six deviations of residuals of these sizes, by their median.
pub(super) fn six_deviations(sizes: &mut [f32]) -> f32 {
    if sizes.is_empty() {
        return f32::INFINITY;
    }
    let middle = sizes.len() / 2;
    let (_, &mut median, _) = sizes.select_nth_unstable_by(middle, f32::total_cmp);
    (OUTLIER_DEVIATIONS * PER_MEDIAN * f64::from(median)) as f32
}
