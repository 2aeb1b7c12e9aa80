//! Batcher's odd-even merge sorting network [@batcher1968sorting], lane by lane and without a branch.

use crate::math::Real;

/// The comparators for any length (Knuth, TAOCP vol. 3, algorithm 5.2.2M).
#[derive(Clone, Debug)]
pub(super) struct SortingNetwork(Vec<(usize, usize)>);

impl SortingNetwork {
    pub(super) fn new(length: usize) -> Self {
        let mut comparators = Vec::new();
        let mut p = 1;
        while p < length {
            let mut k = p;
            while k >= 1 {
                for start in (k % p..length.saturating_sub(k)).step_by(2 * k) {
                    for i in start..(start + k).min(length - k) {
                        if i / (2 * p) == (i + k) / (2 * p) {
                            comparators.push((i, i + k));
                        }
                    }
                }
                k /= 2;
            }
            p *= 2;
        }
        Self(comparators)
    }

    /// Sorts upwards, each lane on its own.
    #[inline(always)]
    pub(super) fn sort<R: Real>(&self, values: &mut [R]) {
        for &(low, high) in &self.0 {
            let (a, b) = (values[low], values[high]);
            values[low] = a.min(b);
            values[high] = a.max(b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sequence_of_zeros_and_ones_is_sorted() {
        // The zero-one principle: a network that sorts these sorts everything.
        for length in 1..=12_usize {
            let network = SortingNetwork::new(length);
            for bits in 0..1_u32 << length {
                let mut values: Vec<f32> =
                    (0..length).map(|i| if bits >> i & 1 == 1 { 1.0 } else { 0.0 }).collect();
                network.sort(&mut values);
                assert!(values.is_sorted(), "{length} {bits:b}");
            }
        }
    }

    #[test]
    fn sixteen_values_take_sixty_three_comparators() {
        assert_eq!(SortingNetwork::new(16).0.len(), 63);
    }
}
