//! Consensus over disjoint subsets, after RANSAC [@fischler1981ransac]: which photographs of a pixel
//! show something other than its surface (hard case 31).
//!
//! A cosine lobe about a free normal turns to a single outlier and takes it for a highlight; lobes
//! that are then added about that normal fit it, too. Pixels in which a photograph is far brighter
//! than the lobe, or brighter by half than all others, are therefore fitted again to disjoint
//! subsets of their photographs. Of more subsets than there are outliers, at least one holds none;
//! the fit with the smallest truncated cost over all photographs says which photographs are
//! outliers. Subsets replace RANSAC's random draws: they are the same in every run, and few.
//!
//! A highlight sharper than that lobe is also far brighter than it. But a highlight is brightest at
//! its middle: only photographs are rejected that are brighter than most photographs nearer both to
//! the mirror direction and to the light. The lobes then decide about the others
//! ([`Refine`](super::refine::Refine)).

use crate::brdf::cosine_lobe::{CosineLobe, PARAMETERS};
use crate::brdf::lafortune::Pair;
use crate::geometry::Rig;
use crate::lm::Options;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Vec3};

use super::estimate::OUTLIER_SHARE;
use super::forward_selection::{ROUGH, with_tolerance};
use super::luminance::Geometries;
use super::normal::{CosineFit, NormalEstimate, fit_cosine_lobe};
use super::outliers::six_deviations;
use super::scratch::{LafortuneScratch, STRIDE};

/// How many subsets there may be.
const SUBSETS: [usize; 4] = [11, 7, 5, 3];

/// Photographs of a subset, on average at least: three for each unknown.
const SUBSET: usize = 3 * PARAMETERS;

/// An odd number without a pattern: that of the golden ratio.
const SHUFFLE: u64 = 0x9e37_79b9_7f4a_7c15;

/// Cells per unit of a direction's component: a millionth of a radian, finer than any rig is measured
/// and coarser than rounding.
const GRID: f64 = (1_u64 << 20) as f64;

/// Factor by which photographs must exceed all others to be suspected: from one view of a rig of
/// hundreds to the next a highlight of n = 60 changes by less.
const ISOLATED: f32 = 1.5;

/// Rejects photographs of some pixels.
pub(super) struct Consensus<'a> {
    pub(super) rig: &'a Rig,
    pub(super) options: &'a Options,
    pub(super) level: Level,
    pub(super) scratch: &'a mut LafortuneScratch,
    pub(super) fine: &'a [usize],
    pub(super) stopped: &'a (dyn Fn() -> bool + Sync),
}

/// A pixel with a photograph that may show something other than its surface.
struct Suspect {
    /// Its index among the pixels.
    i: usize,
    /// The fit to all photographs, then those to subsets.
    fits: Vec<CosineFit>,
    /// Residuals above this are outliers.
    limit: f32,
    /// Photographs that are rejected.
    rejected: Vec<usize>,
}

impl Suspect {
    fn last(&self) -> &CosineFit {
        &self.fits[self.fits.len() - 1]
    }
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct Residuals<'a, 'b> {
    consensus: &'a Consensus<'b>,
    i: usize,
    fit: &'a CosineFit,
}

impl Kernel for Residuals<'_, '_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<f32> {
        let Self { consensus: Consensus { rig, scratch, fine, .. }, i, fit } = self;
        let [across, up] = scratch.places[fine[i]].map(f64::from);
        let model = CosineLobe::new(fit.at.map(f64::from));
        let mut residuals = Vec::with_capacity(rig.observations());
        for photograph in 0..rig.observations() {
            let (towards, irradiance) = rig.lights()[photograph].at(across, up);
            let view = rig.views()[photograph].at(across, up);
            let (shown, _) = model.gradient(towards, view, towards.dot(view));
            let mean = scratch.means[fine[i] + photograph * STRIDE];
            residuals.push(mean - (irradiance * shown) as f32);
        }
        residuals
    }
}

impl Consensus<'_> {
    /// Cosine lobes of the pixels, from the photographs that are not rejected.
    pub(super) fn run(&mut self) -> Vec<NormalEstimate> {
        let every: Vec<_> = (0..self.fine.len()).collect();
        let mut fits = self.fit(&every, self.all(), self.options);
        let going = |_: &usize| !(self.stopped)();
        let mut suspects: Vec<_> = (every.into_iter().take_while(going))
            .filter_map(|i| self.suspect(i, fits[i]))
            .collect();
        let subsets = self.split(&mut suspects);
        // First all outliers of the best fit are rejected: the normal of the remaining photographs
        // then separates highlights from the rest.
        for suspect in suspects.iter_mut().take_while(|_| !(self.stopped)()) {
            let best = self.best(suspect);
            suspect.rejected =
                self.outliers(suspect.i, &self.residuals(suspect.i, &best), suspect.limit);
        }
        self.refit(&mut suspects);
        let mut others = Vec::with_capacity(suspects.len());
        for suspect in suspects.iter_mut().take_while(|_| !(self.stopped)()) {
            let (i, best) = (suspect.i, self.best(suspect));
            suspect.limit = suspect.limit.min(limit(&self.residuals(i, suspect.last())));
            let outliers = self.outliers(i, &self.residuals(i, &best), suspect.limit);
            let mut rejected = self.unsupported(i, &best, outliers);
            // The lobe may have turned to a single bright photograph.
            if let [single] = self.isolated(i)[..]
                && !rejected.contains(&single)
            {
                rejected.push(single);
            }
            others.push(Suspect { rejected, fits: vec![fits[i]], ..*suspect });
        }
        self.refit(&mut others);
        for (every_outlier, unsupported) in
            suspects.into_iter().zip(others).take_while(|_| !(self.stopped)())
        {
            let i = unsupported.i;
            let mut cost = self.cost(i, &fits[i], unsupported.limit);
            // Only with more subsets than outliers is some subset free of them.
            let clean = every_outlier.rejected.len() < subsets;
            let mut chosen = Vec::new();
            for set in [unsupported].into_iter().chain(clean.then_some(every_outlier)) {
                let next = self.cost(i, set.last(), set.limit);
                let samples = self.means(i).filter(|mean| mean.is_finite()).count() as f64;
                // Each rejected photograph must lower the criterion by what an unknown costs.
                let more = set.rejected.len() as f64 - chosen.len() as f64;
                if more > 0.0 && samples * (cost / next).ln() > more * samples.ln() {
                    (cost, fits[i], chosen) = (next, *set.last(), set.rejected);
                }
            }
            self.reject(i, &chosen, true);
        }
        fits.into_iter().map(|fit| fit.facing).collect()
    }

    fn fit(&self, these: &[usize], photographs: Vec<usize>, options: &Options) -> Vec<CosineFit> {
        let pixels: Vec<_> = these.iter().map(|&i| self.fine[i]).collect();
        let geometries = Geometries::of(self.rig, photographs);
        let data = self.scratch.luminance(self.rig);
        fit_cosine_lobe(self.level, &data, geometries, &pixels, options, self.stopped)
    }

    fn all(&self) -> Vec<usize> {
        (0..self.rig.observations()).collect()
    }

    /// The pixel, if its photographs show more than the highlight fitted to all of them.
    fn suspect(&self, i: usize, fit: CosineFit) -> Option<Suspect> {
        let residuals = self.residuals(i, &fit);
        let limit = limit(&residuals);
        let odd = !fit.facing.sigma.is_finite()
            || !self.isolated(i).is_empty()
            || !self.unsupported(i, &fit, self.outliers(i, &residuals, limit)).is_empty();
        odd.then(|| Suspect { i, fits: vec![fit], limit, rejected: Vec::new() })
    }

    /// Fits every subset of the photographs and returns how many subsets there are.
    fn split(&self, suspects: &mut [Suspect]) -> usize {
        let these: Vec<_> = suspects.iter().map(|suspect| suspect.i).collect();
        let count = self.rig.observations();
        let subsets = SUBSETS.into_iter().find(|subsets| count / subsets >= SUBSET).unwrap_or(0);
        let rough = with_tolerance(ROUGH, self.options);
        for subset in 0..subsets {
            let mut members = self.all();
            members.retain(|&photograph| self.key(photograph) % subsets == subset);
            let fits = suspects.iter_mut().zip(self.fit(&these, members, &rough));
            for (suspect, fit) in fits.take_while(|_| !(self.stopped)()) {
                suspect.limit = suspect.limit.min(limit(&self.residuals(suspect.i, &fit)));
                suspect.fits.push(fit);
            }
        }
        subsets
    }

    fn key(&self, photograph: usize) -> usize {
        let light = self.rig.lights()[photograph].direction();
        subset_key(light, self.rig.views()[photograph].direction())
    }

    /// The fit with the smallest truncated cost: most photographs agree with it.
    fn best(&self, suspect: &Suspect) -> CosineFit {
        let costs = suspect.fits.iter().map(|s| (self.cost(suspect.i, s, suspect.limit), *s));
        costs.reduce(|a, b| if b.0 < a.0 { b } else { a }).map_or(suspect.fits[0], |best| best.1)
    }

    /// Fits all photographs that are not rejected.
    fn refit(&mut self, suspects: &mut [Suspect]) {
        for suspect in &*suspects {
            self.reject(suspect.i, &suspect.rejected, true);
        }
        let these: Vec<_> = suspects.iter().map(|suspect| suspect.i).collect();
        for (suspect, fit) in suspects.iter_mut().zip(self.fit(&these, self.all(), self.options)) {
            suspect.fits.push(fit);
        }
        for suspect in &*suspects {
            self.reject(suspect.i, &suspect.rejected, false);
        }
    }

    fn means(&self, i: usize) -> impl Iterator<Item = f32> {
        self.scratch.means[self.fine[i]..].iter().step_by(STRIDE).copied()
    }

    /// Samples minus the cosine lobe; not finite where a photograph does not count.
    fn residuals(&self, i: usize, fit: &CosineFit) -> Vec<f32> {
        self.level.run(Residuals { consensus: self, i, fit })
    }

    /// Sum of squared residuals, each truncated at the limit.
    fn cost(&self, i: usize, fit: &CosineFit, limit: f32) -> f64 {
        if !fit.facing.sigma.is_finite() {
            return f64::INFINITY;
        }
        let residuals = self.residuals(i, fit).into_iter().filter(|residual| residual.is_finite());
        residuals.map(|residual| f64::from(residual.abs().min(limit)).powi(2)).sum()
    }

    /// Which photographs are far too bright for the fit.
    fn outliers(&self, i: usize, residuals: &[f32], limit: f32) -> Vec<usize> {
        let samples = self.means(i).zip(residuals).enumerate();
        samples
            .filter(|&(_, (mean, &residual))| residual > limit && residual > OUTLIER_SHARE * mean)
            .map(|(photograph, _)| photograph)
            .collect()
    }

    /// Which of some photographs that are far too bright do not belong to a highlight.
    fn unsupported(&self, i: usize, fit: &CosineFit, mut outliers: Vec<usize>) -> Vec<usize> {
        if outliers.is_empty() {
            return outliers;
        }
        let [across, up] = self.scratch.places[self.fine[i]].map(f64::from);
        let normal = CosineLobe::new(fit.at.map(f64::from)).normal;
        let geometries = self.rig.lights().iter().zip(self.rig.views());
        let bases: Vec<_> = geometries
            .zip(self.means(i))
            .map(|((light, view), mean)| {
                let (towards, _) = light.at(across, up);
                let view = view.at(across, up);
                let pair = Pair::against(normal, towards, view, towards.dot(view));
                // No base of a photograph that does not count is nearer.
                let base = |base: f64| if mean.is_finite() { base } else { f64::NAN };
                [-pair.tangential, pair.tangential].map(|along| base(pair.upright + along))
            })
            .collect();
        let bright: Vec<_> = outliers.iter().map(|&photograph| bases[photograph]).collect();
        outliers.retain(|&photograph| {
            [0, 1].into_iter().all(|side| {
                let nearer = |base: &&[f64; 2]| base[side] > bases[photograph][side];
                bases.iter().filter(nearer).count() > 2 * bright.iter().filter(nearer).count() + 1
            })
        });
        outliers
    }

    /// The photographs, fewer than the largest number of subsets, in which the pixel is brighter than
    /// in all others by the factor [`ISOLATED`].
    fn isolated(&self, i: usize) -> Vec<usize> {
        let finite = self.means(i).enumerate().filter(|(_, mean)| mean.is_finite());
        let mut order: Vec<_> = finite.collect();
        let most = SUBSETS[0].min(order.len());
        if most < order.len() {
            order.select_nth_unstable_by(most, |a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            order.truncate(most);
        }
        order.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let gap = order.windows(2).position(|pair| pair[0].1 > ISOLATED * pair[1].1.max(0.0));
        order[..gap.map_or(0, |gap| gap + 1)].iter().map(|(photograph, _)| *photograph).collect()
    }

    /// Rejects photographs, or accepts them again.
    fn reject(&mut self, i: usize, photographs: &[usize], rejected: bool) {
        for photograph in photographs {
            let place = photograph * STRIDE + self.fine[i];
            self.scratch.kept[place] = if rejected { f32::NAN } else { self.scratch.means[place] };
        }
    }
}

/// What a photograph's subset is chosen by: its light and view, not its number, so that photographs
/// that do not count, or come in another order, leave the subsets as they are.
///
/// Directions are rounded to a grid: neither a negative zero nor the last digits of a direction
/// change the subsets. Only directions within rounding of a boundary between two cells may differ,
/// one of 10^9.
fn subset_key(light: Vec3<f64>, view: Vec3<f64>) -> usize {
    let cells = [light, view].into_iter().flat_map(Vec3::array);
    let cells = cells.map(|part| (part * GRID).round_ties_even() as i64 as u64);
    let mix = |hash: u64, cell: u64| (hash.rotate_left(5) ^ cell).wrapping_mul(SHUFFLE);
    (cells.fold(0, mix) >> 32) as usize
}

/// Residuals above this are outliers.
fn limit(residuals: &[f32]) -> f32 {
    let sizes = residuals.iter().map(|residual| residual.abs());
    six_deviations(&mut sizes.filter(|size| size.is_finite()).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions all over the hemisphere, and those that people type: axes and halves.
    fn directions() -> Vec<Vec3<f64>> {
        let spiral = (0..200).map(|i| {
            let (turn, z) = (2.4 * f64::from(i), 0.1 + 0.0045 * f64::from(i));
            let radius = (1.0 - z * z).sqrt();
            Vec3::new(radius * turn.cos(), radius * turn.sin(), z)
        });
        let typed =
            [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -0.6, 0.8], [-0.5, 0.5, 0.5_f64.sqrt()]];
        spiral.chain(typed.map(|[x, y, z]| Vec3::new(x, y, z))).collect()
    }

    #[test]
    fn rounding_and_the_sign_of_zero_change_no_subset() {
        let view = Vec3::new(0.0, 0.0, 1.0);
        let change = |v: Vec3<f64>, f: fn(f64) -> f64| Vec3::new(f(v.x), f(v.y), f(v.z));
        for light in directions() {
            let key = subset_key(light, view);
            for f in [f64::next_up, f64::next_down, |v: f64| if v == 0.0 { -v } else { v }] {
                assert_eq!(subset_key(change(light, f), view), key, "{light:?}");
                assert_eq!(
                    subset_key(view, change(light, f)),
                    subset_key(view, light),
                    "{light:?}"
                );
            }
        }
    }

    #[test]
    fn subsets_are_of_similar_size() {
        let view = Vec3::new(0.0, 0.0, 1.0);
        for subsets in SUBSETS {
            let mut sizes = vec![0; subsets];
            for light in directions() {
                sizes[subset_key(light, view) % subsets] += 1;
            }
            // Sizes of random subsets have a deviation below the root of their mean, 204 / subsets:
            // four of them.
            let mean = 204.0 / subsets as f64;
            assert!(
                sizes.iter().all(|&size| (f64::from(size) - mean).abs() < 4.0 * mean.sqrt()),
                "{sizes:?}"
            );
        }
    }
}
