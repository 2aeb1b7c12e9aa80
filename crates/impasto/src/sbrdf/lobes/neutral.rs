//! Model selection by BIC [@schwarz1978bic]: whether a lobe is neutral, as an interface reflects, or
//! tinted, as metal does.
//!
//! A neutral lobe has one strength in all bands. Its shape and the normal stay where the search
//! left them; its strength is the least-squares solution over all bands, with everything else that
//! enters linearly re-solved in each band. Lobes are tested in their order, each together with the
//! neutral ones before it.

use crate::math::{Mask, Real};

use crate::lm::nnls::Sums;

/// The thresholds of the test.
pub(super) struct NeutralTest<R> {
    /// Factor by which one strength for all bands may raise the weighted sum of squares.
    pub(super) price: R,
    /// Weighted sum of squares of the samples' rounding.
    pub(super) rounding: R,
}

/// The weighted sum of squared residuals of some colours. A trait and not a closure: the compiler
/// turns a closure with several calls into a function, without the kernel's instruction set.
pub(super) trait ResidualSum<R, const K: usize> {
    /// From the colours of each band; it must be `#[inline(always)]`.
    fn of(&self, colours: &[[R; K]]) -> R;
}

impl<R: Real> NeutralTest<R> {
    /// Gives each lobe one strength for all bands, lane by lane, where BIC accepts it; returns where.
    /// `colours` are the solution of each band in `sums`, `trial` is scratch memory of the same size.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn constrain<const J: usize, const K: usize>(
        &self,
        sums: &mut [Sums<R, K>],
        barred: &[bool; K],
        (colours, trial): (&mut [[R; K]], &mut [[R; K]]),
        cost: &impl ResidualSum<R, K>,
    ) -> [R::Mask; J] {
        let (zero, bands) = (R::zero(), sums.len());
        let mut neutral = [R::Mask::splat(false); J];
        let mut shared = [zero; K];
        let mut least = cost.of(colours);
        for column in 1..=J {
            let (mut gain, mut fall) = (zero, zero);
            for band in 0..bands {
                let [more, less] = sums[band].pull(column, &colours[band]);
                gain = gain + more;
                fall = fall + less;
            }
            // A lobe that the pixel lacks, or whose best strength is 0, is neither.
            let present = gain.gt(zero) & fall.gt(zero);
            let strength = R::keep(present, gain / fall);
            let everywhere = R::Mask::splat(true);
            for band in 0..bands {
                let mut own = sums[band].hold(column, strength, everywhere).solve(barred).values;
                own[column] = strength;
                for i in 0..K {
                    own[i] = own[i] + shared[i];
                }
                trial[band] = own;
            }
            let left = cost.of(trial);
            let accepted = present & left.le(self.price * least.max(self.rounding));
            for band in 0..bands {
                sums[band] = sums[band].hold(column, strength, accepted);
                for i in 0..K {
                    colours[band][i] = R::select(accepted, trial[band][i], colours[band][i]);
                }
            }
            shared[column] = R::keep(accepted, strength);
            least = R::select(accepted, left, least);
            neutral[column - 1] = accepted;
        }
        neutral
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Scene {
        columns: Vec<[f64; 3]>,
        samples: [Vec<f64>; 3],
    }

    impl ResidualSum<f64, 3> for Scene {
        fn of(&self, colours: &[[f64; 3]]) -> f64 {
            let mut left = 0.0;
            for (colours, samples) in colours.iter().zip(&self.samples) {
                for (c, y) in self.columns.iter().zip(samples) {
                    let shown: f64 = colours.iter().zip(c).map(|(a, b)| a * b).sum();
                    left += (y - shown) * (y - shown);
                }
            }
            left
        }
    }

    /// Three bands of a lobe beside a diffuse term; strengths as given, samples off by `noise`.
    fn test(strengths: [f64; 3], noise: f64) -> (bool, [[f64; 3]; 3]) {
        let mut seed = 7_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let rows = 40;
        let columns: Vec<[f64; 3]> = (0..rows)
            .map(|i| {
                let t = f64::from(i) / f64::from(rows);
                [1.0 - 0.5 * t, (-20.0 * (t - 0.4) * (t - 0.4)).exp(), 1.0]
            })
            .collect();
        let samples = strengths.map(|strength| {
            columns
                .iter()
                .map(|c| 0.3 * c[0] + strength * c[1] + noise * random())
                .collect::<Vec<_>>()
        });
        let mut sums = [Sums::<f64, 3>::zero(); 3];
        for (sums, samples) in sums.iter_mut().zip(&samples) {
            columns.iter().zip(samples).for_each(|(c, &y)| sums.add(c, 1.0, y));
        }
        let barred = [false, false, true];
        let mut colours = sums.map(|sums| sums.solve(&barred).values);
        let m = f64::from(3 * rows);
        let test = NeutralTest { price: (2.0 * m.ln() / m).exp(), rounding: 1e-20 };
        let scene = Scene { columns, samples };
        let memory = (&mut colours[..], &mut [[0.0; 3]; 3][..]);
        let [neutral] = test.constrain::<1, 3>(&mut sums, &barred, memory, &scene);
        (neutral, colours)
    }

    #[test]
    fn equal_strengths_are_one_and_gold_keeps_its_colour() {
        for noise in [0.0, 0.01] {
            let (neutral, colours) = test([2.0; 3], noise);
            assert!(neutral);
            let apart = noise.max(1e-12);
            assert!(colours.iter().all(|c| c[1] == colours[0][1] && (c[1] - 2.0).abs() < apart));
            let (neutral, colours) = test([2.0, 1.5, 0.7], noise);
            assert!(!neutral);
            assert!((colours[2][1] - 0.7).abs() < noise.max(1e-12));
        }
    }
}
