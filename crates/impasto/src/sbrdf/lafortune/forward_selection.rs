//! Forward selection [@miller2002subset] of lobes by the Bayesian information criterion
//! [@schwarz1978bic]: Snel's second pass [@snel], lobes added one at a time.

use crate::lm::{Occupancy, Options, Outcome};
use crate::math::{Element, Level};

use super::estimate::{LafortuneEstimate, MOST_LOBES};
use super::lobes::{LOG_EXPONENT, LafortuneSearch};
use super::luminance::{Geometries, Luminance};

/// Exponents that Snel starts lobes from, in the order in which they are added, and two more
/// orders for pixels whose lobes look like a local minimum.
const STARTS: [[f64; MOST_LOBES]; 3] = [[50.0, 5.0, 20.0], [20.0, 50.0, 5.0], [5.0, 20.0, 50.0]];

/// `n` and `n turn` from which a first lobe starts that stands towards the light: `Cxy = Cz`.
const RETRO: f64 = 5.0;

/// Photographs that all but a pixel's last lobe are looked for in, if there are twice as many.
const SOME: usize = 151;

/// Tolerance of the search for a lobe to which another will be added: a cost to a thousandth is one to 0.7 in
/// the criterion of 700 samples, and a lobe costs 20.
pub(super) const ROUGH: f64 = 1e-3;

/// Strength that a lobe starts from, relative to the diffuse surface of least squares; the
/// diffuse part starts from the same.
const STRENGTH: f64 = 0.5;

/// Rounding of a predicted sample relative to the largest: costs below it are noiseless.
const ROUNDING: f64 = 1.0 / (1_u64 << 21) as f64;

/// How many lobes are selected, and how they are searched for.
#[derive(Clone, Copy, Debug)]
pub struct LafortuneSelection {
    /// Most lobes, 0 to [`MOST_LOBES`].
    pub lobes: usize,
    /// Whether a lobe that does not lower the Bayesian information criterion is left out.
    pub select: bool,
    /// Whether lobes may turn away from the mirror direction (hard case 18: not under one view).
    pub turning: bool,
    /// When the last search of a pixel stops.
    pub options: Options,
}

impl LafortuneSelection {
    /// Fits some pixels; estimates come in their order.
    ///
    /// `stopped` is called before each pixel; once it returns true the estimates are incomplete.
    pub fn fit(
        &self,
        level: Level,
        data: &Luminance<'_>,
        pixels: &[usize],
        stopped: &(dyn Fn() -> bool + Sync),
    ) -> (Vec<LafortuneEstimate>, Occupancy) {
        let mut adding =
            Adding { sequence: self, level, data, stopped, occupancy: Occupancy::default() };
        let [first, others @ ..] = STARTS;
        let plain = pixels.iter().map(|&pixel| self.plain(level, data, pixel)).collect();
        let mut found = adding.lobes(pixels, plain, first, &self.options);
        for starts in others {
            let doubtful: Vec<_> = (0..pixels.len()).filter(|&i| found[i].doubtful()).collect();
            let again: Vec<_> = doubtful.iter().map(|&i| pixels[i]).collect();
            let plain = again.iter().map(|&pixel| self.plain(level, data, pixel));
            // These start from the mirror direction wherever the first search did.
            let plain = plain.map(|plain| LafortuneEstimate { retro: false, ..plain }).collect();
            let mut other =
                adding.lobes(&again, plain, starts, &with_tolerance(ROUGH, &self.options));
            // Few of them are better: only those are worth the last digits.
            let better: Vec<_> =
                (0..again.len()).filter(|&j| other[j].bic() < found[doubtful[j]].bic()).collect();
            adding.finish(&self.options, &again, &better, &mut other);
            for j in better {
                found[doubtful[j]] = other[j];
            }
        }
        found.iter_mut().for_each(LafortuneEstimate::sort);
        (found, adding.occupancy)
    }

    /// Searches on from where some pixels stand, on their known normals.
    pub(super) fn search_on(
        &self,
        level: Level,
        data: &Luminance<'_>,
        pixels: &[usize],
        found: &mut [LafortuneEstimate],
        stopped: &(dyn Fn() -> bool + Sync),
    ) {
        let mut adding =
            Adding { sequence: self, level, data, stopped, occupancy: Occupancy::default() };
        let all: Vec<_> = (0..pixels.len()).collect();
        adding.finish(&self.options, pixels, &all, found);
        // A pixel left without lobes is linear: no search computed its cost.
        for (found, &pixel) in found.iter_mut().zip(pixels).filter(|(found, _)| found.lobes == 0) {
            *found = self.plain(level, data, pixel);
        }
        found.iter_mut().for_each(LafortuneEstimate::sort);
    }

    fn plain(&self, level: Level, data: &Luminance<'_>, pixel: usize) -> LafortuneEstimate {
        let plain = data.plain(pixel, level);
        let mut at = [0.0; 1 + 3 * MOST_LOBES];
        at[0] = plain.diffuse;
        LafortuneEstimate {
            lobes: 0,
            at,
            cost: plain.cost,
            samples: plain.count,
            photographs: data.photographs(),
            retro: self.turning && plain.retro,
            floor: plain.square * ROUNDING * ROUNDING,
        }
    }
}

/// Lobes being added to some pixels.
struct Adding<'a> {
    sequence: &'a LafortuneSelection,
    level: Level,
    data: &'a Luminance<'a>,
    stopped: &'a (dyn Fn() -> bool + Sync),
    occupancy: Occupancy,
}

impl Adding<'_> {
    /// Adds lobes to pixels without any, from exponents in the given order; `options` say when the
    /// last search stops.
    fn lobes(
        &mut self,
        pixels: &[usize],
        mut found: Vec<LafortuneEstimate>,
        starts: [f64; MOST_LOBES],
        options: &Options,
    ) -> Vec<LafortuneEstimate> {
        let LafortuneSelection { lobes: most, select, .. } = *self.sequence;
        let all = self.data.photographs();
        let some = some(all);
        let (rough, sure) = (with_tolerance(ROUGH, options), with_tolerance(0.1 * ROUGH, options));
        let mut open: Vec<_> = (0..pixels.len()).collect();
        for lobes in 1..=most.min(MOST_LOBES) {
            open.retain(|&i| room_for(lobes, found[i].samples) && found[i].at[0] > 0.0);
            let mut trial = found.clone();
            for &i in &open {
                trial[i] = with_lobe(&found[i], starts[lobes - 1]);
            }
            let options = if lobes == most && some == all { options } else { &rough };
            self.search(options, some, pixels, &open, &mut trial);
            if select {
                // Where some photographs leave it open, all of them decide.
                let unclear = |these: &[LafortuneEstimate], i: usize| {
                    these[i].photographs < all && !trial[i].clearly_better(&found[i])
                };
                let [before, after] = [&found, &trial].map(|these| -> Vec<_> {
                    open.iter().copied().filter(|&i| unclear(these, i)).collect()
                });
                self.search(&sure, all, pixels, &before, &mut found);
                self.search(&sure, all, pixels, &after, &mut trial);
            }
            open.retain(|&i| {
                let (next, last) = (&trial[i], &found[i]);
                // Where it was unclear, both are by now fits to all photographs.
                let lower = next.clearly_better(last) || next.bic() < last.bic();
                let better = !select || (next.whole() && lower);
                if better {
                    found[i] = trial[i];
                }
                better
            });
        }
        let open: Vec<_> =
            (0..pixels.len()).filter(|&i| some < all || found[i].lobes < most).collect();
        self.finish(options, pixels, &open, &mut found);
        found
    }

    /// Searches on from where some pixels stand, in all photographs.
    fn finish(
        &mut self,
        options: &Options,
        pixels: &[usize],
        which: &[usize],
        found: &mut [LafortuneEstimate],
    ) {
        // Where the search ended it begins: long first steps.
        let last = Options { damping: 1e-2, ..*options };
        for lobes in 1..=self.sequence.lobes {
            let these: Vec<_> =
                which.iter().copied().filter(|&i| found[i].lobes == lobes).collect();
            self.search(&last, self.data.photographs(), pixels, &these, found);
        }
    }

    /// Searches on from where some pixels, all with as many lobes, stand.
    fn search(
        &mut self,
        options: &Options,
        photographs: usize,
        pixels: &[usize],
        which: &[usize],
        found: &mut [LafortuneEstimate],
    ) {
        let Self { level, data, stopped, .. } = *self;
        let turning = self.sequence.turning;
        let search = LafortuneSearch { data, turning, level, options, photographs, stopped };
        let more = match which.first().map_or(0, |&i| found[i].lobes) {
            0 => return,
            1 => search_lobes::<f32, 4>(&search, pixels, which, found),
            2 => search_lobes::<f32, 7>(&search, pixels, which, found),
            _ => search_lobes::<f32, 10>(&search, pixels, which, found),
        };
        self.occupancy.lanes += more.lanes;
        self.occupancy.useful += more.useful;
    }
}

/// How many of the photographs a rough search uses.
pub(super) fn some(all: usize) -> usize {
    if all >= 2 * SOME { SOME } else { all }
}

/// A search that stops at another tolerance.
pub(super) fn with_tolerance(tolerance: f64, options: &Options) -> Options {
    Options { cost: tolerance, step: tolerance, gradient: tolerance, ..*options }
}

/// Whether so many samples determine so many lobes, with something left over (hard case 30).
fn room_for(lobes: usize, samples: usize) -> bool {
    samples > 2 + 3 * lobes
}

/// One lobe more, as strong as a diffuse part that shares the light with it.
fn with_lobe(found: &LafortuneEstimate, exponent: f64) -> LafortuneEstimate {
    let mut next = *found;
    if found.lobes == 0 {
        next.at[0] *= STRENGTH;
    }
    let strength = next.at[0].max(STRENGTH * 0.5 * found.at[0]);
    let [exponent, turning] =
        if found.lobes == 0 && found.retro { [RETRO; 2] } else { [exponent, 0.0] };
    let place = 1 + 3 * found.lobes;
    next.at[place..place + 3].copy_from_slice(&[
        strength,
        turning,
        exponent.ln().clamp(LOG_EXPONENT[0], LOG_EXPONENT[1]),
    ]);
    next.lobes += 1;
    next
}

fn search_lobes<S: Element, const N: usize>(
    search: &LafortuneSearch<'_>,
    pixels: &[usize],
    which: &[usize],
    found: &mut [LafortuneEstimate],
) -> Occupancy {
    let chosen: Vec<_> = which.iter().map(|&i| pixels[i]).collect();
    let geometries = Geometries::<f32>::some(search.data.rig, search.photographs);
    let counts: Vec<_> =
        chosen.iter().map(|&pixel| search.data.count(pixel, &geometries)).collect();
    let starts: Vec<[f64; N]> =
        which.iter().map(|&i| core::array::from_fn(|p| found[i].at[p])).collect();
    search.run(
        &chosen,
        |problem| starts[problem],
        |problem, outcome: &Outcome<S, N>| {
            let found = &mut found[which[problem]];
            for (at, parameter) in found.at.iter_mut().zip(outcome.parameters) {
                *at = parameter.to_f64();
            }
            found.cost = outcome.normal.cost.to_f64();
            found.samples = counts[problem];
            found.photographs = search.photographs;
        },
    )
}
