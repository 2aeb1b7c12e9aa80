//! The cost of starts before any step, in a tenth of the time of a search from each.

use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Real};

use super::model::{LobeEstimation, Visit};
use super::photographs::Photographs;
use super::tile::{Estimate, STRIDE, TileSamples, gather_lobes, gather_normal};
use crate::lm::nnls::Sums;

/// Evaluates one start of some pixels.
pub(super) struct Score<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    /// Of one band.
    pub(super) samples: &'a TileSamples,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) ambient: bool,
    /// A start for every pixel of the tile.
    pub(super) starts: &'a [Estimate],
    /// The best start so far; replaced by one of smaller cost.
    pub(super) found: &'a mut [Estimate],
    /// The pixels whose starts are evaluated, in rising order.
    pub(super) pixels: &'a [usize],
    pub(super) lobes: usize,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Score<'_, M> {
    pub(super) fn run(self) {
        M::dispatch(self.lobes, self);
    }
}

impl<M: LobeEstimation> Visit for Score<'_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.level;
        level.run(ScorePass::<M, J, K>(self));
    }
}

struct ScorePass<'a, M: LobeEstimation, const J: usize, const K: usize>(Score<'a, M>);

impl<M: LobeEstimation, const J: usize, const K: usize> Kernel for ScorePass<'_, M, J, K> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn run<I: Isa>(self) {
        let Score { photographs, samples, x, y, ambient, starts, found, pixels, .. } = self.0;
        let zero = I::F32::zero();
        let barred = core::array::from_fn(|column| column == K - 1 && !ambient);
        let width = I::F32::WIDTH;
        for some in pixels.chunk_by(|a, b| a / width == b / width) {
            let at = some[0] / width * width;
            let normal = gather_normal(starts, at);
            let lobes = gather_lobes::<I::F32, M, J>(&photographs.model, starts, at);
            let (px, py) = (I::F32::load(&x[at..]), I::F32::load(&y[at..]));
            let mut sums = Sums::<I::F32, K>::zero();
            for photograph in 0..photographs.len() {
                let (towards, irradiance, pair) = photographs.at(photograph, px, py);
                let cosine = normal.dot(towards);
                let mut columns = [I::F32::one(); K];
                let diffuse = photographs.diffuse(normal, towards, &pair).value;
                columns[0] = I::F32::keep(cosine.gt(zero), diffuse * irradiance);
                for j in 0..J {
                    columns[1 + j] = photographs.model.value(&lobes[j], &pair, normal) * irradiance;
                }
                let place = photograph * STRIDE + at;
                let weight = I::F32::load(&samples.weights[place..]);
                sums.add(&columns, weight, I::F32::load(&samples.samples[place..]));
            }
            let colours = sums.solve(&barred).values;
            let mut costs = [0.0; MAX_LANES];
            sums.left(&colours).store(&mut costs);
            for &pixel in some {
                let cost = costs[pixel - at];
                if cost < found[pixel].cost {
                    found[pixel] = Estimate { lobes: J, cost, ..starts[pixel] };
                }
            }
        }
    }
}
