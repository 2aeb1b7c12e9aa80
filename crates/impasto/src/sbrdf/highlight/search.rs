//! The search for the lobes of one tile's pixels.

use crate::brdf::torrance_sparrow::{GAMMA_MAX, GAMMA_MIN, sharpness};
use crate::lm::{Batch, Bounds, Column, Normal, Occupancy, Options, Outcome, Reason, Rows, fit};
use crate::maps::Status;
use crate::math::elementary::{exp, exp_in_range};
use crate::math::{Real, Scalar};

use super::kernels::{Finish, Prepare, Survey};
use super::tile::{HighlightTile, STAGE};

impl HighlightTile<'_> {
    pub(super) fn fit(mut self) -> Occupancy {
        let level = self.level;
        level.run(Survey(&mut self));
        let count = self.used.len();
        let mut usable = Vec::with_capacity(count);
        for pixel in 0..count {
            let verdict = match self.used[pixel] {
                0 => Status::InvalidInput,
                1 => Status::TooFewSamples,
                _ if self.top[pixel] <= 0.0 => Status::Dark,
                _ => {
                    usable.push(pixel);
                    continue;
                }
            };
            self.give_up(pixel, verdict);
        }
        let bounds = Bounds {
            lower: [0.0, sharpness(GAMMA_MAX).ln() as f32],
            upper: [f32::MAX, sharpness(GAMMA_MIN).ln() as f32],
        };
        let busy = fit(level, &mut self, usable, &bounds, &SEARCH);
        level.run(Finish(&mut self));
        busy
    }
}

/// Starts are near enough for long first steps. A cost within 1e-5 is, after a last step that
/// converges quadratically, a hundredth of a standard deviation.
const SEARCH: Options = Options {
    max_iterations: 100,
    cost: 1e-5,
    step: 1e-5,
    gradient: 1e-5,
    offset: 0.0,
    damping: 1e-2,
    memory: 0.0,
};

impl Batch<f32, 2> for HighlightTile<'_> {
    const COVARIANCE: bool = true;
    const INTERLEAVE: bool = true;

    fn rows(&self) -> usize {
        2 * self.observations
    }

    #[inline(always)]
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 2] {
        let (first, lane) = (problem / STAGE * STAGE, problem % STAGE);
        if self.staged != first {
            self.staged = first;
            // A call of its own, not a part of the search's loop.
            self.level.run(Prepare(self));
        }
        column.fill(self.stage.iter().map(|line| line[lane]));
        [self.strengths[lane], self.width]
    }

    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; 2]) -> Normal<R, 2> {
        self.visit(rows, at).1
    }

    #[inline(always)]
    fn visit<R: Real<Scalar = f32>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; 2],
    ) -> ([R; 2], Normal<R, 2>) {
        let (k, floor) = (-exp(at[1]), R::splat(R::Scalar::EXP_UNDERFLOW));
        let mut normal = Normal::zero();
        for i in 0..self.observations {
            // Beyond the floor a lobe is 1e-38, which adds nothing to any sum.
            let exponent = (k * rows.get(self.observations + i)).max(floor);
            let lobe = exp_in_range(exponent);
            let residual = (-at[0]).mul_add(lobe, rows.get(i));
            normal.add([lobe, exponent * lobe], residual);
        }
        normal.project(at, R::zero())
    }

    #[inline(always)]
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 2>) {
        let [beta, log_sharpness] = outcome.parameters;
        let [strength, width] = outcome.deficient();
        let verdict = match outcome.reason {
            // Samples are finite and near one: the strength is not, for the lobe has vanished.
            Reason::NotFinite => Some(Status::RankDeficient),
            _ if beta <= 0.0 || strength => Some(Status::Dark),
            _ if width => Some(Status::RankDeficient),
            _ => None,
        };
        if let Some(verdict) = verdict {
            return self.give_up(problem, verdict);
        }
        // As the search has it; `Finish` makes maps of it for many pixels together.
        let inverse = outcome.covariance(1.0);
        let maps = &mut self.maps;
        maps.beta[problem] = beta;
        maps.gamma[problem] = log_sharpness;
        maps.covariance[0][problem] = inverse[0][0];
        maps.covariance[1][problem] = inverse[1][0];
        maps.covariance[2][problem] = inverse[1][1];
        maps.residual[problem] = outcome.normal.cost;
        let sure = outcome.reason.converged();
        maps.status[problem] = if sure { Status::Fitted } else { Status::IllConditioned }.code();
    }
}
