//! One register of pixels on its way through the fit.

use crate::math::{Mask, Real, Vec3};

use super::lights::Lights;
use super::loss::{Absolute, Cauchy, Huber, Loss, Share, Tukey};
use super::problem::Problem;
use super::reweigh::Reweigh;
use super::rows::{MAX_LANES, Rows, any};
use super::rule::{Ranks, Rule, Verdict, threshold};
use super::samples::{Samples, Sifted};
use super::solve::{Inverse, Solution, Symmetric};
use super::sums::{Accumulate, Multiply, Squares};

/// What a register's samples say of its pixels; the albedo stays in [`Pixels`].
pub(super) struct Estimate<R: Real> {
    pub(super) verdict: Verdict<R>,
    /// Least squares over the kept samples.
    pub(super) start: Solution<R>,
    /// After reweighting.
    pub(super) normal: Vec3<R>,
    /// Of the normal times the albedo, and one over it.
    pub(super) length: R,
    pub(super) per_length: R,
    /// Sum of the residuals' squares.
    pub(super) squares: R,
}

pub(super) struct Pixels<R: Real, L> {
    rule: Rule,
    loss: Loss,
    steps: usize,
    ranks: Option<Ranks<R>>,
    reweigh: Reweigh<R>,
    pub(super) lights: L,
    /// Of all lights, where that is the same for every pixel; without `b` and `total`.
    uniform: Option<Solution<R>>,
    /// Rows of the pseudoinverse of all lights.
    pseudoinverse: Vec<Vec3<f32>>,
    /// Which samples a rule kept.
    pub(super) kept: Vec<R::Mask>,
    /// Number of valid samples, and of clipped ones.
    pub(super) valid: R,
    pub(super) saturated: R,
    /// Of as many samples as the last pixels kept.
    pub(super) share: Share<R>,
    /// Every band's albedo.
    pub(super) albedo: Vec<R>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Pixels<R, L> {
    #[inline(always)]
    pub(super) fn new(problem: &Problem<'_>) -> Self {
        let shape = problem.stack.shape();
        let (zero, count) = (R::zero(), shape.observations);
        let mut pixels = Self {
            rule: problem.rule,
            loss: problem.loss,
            steps: problem.options.steps,
            ranks: match problem.rule {
                Rule::Rank { low, high } => Some(Ranks::new((low, high), count)),
                _ => None,
            },
            reweigh: Reweigh::new(count),
            lights: L::new(problem.rig),
            uniform: None,
            pseudoinverse: Vec::new(),
            kept: vec![Mask::splat(false); count],
            valid: zero,
            saturated: zero,
            share: Share::of(zero, problem.loss),
            albedo: vec![zero; shape.bands],
        };
        if let Some(uniform) = &problem.uniform {
            pixels.pseudoinverse = uniform.pseudoinverse.iter().map(|row| row.splat()).collect();
            pixels.uniform = Some(Solution {
                b: Vec3::new(zero, zero, zero),
                total: zero,
                matrix: uniform.matrix.splat(),
                inverse: Inverse {
                    adjugate: uniform.inverse.adjugate.splat(),
                    per_determinant: R::of(uniform.inverse.per_determinant),
                },
                squared: R::of(uniform.squared),
                condition: R::of(uniform.squared.sqrt()),
            });
        }
        pixels
    }

    /// Everything about pixels whose samples are all valid; `sum` is that of the means.
    #[inline(always)]
    pub(super) fn fit_all(
        &mut self,
        samples: &Samples<'_>,
        mut sum: R,
        sifted: &mut Sifted,
    ) -> Estimate<R> {
        self.valid = R::of(self.kept.len() as f64);
        self.saturated = R::zero();
        let mut relative = samples.means;
        if !L::DISTANT && self.rule != Rule::All {
            sum = R::zero();
            for k in 0..self.kept.len() {
                let mean = samples.means.at::<R>(k) * self.lights.per_irradiance(k);
                sum = sum + mean;
                mean.store(&mut sifted.relative[k * MAX_LANES..]);
            }
            relative = Rows::new(&sifted.relative, MAX_LANES);
        }
        self.fit::<true>(relative, sum, samples.signal, samples.bands)
    }

    /// Everything about pixels, after a look at each sample.
    #[inline(always)]
    pub(super) fn fit_some(&mut self, samples: &Samples<'_>, sifted: &mut Sifted) -> Estimate<R> {
        let (zero, one, nan) = (R::zero(), R::one(), R::splat(f32::NAN));
        let largest = R::splat(f32::MAX);
        (self.valid, self.saturated) = (zero, zero);
        let mut sum = zero;
        for k in 0..self.kept.len() {
            let mean: R = samples.means.at(k);
            let valid = mean.is_finite();
            self.kept[k] = valid;
            self.valid = self.valid + R::keep(valid, one);
            self.saturated = self.saturated + R::keep(mean.gt(largest), one);
            let relative = mean * self.lights.per_irradiance(k);
            sum = sum + R::keep(valid, relative);
            R::select(valid, relative, nan).store(&mut sifted.relative[k * MAX_LANES..]);
            R::keep(valid, samples.signal.at(k)).store(&mut sifted.signal[k * MAX_LANES..]);
        }
        let relative = Rows::new(&sifted.relative, MAX_LANES);
        self.fit::<false>(relative, sum, Rows::new(&sifted.signal, MAX_LANES), samples.bands)
    }

    /// With `ALL` every sample is valid; `sum` is that of the `relative` samples that are.
    #[inline(always)]
    fn fit<const ALL: bool>(
        &mut self,
        relative: Rows<'_>,
        sum: R,
        signal: Rows<'_>,
        bands: Rows<'_>,
    ) -> Estimate<R> {
        let mut verdict = self.select::<ALL>(relative, sum);
        let start = self.start::<ALL>(signal);
        let mut b = start.b;
        if self.loss != Loss::Squares && self.steps > 0 {
            let steps = self.steps;
            let (lights, kept, reweigh) = (&self.lights, &self.kept, &mut self.reweigh);
            let left = match self.loss {
                Loss::Absolute => reweigh.run::<Absolute, L>(lights, kept, signal, steps, &mut b),
                Loss::Huber => reweigh.run::<Huber, L>(lights, kept, signal, steps, &mut b),
                Loss::Cauchy => reweigh.run::<Cauchy, L>(lights, kept, signal, steps, &mut b),
                Loss::Tukey => reweigh.run::<Tukey, L>(lights, kept, signal, steps, &mut b),
                Loss::Squares => Mask::splat(true),
            };
            verdict.relaxed = verdict.relaxed | !left;
        }
        let (lights, kept) = (&self.lights, &self.kept[..]);
        let squares = if ALL && self.rule == Rule::All {
            R::apart(Squares::<_, _, _, true> { lights, kept, signal, b })
        } else {
            R::apart(Squares::<_, _, _, false> { lights, kept, signal, b })
        };
        let length = b.length();
        let per_length = length.recip();
        let normal = b.scale(per_length);
        self.follow::<ALL>(bands, normal, length);
        // Dividing takes time, and the number of kept samples is mostly that of the neighbours.
        if any(verdict.kept - self.share.count) {
            self.share = Share::of(verdict.kept, self.loss);
        }
        Estimate { verdict, start, normal, length, per_length, squares }
    }

    /// Which samples the rule keeps.
    #[inline(always)]
    fn select<const ALL: bool>(&mut self, relative: Rows<'_>, sum: R) -> Verdict<R> {
        match (&mut self.ranks, self.rule) {
            (Some(ranks), _) => ranks.apply::<ALL>(relative, &mut self.kept, self.valid),
            (None, Rule::Threshold { w1, w2 }) => {
                let mean = sum / self.valid;
                threshold::<R, ALL>((w1, w2), relative, mean, &mut self.kept, self.valid)
            }
            _ => {
                if ALL {
                    self.kept.fill(Mask::splat(true));
                }
                Verdict::all(self.valid)
            }
        }
    }

    /// Least squares over the kept samples. Pixels all of whose samples count, under distant
    /// lights, are multiplied by the one pseudoinverse.
    #[inline(always)]
    fn start<const ALL: bool>(&self, signal: Rows<'_>) -> Solution<R> {
        let (lights, kept) = (&self.lights, &self.kept[..]);
        let mut all = None;
        if let Some(uniform) = self.uniform {
            let pseudoinverse = &self.pseudoinverse[..];
            let (b, total) = R::apart(Multiply { pseudoinverse, signal });
            if ALL {
                return Solution { b, total, ..uniform };
            }
            all = Some((uniform, b));
        }
        let (matrix, right, total) = R::apart(Accumulate { lights, kept, signal });
        let inverse = matrix.inverse();
        let squared = matrix.squared_condition(&inverse);
        let condition = squared.sqrt();
        let some = Solution { b: inverse.times(right), total, matrix, inverse, squared, condition };
        let Some((uniform, all)) = all else { return some };
        let whole = self.valid.ge(R::of(self.kept.len() as f64));
        Solution {
            b: Vec3::new(
                R::select(whole, all.x, some.b.x),
                R::select(whole, all.y, some.b.y),
                R::select(whole, all.z, some.b.z),
            ),
            total,
            matrix: Symmetric::select(whole, &uniform.matrix, &some.matrix),
            inverse: Inverse {
                adjugate: Symmetric::select(
                    whole,
                    &uniform.inverse.adjugate,
                    &some.inverse.adjugate,
                ),
                per_determinant: R::select(
                    whole,
                    uniform.inverse.per_determinant,
                    some.inverse.per_determinant,
                ),
            },
            squared: R::select(whole, uniform.squared, some.squared),
            condition: R::select(whole, uniform.condition, some.condition),
        }
    }

    /// Every band's albedo along the normal.
    #[inline(always)]
    fn follow<const ALL: bool>(&mut self, bands: Rows<'_>, normal: Vec3<R>, length: R) {
        let (zero, one) = (R::zero(), R::one());
        if let [albedo] = &mut self.albedo[..] {
            // The same number: the normal is the direction of the least-squares solution.
            *albedo = length;
            return;
        }
        let by_rule = self.loss == Loss::Squares || self.steps == 0;
        self.albedo.fill(zero);
        let mut squares = zero;
        let count = self.albedo.len();
        for (k, &kept) in self.kept.iter().enumerate() {
            let cosine = normal.dot(self.lights.at(k));
            let weight = if ALL && self.rule == Rule::All && self.loss == Loss::Squares {
                one
            } else if by_rule {
                R::keep(kept, one)
            } else {
                self.reweigh.weights()[k]
            };
            let weighted = cosine * weight;
            squares = weighted.mul_add(cosine, squares);
            for (band, albedo) in self.albedo.iter_mut().enumerate() {
                let sample: R = bands.at(k * count + band);
                let sample = if ALL { sample } else { R::keep(weight.gt(zero), sample) };
                *albedo = weighted.mul_add(sample, *albedo);
            }
        }
        let per_square = squares.recip();
        for albedo in &mut self.albedo {
            *albedo = *albedo * per_square;
        }
    }
}
