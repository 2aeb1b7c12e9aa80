//! Alternating refinement of the normal, the lobes and the choice of samples, until they agree.

use crate::geometry::Rig;
use crate::lm::Options;
use crate::math::Level;

use super::estimate::LafortuneEstimate;
use super::forward_selection::{LafortuneSelection, ROUGH, some, with_tolerance};
use super::joint::fit_jointly;
use super::lobes::LafortuneSearch;
use super::normal::NormalEstimate;
use super::outliers::Outliers;
use super::scratch::LafortuneScratch;
use super::seen::unseen;

/// Pixels whose normals have a smaller z (lean by more than 30 degrees) are also searched from the
/// painting's own plane.
const LEANING: f32 = 0.866;

/// The pixels of a tile that are refined.
pub(super) struct Refine<'a> {
    pub(super) rig: &'a Rig,
    pub(super) sequence: &'a LafortuneSelection,
    /// Searches besides the first, for pixels where it turned the normal or left samples out: two
    /// reweightings are enough (hard case 31).
    pub(super) rounds: usize,
    pub(super) level: Level,
    pub(super) scratch: &'a mut LafortuneScratch,
    pub(super) fine: &'a [usize],
    /// Deviations of normals, `(pixel of the tile)`.
    pub(super) sigma: &'a mut [f32],
    pub(super) stopped: &'a (dyn Fn() -> bool + Sync),
}

impl Refine<'_> {
    /// Refines estimates that were made with the current normals.
    pub(super) fn run(&mut self, found: &mut [LafortuneEstimate]) {
        let mut these: Vec<_> = (0..found.len()).collect();
        let mut trial = found.to_vec();
        for round in 0..=self.rounds {
            let mut again = self.free_normals(&these, &mut trial, found);
            if round == 0 {
                again.extend(self.upright(found));
            }
            if round == self.rounds {
                break;
            }
            again.extend(self.reject_outliers(&these, found));
            again.sort_unstable();
            again.dedup();
            // A lobe too many may have compensated a wrong normal or outliers: all are selected anew.
            let pixels = self.pixels(&again);
            let data = self.scratch.luminance(self.rig);
            trial = self.sequence.fit(self.level, &data, &pixels, self.stopped).0;
            these = again;
        }
        self.eliminate(found);
        self.remove_unseen(found);
    }

    fn pixels(&self, these: &[usize]) -> Vec<usize> {
        these.iter().map(|&i| self.fine[i]).collect()
    }

    /// Frees normals and lobes together and keeps what lowers the criterion. Returns the pixels whose
    /// normals were wrong.
    fn free_normals(
        &mut self,
        these: &[usize],
        trial: &mut [LafortuneEstimate],
        found: &mut [LafortuneEstimate],
    ) -> Vec<usize> {
        let before: Vec<_> = trial.iter().map(LafortuneEstimate::bic).collect();
        let facing = self.free(these, trial);
        let mut wrong = Vec::new();
        for (((&i, now), facing), before) in these.iter().zip(trial).zip(facing).zip(before) {
            if now.bic() < found[i].bic() {
                found[i] = *now;
                self.set_normal(i, facing);
                // Two slopes must lower the criterion by what two unknowns cost.
                if before - now.bic() > 2.0 * (now.samples as f64).ln() {
                    wrong.push(i);
                }
            }
        }
        wrong
    }

    /// Begins again from the painting's plane where the normal leans far. A cosine lobe so broad
    /// that it shares the diffuse part's work may fit a matte surface as well from there, or a
    /// little better, as about its own normal; lobes that fit it there find no way back. Returns the
    /// pixels where the new start is clearly better; they keep it.
    fn upright(&mut self, found: &mut [LafortuneEstimate]) -> Vec<usize> {
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
                self.set_normal(i, facing);
                better.push(i);
            } else {
                self.scratch.normals[self.fine[i]] = before;
            }
        }
        better
    }

    /// Searches for normals and lobes together, where views tell them apart.
    fn free(
        &self,
        these: &[usize],
        trial: &mut [LafortuneEstimate],
    ) -> Vec<Option<NormalEstimate>> {
        if !self.sequence.turning {
            return vec![None; these.len()];
        }
        self.search(these, trial, &self.sequence.options, self.rig.observations())
    }

    /// The rough search before [`free`](Self::free): some photographs, large tolerances.
    fn free_roughly(&self, these: &[usize], trial: &mut [LafortuneEstimate]) {
        let rough = with_tolerance(ROUGH, &self.sequence.options);
        self.search(these, trial, &rough, some(self.rig.observations()));
    }

    fn search(
        &self,
        these: &[usize],
        trial: &mut [LafortuneEstimate],
        options: &Options,
        photographs: usize,
    ) -> Vec<Option<NormalEstimate>> {
        let data = &self.scratch.luminance(self.rig);
        let (turning, level, stopped) = (self.sequence.turning, self.level, self.stopped);
        let search = LafortuneSearch { data, turning, level, options, photographs, stopped };
        fit_jointly(&search, &self.pixels(these), trial)
    }

    fn set_normal(&mut self, i: usize, facing: Option<NormalEstimate>) {
        if let Some(NormalEstimate { normal, sigma, .. }) = facing {
            self.scratch.normals[self.fine[i]] = normal;
            self.sigma[self.fine[i]] = sigma;
        }
    }

    /// Leaves outliers out; returns the pixels whose choice of samples changed.
    fn reject_outliers(&mut self, these: &[usize], found: &mut [LafortuneEstimate]) -> Vec<usize> {
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

    /// Backward elimination [@miller2002subset]: removes lobes that pixels can do without once their
    /// normals are refined.
    fn eliminate(&mut self, found: &mut [LafortuneEstimate]) {
        if !self.sequence.turning {
            return;
        }
        for lobe in (0..self.sequence.lobes).rev() {
            let mut these: Vec<_> =
                (0..found.len()).filter(|&i| found[i].lobes > lobe.max(1)).collect();
            let mut trial: Vec<_> = these.iter().map(|&i| found[i].without(lobe)).collect();
            self.free_roughly(&these, &mut trial);
            (these, trial) = these
                .into_iter()
                .zip(trial)
                .filter(|&(i, trial)| !found[i].clearly_better(&trial))
                .map(|(i, trial)| (i, LafortuneEstimate { cost: f64::MAX, ..trial }))
                .unzip();
            let facing = self.free(&these, &mut trial);
            for ((i, trial), facing) in these.into_iter().zip(trial).zip(facing) {
                if facing.is_some() && trial.bic() < found[i].bic() {
                    found[i] = trial;
                    self.set_normal(i, facing);
                }
            }
        }
    }

    /// Removes lobes whose peaks no photograph shows, one at a time, and searches on with the others.
    /// Normals stay: they were estimated where there are photographs.
    fn remove_unseen(&self, found: &mut [LafortuneEstimate]) {
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
