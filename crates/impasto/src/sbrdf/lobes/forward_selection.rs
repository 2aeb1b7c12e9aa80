//! Forward selection [@miller2002subset] of a pixel's lobes, on the mean of the bands.
//!
//! Lobes are added one at a time; the Bayesian information criterion (BIC) [@schwarz1978bic]
//! decides whether one more is worth its unknowns.

use crate::geometry::Grid;
use crate::lm::Options;
use crate::passes::Purpose;
use crate::pixels::Run;

use super::brightest::brightest;
use super::maps::MOST_LOBES;
use super::model::LobeEstimation;
use super::options::{LobeOptions, Origin, Precision};
use super::photographs::Photographs;
use super::prior::Prior;
use super::score::Score;
use super::search::{Freedom, Search};
use super::seeds::{Seed, Seeds};
use super::support::supported;
use super::tile::{ByLobeCount, Estimate, LobeFitTile};

/// Where the search for one more lobe starts.
pub(super) enum Starts<'a> {
    /// One search from every starting shape of the model; the best end is kept.
    Multistart,
    /// One search, from the model's starting shape with the least sum of squares.
    BestStart,
    /// The seeds around each pixel: one search, from the start with the least sum of squares.
    Neighbours {
        around: &'a [Vec<&'a Seed>],
        /// How many lobes each pixel may have.
        most: &'a [usize],
    },
}

/// What is known of a tile's pixels before one more lobe is added.
#[derive(Clone, Copy)]
struct Before<'a> {
    /// Their estimates before any lobe.
    first: &'a [Estimate],
    /// The normals that mirror their brightest photograph.
    brightest: &'a [[f32; 3]],
    /// Their best estimates with one lobe less.
    fewer: &'a [Estimate],
}

/// Adds lobes to the pixels of a tile, one at a time.
pub(super) struct ForwardSelection<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    pub(super) options: &'a LobeOptions,
    pub(super) prior: Option<&'a Prior>,
    pub(super) run: &'a Run<'a>,
}

impl<M: LobeEstimation> ForwardSelection<'_, M> {
    /// Adds lobes as long as BIC accepts them, from the tile's current estimates.
    pub(super) fn select(
        &self,
        tile: &mut LobeFitTile,
        fitted: &[usize],
        origin: &Starts<'_>,
    ) -> Vec<ByLobeCount> {
        let first = tile.estimates.clone();
        let brightest = brightest(self.photographs, tile, self.run.level);
        self.search(tile, &first, fitted, 0);
        let without =
            |&estimate: &Estimate| ByLobeCount { estimates: [estimate; MOST_LOBES + 1], lobes: 0 };
        let mut found: Vec<ByLobeCount> = tile.estimates.iter().map(without).collect();
        for lobes in 1..=self.options.lobes {
            let able: Vec<usize> = fitted
                .iter()
                .copied()
                .filter(|&pixel| {
                    self.supports(tile, pixel, lobes)
                        && found[pixel].lobes + 1 == lobes
                        && match origin {
                            Starts::Multistart | Starts::BestStart => true,
                            Starts::Neighbours { most, .. } => lobes <= most[pixel],
                        }
                })
                .collect();
            let fewer: Vec<Estimate> = found.iter().map(|found| *found.chosen()).collect();
            let before = Before { first: &first, brightest: &brightest, fewer: &fewer };
            self.add_lobe(tile, &able, before, lobes, origin);
            self.accept(tile, &able, &fewer, lobes, &mut found);
            // A lobe like those of the seeds may be one that the pixel already has: the search then
            // ends in a poor minimum, and a lobe of another width is missed. Without such seeds the
            // search has started from the model's shapes already.
            if let (Starts::Neighbours { around, .. }, 2..) = (origin, lobes) {
                let refused: Vec<usize> = able
                    .into_iter()
                    .filter(|&pixel| {
                        found[pixel].lobes < lobes
                            && fewer[pixel].cost > tile.rounding[pixel]
                            && around[pixel].iter().any(|seed| seed.by_count.lobes >= lobes)
                    })
                    .collect();
                self.add_lobe(tile, &refused, before, lobes, &Starts::BestStart);
                self.accept(tile, &refused, &fewer, lobes, &mut found);
            }
        }
        found
    }

    /// Takes the lobe that was added to some pixels where BIC and their photographs support it.
    fn accept(
        &self,
        tile: &LobeFitTile,
        able: &[usize],
        fewer: &[Estimate],
        lobes: usize,
        found: &mut [ByLobeCount],
    ) {
        // The unknowns that one more lobe costs: its strength, and its shape where no prior
        // covers it.
        let shape_is_known = self.prior.is_some_and(|prior| prior.covers(lobes));
        let unknowns = match (self.options.sparing, shape_is_known) {
            (false, _) => 0,
            (true, true) => 1,
            (true, false) => 1 + M::SHAPES,
        };
        let better: Vec<usize> = able
            .iter()
            .copied()
            .filter(|&pixel| {
                let above_rounding = fewer[pixel].cost > tile.rounding[pixel];
                let more = &tile.estimates[pixel];
                above_rounding && lowers_bic(more, &fewer[pixel], tile.usable[pixel], unknowns)
            })
            .collect();
        let supported = supported(self.photographs, tile, &better, self.run.level);
        for (pixel, supported) in better.into_iter().zip(supported) {
            if supported[..lobes].iter().all(|&supported| supported) {
                found[pixel].estimates[lobes] = tile.estimates[pixel];
                found[pixel].lobes = lobes;
            }
        }
    }

    /// Adds lobes from the seeds around each pixel, or from the model's best start where theirs are
    /// refused, and by multistart where the fit is then much worse than the seeds' own.
    pub(super) fn select_from_seeds(
        &self,
        tile: &mut LobeFitTile,
        fitted: &[usize],
        seeds: &Seeds,
        grid: Grid,
    ) -> Vec<ByLobeCount> {
        let first = tile.estimates.clone();
        let around: Vec<_> =
            tile.pixels.iter().map(|&pixel| seeds.around(grid.place(pixel))).collect();
        let most: Vec<usize> = if seeds.are_coarse() {
            vec![self.options.lobes; around.len()]
        } else {
            around.iter().map(|seeds| self.most_lobes(seeds)).collect()
        };
        let seeded = fitted.iter().copied().filter(|&pixel| !around[pixel].is_empty());
        // Pixels without a seed around them keep their infinite cost.
        let origin = Starts::Neighbours { around: &around, most: &most };
        let mut found = self.select(tile, &seeded.collect::<Vec<_>>(), &origin);
        let poor: Vec<usize> = fitted
            .iter()
            .copied()
            .filter(|&pixel| {
                // A misfit below rounding counts as rounding.
                let worst = around[pixel].iter().map(|seed| seed.misfit).fold(1.0, f32::max);
                found[pixel].chosen().cost
                    > worst * tile.rounding[pixel] * self.scatter(tile, pixel)
            })
            .collect();
        if poor.is_empty() {
            return found;
        }
        tile.estimates = first;
        let multistart = self.select(tile, &poor, &Starts::Multistart);
        for pixel in poor {
            if multistart[pixel].chosen().cost < found[pixel].chosen().cost {
                found[pixel] = multistart[pixel];
            }
        }
        found
    }

    /// How many lobes are searched for at a pixel between the seeds: as many as one of the seeds
    /// around it has, or as there are priors for. If fewer pixels have them, it is by chance.
    fn most_lobes(&self, around: &[&Seed]) -> usize {
        let beside = around.iter().map(|seed| seed.by_count.lobes).max().unwrap_or(0);
        let usual = match (self.options.start, self.prior) {
            (Origin::NeighboursOnly, _) => 1,
            (_, None) => self.options.lobes,
            (_, Some(prior)) => {
                (2..=self.options.lobes).rev().find(|&lobes| prior.covers(lobes)).unwrap_or(1)
            }
        };
        beside.max(usual)
    }

    /// Factor by which the sums of squares of two pixels may differ by chance: the quotient of two
    /// sums of `n` squares of normal deviates has a standard deviation of `2 / sqrt n`; one in forty
    /// is more than two of these above 1.
    fn scatter(&self, tile: &LobeFitTile, pixel: usize) -> f32 {
        let free = tile.usable[pixel].saturating_sub(self.unknowns(self.options.lobes)).max(1);
        1.0 + 4.0 / (free as f32).sqrt()
    }

    /// Replaces the tile's estimates by the best with one lobe more than before.
    fn add_lobe(
        &self,
        tile: &mut LobeFitTile,
        able: &[usize],
        before: Before<'_>,
        lobes: usize,
        origin: &Starts<'_>,
    ) {
        reset_costs(tile);
        let mut starts = before.fewer.to_vec();
        let mut pixels = Vec::with_capacity(able.len());
        for number in 0.. {
            pixels.clear();
            for &pixel in able {
                let trial = match origin {
                    Starts::Multistart | Starts::BestStart => {
                        self.model_start(pixel, before, lobes, number)
                    }
                    Starts::Neighbours { around, .. } => {
                        self.seed_start(pixel, before, &around[pixel], lobes, number)
                    }
                };
                if let Some(start) = trial {
                    starts[pixel] = start;
                    pixels.push(pixel);
                }
            }
            // Nobody reads the tile of a cancelled call: it may be left unfinished.
            if pixels.is_empty() || self.run.cancelled() {
                break;
            }
            match origin {
                Starts::Multistart => self.search(tile, &starts, &pixels, lobes),
                Starts::BestStart | Starts::Neighbours { .. } => {
                    self.score(tile, &starts, &pixels, lobes);
                }
            }
        }
        if let Starts::BestStart | Starts::Neighbours { .. } = origin {
            let starts = tile.estimates.clone();
            reset_costs(tile);
            let scored = able.iter().copied().filter(|&pixel| starts[pixel].cost.is_finite());
            self.search(tile, &starts, &scored.collect::<Vec<_>>(), lobes);
        }
    }

    /// Start `number` of multistart: a starting shape of the model beside the lobes found before;
    /// for the first lobe also with the normal that mirrors the brightest photograph.
    fn model_start(
        &self,
        pixel: usize,
        before: Before<'_>,
        lobes: usize,
        number: usize,
    ) -> Option<Estimate> {
        let normals = if lobes == 1 { 2 } else { 1 };
        let shape = self.photographs.model.starts().get(number / normals)?;
        let mut start = before.fewer[pixel];
        start.shapes[lobes - 1] = shape.map(|number| number as f32);
        if number % normals == 1 {
            start.normal = before.brightest[pixel];
        }
        Some(start)
    }

    /// Start `number` from the seeds: a seed's shapes with so many lobes, for the first lobe with
    /// the normal moved as the seed's own was; then the nearest seed's shapes with the pixel's other
    /// normals. Multistart where no seed around the pixel has so many lobes.
    fn seed_start(
        &self,
        pixel: usize,
        before: Before<'_>,
        seeds: &[&Seed],
        lobes: usize,
        number: usize,
    ) -> Option<Estimate> {
        let candidates = || seeds.iter().filter(|seed| seed.by_count.lobes >= lobes);
        let Some(nearest) = candidates().next() else {
            return self.model_start(pixel, before, lobes, number);
        };
        let fewer = before.fewer[pixel];
        let shapes_of = |seed: &Seed| seed.by_count.estimates[lobes].shapes;
        if let Some(seed) = candidates().nth(number) {
            let moved = || seed.moved_normal(before.first[pixel].normal);
            let normal = if lobes == 1 { moved() } else { fewer.normal };
            return Some(Estimate { shapes: shapes_of(seed), normal, ..fewer });
        }
        let normal = match number - candidates().count() {
            0 if lobes == 1 => fewer.normal,
            1 if lobes == 1 => before.brightest[pixel],
            _ => return None,
        };
        Some(Estimate { shapes: shapes_of(nearest), normal, ..fewer })
    }

    /// Whether a pixel has more usable photographs than unknowns (hard case 30).
    pub(super) fn supports(&self, tile: &LobeFitTile, pixel: usize, lobes: usize) -> bool {
        tile.usable[pixel] > self.unknowns(lobes)
    }

    /// Unknowns of the fit to the mean of the bands.
    pub(super) fn unknowns(&self, lobes: usize) -> usize {
        let others = 1 + 2 * usize::from(self.options.normal) + usize::from(self.options.ambient);
        others + lobes * (1 + M::SHAPES)
    }

    fn score(&self, tile: &mut LobeFitTile, starts: &[Estimate], pixels: &[usize], lobes: usize) {
        self.count(Purpose::Starts, || {
            Score {
                photographs: self.photographs,
                samples: &tile.grey,
                x: &tile.x,
                y: &tile.y,
                ambient: self.options.ambient,
                starts,
                found: &mut tile.estimates,
                pixels,
                lobes,
                level: self.run.level,
            }
            .run();
            [pixels.len() as u64; 2]
        });
    }

    fn search(&self, tile: &mut LobeFitTile, starts: &[Estimate], pixels: &[usize], lobes: usize) {
        let purpose = match lobes {
            0 => Purpose::Matte,
            1 => Purpose::FirstLobe,
            _ => Purpose::MoreLobes,
        };
        let max_iterations = self.options.iterations;
        let options = &Options { max_iterations, cost: 1e-4, ..Options::single() };
        let double = self.options.precision == Precision::Double;
        self.count(purpose, || {
            Search {
                photographs: self.photographs,
                samples: &tile.grey,
                x: &tile.x,
                y: &tile.y,
                ambient: self.options.ambient,
                freedom: Freedom::of_options(self.options),
                typical: None,
                starts,
                found: &mut tile.estimates,
                pixels,
                lobes,
                double,
                options,
                level: self.run.level,
            }
            .run()
        });
    }

    /// Counts passes; without a prior, they are for what is learned.
    pub(super) fn count(&self, purpose: Purpose, work: impl FnOnce() -> [u64; 2]) {
        let purpose = if self.prior.is_some() { purpose } else { Purpose::Learning };
        self.run.progress.passes.count(purpose, work);
    }
}

/// Sets all costs to infinity, so that the next estimate replaces the present one.
fn reset_costs(tile: &mut LobeFitTile) {
    for estimate in &mut tile.estimates {
        estimate.cost = f32::INFINITY;
    }
}

/// Whether BIC, `m ln(C / m) + p ln m`, is smaller with more lobes.
fn lowers_bic(more: &Estimate, fewer: &Estimate, samples: usize, unknowns: usize) -> bool {
    let m = samples as f32;
    let gain = m * (fewer.cost.ln() - more.cost.ln());
    more.lobes > fewer.lobes && gain > unknowns as f32 * m.ln()
}
