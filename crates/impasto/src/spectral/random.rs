//! The `SplitMix64` generator [@steele2014splittable]: random numbers that are the same on every machine.

use nalgebra::DMatrix;

/// A stream of random numbers: `SplitMix64`.
#[derive(Clone, Debug)]
pub(super) struct Source(u64);

impl Source {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Mean 0, variance 1: the sum of twelve uniform numbers, which needs no logarithm whose last
    /// bit depends on the platform.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// `0 .. count` in random order.
    pub(super) fn permutation(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            let other = (self.uniform() * (last + 1) as f64) as usize;
            order.swap(last, other);
        }
        order
    }

    /// The matrix with white noise of standard deviation `sigma` added.
    pub(super) fn noisy(&mut self, matrix: &DMatrix<f64>, sigma: f64) -> DMatrix<f64> {
        matrix.map(|value| self.normal().mul_add(sigma, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_variance_it_claims() {
        let noise = Source::new(1).noisy(&DMatrix::zeros(200, 200), 2.0);
        // 40 000 numbers: the mean's standard error is 0.01, the variance's 4 sqrt(2 / 40000).
        assert!(noise.mean().abs() < 0.05);
        assert!((noise.variance() - 4.0).abs() < 0.15);
    }

    #[test]
    fn a_permutation_holds_every_number_once() {
        let mut order = Source::new(7).permutation(100);
        assert_ne!(order, (0..100).collect::<Vec<_>>());
        order.sort_unstable();
        assert_eq!(order, (0..100).collect::<Vec<_>>());
    }
}
