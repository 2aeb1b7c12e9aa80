//! Sums over the samples of one register of pixels: the inner loops of the fit.

use crate::math::real::Part;
use crate::math::{Real, Vec3};

use super::lights::Lights;
use super::rows::PlaneRows;
use super::solve::Symmetric;

/// The product with the pseudoinverse of all lights, and the sum of the samples.
pub(super) struct Multiply<'a> {
    pub(super) pseudoinverse: &'a [Vec3<f32>],
    pub(super) signal: PlaneRows<'a>,
}

impl<R: Real<Scalar = f32>> Part<R> for Multiply<'_> {
    type Output = (Vec3<R>, R);

    #[inline(always)]
    fn compute(self) -> (Vec3<R>, R) {
        let zero = R::zero();
        let (mut b, mut total) = (Vec3::new(zero, zero, zero), zero);
        for (k, row) in self.pseudoinverse.iter().enumerate() {
            let sample: R = self.signal.at(k);
            b = row.fill().mul_add(sample, b);
            total = total + sample;
        }
        (b, total)
    }
}

/// The normal equations of the kept samples, and their sum.
pub(super) struct Accumulate<'a, L, M> {
    pub(super) lights: &'a L,
    pub(super) kept: &'a [M],
    pub(super) signal: PlaneRows<'a>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Part<R> for Accumulate<'_, L, R::Mask> {
    type Output = (Symmetric<R>, Vec3<R>, R);

    #[inline(always)]
    fn compute(self) -> Self::Output {
        let zero = R::zero();
        let (mut right, mut total) = (Vec3::new(zero, zero, zero), zero);
        let mut matrix = Symmetric::zero();
        for (k, &kept) in self.kept.iter().enumerate() {
            let light = self.lights.at(k).keep(kept);
            let sample: R = self.signal.at(k);
            matrix.add(light, light);
            right = light.mul_add(sample, right);
            total = total + R::keep(kept, sample);
        }
        (matrix, right, total)
    }
}

/// The kept samples' squared residuals; `WHOLE` means that all are kept.
pub(super) struct Squares<'a, R, L, M, const WHOLE: bool> {
    pub(super) lights: &'a L,
    pub(super) kept: &'a [M],
    pub(super) signal: PlaneRows<'a>,
    pub(super) b: Vec3<R>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>, const WHOLE: bool> Part<R>
    for Squares<'_, R, L, R::Mask, WHOLE>
{
    type Output = R;

    #[inline(always)]
    fn compute(self) -> R {
        let mut squares = R::zero();
        for (k, &kept) in self.kept.iter().enumerate() {
            let residual = residual(self.signal.at(k), self.lights.at(k), self.b);
            let residual = if WHOLE { residual } else { R::keep(kept, residual) };
            squares = residual.mul_add(residual, squares);
        }
        squares
    }
}

/// `sample - b . light`, whose order of sums is part of the results' bits.
#[inline(always)]
pub(super) fn residual<R: Real>(sample: R, light: Vec3<R>, b: Vec3<R>) -> R {
    let rest = (-light.x).mul_add(b.x, sample);
    let rest = (-light.y).mul_add(b.y, rest);
    (-light.z).mul_add(b.z, rest)
}

/// Bands that are summed together: their sums, of two registers each, hide the latency of the multiply-add.
pub(super) const TOGETHER: usize = 3;

/// The samples of all bands, and a weight for each light.
pub(super) struct WeightedSamples<'a, R: Real> {
    pub(super) weights: &'a [R],
    /// Where they count; everywhere if none.
    pub(super) kept: Option<&'a [R::Mask]>,
    pub(super) bands: PlaneRows<'a>,
    /// Bands in all.
    pub(super) count: usize,
}

impl<R: Real<Scalar = f32>> WeightedSamples<'_, R> {
    /// The sums of `N` bands. They stay in registers: of as many as a camera has, each would wait for memory.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "only loops with indices stay in line")]
    pub(super) fn sums<const N: usize>(&self, first: usize) -> [R; N] {
        let mut sums = [R::zero(); N];
        if let Some(kept) = self.kept {
            for k in 0..self.weights.len() {
                for band in 0..N {
                    let sample: R = self.bands.at(k * self.count + first + band);
                    sums[band] = self.weights[k].mul_add(R::keep(kept[k], sample), sums[band]);
                }
            }
        } else {
            for k in 0..self.weights.len() {
                for band in 0..N {
                    let sample: R = self.bands.at(k * self.count + first + band);
                    sums[band] = self.weights[k].mul_add(sample, sums[band]);
                }
            }
        }
        sums
    }
}
