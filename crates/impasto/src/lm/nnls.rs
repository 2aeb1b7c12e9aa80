//! Non-negative least squares [@lawson1974nnls] over a few columns, one problem per lane, by block
//! principal pivoting [@portugal1994nnls].

use super::cholesky::{Factor, factor};
use crate::math::{Mask, Real};

/// So many times all columns that are wrong change sides together; then one at a time.
const AT_ONCE: usize = 4;

/// Changes of the free columns at most: those, two for each of up to five columns, which hard cases
/// take, and the last look.
/// Neither limit depends on the number of columns: a pixel in a register whose others have more
/// lobes goes through the same changes as without them.
const MOST_CHANGES: usize = 15;

/// Slope of a column at 0, relative to what its samples could pull, below which it stays there.
const FLAT: f64 = 1e-5;

/// Sums over samples: `gram = sum w c c'` (lower triangle) and `right = sum w c y`.
#[derive(Clone, Copy, Debug)]
pub struct Sums<R, const K: usize> {
    gram: [[R; K]; K],
    right: [R; K],
    square: R,
}

/// Loops with indices: iterators over arrays become calls, without a kernel's instruction set.
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
impl<R: Real, const K: usize> Sums<R, K> {
    /// Of no samples.
    #[must_use]
    #[inline(always)]
    pub fn zero() -> Self {
        Self { gram: [[R::zero(); K]; K], right: [R::zero(); K], square: R::zero() }
    }

    /// Adds a sample with its columns.
    #[inline(always)]
    pub fn add(&mut self, columns: &[R; K], weight: R, sample: R) {
        let pull = weight * sample;
        self.square = pull.mul_add(sample, self.square);
        for i in 0..K {
            let heavy = weight * columns[i];
            self.right[i] = pull.mul_add(columns[i], self.right[i]);
            for j in 0..=i {
                self.gram[i][j] = heavy.mul_add(columns[j], self.gram[i][j]);
            }
        }
    }

    /// The sums that are left once a column has this strength in the chosen lanes; there it is
    /// fixed.
    #[must_use]
    #[inline(always)]
    pub fn hold(&self, column: usize, strength: R, chosen: R::Mask) -> Self {
        let mut left = *self;
        for i in 0..K {
            let shared = self.entry(i, column);
            left.right[i] = R::keep(chosen, -strength).mul_add(shared, self.right[i]);
            let (row, other) = if i >= column { (i, column) } else { (column, i) };
            left.gram[row][other] = R::keep(!chosen, shared);
        }
        left.right[column] = R::keep(!chosen, self.right[column]);
        left
    }

    /// What a column pulls at 0 (half the slope of the sum of squares) and how that falls with more
    /// of it, the columns that are free in this best solution following: their quotient is the best
    /// strength.
    #[must_use]
    #[inline(always)]
    pub fn pull(&self, column: usize, best: &[R; K]) -> [R; 2] {
        let zero = R::zero();
        let mut held = [R::Mask::splat(true); K];
        let mut shared = [zero; K];
        for i in 0..K {
            if i != column {
                held[i] = !best[i].gt(zero);
            }
            shared[i] = self.entry(i, column);
        }
        let follow = factor(&self.gram, zero, &held).solve(&shared);
        let (mut fall, mut slope) = (shared[column], self.right[column]);
        for i in 0..K {
            fall = (-shared[i]).mul_add(follow[i], fall);
            slope = (-shared[i]).mul_add(best[i], slope);
        }
        [fall.mul_add(best[column], slope), fall]
    }

    /// The weighted sum of squared samples.
    #[must_use]
    #[inline(always)]
    pub fn square(&self) -> R {
        self.square
    }

    /// What the best solution leaves of the sum of squares, to the rounding of that sum.
    #[must_use]
    #[inline(always)]
    pub fn left(&self, best: &[R; K]) -> R {
        let mut left = self.square;
        for i in 0..K {
            left = (-self.right[i]).mul_add(best[i], left);
        }
        left.max(R::zero())
    }

    #[inline(always)]
    fn entry(&self, i: usize, j: usize) -> R {
        if i >= j { self.gram[i][j] } else { self.gram[j][i] }
    }

    /// The solution that leaves the smallest residuals, no strength negative; the columns in
    /// `barred` stay 0. Columns change sides together a few times, then one at a time
    /// (Murty), which ends; far beyond what hard cases take, it is cut off.
    #[must_use]
    #[inline(always)]
    pub fn solve(&self, barred: &[bool; K]) -> Solution<R, K> {
        let zero = R::zero();
        let mut held = [R::Mask::splat(false); K];
        for i in 0..K {
            held[i] = R::Mask::splat(barred[i]) | !self.gram[i][i].gt(zero);
        }
        let never = held;
        let mut change = 0;
        loop {
            let factor = factor(&self.gram, zero, &held);
            let mut values = factor.solve(&self.right);
            let mut wrong = [R::Mask::splat(false); K];
            let mut any = R::Mask::splat(false);
            for i in 0..K {
                let mut slope = self.right[i];
                for j in 0..K {
                    slope = (-self.entry(i, j)).mul_add(values[j], slope);
                }
                let reach = R::of(FLAT) * (self.gram[i][i] * self.square).sqrt();
                let wanted = held[i] & !never[i] & slope.gt(reach);
                wrong[i] = wanted | (!held[i] & values[i].lt(zero));
                any = any | wrong[i];
            }
            change += 1;
            if !any.any() || change == MOST_CHANGES {
                for i in 0..K {
                    values[i] = values[i].max(zero);
                }
                return Solution { values, factor };
            }
            // A lane that is right keeps its columns: its neighbours change nothing for it.
            let one_by_one = change > AT_ONCE;
            let mut taken = R::Mask::splat(false);
            for i in (0..K).rev() {
                let swap = if one_by_one { wrong[i] & !taken } else { wrong[i] };
                taken = taken | swap;
                held[i] = (held[i] & !swap) | (!held[i] & swap);
            }
        }
    }
}

/// The strengths of the columns.
#[derive(Clone, Copy, Debug)]
pub struct Solution<R: Real, const K: usize> {
    /// Strengths.
    pub values: [R; K],
    /// Of the columns that are free.
    pub factor: Factor<R, K>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All subsets of columns, tried one by one.
    fn exhaustive(sums: &Sums<f64, 4>) -> f64 {
        let mut best = 0.0_f64;
        for subset in 0..16 {
            let held: [bool; 4] = core::array::from_fn(|i| subset >> i & 1 == 0);
            let x = factor(&sums.gram, 0.0, &held).solve(&sums.right);
            if x.iter().all(|&x| x >= 0.0) {
                let gain: f64 = x.iter().zip(&sums.right).map(|(x, b)| x * b).sum();
                best = best.max(gain);
            }
        }
        best
    }

    #[test]
    fn it_finds_what_trying_every_subset_finds() {
        let mut seed = 1_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 40) as f64 / f64::from(1 << 24)
        };
        for round in 0..500 {
            let mut sums = Sums::<f64, 4>::zero();
            for _ in 0..12 {
                // Columns that overlap, as wide lobes and a cosine do.
                let shared = random();
                let columns = core::array::from_fn(|_| 0.3 * random() + shared);
                sums.add(&columns, random(), random() - 0.3 * f64::from(round % 3));
            }
            let found = sums.solve(&[false; 4]);
            assert!(found.values.iter().all(|&x| x >= 0.0));
            let gain = |x: &[f64; 4]| {
                let mut gain = 0.0;
                for i in 0..4 {
                    gain += 2.0 * x[i] * sums.right[i];
                    for j in 0..4 {
                        gain -= x[i] * x[j] * sums.gram[i.max(j)][i.min(j)];
                    }
                }
                gain
            };
            // Slopes of FLAT are left alone; what they could bring is their square.
            let best = exhaustive(&sums);
            assert!(gain(&found.values) >= best - 1e-9 * sums.square, "{round}");
        }
    }

    /// One of 300,000 random problems: all at once, its columns change sides for ever.
    #[test]
    fn columns_that_change_sides_for_ever_end_one_at_a_time() {
        let rows = [
            ([1.87, 1.54, 1.83, 1.4], 1.11),
            ([1.6, 1.48, 1.74, 1.07], 0.34),
            ([1.91, 1.93, 1.39, 2.06], 2.14),
            ([0.43, 0.94, 0.44, 0.98], 0.42),
            ([1.45, 1.1, 1.64, 0.78], 1.4),
            ([0.72, 0.81, 0.7, 0.72], -0.27),
        ];
        let mut sums = Sums::<f64, 4>::zero();
        for (columns, sample) in rows {
            sums.add(&columns, 1.0, sample);
        }
        let found = sums.solve(&[false; 4]).values;
        let gain: f64 = found.iter().zip(&sums.right).map(|(x, b)| x * b).sum();
        let best = exhaustive(&sums);
        assert!(found.iter().all(|&x| x >= 0.0));
        // The same columns give the same sum but for rounding; the next best subset gains 1 % less.
        assert!(best > 0.0 && (gain - best).abs() <= 1e-12 * sums.square, "{gain} {best}");
    }

    /// Pixels with fewer lobes than others of their register have columns of zeros.
    #[test]
    fn columns_of_zeros_change_no_bit() {
        let mut seed = 3_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 40) as f32 / (1 << 24) as f32
        };
        for _ in 0..20_000 {
            let mut own = Sums::<f32, 3>::zero();
            let mut beside = Sums::<f32, 5>::zero();
            for _ in 0..6 {
                // Nearly the same columns: rounding turns them about again and again.
                let shared = random();
                let [a, b, c] = core::array::from_fn(|_| shared + 1e-4 * random());
                let (weight, sample) = (random(), random() - 0.5);
                own.add(&[a, b, c], weight, sample);
                beside.add(&[a, b, 0.0, 0.0, c], weight, sample);
            }
            let [own, beside] =
                [own.solve(&[false; 3]).values.to_vec(), beside.solve(&[false; 5]).values.to_vec()];
            assert_eq!(own, [beside[0], beside[1], beside[4]]);
            assert_eq!(beside[2..4], [0.0; 2]);
        }
    }

    #[test]
    fn a_column_is_held_where_its_best_strength_is_found() {
        let mut sums = Sums::<f64, 3>::zero();
        for i in 0..9 {
            let t = f64::from(i);
            // The third column pulls below 0 and stays there.
            sums.add(&[1.0, t, t * t], 1.0 + 0.1 * t, 2.0 + 3.0 * t - 0.2 * t * t);
        }
        let free = sums.solve(&[false; 3]).values;
        assert!(free[1] > 0.0 && free[2] == 0.0);
        let [gain, fall] = sums.pull(1, &free);
        let best = gain / fall;
        // Nine terms rounded to 2e-16, up to six times as large as the differences of their sums: 1e-14.
        assert!((best / free[1] - 1.0).abs() < 1e-12, "{best} {}", free[1]);
        let held = sums.hold(1, best, true).solve(&[false; 3]).values;
        // The same terms, twice as large as their difference.
        assert!((held[0] / free[0] - 1.0).abs() < 1e-12 && held[1] == 0.0 && held[2] == 0.0);
        assert_eq!(sums.hold(1, best, false).solve(&[false; 3]).values, free);
    }

    #[test]
    fn a_column_that_is_barred_or_dark_stays_0() {
        let mut sums = Sums::<f64, 3>::zero();
        for i in 0..5 {
            let t = f64::from(i);
            sums.add(&[1.0, t, 0.0], 1.0, 1.0 + t);
        }
        let found = sums.solve(&[false; 3]).values;
        // Sums of whole numbers are exact; their equations have a condition number of 22: 22 x 2e-16.
        assert!((found[0] - 1.0).abs() < 1e-12 && (found[1] - 1.0).abs() < 1e-12);
        assert_eq!(found[2], 0.0);
        assert_eq!(sums.solve(&[true, false, false]).values[0], 0.0);
    }
}
