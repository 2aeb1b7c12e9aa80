//! How much of a pixel's residuals is an error of the model.
//!
//! A sensor's noise differs from band to band, a wrong lobe or reflected light is alike in all: the
//! intraclass correlation of the bands [@fisher1925methods] is 0 for noise and 1 for an error that all
//! bands share. With one band, the correlation of neighbouring lights takes its place.

use crate::math::{Mask, Real};

/// Neighbours of a light.
const NEAREST: f64 = 3.0;

/// Sums over the weighted residuals of a register of pixels.
pub(super) struct Coherence<R> {
    bands: usize,
    /// Of the present photograph.
    sum: R,
    /// Squared sums over the bands of a photograph.
    together: R,
    /// Squares of the residuals.
    squares: R,
    /// Of each photograph, where there is one band, with 1 where it counts.
    single: Vec<[R; 2]>,
}

impl<R: Real> Coherence<R> {
    pub(super) fn new(photographs: usize, bands: usize) -> Self {
        let zero = R::zero();
        let single = if bands == 1 { photographs } else { 0 };
        Self { bands, sum: zero, together: zero, squares: zero, single: vec![[zero; 2]; single] }
    }

    #[inline(always)]
    pub(super) fn clear(&mut self) {
        let zero = R::zero();
        (self.sum, self.together, self.squares) = (zero, zero, zero);
    }

    /// Adds a residual in units of its noise, where it counts.
    #[inline(always)]
    pub(super) fn add(&mut self, photograph: usize, residual: R, counts: R::Mask) {
        let residual = R::keep(counts, residual);
        self.sum = self.sum + residual;
        self.squares = residual.mul_add(residual, self.squares);
        if self.bands == 1 {
            self.single[photograph] = [residual, R::keep(counts, R::one())];
        }
    }

    /// Must follow the last band of every photograph.
    #[inline(always)]
    pub(super) fn end_photograph(&mut self) {
        self.together = self.sum.mul_add(self.sum, self.together);
        self.sum = R::zero();
    }

    /// From 0, noise, to 1: all of it is an error that bands, or the `nearest` lights, share.
    #[inline(always)]
    pub(super) fn share(&self, nearest: &[Vec<usize>]) -> R {
        let (zero, one) = (R::zero(), R::one());
        let mut shared =
            (self.together - self.squares) * R::of(1.0 / (self.bands.max(2) - 1) as f64);
        let mut squares = self.squares;
        if self.bands == 1 {
            (shared, squares) = (zero, zero);
            for (&[own, counts], others) in self.single.iter().zip(nearest) {
                let mut found = zero;
                for &other in others {
                    let [other, also] = self.single[other];
                    let both = counts.gt(zero) & also.gt(zero) & found.lt(R::of(NEAREST));
                    let (own, other) = (R::keep(both, own), R::keep(both, other));
                    found = found + R::keep(both, one);
                    shared = own.mul_add(other, shared);
                    squares = own.mul_add(own, other.mul_add(other, squares));
                    if found.ge(R::of(NEAREST)).all() {
                        break;
                    }
                }
            }
            squares = squares * R::of(0.5);
        }
        let share = shared / squares;
        R::keep(share.is_finite(), share).max(zero).min(one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals `shared + own`, of variances `share` and `1 - share`.
    fn found(bands: usize, share: f64) -> f64 {
        let mut seed = 3_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            ((seed >> 40) as f64 / f64::from(1 << 24) - 0.5) * 12.0_f64.sqrt()
        };
        let count = 20_000;
        let mut coherence = Coherence::<f64>::new(count, bands);
        for photograph in 0..count {
            let shared = random();
            for _ in 0..bands {
                let own = random();
                coherence.add(photograph, share.sqrt() * shared + (1.0 - share).sqrt() * own, true);
            }
            coherence.end_photograph();
        }
        coherence.share(&[])
    }

    #[test]
    fn the_share_that_bands_have_in_common() {
        // 20000 photographs leave 0.7 %.
        for bands in [2, 3, 6] {
            for share in [0.0, 0.3, 0.9, 1.0] {
                assert!((found(bands, share) - share).abs() < 0.03, "{bands} {share}");
            }
        }
    }

    #[test]
    fn of_one_band_that_of_neighbouring_lights() {
        let pairs = [vec![1], vec![0], vec![3], vec![2]];
        for (residuals, expected) in [([1.0, 1.0, -2.0, -2.0], 1.0), ([1.0, -1.0, 2.0, -2.0], 0.0)]
        {
            let mut coherence = Coherence::<f64>::new(4, 1);
            for (photograph, residual) in residuals.into_iter().enumerate() {
                coherence.add(photograph, residual, true);
                coherence.end_photograph();
            }
            assert_eq!(coherence.share(&pairs), expected);
        }
    }

    #[test]
    fn no_residual_is_no_error() {
        assert_eq!(found(1, 0.0), 0.0);
        assert_eq!(Coherence::<f32>::new(4, 3).share(&[]), 0.0);
    }
}
