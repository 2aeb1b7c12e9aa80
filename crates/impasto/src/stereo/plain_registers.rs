//! Least squares under distant lights, for registers of pixels of which every sample counts and nothing is
//! remarkable: what most pixels of most stacks are.
//!
//! All of them have the same pseudoinverse, condition and scale of errors. What is left per pixel is a product,
//! its length, and what the residuals say: so little that it must not wait for memory, nor pass the decisions
//! that other pixels need. Maps that nobody asked for are not computed.
//!
//! The bits are those of [`NormalLanes`], from the same operations in the same order: whether the neighbours of a
//! pixel are plain changes nothing for it. All other registers are left to `NormalLanes`.

use crate::math::real::Part;
use crate::math::{Mask, Real, Vec3};

use super::lanes::NormalLanes;
use super::lights::Lights;
use super::m_estimators::{ErrorScale, LossFunction};
use super::problem::StereoProblem;
use super::results::SHORTEST;
use super::rows::{PlaneRows, store};
use super::samples::{BLOCK, RegisterSamples, StereoScratch};
use super::solve::{ENOUGH, Solution, well_determined};
use super::sums::{Multiply, TOGETHER, WeightedSamples, residual};
use super::tile::NormalTile;

/// Largest sample of which no result can leave the range of single precision where the lights are well determined:
/// its square times the number of samples, times the worst variance (2700 over that number), is 3e33; its root over
/// the shortest length is 5e35.
const MODEST: f32 = 1e15;

/// What is the same for all plain registers.
pub(super) struct PlainRegisters<R: Real> {
    uniform: Solution<R>,
    pseudoinverse: Vec<Vec3<f32>>,
    scale: ErrorScale<R>,
    count: u16,
    /// Whether squares of residuals may be infinite.
    immodest: bool,
    /// Of one register, from the lights.
    cosines: Vec<R>,
    /// First pixels of the registers of a block that are not plain.
    pub(super) left: Vec<usize>,
}

impl<R: Real<Scalar = f32>> PlainRegisters<R> {
    /// None where the method has other sums, or the lights give every pixel another status than fitted.
    #[inline(always)]
    pub(super) fn new<L: Lights<R>>(
        problem: &StereoProblem<'_>,
        pixels: &NormalLanes<R, L>,
    ) -> Option<Self> {
        let observations = problem.rig.observations();
        let uniform = pixels.uniform?;
        let squares = problem.loss == LossFunction::Squares;
        if !squares || observations < ENOUGH || !well_determined(uniform.squared).all() {
            return None;
        }
        Some(Self {
            uniform,
            pseudoinverse: pixels.pseudoinverse.clone(),
            scale: ErrorScale::of(R::of(observations as f64), LossFunction::Squares),
            count: u16::try_from(observations).unwrap_or(u16::MAX),
            immodest: !problem.stack.largest().is_some_and(|largest| largest <= MODEST),
            cosines: vec![R::zero(); observations],
            left: Vec::with_capacity(BLOCK),
        })
    }
}

/// The plain registers of one block.
pub(super) struct PlainBlock<'a, 'b, R: Real, L> {
    pub(super) plain: &'a mut PlainRegisters<R>,
    pub(super) lights: &'a L,
    pub(super) problem: &'a StereoProblem<'a>,
    pub(super) scratch: &'a StereoScratch,
    pub(super) tile: &'a mut NormalTile<'b>,
    /// Where the block lies in the tile.
    pub(super) start: usize,
    pub(super) count: usize,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Part<R> for PlainBlock<'_, '_, R, L> {
    type Output = ();

    #[inline(always)]
    fn compute(mut self) {
        self.plain.left.clear();
        let (range, count) = (self.start..self.start + self.count, self.plain.count);
        if let Some(used) = &mut self.tile.used {
            used[range.clone()].fill(count);
        }
        let mut at = 0;
        while at < self.count {
            if !self.register(at) {
                self.plain.left.push(at);
            }
            at += R::WIDTH;
        }
    }
}

impl<R: Real<Scalar = f32>, L: Lights<R>> PlainBlock<'_, '_, R, L> {
    /// Writes the results of a register, or returns false.
    #[inline(always)]
    fn register(&mut self, at: usize) -> bool {
        let samples = RegisterSamples::of(self.scratch, self.problem, at);
        let signal = samples.signal;
        let pseudoinverse = &self.plain.pseudoinverse[..];
        let (b, total): (Vec3<R>, R) = Multiply { pseudoinverse, signal }.compute();
        // A sum is finite only if all samples are.
        let mut finite = total.is_finite();
        if self.problem.options.selection.is_some() {
            let mut sum = R::zero();
            for k in 0..pseudoinverse.len() {
                sum = sum + samples.means.at::<R>(k);
            }
            finite = sum.is_finite();
        }
        let length = b.length();
        let per_length = length.recip();
        let normal = b.scale(per_length);
        let lit = total.gt(R::zero()) & length.ge(R::of(SHORTEST)) & length.is_finite();
        if !(finite & lit).all() {
            return false;
        }
        let place = self.start + at;
        let errors = self.tile.residual.is_some() || self.tile.sigma.is_some();
        if errors || self.plain.immodest {
            let mut squares = R::zero();
            for k in 0..pseudoinverse.len() {
                let rest = residual(signal.at(k), self.lights.at(k), b);
                squares = rest.mul_add(rest, squares);
            }
            let (uniform, scale) = (&self.plain.uniform, &self.plain.scale);
            let worst = uniform.matrix.worst_tangent_variance(&uniform.inverse, normal);
            let sigma = (squares * worst * scale.per_freedom).sqrt() * per_length * scale.quantile;
            if !(squares.is_finite() & worst.ge(R::zero()) & sigma.is_finite()).all() {
                return false;
            }
            if let Some(map) = &mut self.tile.residual {
                store((squares * scale.per_count).sqrt(), map, place);
            }
            if let Some(map) = &mut self.tile.sigma {
                store(sigma, map, place);
            }
        }
        for (plane, value) in self.tile.normal.iter_mut().zip(normal.array()) {
            store(value, plane, place);
        }
        if let Some(map) = &mut self.tile.condition {
            store(self.plain.uniform.condition, map, place);
        }
        match &mut self.tile.albedo[..] {
            [] => {}
            [map] => store(length, map, place),
            _ => self.albedo(samples.bands, normal, place),
        }
        true
    }

    /// Every band's albedo along the normal.
    #[inline(always)]
    fn albedo(&mut self, bands: PlaneRows<'_>, normal: Vec3<R>, place: usize) {
        let mut squares = R::zero();
        for (k, cosine) in self.plain.cosines.iter_mut().enumerate() {
            *cosine = normal.dot(self.lights.at(k));
            squares = cosine.mul_add(*cosine, squares);
        }
        let per_square = squares.recip();
        let count = self.tile.albedo.len();
        let samples = WeightedSamples { weights: &self.plain.cosines, kept: None, bands, count };
        let mut first = 0;
        while first < count {
            if count - first >= TOGETHER {
                let sums = samples.sums::<TOGETHER>(first);
                for (band, &sum) in sums.iter().enumerate() {
                    store(sum * per_square, self.tile.albedo[first + band], place);
                }
                first += TOGETHER;
            } else {
                let [sum] = samples.sums::<1>(first);
                store(sum * per_square, self.tile.albedo[first], place);
                first += 1;
            }
        }
    }
}
