//! Empirical Bayes [@morris1983empirical]: a prior for the shapes of a pixel's lobes, estimated from
//! the painting itself.
//!
//! Few lights lie near a pixel's highlight, and a narrow lobe between two of them fits anything. A
//! sample of pixels whose photographs determine their lobes' shapes gives the prior towards which
//! every pixel's shapes are drawn. It changes little where the photographs determine the shape; where
//! they do not, the pixel takes the painting's lobe, and its status says so.
//!
//! A painting consists of several materials, and their average describes none of them: the prior of a
//! pixel is a mixture in which the sampled pixels that resemble it have the weight.

use crate::error::{Error, Result};
use crate::math::elementary::exp;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real};

use super::maps::MOST_LOBES;
use super::model::{LobeEstimation, MAX_SHAPES};
use super::tile::Estimate;

/// Fewest pixels with a well-determined shape from which a prior is made.
pub(super) const FEWEST: usize = 20;
/// Their least fraction of all pixels: noise gives a few percent of the pixels a lobe too many.
const FEWEST_FRACTION: f64 = 0.05;

/// Most pixels of a sample: 64 or 256 predict held-out photographs no better.
pub(super) const SAMPLE_SIZE: usize = 32;

/// Standard deviation of the shapes of one material, as a fraction of the painting's: 4 % of a lobe's
/// width. Of 0.2, 0.3 and 0.5 this predicts held-out photographs of the icon best, by little;
/// simulated varnishes, which are uniform, need less.
const MATERIAL: f64 = 0.3;

/// Least sum of the mixture's weights. Below it no sampled pixel resembles the pixel: the nearest
/// lies 3.7 standard deviations away.
const RESEMBLANCE: f32 = 1e-3;

/// A sample for each number of lobes; `None` where too few pixels have well-determined shapes.
#[derive(Clone, Debug)]
pub(super) struct Prior([Option<Box<PriorSample>>; MOST_LOBES]);

/// A prior as numbers, to be saved; see [`LearnedLobes::prior`](super::LearnedLobes::prior).
#[derive(Clone, Debug, PartialEq)]
pub struct PriorNumbers {
    /// `(number of lobes,)`: how many pixels were sampled that have 1, 2 and 3 lobes; 0: no prior.
    pub counts: Vec<u32>,
    /// `(number of lobes, lobe, unknown, pixel)`: the unknowns of their shapes.
    pub shapes: Vec<f32>,
    /// `(number of lobes, lobe, pixel)`: the variances of these.
    pub variances: Vec<f32>,
}

impl PriorNumbers {
    /// Sizes of [`Self::shapes`]: numbers of lobes, lobes, unknowns of a shape, pixels.
    pub const SHAPE: [usize; 4] = [MOST_LOBES, MOST_LOBES, MAX_SHAPES, SAMPLE_SIZE];
}

/// Sampled pixels with the same number of lobes; rows hold `count` numbers, then zeros.
#[derive(Clone, Debug)]
struct PriorSample {
    count: usize,
    shapes: [[[f32; SAMPLE_SIZE]; MAX_SHAPES]; MOST_LOBES],
    /// Variances of the shapes.
    variances: [[f32; SAMPLE_SIZE]; MOST_LOBES],
}

impl PriorSample {
    const EMPTY: Self = Self {
        count: 0,
        shapes: [[[0.0; SAMPLE_SIZE]; MAX_SHAPES]; MOST_LOBES],
        variances: [[0.0; SAMPLE_SIZE]; MOST_LOBES],
    };

    /// Quantiles of the pixels: independent of their order, and no material is missed by chance.
    fn of(determined: &mut [&Estimate]) -> Self {
        let key = |estimate: &Estimate| estimate.shapes[0][0];
        determined.sort_by(|a, b| key(a).total_cmp(&key(b)));
        let count = determined.len().min(SAMPLE_SIZE);
        let mut sample = Self { count, ..Self::EMPTY };
        for part in 0..count {
            let estimate = determined[(2 * part + 1) * determined.len() / (2 * count)];
            for (lobe, shape) in estimate.shapes.iter().enumerate() {
                for (number, &value) in shape.iter().enumerate() {
                    sample.shapes[lobe][number][part] = value;
                }
                sample.variances[lobe][part] = square(estimate.shape_deviation[lobe]);
            }
        }
        sample
    }
}

impl Prior {
    /// A sample of the pixels whose shapes are known better than shapes usually differ.
    pub(super) fn of_estimates<M: LobeEstimation>(model: &M, estimates: &[Estimate]) -> Self {
        let spread = model.deviations()[0] as f32;
        let fewest = FEWEST.max((FEWEST_FRACTION * estimates.len() as f64) as usize);
        Self(core::array::from_fn(|index| {
            let is_determined = |estimate: &&Estimate| {
                estimate.lobes == index + 1
                    && estimate.shape_deviation[..=index].iter().all(|&own| own < spread)
            };
            let mut determined: Vec<&Estimate> = estimates.iter().filter(is_determined).collect();
            (determined.len() >= fewest).then(|| Box::new(PriorSample::of(&mut determined)))
        }))
    }

    /// The sampled pixels as plain numbers, zeros where there are none.
    pub(super) fn to_numbers(&self) -> PriorNumbers {
        let none = PriorSample::EMPTY;
        let samples = self.0.each_ref().map(|sample| sample.as_deref().unwrap_or(&none));
        PriorNumbers {
            counts: samples.iter().map(|sample| sample.count as u32).collect(),
            shapes: samples
                .iter()
                .flat_map(|sample| sample.shapes.as_flattened().as_flattened())
                .copied()
                .collect(),
            variances: samples
                .iter()
                .flat_map(|sample| sample.variances.as_flattened())
                .copied()
                .collect(),
        }
    }

    /// The inverse of [`Self::to_numbers`].
    pub(super) fn from_numbers(numbers: &PriorNumbers) -> Result<Self> {
        let PriorNumbers { counts, shapes, variances } = numbers;
        let size = MOST_LOBES * SAMPLE_SIZE;
        let sizes = [
            ("counts", counts.len(), MOST_LOBES),
            ("shapes", shapes.len(), MOST_LOBES * MAX_SHAPES * size),
            ("variances", variances.len(), MOST_LOBES * size),
        ];
        if let Some((name, found, expected)) = sizes.iter().find(|(_, found, size)| found != size) {
            return Err(Error::argument(
                name,
                format!("expected {expected} numbers, found {found}"),
            ));
        }
        if let Some(&count) = counts.iter().find(|&&count| count as usize > SAMPLE_SIZE) {
            return Err(Error::argument("counts", format!("at most {SAMPLE_SIZE}, found {count}")));
        }
        let positive = variances.iter().all(|&variance| variance >= 0.0);
        if !(positive && shapes.iter().all(|shape| shape.is_finite())) {
            let problem = "expected finite shapes, and variances of 0 or more";
            return Err(Error::argument("prior", problem));
        }
        Ok(Self(core::array::from_fn(|index| {
            let count = counts[index] as usize;
            let mut sample = PriorSample { count, ..PriorSample::EMPTY };
            let into = sample.shapes.as_flattened_mut().as_flattened_mut();
            into.copy_from_slice(&shapes[index * into.len()..][..into.len()]);
            let into = sample.variances.as_flattened_mut();
            into.copy_from_slice(&variances[index * into.len()..][..into.len()]);
            (count > 0).then(|| Box::new(sample))
        })))
    }

    /// The prior of a pixel's shapes, whose samples have this variance.
    #[inline(always)]
    pub(super) fn shapes_of<R: Real<Scalar = f32>, M: LobeEstimation>(
        &self,
        model: &M,
        estimate: &Estimate,
        variance: f32,
    ) -> ShapePrior {
        let mut prior = ShapePrior::NONE;
        let Some(index) = estimate.lobes.checked_sub(1) else { return prior };
        if let Some(sample) = self.0[index].as_ref() {
            let material = model.deviations().map(|spread| square((MATERIAL * spread) as f32));
            prior.combine::<R>(sample, estimate, variance, &material[..M::SHAPES]);
        }
        prior
    }

    /// Whether there is a sample of pixels with so many lobes.
    pub(super) fn covers(&self, lobes: usize) -> bool {
        self.0[lobes - 1].is_some()
    }
}

/// The priors of a tile's pixels, whose samples have these variances.
pub(super) struct ShapePriors<'a, M: LobeEstimation> {
    pub(super) prior: &'a Prior,
    pub(super) model: &'a M,
    pub(super) estimates: &'a [Estimate],
    pub(super) variances: &'a [f32],
}

impl<M: LobeEstimation> Kernel for ShapePriors<'_, M> {
    type Output = Vec<ShapePrior>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<ShapePrior> {
        let mut priors = Vec::with_capacity(self.estimates.len());
        for (estimate, &variance) in self.estimates.iter().zip(self.variances) {
            priors.push(self.prior.shapes_of::<I::F32, M>(self.model, estimate, variance));
        }
        priors
    }
}

/// The prior of one pixel: for every number of each lobe's shape its mean, and its weight as the
/// standard deviation of a sample over that of the number (0: no prior).
#[derive(Clone, Copy, Debug)]
pub(super) struct ShapePrior(pub(super) [[[f32; 2]; MAX_SHAPES]; MOST_LOBES]);

impl ShapePrior {
    pub(super) const NONE: Self = Self([[[0.0; 2]; MAX_SHAPES]; MOST_LOBES]);

    /// Combines the sampled pixels into a prior; none where no sampled pixel resembles this one.
    ///
    /// The prior has the mean and variance of a mixture of normal distributions, one about each
    /// sampled pixel. Their weights are the likelihoods of the pixel's own shapes, with their
    /// uncertainty (the first step of expectation maximisation), over the variance of each.
    #[inline(always)]
    fn combine<R: Real<Scalar = f32>>(
        &mut self,
        sample: &PriorSample,
        estimate: &Estimate,
        variance: f32,
        material: &[f32],
    ) {
        let mut weights = [0.0; SAMPLE_SIZE];
        for at in (0..SAMPLE_SIZE).step_by(R::WIDTH) {
            let mut distance = R::zero();
            for lobe in 0..estimate.lobes {
                let own = R::splat(square(estimate.own_deviation[lobe]) * variance);
                let both = own + R::load(&sample.variances[lobe][at..]);
                for (number, &within) in material.iter().enumerate() {
                    let other = R::load(&sample.shapes[lobe][number][at..]);
                    let apart = R::splat(estimate.shapes[lobe][number]) - other;
                    distance = distance + apart * apart / (R::splat(within) + both);
                }
            }
            exp(distance * R::of(-0.5)).store(&mut weights[at..]);
        }
        let weights = &weights[..sample.count];
        // Written so that NaN gives no prior.
        if weights.iter().sum::<f32>() > RESEMBLANCE {
            for (lobe, numbers) in self.0[..estimate.lobes].iter_mut().enumerate() {
                for (number, &within) in material.iter().enumerate() {
                    let others = &sample.shapes[lobe][number];
                    let [mean, total] = mixture(weights, others, &sample.variances[lobe], within);
                    numbers[number] = [mean, (variance / total).sqrt()];
                }
            }
        }
    }
}

/// Mean and variance of a mixture of distributions of one `variance`, whose means have the variances
/// `variances` themselves.
#[inline(always)]
fn mixture(weights: &[f32], means: &[f32], variances: &[f32], variance: f32) -> [f32; 2] {
    let (mut whole, mut first, mut second) = (0.0, 0.0, 0.0);
    let about = means[0];
    for ((&weight, &mean), &own) in weights.iter().zip(means).zip(variances) {
        let weight = weight / (variance + own);
        let off = mean - about;
        whole += weight;
        first = weight.mul_add(off, first);
        second = (weight * off).mul_add(off, second);
    }
    let off = first / whole;
    [about + off, variance + (second / whole - off * off).max(0.0)]
}

/// The square of a standard deviation; infinite where that is not a number.
#[inline(always)]
fn square(spread: f32) -> f32 {
    if spread.is_finite() { spread * spread } else { f32::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Level;
    use crate::surface::TorranceSparrow;

    const MODEL: TorranceSparrow = TorranceSparrow { index: 1.45 };

    /// A pixel of one lobe whose logarithm of sharpness has this standard deviation.
    fn pixel(shape: f32, spread: f32) -> Estimate {
        let mut pixel = Estimate { lobes: 1, ..Estimate::new([0.0, 0.0, 1.0]) };
        pixel.shapes[0][0] = shape;
        pixel.shape_deviation[0] = spread;
        pixel.own_deviation[0] = spread;
        pixel
    }

    /// Mean of a pixel's prior and its standard deviation.
    fn prior_of(estimate: &Estimate, shapes: &[f32]) -> [f32; 2] {
        let estimates: Vec<Estimate> = shapes.iter().map(|&shape| pixel(shape, 0.02)).collect();
        let prior = Prior::of_estimates(&MODEL, &estimates);
        let priors = ShapePriors {
            prior: &prior,
            model: &MODEL,
            estimates: &[*estimate],
            variances: &[1.0],
        };
        let [mean, pull] = Level::detect().run(priors)[0].0[0][0];
        [mean, pull.recip()]
    }

    #[test]
    fn materials_do_not_mix() {
        let shapes: Vec<f32> = (0..32).map(|i| if i % 2 == 0 { 4.5 } else { 2.0 }).collect();
        let material = (MATERIAL * 0.25) as f32;
        for side in [4.5, 2.0] {
            let [mean, spread] = prior_of(&pixel(side + 0.1, 0.1), &shapes);
            // The other material, 19 standard deviations away, weighs 0 in single precision. Rounding
            // is left: 2.4e-7 of a mean of 4.5, 6e-8 of each root and quotient of the spread.
            assert!((mean - side).abs() < 1e-6, "{mean}");
            assert!((spread / material - 1.0).abs() < 1e-5, "{spread}");
        }
        // A pixel with an unknown shape gets both materials, and the spread between them.
        let [mean, spread] = prior_of(&pixel(4.5, f32::NAN), &shapes);
        // Rounding of 2.4e-7 in sums of 32 terms; sqrt(1.25^2 + 0.075^2) = 1.252.
        assert!((mean - 3.25).abs() < 1e-5, "{mean}");
        assert!((spread - 1.25).abs() < 0.01, "{spread}");
    }

    #[test]
    fn too_few_or_no_similar_pixels_give_no_prior() {
        let shapes = [4.5; 32];
        assert_eq!(prior_of(&pixel(4.5, 0.1), &shapes[..19])[1], f32::INFINITY);
        assert_eq!(prior_of(&pixel(1.0, 0.02), &shapes)[1], f32::INFINITY);
        assert_eq!(prior_of(&Estimate { lobes: 0, ..pixel(4.5, 0.1) }, &shapes)[1], f32::INFINITY);
        assert_eq!(prior_of(&Estimate { lobes: 2, ..pixel(4.5, 0.1) }, &shapes)[1], f32::INFINITY);
    }

    #[test]
    fn the_sample_holds_quantiles() {
        let estimates: Vec<Estimate> = (0..1000).map(|i| pixel(0.01 * i as f32, 0.02)).collect();
        let Prior([Some(one), None, None]) = Prior::of_estimates(&MODEL, &estimates) else {
            panic!()
        };
        assert_eq!(one.count, SAMPLE_SIZE);
        // The middles of 32 equal parts of all; the pixel below each has a shape less than 0.01 smaller.
        for (part, &shape) in one.shapes[0][0].iter().enumerate() {
            assert!(
                (shape - (part as f32 + 0.5) * 10.0 / SAMPLE_SIZE as f32).abs() < 0.02,
                "{shape}"
            );
        }
    }
}
