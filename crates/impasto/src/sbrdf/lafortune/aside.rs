//! Photographs that show something else than the surface, told before lobes are (hard case 31).
//!
//! A cosine lobe about a free normal turns to a gross outlier and takes it for a highlight; lobes
//! that are then added about that normal believe it, too. Where a photograph is grossly brighter
//! than the lobe, or brighter by half than all others, photographs are therefore dealt out like
//! cards: of more hands than there are gross photographs one at least has none, and the lobe of a
//! hand that most photographs agree with says which they are.
//!
//! Grossly bright is also a highlight sharper than that lobe. But a highlight is brightest at its
//! middle: what is set aside is brighter than most photographs that stand nearer both to the mirror
//! direction and to the light. What lobes say of it then decides ([`Settle`](super::settle::Settle)).

use crate::brdf::cosine_lobe::{CosineLobe, PARAMETERS};
use crate::brdf::lafortune::Pair;
use crate::geometry::{Light, Rig};
use crate::lm::Options;
use crate::math::{Level, Vec3};

use super::found::SHARE;
use super::luminance::Sights;
use super::normal::{Facing, Shine, fit_shine};
use super::outliers::six_deviations;
use super::scratch::{Scratch, TILE};
use super::sequence::{ROUGH, to};

/// How many hands there may be.
const HANDS: [usize; 4] = [11, 7, 5, 3];

/// Photographs of a hand, on average at least: three for each unknown.
const HAND: usize = 3 * PARAMETERS;

/// An odd number without a pattern: that of the golden ratio.
const SHUFFLE: u64 = 0x9e37_79b9_7f4a_7c15;

/// How much brighter than all others photographs are that are looked at twice: from one view of a
/// rig of hundreds to the next a highlight of n = 60 changes by less.
const LONE: f32 = 1.5;

/// Sets photographs of some pixels aside.
pub(super) struct Aside<'a> {
    pub(super) rig: &'a Rig,
    pub(super) options: &'a Options,
    pub(super) level: Level,
    pub(super) scratch: &'a mut Scratch,
    pub(super) fine: &'a [usize],
    pub(super) stopped: &'a (dyn Fn() -> bool + Sync),
}

/// A pixel of which a photograph may show something else.
struct Suspect {
    /// Its place among the pixels.
    i: usize,
    /// What all photographs say of it, and what some do.
    shines: Vec<Shine>,
    /// The size from which residuals are gross.
    limit: f32,
    /// What is set aside.
    aside: Vec<usize>,
}

impl Suspect {
    fn last(&self) -> &Shine {
        &self.shines[self.shines.len() - 1]
    }
}

impl Aside<'_> {
    /// Cosine lobes of the pixels, by the photographs that are not set aside.
    pub(super) fn run(&mut self) -> Vec<Facing> {
        let every: Vec<_> = (0..self.fine.len()).collect();
        let mut shines = self.fit(&every, self.all(), self.options);
        let going = |_: &usize| !(self.stopped)();
        let mut suspects: Vec<_> = (every.into_iter().take_while(going))
            .filter_map(|i| self.suspect(i, shines[i]))
            .collect();
        let hands = self.deal(&mut suspects);
        // All that is gross to the best hand is set aside at first: the normal that the others tell
        // then tells highlights from the rest.
        for suspect in suspects.iter_mut().take_while(|_| !(self.stopped)()) {
            let best = self.best(suspect);
            suspect.aside = self.gross(suspect.i, &self.off(suspect.i, &best), suspect.limit);
        }
        self.refit(&mut suspects);
        let mut others = Vec::with_capacity(suspects.len());
        for suspect in suspects.iter_mut().take_while(|_| !(self.stopped)()) {
            let (i, best) = (suspect.i, self.best(suspect));
            suspect.limit = suspect.limit.min(limit(&self.off(i, suspect.last())));
            let gross = self.gross(i, &self.off(i, &best), suspect.limit);
            let mut aside = self.unsupported(i, &best, gross);
            // One alone may be what the lobe turned to.
            if let [lone] = self.lone(i)[..]
                && !aside.contains(&lone)
            {
                aside.push(lone);
            }
            others.push(Suspect { aside, shines: vec![shines[i]], ..*suspect });
        }
        self.refit(&mut others);
        for (gross, odd) in suspects.into_iter().zip(others).take_while(|_| !(self.stopped)()) {
            let i = odd.i;
            let mut cost = self.cost(i, &shines[i], odd.limit);
            // More hands than gross photographs, or no hand need be right.
            let right = gross.aside.len() < hands;
            let mut chosen = Vec::new();
            for set in [odd].into_iter().chain(right.then_some(gross)) {
                let next = self.cost(i, set.last(), set.limit);
                let samples = self.means(i).filter(|mean| mean.is_finite()).count() as f64;
                // Each photograph that is set aside must earn what any unknown costs.
                let more = set.aside.len() as f64 - chosen.len() as f64;
                if more > 0.0 && samples * (cost / next).ln() > more * samples.ln() {
                    (cost, shines[i], chosen) = (next, *set.last(), set.aside);
                }
            }
            self.mark(i, &chosen, true);
        }
        shines.into_iter().map(|shine| shine.facing).collect()
    }

    fn fit(&self, these: &[usize], photographs: Vec<usize>, options: &Options) -> Vec<Shine> {
        let pixels: Vec<_> = these.iter().map(|&i| self.fine[i]).collect();
        let sights = Sights::of(self.rig, photographs);
        let data = self.scratch.luminance(self.rig);
        fit_shine(self.level, &data, sights, &pixels, options, self.stopped)
    }

    fn all(&self) -> Vec<usize> {
        (0..self.rig.observations()).collect()
    }

    /// A pixel that shows more than its highlight, as the lobe of all photographs has it.
    fn suspect(&self, i: usize, shine: Shine) -> Option<Suspect> {
        let residuals = self.off(i, &shine);
        let limit = limit(&residuals);
        let odd = !shine.facing.sigma.is_finite()
            || !self.lone(i).is_empty()
            || !self.unsupported(i, &shine, self.gross(i, &residuals, limit)).is_empty();
        odd.then(|| Suspect { i, shines: vec![shine], limit, aside: Vec::new() })
    }

    /// Has every hand speak; the answer is how many there are.
    fn deal(&self, suspects: &mut [Suspect]) -> usize {
        let these: Vec<_> = suspects.iter().map(|suspect| suspect.i).collect();
        let count = self.rig.observations();
        let hands = HANDS.into_iter().find(|hands| count / hands >= HAND).unwrap_or(0);
        let rough = to(ROUGH, self.options);
        for hand in 0..hands {
            let mut hold = self.all();
            hold.retain(|&photograph| self.number(photograph) % hands == hand);
            let said = suspects.iter_mut().zip(self.fit(&these, hold, &rough));
            for (suspect, shine) in said.take_while(|_| !(self.stopped)()) {
                suspect.limit = suspect.limit.min(limit(&self.off(suspect.i, &shine)));
                suspect.shines.push(shine);
            }
        }
        hands
    }

    /// What a photograph is dealt out by: light and view, not its place, so that photographs which do
    /// not count, or stand elsewhere, leave the hands as they are.
    fn number(&self, photograph: usize) -> usize {
        let (light, view) =
            (self.rig.lights()[photograph].direction(), self.rig.views()[photograph]);
        let bits = [light, view].into_iter().flat_map(Vec3::array).map(f64::to_bits);
        let mix = |hash: u64, bits: u64| (hash.rotate_left(5) ^ bits).wrapping_mul(SHUFFLE);
        (bits.fold(0, mix) >> 32) as usize
    }

    /// What most photographs agree with.
    fn best(&self, suspect: &Suspect) -> Shine {
        let costs = suspect.shines.iter().map(|s| (self.cost(suspect.i, s, suspect.limit), *s));
        costs.reduce(|a, b| if b.0 < a.0 { b } else { a }).map_or(suspect.shines[0], |best| best.1)
    }

    /// Has all photographs speak that are not set aside.
    fn refit(&mut self, suspects: &mut [Suspect]) {
        for suspect in &*suspects {
            self.mark(suspect.i, &suspect.aside, true);
        }
        let these: Vec<_> = suspects.iter().map(|suspect| suspect.i).collect();
        for (suspect, shine) in suspects.iter_mut().zip(self.fit(&these, self.all(), self.options))
        {
            suspect.shines.push(shine);
        }
        for suspect in &*suspects {
            self.mark(suspect.i, &suspect.aside, false);
        }
    }

    fn means(&self, i: usize) -> impl Iterator<Item = f32> {
        self.scratch.means[self.fine[i]..].iter().step_by(TILE).copied()
    }

    /// What a pixel shows above its cosine lobe; not finite where a photograph does not count.
    fn off(&self, i: usize, shine: &Shine) -> Vec<f32> {
        let [across, up] = self.scratch.places[self.fine[i]].map(f64::from);
        let model = CosineLobe::new(shine.at.map(f64::from));
        let sights = self.rig.lights().iter().zip(self.rig.views());
        let residual = |(mean, (light, &view)): (f32, (&Light, &Vec3<f64>))| {
            let (towards, irradiance) = light.at(across, up);
            let (shown, _) = model.gradient(towards, view, towards.dot(view));
            mean - (irradiance * shown) as f32
        };
        self.means(i).zip(sights).map(residual).collect()
    }

    /// Sum of squares of all residuals, none of them larger than that of a limit.
    fn cost(&self, i: usize, shine: &Shine, limit: f32) -> f64 {
        if !shine.facing.sigma.is_finite() {
            return f64::INFINITY;
        }
        let off = self.off(i, shine).into_iter().filter(|residual| residual.is_finite());
        off.map(|residual| f64::from(residual.abs().min(limit)).powi(2)).sum()
    }

    /// Which photographs are grossly bright.
    fn gross(&self, i: usize, residuals: &[f32], limit: f32) -> Vec<usize> {
        let off = self.means(i).zip(residuals).enumerate();
        off.filter(|&(_, (mean, &residual))| residual > limit && residual > SHARE * mean)
            .map(|(photograph, _)| photograph)
            .collect()
    }

    /// Which of some grossly bright photographs are no part of a highlight.
    fn unsupported(&self, i: usize, shine: &Shine, mut gross: Vec<usize>) -> Vec<usize> {
        if gross.is_empty() {
            return gross;
        }
        let [across, up] = self.scratch.places[self.fine[i]].map(f64::from);
        let normal = CosineLobe::new(shine.at.map(f64::from)).normal;
        let sights = self.rig.lights().iter().zip(self.rig.views());
        let bases: Vec<_> = sights
            .zip(self.means(i))
            .map(|((light, &view), mean)| {
                let (towards, _) = light.at(across, up);
                let pair = Pair::against(normal, towards, view, towards.dot(view));
                // No base of a photograph that does not count is nearer.
                let base = |base: f64| if mean.is_finite() { base } else { f64::NAN };
                [-pair.tangential, pair.tangential].map(|along| base(pair.upright + along))
            })
            .collect();
        let bright: Vec<_> = gross.iter().map(|&photograph| bases[photograph]).collect();
        gross.retain(|&photograph| {
            [0, 1].into_iter().all(|side| {
                let nearer = |base: &&[f64; 2]| base[side] > bases[photograph][side];
                bases.iter().filter(nearer).count() > 2 * bright.iter().filter(nearer).count() + 1
            })
        });
        gross
    }

    /// The photographs, fewer than there may be hands, in which a pixel is brighter than in any
    /// other, by half.
    fn lone(&self, i: usize) -> Vec<usize> {
        let finite = self.means(i).enumerate().filter(|(_, mean)| mean.is_finite());
        let mut order: Vec<_> = finite.collect();
        let most = HANDS[0].min(order.len());
        if most < order.len() {
            order.select_nth_unstable_by(most, |a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            order.truncate(most);
        }
        order.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let gap = order.windows(2).position(|pair| pair[0].1 > LONE * pair[1].1.max(0.0));
        order[..gap.map_or(0, |gap| gap + 1)].iter().map(|(photograph, _)| *photograph).collect()
    }

    /// Sets photographs aside, or puts them back.
    fn mark(&mut self, i: usize, photographs: &[usize], aside: bool) {
        for photograph in photographs {
            let place = photograph * TILE + self.fine[i];
            self.scratch.kept[place] = if aside { f32::NAN } else { self.scratch.means[place] };
        }
    }
}

/// The size from which residuals are gross.
fn limit(residuals: &[f32]) -> f32 {
    let sizes = residuals.iter().map(|residual| residual.abs());
    six_deviations(&mut sizes.filter(|size| size.is_finite()).collect::<Vec<_>>())
}
