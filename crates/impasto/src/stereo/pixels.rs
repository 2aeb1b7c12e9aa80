//! One register of pixels on its way through the fit.

use crate::math::{Mask, Real, Vec3};

use super::Problem;
use super::fit::{Samples, Sifted};
use super::found::Found;
use super::loss::{Absolute, Cauchy, Huber, Loss, Tukey};
use super::reweigh::Reweigh;
use super::rows::{MAX_LANES, Rows};
use super::rule::{Ranks, Rule, Verdict, threshold};
use super::solve::{Inverse, Symmetric};

/// The least-squares solution over some samples, and what it says about them.
#[derive(Clone, Copy)]
pub(super) struct Solution<R> {
    /// Normal times albedo.
    pub(super) b: Vec3<R>,
    pub(super) matrix: Symmetric<R>,
    pub(super) inverse: Inverse<R>,
    /// Squared condition number of the lights.
    pub(super) squared: R,
}

pub(super) struct Pixels<R: Real> {
    rule: Rule,
    loss: Loss,
    steps: usize,
    ranks: Option<Ranks<R>>,
    reweigh: Reweigh<R>,
    /// Direction to each light times its irradiance.
    pub(super) lights: Vec<Vec3<R>>,
    per_irradiance: Vec<R>,
    /// Of all lights, where that is the same for every pixel; `b` is unused.
    uniform: Option<Solution<R>>,
    /// Rows of the pseudoinverse of all lights.
    pseudoinverse: Vec<Vec3<R>>,
    /// 1 where a rule kept the sample, else 0.
    pub(super) kept: Vec<R>,
    /// Number of valid samples, and of clipped ones.
    pub(super) valid: R,
    pub(super) saturated: R,
    /// Every band's albedo.
    pub(super) albedo: Vec<R>,
}

impl<R: Real<Scalar = f32>> Pixels<R> {
    #[inline(always)]
    pub(super) fn new(problem: &Problem<'_>) -> Self {
        let shape = problem.stack.shape();
        let (zero, count) = (R::zero(), shape.observations);
        let none = Vec3::new(zero, zero, zero);
        let mut pixels = Self {
            rule: problem.rule,
            loss: problem.loss,
            steps: problem.options.steps,
            ranks: match problem.rule {
                Rule::Rank { low, high } => Some(Ranks::new((low, high), count)),
                _ => None,
            },
            reweigh: Reweigh::new(count),
            lights: vec![none; count],
            per_irradiance: vec![R::one(); count],
            uniform: None,
            pseudoinverse: vec![none; count],
            kept: vec![zero; count],
            valid: zero,
            saturated: zero,
            albedo: vec![zero; shape.bands],
        };
        if let Some(uniform) = &problem.uniform {
            for (k, row) in uniform.pseudoinverse.iter().enumerate() {
                pixels.pseudoinverse[k] = row.splat();
            }
            pixels.uniform = Some(Solution {
                b: none,
                matrix: uniform.matrix.splat(),
                inverse: Inverse {
                    adjugate: uniform.inverse.adjugate.splat(),
                    per_determinant: R::of(uniform.inverse.per_determinant),
                },
                squared: R::of(uniform.squared),
            });
        }
        pixels
    }

    /// Directions and irradiances at the points `(x, y)` in mm.
    #[inline(always)]
    pub(super) fn aim(&mut self, problem: &Problem<'_>, x: R, y: R) {
        for (k, light) in problem.rig.lights().iter().enumerate() {
            let (towards, irradiance) = light.at(x, y);
            self.lights[k] = towards.scale(irradiance);
            self.per_irradiance[k] = irradiance.recip();
        }
    }

    /// Everything about pixels whose samples are all valid.
    #[inline(always)]
    pub(super) fn fit_all(
        &mut self,
        problem: &Problem<'_>,
        samples: &Samples<'_>,
        sifted: &mut Sifted,
    ) -> Found<R> {
        self.valid = R::of(self.kept.len() as f64);
        self.saturated = R::zero();
        let mut relative = samples.means;
        if !problem.rig.is_distant() && self.rule != Rule::All {
            for k in 0..self.kept.len() {
                let mean: R = samples.means.at(k);
                (mean * self.per_irradiance[k]).store(&mut sifted.relative[k * MAX_LANES..]);
            }
            relative = Rows::new(&sifted.relative, MAX_LANES);
        }
        self.fit::<true>(relative, samples.signal, samples.bands)
    }

    /// Everything about pixels, after a look at each sample.
    #[inline(always)]
    pub(super) fn fit_some(&mut self, samples: &Samples<'_>, sifted: &mut Sifted) -> Found<R> {
        let (zero, one, nan) = (R::zero(), R::one(), R::splat(f32::NAN));
        let largest = R::splat(f32::MAX);
        (self.valid, self.saturated) = (zero, zero);
        for k in 0..self.kept.len() {
            let mean: R = samples.means.at(k);
            let valid = mean.is_finite();
            self.kept[k] = R::keep(valid, one);
            self.valid = self.valid + self.kept[k];
            self.saturated = self.saturated + R::keep(mean.gt(largest), one);
            let relative = R::select(valid, mean * self.per_irradiance[k], nan);
            relative.store(&mut sifted.relative[k * MAX_LANES..]);
            R::keep(valid, samples.signal.at(k)).store(&mut sifted.signal[k * MAX_LANES..]);
        }
        let relative = Rows::new(&sifted.relative, MAX_LANES);
        self.fit::<false>(relative, Rows::new(&sifted.signal, MAX_LANES), samples.bands)
    }

    #[inline(always)]
    fn fit<const ALL: bool>(
        &mut self,
        relative: Rows<'_>,
        signal: Rows<'_>,
        bands: Rows<'_>,
    ) -> Found<R> {
        let mut verdict = self.select::<ALL>(relative);
        let start = self.start::<ALL>(signal);
        let mut b = start.b;
        if self.loss != Loss::Squares && self.steps > 0 {
            if ALL && self.rule == Rule::All {
                self.kept.fill(R::one());
            }
            let steps = self.steps;
            let (lights, kept, reweigh) = (&self.lights, &self.kept, &mut self.reweigh);
            let left = match self.loss {
                Loss::Absolute => reweigh.run::<Absolute>(lights, kept, signal, steps, &mut b),
                Loss::Huber => reweigh.run::<Huber>(lights, kept, signal, steps, &mut b),
                Loss::Cauchy => reweigh.run::<Cauchy>(lights, kept, signal, steps, &mut b),
                Loss::Tukey => reweigh.run::<Tukey>(lights, kept, signal, steps, &mut b),
                Loss::Squares => R::zero().le(R::zero()),
            };
            verdict.relaxed = verdict.relaxed | !left;
        }
        let (squares, total) = if ALL && self.rule == Rule::All {
            self.residuals::<true>(signal, b)
        } else {
            self.residuals::<false>(signal, b)
        };
        let length = b.length();
        let normal = b.scale(length.recip());
        self.follow::<ALL>(bands, normal, length);
        Found::new(self, self.loss, &verdict, &start, (normal, length), (squares, total))
    }

    /// Which samples the rule keeps.
    #[inline(always)]
    fn select<const ALL: bool>(&mut self, relative: Rows<'_>) -> Verdict<R> {
        match (&mut self.ranks, self.rule) {
            (Some(ranks), _) => ranks.apply::<ALL>(relative, &mut self.kept, self.valid),
            (None, Rule::Threshold { w1, w2 }) => {
                threshold::<R, ALL>((w1, w2), relative, &mut self.kept, self.valid)
            }
            _ => Verdict::all(self.valid),
        }
    }

    /// Least squares over the kept samples. Pixels all of whose samples count, under distant
    /// lights, are multiplied by the one pseudoinverse.
    #[inline(always)]
    fn start<const ALL: bool>(&self, signal: Rows<'_>) -> Solution<R> {
        let zero = R::zero();
        let mut all = Vec3::new(zero, zero, zero);
        if let Some(uniform) = self.uniform {
            for (k, &row) in self.pseudoinverse.iter().enumerate() {
                all = row.mul_add(signal.at(k), all);
            }
            if ALL {
                return Solution { b: all, ..uniform };
            }
        }
        let mut matrix = Symmetric::zero();
        let mut right = Vec3::new(zero, zero, zero);
        for (k, (&light, &kept)) in self.lights.iter().zip(&self.kept).enumerate() {
            let kept = if ALL && self.rule == Rule::All { R::one() } else { kept };
            let weighted = light.scale(kept);
            matrix.add(light, weighted);
            right = weighted.mul_add(signal.at(k), right);
        }
        let inverse = matrix.inverse();
        let squared = matrix.squared_condition(&inverse);
        let some = Solution { b: inverse.times(right), matrix, inverse, squared };
        let Some(uniform) = self.uniform else { return some };
        let whole = self.valid.ge(R::of(self.kept.len() as f64));
        Solution {
            b: Vec3::new(
                R::select(whole, all.x, some.b.x),
                R::select(whole, all.y, some.b.y),
                R::select(whole, all.z, some.b.z),
            ),
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
        }
    }

    /// Sums over the kept samples, which `WHOLE` says are all: squared residuals, and samples.
    #[inline(always)]
    fn residuals<const WHOLE: bool>(&self, signal: Rows<'_>, b: Vec3<R>) -> (R, R) {
        let (mut squares, mut total) = (R::zero(), R::zero());
        for (k, (&light, &kept)) in self.lights.iter().zip(&self.kept).enumerate() {
            let sample: R = signal.at(k);
            let residual = residual(sample, light, b);
            if WHOLE {
                squares = residual.mul_add(residual, squares);
                total = total + sample;
            } else {
                squares = (residual * kept).mul_add(residual, squares);
                total = sample.mul_add(kept, total);
            }
        }
        (squares, total)
    }

    /// Every band's albedo along the normal.
    #[inline(always)]
    fn follow<const ALL: bool>(&mut self, bands: Rows<'_>, normal: Vec3<R>, length: R) {
        let zero = R::zero();
        if let [albedo] = &mut self.albedo[..] {
            // The same number: the normal is the direction of the least-squares solution.
            *albedo = length;
            return;
        }
        let weights = match self.loss {
            Loss::Squares => &self.kept,
            _ if self.steps == 0 => &self.kept,
            _ => self.reweigh.weights(),
        };
        self.albedo.fill(zero);
        let mut squares = zero;
        let count = self.albedo.len();
        for (k, (&light, &weight)) in self.lights.iter().zip(weights).enumerate() {
            let cosine = normal.dot(light);
            let weight = if ALL && self.rule == Rule::All && self.loss == Loss::Squares {
                R::one()
            } else {
                weight
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

/// `sample - b . light`, whose order of sums is part of the results' bits.
#[inline(always)]
pub(super) fn residual<R: Real>(sample: R, light: Vec3<R>, b: Vec3<R>) -> R {
    let rest = (-light.x).mul_add(b.x, sample);
    let rest = (-light.y).mul_add(b.y, rest);
    (-light.z).mul_add(b.z, rest)
}

/// Whether any lane differs from zero.
#[inline(always)]
pub(super) fn any<R: Real>(value: R) -> bool {
    value.abs().gt(R::zero()).any()
}
