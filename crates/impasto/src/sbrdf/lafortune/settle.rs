//! Normal, lobes and the choice of samples, in turns until they agree.

use crate::geometry::Rig;
use crate::lm::Options;
use crate::math::Level;

use super::found::Found;
use super::lobes::Search;
use super::normal::Facing;
use super::outliers::Outliers;
use super::scratch::Scratch;
use super::seen::unseen;
use super::sequence::{ROUGH, Sequence, some, to};
use super::turned::turn;

/// Normals that lean further, by their z, are asked whether the painting's own plane is not a better
/// place to begin from: 30 degrees.
const LEANING: f32 = 0.866;

/// The pixels of a tile that are settled.
pub(super) struct Settle<'a> {
    pub(super) rig: &'a Rig,
    pub(super) sequence: &'a Sequence,
    /// Searches besides the first, for pixels where it turned the normal or left samples out: two
    /// reweightings settle what there is (hard case 31).
    pub(super) rounds: usize,
    pub(super) level: Level,
    pub(super) scratch: &'a mut Scratch,
    pub(super) fine: &'a [usize],
    /// Deviations of normals, `(pixel of the tile)`.
    pub(super) sigma: &'a mut [f32],
    pub(super) stopped: &'a (dyn Fn() -> bool + Sync),
}

impl Settle<'_> {
    /// Settles what was found with the normals as they stand.
    pub(super) fn run(&mut self, found: &mut [Found]) {
        let mut these: Vec<_> = (0..found.len()).collect();
        let mut trial = found.to_vec();
        for round in 0..=self.rounds {
            let mut again = self.turn(&these, &mut trial, found);
            if round == 0 {
                again.extend(self.upright(found));
            }
            if round == self.rounds {
                break;
            }
            again.extend(self.weigh(&these, found));
            again.sort_unstable();
            again.dedup();
            // A lobe too many may have stood in for the right normal, or for outliers: all anew.
            let pixels = self.pixels(&again);
            let data = self.scratch.luminance(self.rig);
            trial = self.sequence.fit(self.level, &data, &pixels, self.stopped).0;
            these = again;
        }
        self.leave_out(found);
        self.bound(found);
    }

    fn pixels(&self, these: &[usize]) -> Vec<usize> {
        these.iter().map(|&i| self.fine[i]).collect()
    }

    /// Frees normals and lobes together and keeps what is better than what there is. The answers
    /// are those whose normals were wrong.
    fn turn(&mut self, these: &[usize], trial: &mut [Found], found: &mut [Found]) -> Vec<usize> {
        let before: Vec<_> = trial.iter().map(Found::bic).collect();
        let facing = self.free(these, trial);
        let mut wrong = Vec::new();
        for (((&i, now), facing), before) in these.iter().zip(trial).zip(facing).zip(before) {
            if now.bic() < found[i].bic() {
                found[i] = *now;
                self.face(i, facing);
                // Two slopes must earn what any unknown costs.
                if before - now.bic() > 2.0 * (now.samples as f64).ln() {
                    wrong.push(i);
                }
            }
        }
        wrong
    }

    /// Begins again from the painting's plane where the normal leans far. A cosine lobe so broad
    /// that it shares the diffuse part's work may fit a matte surface as well from there, or a
    /// little better, as about its own normal; lobes that fit it there find no way back. What is
    /// clearly better is kept, and named in the answers.
    fn upright(&mut self, found: &mut [Found]) -> Vec<usize> {
        let normal = |i: usize| self.scratch.normals[self.fine[i]];
        let leaning = (0..found.len()).filter(|&i| normal(i)[2] < LEANING);
        let these: Vec<_> = leaning.filter(|_| self.sequence.turning).collect();
        let before: Vec<_> = these.iter().map(|&i| normal(i)).collect();
        for &i in &these {
            self.scratch.normals[self.fine[i]] = [0.0, 0.0, 1.0];
        }
        let data = self.scratch.luminance(self.rig);
        let pixels = self.pixels(&these);
        let mut trial = self.sequence.fit(self.level, &data, &pixels, self.stopped).0;
        let facing = self.free(&these, &mut trial);
        let mut better = Vec::new();
        for (((i, before), trial), facing) in these.into_iter().zip(before).zip(trial).zip(facing) {
            if facing.is_some() && trial.clearly_better(&found[i]) {
                found[i] = trial;
                self.face(i, facing);
                better.push(i);
            } else {
                self.scratch.normals[self.fine[i]] = before;
            }
        }
        better
    }

    /// Searches for normals and lobes together, where views tell them apart.
    fn free(&self, these: &[usize], trial: &mut [Found]) -> Vec<Option<Facing>> {
        if !self.sequence.turning {
            return vec![None; these.len()];
        }
        self.search(these, trial, &self.sequence.options, self.rig.observations())
    }

    /// A first look at what [`free`](Self::free) would find.
    fn glance(&self, these: &[usize], trial: &mut [Found]) {
        let rough = to(ROUGH, &self.sequence.options);
        self.search(these, trial, &rough, some(self.rig.observations()));
    }

    fn search(
        &self,
        these: &[usize],
        trial: &mut [Found],
        options: &Options,
        photographs: usize,
    ) -> Vec<Option<Facing>> {
        let data = &self.scratch.luminance(self.rig);
        let (turning, level, stopped) = (self.sequence.turning, self.level, self.stopped);
        let search = Search { data, turning, level, options, photographs, stopped };
        turn(&search, &self.pixels(these), trial)
    }

    fn face(&mut self, i: usize, facing: Option<Facing>) {
        if let Some(Facing { normal, sigma, .. }) = facing {
            self.scratch.normals[self.fine[i]] = normal;
            self.sigma[self.fine[i]] = sigma;
        }
    }

    /// Leaves gross outliers out; the answers are the pixels whose choice of samples changed.
    fn weigh(&mut self, these: &[usize], found: &mut [Found]) -> Vec<usize> {
        let pixels = self.pixels(these);
        let mut chosen: Vec<_> = these.iter().map(|&i| found[i]).collect();
        let outliers =
            Outliers { rig: self.rig, scratch: self.scratch, pixels: &pixels, found: &mut chosen };
        let changed = self.level.run(outliers);
        let mut again = Vec::new();
        for ((&i, chosen), changed) in these.iter().zip(chosen).zip(changed) {
            if changed {
                found[i] = chosen;
                again.push(i);
            }
        }
        again
    }

    /// Leaves out lobes that pixels can do without once their normals have settled.
    fn leave_out(&mut self, found: &mut [Found]) {
        if !self.sequence.turning {
            return;
        }
        for lobe in (0..self.sequence.lobes).rev() {
            let mut these: Vec<_> =
                (0..found.len()).filter(|&i| found[i].lobes > lobe.max(1)).collect();
            let mut trial: Vec<_> = these.iter().map(|&i| found[i].without(lobe)).collect();
            self.glance(&these, &mut trial);
            (these, trial) = these
                .into_iter()
                .zip(trial)
                .filter(|&(i, trial)| !found[i].clearly_better(&trial))
                .map(|(i, trial)| (i, Found { cost: f64::MAX, ..trial }))
                .unzip();
            let facing = self.free(&these, &mut trial);
            for ((i, trial), facing) in these.into_iter().zip(trial).zip(facing) {
                if facing.is_some() && trial.bic() < found[i].bic() {
                    found[i] = trial;
                    self.face(i, facing);
                }
            }
        }
    }

    /// Leaves out lobes whose peaks no photograph shows, one at a time, and searches on for the
    /// others. Normals stay: what told them are photographs, not what a lobe does elsewhere.
    fn bound(&self, found: &mut [Found]) {
        let data = self.scratch.luminance(self.rig);
        let mut these: Vec<_> = (0..found.len()).collect();
        while !these.is_empty() {
            let mut fewer = Vec::new();
            these.retain(|&i| {
                let unseen = unseen(&data, self.fine[i], &found[i]);
                fewer.extend(unseen.map(|lobe| found[i].without(lobe)));
                unseen.is_some()
            });
            let pixels = self.pixels(&these);
            self.sequence.search_on(self.level, &data, &pixels, &mut fewer, self.stopped);
            for (&i, fewer) in these.iter().zip(fewer) {
                found[i] = fewer;
            }
        }
    }
}
