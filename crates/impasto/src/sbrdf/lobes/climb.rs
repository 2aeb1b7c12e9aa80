//! Lobes one at a time, on the mean of the bands.

use crate::lm::Options;
use crate::pixels::Run;

use super::maps::MOST_LOBES;
use super::model::LobeModel;
use super::options::{LobeOptions, Precision};
use super::prior::Prior;
use super::pyramid::{Node, Pyramid};
use super::score::Score;
use super::search::Search;
use super::seen::sees;
use super::sight::Sight;
use super::tile::{Ladder, Place, TILE, Tile};

/// What a lobe is looked for from.
pub(super) enum Trials<'a> {
    /// A search from every shape of the model's table.
    Table,
    /// The nodes about each pixel: one search, from what leaves least of the samples.
    Nodes(&'a [Vec<&'a Node>]),
}

/// Looks for lobes on the mean of the bands, one more at a time.
pub(super) struct Climber<'a, M: LobeModel> {
    pub(super) sight: &'a Sight<'a, M>,
    pub(super) options: &'a LobeOptions,
    pub(super) prior: Option<&'a Prior>,
    pub(super) run: &'a Run<'a>,
}

impl<M: LobeModel> Climber<'_, M> {
    /// Climbs as far as lobes are worth their unknowns, from where the tile's pixels stand.
    pub(super) fn climb(
        &self,
        tile: &mut Tile,
        fine: &[usize],
        trials: &Trials<'_>,
    ) -> Vec<Ladder> {
        let first = tile.places.clone();
        self.search(tile, &first, fine, 0);
        let ladder = |&place: &Place| Ladder { rungs: [place; MOST_LOBES + 1], lobes: 0 };
        let mut ladders: Vec<Ladder> = tile.places.iter().map(ladder).collect();
        for lobes in 1..=self.options.lobes {
            let able: Vec<usize> = fine
                .iter()
                .copied()
                .filter(|&pixel| {
                    self.supports(tile, pixel, lobes) && ladders[pixel].lobes + 1 == lobes
                })
                .collect();
            let before: Vec<Place> = ladders.iter().map(|ladder| *ladder.top()).collect();
            self.step_up(tile, &able, (&first, &before), lobes, trials);
            // A strength, and a shape that nothing else is known of.
            let known = self.prior.is_some_and(|prior| prior.knows(lobes));
            let unknowns = match (self.options.sparing, known) {
                (false, _) => 0,
                (true, true) => 1,
                (true, false) => 1 + M::SHAPES,
            };
            for &pixel in &able {
                let told = before[pixel].cost > tile.rounding[pixel];
                let more = &tile.places[pixel];
                if told
                    && better(more, &before[pixel], tile.usable[pixel], unknowns)
                    && (0..lobes).all(|lobe| sees(self.sight, tile, pixel, lobe, self.run.level))
                {
                    ladders[pixel].rungs[lobes] = *more;
                    ladders[pixel].lobes = lobes;
                }
            }
        }
        ladders
    }

    /// Lobes from what the nodes found.
    pub(super) fn refined(
        &self,
        tile: &mut Tile,
        fine: &[usize],
        pyramid: &Pyramid,
    ) -> Vec<Ladder> {
        let first = tile.places.clone();
        let around: Vec<_> = tile.pixels.iter().map(|&pixel| pyramid.about(pixel)).collect();
        let led = fine.iter().copied().filter(|&pixel| !around[pixel].is_empty());
        // Pixels with no node about them stay where they are, at infinite cost.
        let mut ladders = self.climb(tile, &led.collect::<Vec<_>>(), &Trials::Nodes(&around));
        let odd: Vec<usize> = fine
            .iter()
            .copied()
            .filter(|&pixel| {
                // Less than rounding is no misfit.
                let worst = around[pixel].iter().map(|node| node.misfit).fold(1.0, f32::max);
                ladders[pixel].top().cost
                    > worst * tile.rounding[pixel] * self.accident(tile, pixel)
            })
            .collect();
        if odd.is_empty() {
            return ladders;
        }
        tile.places = first;
        let thorough = self.climb(tile, &odd, &Trials::Table);
        for pixel in odd {
            if thorough[pixel].top().cost < ladders[pixel].top().cost {
                ladders[pixel] = thorough[pixel];
            }
        }
        ladders
    }

    /// How much more one pixel may leave than another by accident: the quotient of two sums of
    /// `n` squares of normal deviates scatters by `2 / sqrt n`; one in forty is beyond two of it.
    fn accident(&self, tile: &Tile, pixel: usize) -> f32 {
        let free = tile.usable[pixel].saturating_sub(self.unknowns(self.options.lobes)).max(1);
        1.0 + 4.0 / (free as f32).sqrt()
    }

    /// The best places with one lobe more than `before`.
    fn step_up(
        &self,
        tile: &mut Tile,
        able: &[usize],
        (first, before): (&[Place], &[Place]),
        lobes: usize,
        trials: &Trials<'_>,
    ) {
        forget(tile);
        let mut starts = before.to_vec();
        let mut pixels = Vec::with_capacity(able.len());
        for number in 0.. {
            pixels.clear();
            for &pixel in able {
                let trial = match trials {
                    Trials::Table => self.of_table(tile, pixel, &before[pixel], lobes, number),
                    Trials::Nodes(around) => {
                        let own = (&first[pixel], &before[pixel]);
                        self.of_nodes(tile, pixel, own, &around[pixel], lobes, number)
                    }
                };
                if let Some(start) = trial {
                    starts[pixel] = start;
                    pixels.push(pixel);
                }
            }
            // A cancelled tile is nobody's: it need not be brought to an end.
            if pixels.is_empty() || self.run.cancelled() {
                break;
            }
            match trials {
                Trials::Table => self.search(tile, &starts, &pixels, lobes),
                Trials::Nodes(_) => self.score(tile, &starts, &pixels, lobes),
            }
        }
        if let Trials::Nodes(_) = trials {
            let starts = tile.places.clone();
            forget(tile);
            let told = able.iter().copied().filter(|&pixel| starts[pixel].cost.is_finite());
            self.search(tile, &starts, &told.collect::<Vec<_>>(), lobes);
        }
    }

    /// A shape of the table beside the lobes that there are; the first lobe also about the normal
    /// that mirrors the brightest photograph.
    fn of_table(
        &self,
        tile: &Tile,
        pixel: usize,
        before: &Place,
        lobes: usize,
        number: usize,
    ) -> Option<Place> {
        let normals = if lobes == 1 { 2 } else { 1 };
        let shape = self.sight.model.starts().get(number / normals)?;
        let mut start = *before;
        start.shapes[lobes - 1] = shape.map(|number| number as f32);
        if number % normals == 1 {
            start.normal = self.brightest(tile, pixel);
        }
        Some(start)
    }

    /// What a node found with so many lobes, the first about a normal that is turned as its own
    /// was; or the nearest's shape about the pixel's other normals. The table where no node about
    /// the pixel has so many.
    fn of_nodes(
        &self,
        tile: &Tile,
        pixel: usize,
        (first, before): (&Place, &Place),
        nodes: &[&Node],
        lobes: usize,
        number: usize,
    ) -> Option<Place> {
        let found = || nodes.iter().filter(|node| node.ladder.lobes >= lobes);
        let Some(nearest) = found().next() else {
            return self.of_table(tile, pixel, before, lobes, number);
        };
        let shapes_of = |node: &Node| node.ladder.rungs[lobes].shapes;
        if let Some(node) = found().nth(number) {
            let normal = if lobes == 1 { node.turned(first.normal) } else { before.normal };
            return Some(Place { shapes: shapes_of(node), normal, ..*before });
        }
        let normal = match number - found().count() {
            0 if lobes == 1 => before.normal,
            1 if lobes == 1 => self.brightest(tile, pixel),
            _ => return None,
        };
        Some(Place { shapes: shapes_of(nearest), normal, ..*before })
    }

    /// Whether a pixel's photographs outnumber the unknowns (hard case 30).
    pub(super) fn supports(&self, tile: &Tile, pixel: usize, lobes: usize) -> bool {
        tile.usable[pixel] > self.unknowns(lobes)
    }

    /// Unknowns of the mean of the bands.
    pub(super) fn unknowns(&self, lobes: usize) -> usize {
        let others = 1 + 2 * usize::from(self.options.normal) + usize::from(self.options.ambient);
        others + lobes * (1 + M::SHAPES)
    }

    /// The normal that mirrors the brightest photograph into the view.
    fn brightest(&self, tile: &Tile, pixel: usize) -> [f32; 3] {
        let samples = tile.grey.samples[pixel..].iter().step_by(TILE);
        let mut best = (f32::NEG_INFINITY, 0);
        for (photograph, &sample) in samples.enumerate() {
            if sample > best.0 {
                best = (sample, photograph);
            }
        }
        self.sight.facing(best.1).array().map(|v| v as f32)
    }

    fn score(&self, tile: &mut Tile, starts: &[Place], pixels: &[usize], lobes: usize) {
        Score {
            sight: self.sight,
            plate: &tile.grey,
            x: &tile.x,
            y: &tile.y,
            ambient: self.options.ambient,
            starts,
            found: &mut tile.places,
            pixels,
            lobes,
            level: self.run.level,
        }
        .run();
    }

    fn search(&self, tile: &mut Tile, starts: &[Place], pixels: &[usize], lobes: usize) {
        Search {
            sight: self.sight,
            plate: &tile.grey,
            x: &tile.x,
            y: &tile.y,
            ambient: self.options.ambient,
            free: self.options.normal,
            typical: None,
            starts,
            found: &mut tile.places,
            pixels,
            lobes,
            double: self.options.precision == Precision::Double,
            options: &Options {
                max_iterations: self.options.iterations,
                damping: 1e-2,
                cost: 1e-4,
                ..Options::single()
            },
            level: self.run.level,
        }
        .run();
    }
}

/// Whatever is found next is better.
fn forget(tile: &mut Tile) {
    for place in &mut tile.places {
        place.cost = f32::INFINITY;
    }
}

/// Whether more lobes are worth their unknowns: BIC, `m ln(C / m) + p ln m`.
fn better(more: &Place, fewer: &Place, samples: usize, unknowns: usize) -> bool {
    let m = samples as f32;
    let gain = m * (fewer.cost.ln() - more.cost.ln());
    more.lobes > fewer.lobes && gain > unknowns as f32 * m.ln()
}
