//! The kernel: a register of pixels at a time, from stored samples to all maps.

use crate::math::lanes::{Isa, Pair};
use crate::math::{Kernel, Mask, Real};

use super::lanes::NormalLanes;
use super::lights::{Distant, Lights, Near};
use super::plain_registers::{PlainBlock, PlainRegisters};
use super::problem::StereoProblem;
use super::results::NormalResults;
use super::rows::store;
use super::samples::{BLOCK, RegisterSamples, ScreenedSamples, StereoScratch};
use super::tile::NormalTile;

pub(super) struct NormalFit<'a, 'b, 'c> {
    pub(super) problem: &'a StereoProblem<'a>,
    pub(super) scratch: &'c mut StereoScratch,
    pub(super) tile: &'c mut NormalTile<'b>,
}

impl Kernel for NormalFit<'_, '_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        if self.problem.rig.is_distant() {
            self.fit::<Pair<I::F32>, Distant>();
        } else {
            self.fit::<Pair<I::F32>, Near<Pair<I::F32>>>();
        }
    }
}

impl NormalFit<'_, '_, '_> {
    #[inline(always)]
    fn fit<R: Real<Scalar = f32>, L: Lights<R>>(self) {
        let Self { problem, scratch, tile } = self;
        let mut pixels = NormalLanes::<R, L>::new(problem);
        let mut plain = PlainRegisters::new(problem, &pixels);
        let mut screened = ScreenedSamples::new(problem);
        let every: Vec<usize> = (0..BLOCK).step_by(R::WIDTH).collect();
        let mut start = 0;
        // A tile of hundreds of photographs takes long.
        while start < tile.count && !problem.run.cancelled() {
            scratch.read::<R>(problem, tile.start + start);
            let count = BLOCK.min(tile.count - start);
            let mut left = &every[..count.div_ceil(R::WIDTH)];
            if let Some(plain) = &mut plain {
                let (lights, scratch, tile) = (&pixels.lights, &*scratch, &mut *tile);
                R::apart(PlainBlock { plain, lights, problem, scratch, tile, start, count });
                left = &plain.left;
            }
            for &at in left {
                let (x, y) = (R::load(&scratch.x[at..]), R::load(&scratch.y[at..]));
                if !L::DISTANT {
                    pixels.lights.aim(problem.rig, x, y);
                }
                pixels.views.aim(problem.rig, x, y);
                let samples = RegisterSamples::of(scratch, problem, at);
                let mut sum = R::zero();
                for k in 0..problem.rig.observations() {
                    sum = sum + samples.means.at::<R>(k);
                }
                // A sum is finite only if all samples are; then none needs to be looked at again.
                let estimate = if sum.is_finite().all() {
                    pixels.fit_all(&samples, sum, &mut screened)
                } else {
                    pixels.fit_some(&samples, &mut screened)
                };
                for (plane, value) in tile.statistics.iter_mut().zip(pixels.statistics.planes()) {
                    store(value, plane, start + at);
                }
                NormalResults::new(&pixels, &estimate).write(&pixels, tile, start + at);
            }
            start += BLOCK;
        }
        if let Some(mask) = problem.stack.mask() {
            for pixel in 0..tile.count {
                if !mask[tile.start + pixel] {
                    tile.mask(pixel);
                }
            }
        }
    }
}
