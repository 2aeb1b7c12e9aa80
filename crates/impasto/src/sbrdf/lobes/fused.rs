//! Fused rounds: iteratively reweighted least squares [@holland1977robust] for colours, shapes and
//! normals with one Gauss-Newton step per round, in one pass over the columns.
//!
//! A round computes columns and slopes once. The colours under the old weights give the residuals, the
//! residuals the new weights, and the equations under these the step. A pixel whose step has raised
//! the cost keeps weights and equations, and tries a shorter one: every pixel takes the same number of
//! passes, without branches.

use core::ops::Range;

use crate::lm::{Normal, factor};
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Mask, Real, Vec3};

use super::bounds::{self, BandSamples, light_of, weight_at};
use super::maps::MOST_LOBES;
use super::model::{LobeEstimation, MAX_SHAPES, Visit};
use super::normal_equations::{
    PixelSamples, Place, Pull, Records, add_band, add_priors, look, record, tilted, worst,
};
use super::photographs::Photographs;
use super::prior::Prior;
use super::search::Freedom;
use super::tile::{Estimate, TileSamples, gather, gather_normal, runs_by_lobes};
use super::weights::Shown;

/// Share of its diagonal that is added to the matrix of a step.
const DAMPING: f64 = 0.01;

/// Longest tilt of a step in radians, and longest change of an unknown of a shape: the equations are
/// linear about as far.
const LONGEST_TILT: f64 = 0.15;
const LONGEST_CHANGE: f64 = 0.7;

/// Factor by which a step may raise the cost under the weights that it was computed with. Rounding
/// is a tenth of it.
const RISE: f64 = 1.0005;

/// A step that has raised the cost is tried at this share of its length in the next round.
const SHORTER: f64 = 0.25;

/// Squared length of the last step in standard deviations below which a pixel has converged: half a
/// deviation (the relative offset of Bates and Watts [@bates1981offset]). Further steps are shorter.
const OFFSET: f64 = 0.25;

/// The same, as a share of the cost: where there is no noise, deviations are 0.
const NOTHING_LEFT: f64 = 1e-6;

/// All rounds of a tile's pixels.
pub(super) struct FusedRounds<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    /// Where the rounds start, and then where they end.
    pub(super) estimates: &'a mut [Estimate],
    /// Their weights become those of the last round.
    pub(super) samples: &'a mut TileSamples,
    pub(super) ambient: bool,
    pub(super) freedom: Freedom,
    pub(super) prior: Option<&'a Prior>,
    pub(super) rounds: usize,
    /// The variances of the samples in the last round.
    pub(super) variances: &'a mut [f32],
    pub(super) level: Level,
}

impl<M: LobeEstimation> FusedRounds<'_, M> {
    pub(super) fn run(mut self) {
        for (lobes, range) in runs_by_lobes(self.estimates) {
            M::dispatch(lobes, Part { rounds: &mut self, range });
        }
    }

    /// Smallest and largest unknowns of a shape.
    fn bounds(&self) -> [[f64; MAX_SHAPES]; 2] {
        let [lower, upper] = self.photographs.model.bounds();
        if self.freedom == Freedom::Bounded {
            [self.photographs.model.widest_with_normal(), upper]
        } else {
            [lower, upper]
        }
    }
}

/// The rounds of some of the pixels, with at most so many lobes.
struct Part<'a, 'b, M: LobeEstimation> {
    rounds: &'a mut FusedRounds<'b, M>,
    range: Range<usize>,
}

impl<M: LobeEstimation> Visit for Part<'_, '_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.rounds.level;
        level.run(FusedPass::<M, J, K, N>(self));
    }
}

struct FusedPass<'a, 'b, M: LobeEstimation, const J: usize, const K: usize, const N: usize>(
    Part<'a, 'b, M>,
);

impl<M: LobeEstimation, const J: usize, const K: usize, const N: usize> Kernel
    for FusedPass<'_, '_, M, J, K, N>
{
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Part { rounds, range } = self.0;
        let size = record(J, M::SHAPES) * rounds.photographs.len() * I::F32::WIDTH;
        let planes = rounds.samples.planes();
        let mut memory =
            Memory { numbers: vec![0.0; size], shown: Shown::new(planes), bounded: Vec::new() };
        for at in range.step_by(I::F32::WIDTH) {
            Pass::<'_, '_, '_, I::F32, M, J, K, N>::new(rounds, &mut memory, at).run();
        }
    }
}

/// Scratch memory.
struct Memory<R: Real> {
    /// What [`look`] writes.
    numbers: Vec<R::Scalar>,
    shown: Shown<R>,
    bounded: Vec<usize>,
}

/// The samples of the pixels from `at` on.
#[derive(Clone, Copy)]
struct TileLanes<'a> {
    samples: &'a TileSamples,
    at: usize,
}

impl<R: Real<Scalar = f32>> PixelSamples<R> for TileLanes<'_> {
    #[inline(always)]
    fn plane(&self, plane: usize) -> (R, R) {
        self.samples.at(plane, self.at)
    }
}

/// The samples of a band of the pixels from `at` on, beside what [`look`] wrote.
#[inline(always)]
fn records<'a, R: Real<Scalar = f32>, M: LobeEstimation, const J: usize>(
    rounds: &'a FusedRounds<'_, M>,
    numbers: &'a [f32],
    band: usize,
    at: usize,
) -> Records<'a, R, TileLanes<'a>> {
    Records {
        samples: TileLanes { samples: rounds.samples, at },
        bands: rounds.samples.bands,
        band,
        numbers,
        photographs: rounds.photographs.len(),
        lobes: J,
        shapes: M::SHAPES,
    }
}

/// A normal and shapes.
#[derive(Clone, Copy)]
struct Point<R, const N: usize> {
    normal: Vec3<R>,
    /// Two numbers that are not read, then the shapes.
    shapes: [R; N],
}

impl<R: Real, const N: usize> Point<R, N> {
    /// This place where the mask says, else the other.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn or(&self, chosen: R::Mask, other: &Self) -> Self {
        let mut found = *self;
        found.normal = Vec3::new(
            R::select(chosen, self.normal.x, other.normal.x),
            R::select(chosen, self.normal.y, other.normal.y),
            R::select(chosen, self.normal.z, other.normal.z),
        );
        for i in 0..N {
            found.shapes[i] = R::select(chosen, self.shapes[i], other.shapes[i]);
        }
        found
    }

    /// A step from here.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn moved(&self, step: &[R; N]) -> Self {
        let (normal, _) = tilted(self.normal, step[0], step[1]);
        let mut found = Self { normal, shapes: self.shapes };
        for i in 2..N {
            found.shapes[i] = self.shapes[i] + step[i];
        }
        found
    }
}

/// The rounds of a register of pixels.
struct Pass<'a, 'b, 'c, R: Real, M: LobeEstimation, const J: usize, const K: usize, const N: usize>
{
    rounds: &'a mut FusedRounds<'b, M>,
    memory: &'c mut Memory<R>,
    at: usize,
    x: R,
    y: R,
    lobes: R,
    barred: [bool; K],
    priors: [Pull<R>; N],
}

impl<
    'a,
    'b,
    'c,
    R: Real<Scalar = f32>,
    M: LobeEstimation,
    const J: usize,
    const K: usize,
    const N: usize,
> Pass<'a, 'b, 'c, R, M, J, K, N>
{
    #[inline(always)]
    fn new(rounds: &'a mut FusedRounds<'b, M>, memory: &'c mut Memory<R>, at: usize) -> Self {
        let mut barred = [false; K];
        barred[K - 1] = !rounds.ambient;
        Self {
            x: R::load(&rounds.x[at..]),
            y: R::load(&rounds.y[at..]),
            lobes: gather(rounds.estimates, at, |estimate| estimate.lobes as f32),
            barred,
            priors: [[R::zero(); 2]; N],
            rounds,
            memory,
            at,
        }
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn run(&mut self) {
        let zero = R::zero();
        let estimates = &*self.rounds.estimates;
        let mut here = Point { normal: gather_normal(estimates, self.at), shapes: [zero; N] };
        for i in 2..N {
            let (lobe, shape) = ((i - 2) / M::SHAPES, (i - 2) % M::SHAPES);
            here.shapes[i] = gather(estimates, self.at, |estimate| estimate.shapes[lobe][shape]);
        }
        let never = R::Mask::splat(false);
        let (mut before, mut step, mut least) = (here, [zero; N], zero);
        let (mut total, mut variance) = (Normal::zero(), zero);
        let mut converged = never;
        for round in 0..=self.rounds.rounds {
            let cost = self.look(&here);
            // Written so that a cost that is no number counts as worse.
            let worse = if round == 0 { never } else { !cost.le(R::of(RISE) * least) };
            if round == self.rounds.rounds {
                let cost = R::select(worse, least, cost);
                self.store(&before.or(worse, &here), cost, converged & !worse);
                return;
            }
            // Where a step has raised the cost, all stays as it was, and the step is tried shorter.
            let better = !worse;
            let left = self.memory.shown.left(self.rounds.samples, self.at);
            let fresh = self.memory.shown.renew(&left, better, self.rounds.samples, self.at);
            variance = R::select(better, fresh, variance);
            variance.store(&mut self.rounds.variances[self.at..]);
            self.draw(variance, better);
            let equations = self.equations(&here.shapes);
            total.replace(better, &equations);
            least = R::select(better, equations.cost, least);
            before = here.or(better, &before);
            self.deviations(&total);
            let (fresh, wish) = self.step(&total, &before);
            let shorter = R::of(SHORTER);
            for i in 0..N {
                step[i] = R::select(better, fresh[i], step[i] * shorter);
            }
            let nothing = R::of(NOTHING_LEFT) * least;
            converged = better & wish.le((R::of(OFFSET) * variance).max(nothing));
            here = before.moved(&step);
        }
    }

    /// Columns and slopes at a place, what the best colours show there, and their cost.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn look(&mut self, here: &Point<R, N>) -> R {
        let rounds = &*self.rounds;
        let (_, tilts) = tilted(here.normal, R::zero(), R::zero());
        let place = Place {
            x: self.x,
            y: self.y,
            normal: here.normal,
            tilts,
            shapes: here.shapes,
            lobes: self.lobes,
        };
        look::<R, M, J, N>(rounds.photographs, &mut self.memory.numbers, &place);
        let mut cost = R::zero();
        self.memory.shown.clear();
        for band in 0..rounds.samples.bands {
            let seen = records::<R, M, J>(rounds, &self.memory.numbers, band, self.at);
            let (colours, _) = bounds::solve(&seen, &self.barred, &mut self.memory.bounded);
            for photograph in 0..rounds.photographs.len() {
                let (columns, weight, sample): ([R; K], R, R) = seen.at(photograph);
                let shown = light_of(&columns, &colours.values);
                let weight = weight_at(weight, sample, shown);
                let residual = sample - shown;
                cost = (weight * residual).mul_add(residual, cost);
                let diffuse = seen.diffuse(photograph) * colours.values[0];
                let plane = photograph * rounds.samples.bands + band;
                self.memory.shown.count(sample, weight);
                self.memory.shown.set(plane, [shown, diffuse]);
            }
        }
        for i in 2..N {
            let [typical, pull] = self.priors[i];
            let residual = pull * (typical - here.shapes[i]);
            cost = residual.mul_add(residual, cost);
        }
        cost
    }

    /// The priors of the shapes where samples have these variances, for pixels of the mask.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn draw(&mut self, variance: R, chosen: R::Mask) {
        let Some(prior) = self.rounds.prior else { return };
        let mut variances = [0.0; MAX_LANES];
        variance.store(&mut variances);
        let mut numbers = [[[0.0; MAX_LANES]; 2]; N];
        let model = &self.rounds.photographs.model;
        for lane in 0..R::WIDTH.min(self.rounds.estimates.len() - self.at) {
            let estimate = &self.rounds.estimates[self.at + lane];
            let drawn = prior.shapes_of::<R, M>(model, estimate, variances[lane]);
            for i in 2..N {
                let [typical, pull] = drawn.0[(i - 2) / M::SHAPES][(i - 2) % M::SHAPES];
                numbers[i][0][lane] = typical;
                numbers[i][1][lane] = pull;
            }
        }
        for i in 2..N {
            for n in 0..2 {
                self.priors[i][n] = R::select(chosen, R::load(&numbers[i][n]), self.priors[i][n]);
            }
        }
    }

    /// The equations under the renewed weights.
    #[inline(always)]
    fn equations(&mut self, shapes: &[R; N]) -> Normal<R, N> {
        let rounds = &*self.rounds;
        let mut total = Normal::zero();
        for band in 0..rounds.samples.bands {
            let seen = records::<R, M, J>(rounds, &self.memory.numbers, band, self.at);
            let bounded = &mut self.memory.bounded;
            add_band::<R, M, _, J, K, N>(&mut total, &seen, &self.barred, bounded);
        }
        add_priors(&mut total, shapes, &self.priors);
        total
    }

    /// Writes the deviations of normals and shapes, for residuals of unit variance.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn deviations(&mut self, total: &Normal<R, N>) {
        let (zero, unknown) = (R::zero(), R::of(f64::NAN));
        let inverse = factor(&total.matrix, zero, &[R::Mask::splat(false); N]).inverse();
        let mut known = [unknown; N];
        for i in 0..N {
            known[i] = R::select(total.matrix[i][i].gt(zero), inverse[i][i], unknown);
        }
        let mut normal = [0.0; MAX_LANES];
        let tilt = worst(known[0], inverse[1][0], known[1]);
        tilt.store(&mut normal);
        let mut own = [[[0.0; MAX_LANES]; 2]; MOST_LOBES];
        for j in 0..J {
            let variance = known[2 + j * M::SHAPES];
            variance.sqrt().store(&mut own[j][0]);
            // This variance combines the photographs with the prior: take the prior out.
            let [_, pull] = self.priors[2 + j * M::SHAPES];
            let precision = (-pull).mul_add(pull, variance.recip());
            let apart =
                R::select(precision.gt(zero), precision.sqrt().recip(), R::of(f64::INFINITY));
            R::select(variance.gt(zero), apart, unknown).store(&mut own[j][1]);
        }
        let estimates = &mut self.rounds.estimates[self.at..];
        for (lane, estimate) in estimates.iter_mut().take(R::WIDTH).enumerate() {
            estimate.normal_deviation = normal[lane];
            for j in 0..J.min(estimate.lobes) {
                estimate.shape_deviation[j] = own[j][0][lane];
                estimate.own_deviation[j] = own[j][1][lane];
            }
        }
    }

    /// The step within its bounds, and the squared length that it wishes for, in units of the
    /// samples' weights.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn step(&self, total: &Normal<R, N>, here: &Point<R, N>) -> ([R; N], R) {
        let zero = R::zero();
        let [lower, upper] = self.rounds.bounds();
        let mut held = [R::Mask::splat(self.rounds.freedom == Freedom::Shapes); N];
        for i in 2..N {
            let (low, high) =
                (R::of(lower[(i - 2) % M::SHAPES]), R::of(upper[(i - 2) % M::SHAPES]));
            let descent = total.descent[i];
            let outwards = here.shapes[i].le(low) & descent.lt(zero);
            held[i] = outwards | (here.shapes[i].ge(high) & descent.gt(zero));
        }
        let mut step = factor(&total.matrix, R::of(DAMPING), &held).solve(&total.descent);
        let mut wish = zero;
        for i in 0..N {
            step[i] = R::keep(step[i].is_finite(), step[i]);
            wish = step[i].mul_add(total.descent[i], wish);
        }
        let tilt = step[0].mul_add(step[0], step[1] * step[1]).sqrt();
        let longest = R::of(LONGEST_TILT);
        let short = R::select(tilt.gt(longest), longest / tilt, R::one());
        step[0] = step[0] * short;
        step[1] = step[1] * short;
        let most = R::of(LONGEST_CHANGE);
        for i in 2..N {
            let (low, high) =
                (R::of(lower[(i - 2) % M::SHAPES]), R::of(upper[(i - 2) % M::SHAPES]));
            let change = step[i].max(-most).min(most);
            step[i] = (here.shapes[i] + change).max(low).min(high) - here.shapes[i];
        }
        (step, wish)
    }

    /// Writes where the rounds end.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn store(&mut self, here: &Point<R, N>, cost: R, converged: R::Mask) {
        let mut numbers = [[0.0; MAX_LANES]; 5];
        here.normal.x.store(&mut numbers[0]);
        here.normal.y.store(&mut numbers[1]);
        here.normal.z.store(&mut numbers[2]);
        cost.store(&mut numbers[3]);
        R::keep(converged, R::one()).store(&mut numbers[4]);
        let mut shapes = [[0.0; MAX_LANES]; N];
        for i in 2..N {
            here.shapes[i].store(&mut shapes[i]);
        }
        let estimates = &mut self.rounds.estimates[self.at..];
        for (lane, estimate) in estimates.iter_mut().take(R::WIDTH).enumerate() {
            estimate.normal = [numbers[0][lane], numbers[1][lane], numbers[2][lane]];
            estimate.cost = numbers[3][lane];
            estimate.converged = numbers[4][lane] > 0.0;
            for i in 2..N {
                let (lobe, shape) = ((i - 2) / M::SHAPES, (i - 2) % M::SHAPES);
                if lobe < estimate.lobes {
                    estimate.shapes[lobe][shape] = shapes[i][lane];
                }
            }
        }
    }
}
