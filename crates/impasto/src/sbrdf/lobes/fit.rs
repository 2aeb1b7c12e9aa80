//! The fit, tile by tile: a search on the mean of the bands finds lobes one at a time, then all
//! bands settle shapes, normal and weights together.

use core::f32::consts::FRAC_PI_2;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm::Options;
use crate::maps::Status;
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::maps::{LobeMaps, MOST_LOBES, Sheet};
use super::model::{LobeModel, MAX_SHAPES};
use super::prior::Prior;
use super::search::Search;
use super::seen::{drop_unseen, sees};
use super::settle::{COLUMNS, Settle, Settled};
use super::sight::Sight;
use super::tile::{Place, TILE, Tile};

/// How the fit goes about it.
#[derive(Clone, Copy, Debug)]
pub struct LobeOptions {
    /// Lobes per pixel at most, up to [`MOST_LOBES`].
    pub lobes: usize,
    /// Whether every band has a constant besides: ambient and inter-reflected light.
    pub ambient: bool,
    /// Whether the normal is free; else it stays where it starts.
    pub normal: bool,
    /// Rounds in which all bands settle and samples are weighed anew by their residuals.
    pub rounds: usize,
    /// Whether shapes are drawn towards what is typical of the painting.
    pub typical: bool,
    /// Steps of a search at most.
    pub iterations: usize,
}

/// Lobes of every pixel, from the normals of photometric stereo.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit_lobes<M: LobeModel>(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    model: M,
    options: &LobeOptions,
    run: &Run<'_>,
) -> Result<LobeMaps> {
    let shape = stack.shape();
    if rig.observations() != shape.observations {
        let problem =
            format!("{} lights for {} photographs", rig.observations(), shape.observations);
        return Err(Error::geometry("lights", problem));
    }
    if options.lobes > MOST_LOBES {
        let problem = format!("at most {MOST_LOBES}, found {}", options.lobes);
        return Err(Error::argument("lobes", problem));
    }
    start.check(shape.pixels(), shape.bands)?;
    let sight = Sight::new(model, rig);
    let fit = Fit { stack, rig, start, sight: &sight, options, prior: None, run };
    let prior = if options.typical { Some(fit.typical()?) } else { None };
    let fit = Fit { prior: prior.as_ref(), ..fit };
    let mut maps = LobeMaps::new(shape.bands, options.lobes, M::NAMES.len(), start.status);
    run.for_each(
        maps.sheets(TILE),
        || Scratch::new(stack),
        |scratch, sheet| {
            let fine = fit.settle_tile(scratch, sheet.start);
            fit.write(scratch, &fine, sheet);
        },
    )?;
    // The last tiles may have been left before their end.
    if run.cancelled() { Err(Error::Cancelled) } else { Ok(maps) }
}

/// Tiles that tell what is typical of a painting, at most.
const SAMPLED: usize = 40;

/// Pixels that are fitted twice, at most: first those that tell what is typical of a painting.
pub const TYPICAL_PIXELS: usize = SAMPLED * TILE;

/// Share of the usual spread beyond which a shape's error says that the pixel's photographs and
/// what is typical know equally little: two measurements of equal weight halve the variance.
const TYPICAL: f32 = core::f32::consts::FRAC_1_SQRT_2;

struct Scratch {
    tile: Tile,
    settled: Settled,
}

impl Scratch {
    fn new(stack: &Stack<'_>) -> Self {
        Self { tile: Tile::new(stack), settled: Settled::new(stack.shape().bands) }
    }
}

#[derive(Clone, Copy)]
struct Fit<'a, M: LobeModel> {
    stack: &'a Stack<'a>,
    rig: &'a Rig,
    start: &'a Start<'a>,
    sight: &'a Sight<'a, M>,
    options: &'a LobeOptions,
    prior: Option<&'a Prior>,
    run: &'a Run<'a>,
}

impl<M: LobeModel> Fit<'_, M> {
    /// What is typical of the painting, from tiles spread over it.
    fn typical(&self) -> Result<Prior> {
        let tiles = self.stack.shape().pixels().div_ceil(TILE);
        let starts: Vec<usize> =
            (0..tiles).step_by(tiles.div_ceil(SAMPLED)).map(|tile| tile * TILE).collect();
        let places = self.run.map(
            starts,
            || Scratch::new(self.stack),
            |scratch, start| {
                let fine = self.settle_tile(scratch, start);
                fine.into_iter().map(|pixel| scratch.tile.places[pixel]).collect::<Vec<_>>()
            },
        )?;
        Ok(Prior::of_places(&self.sight.model, &places.concat()))
    }

    /// A tile's pixels brought to where they stay; returns those that can be fitted.
    fn settle_tile(&self, scratch: &mut Scratch, start: usize) -> Vec<usize> {
        let Scratch { tile, settled } = scratch;
        tile.read(self.stack, self.rig, start, self.start);
        let status = &self.start.status[start..start + tile.count];
        let fine: Vec<usize> = (0..tile.count)
            .filter(|&pixel| status[pixel] < Status::Dark.code() && self.supports(tile, pixel, 0))
            .collect();
        self.find(tile, &fine);
        for _ in 0..self.options.rounds {
            if self.run.cancelled() {
                return fine;
            }
            self.settle(tile, settled, true);
            self.refine(tile, &fine);
            drop_unseen(self.sight, tile, &fine);
        }
        self.settle(tile, settled, false);
        for (place, &variance) in tile.places.iter_mut().zip(&settled.variance) {
            let scale = variance.sqrt();
            place.normal_spread *= scale;
            place.shape_spread = place.shape_spread.map(|spread| spread * scale);
        }
        fine
    }

    /// Lobes one at a time, on the mean of the bands.
    fn find(&self, tile: &mut Tile, fine: &[usize]) {
        let first = tile.places.clone();
        self.search(tile, &first, fine, 0);
        let mut best = tile.places.clone();
        for lobes in 1..=self.options.lobes {
            let able: Vec<usize> = fine
                .iter()
                .copied()
                .filter(|&pixel| {
                    self.supports(tile, pixel, lobes) && best[pixel].lobes + 1 == lobes
                })
                .collect();
            let before = best.clone();
            for place in &mut tile.places {
                place.cost = f32::INFINITY;
            }
            for &shape in self.sight.model.starts() {
                for facing in [false, true] {
                    if facing && lobes > 1 {
                        continue;
                    }
                    let mut starts = before.clone();
                    for &pixel in &able {
                        starts[pixel].shapes[lobes - 1] = shape.map(|number| number as f32);
                        if facing {
                            starts[pixel].normal = self.brightest(tile, pixel);
                        }
                    }
                    self.search(tile, &starts, &able, lobes);
                }
            }
            // A strength, and a shape that nothing else is known of.
            let known = self.prior.is_some_and(|prior| prior.knows(lobes));
            let unknowns = if known { 1 } else { 1 + M::SHAPES };
            for &pixel in &able {
                let told = best[pixel].cost > tile.rounding[pixel];
                let more = &tile.places[pixel];
                if told
                    && better(more, &best[pixel], tile.usable[pixel], unknowns)
                    && (0..lobes).all(|lobe| sees(self.sight, tile, pixel, lobe))
                {
                    best[pixel] = *more;
                }
            }
        }
        for place in &mut best {
            let key = |shape: &[f32; MAX_SHAPES]| self.sight.model.order(*shape);
            place.shapes[..place.lobes].sort_by(|a, b| key(b).total_cmp(&key(a)));
        }
        tile.places = best;
    }

    /// Whether a pixel's photographs outnumber the unknowns (hard case 30).
    fn supports(&self, tile: &Tile, pixel: usize, lobes: usize) -> bool {
        let others = 1 + 2 * usize::from(self.options.normal) + usize::from(self.options.ambient);
        tile.usable[pixel] > others + lobes * (1 + M::SHAPES)
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

    fn search(&self, tile: &mut Tile, starts: &[Place], pixels: &[usize], lobes: usize) {
        Search {
            sight: self.sight,
            plate: &tile.grey,
            x: &tile.x,
            y: &tile.y,
            ambient: self.options.ambient,
            free: self.options.normal,
            prior: None,
            starts,
            found: &mut tile.places,
            pixels: pixels.iter().copied(),
            lobes,
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

    /// All bands from where the pixels stand.
    fn refine(&self, tile: &mut Tile, fine: &[usize]) {
        let starts = tile.places.clone();
        for place in &mut tile.places {
            place.cost = f32::INFINITY;
            place.converged = false;
        }
        for lobes in 0..=self.options.lobes {
            Search {
                sight: self.sight,
                plate: &tile.colour,
                x: &tile.x,
                y: &tile.y,
                ambient: self.options.ambient,
                free: self.options.normal,
                prior: self.prior,
                starts: &starts,
                found: &mut tile.places,
                pixels: fine.iter().copied().filter(|&pixel| starts[pixel].lobes == lobes),
                lobes,
                options: &Options { max_iterations: self.options.iterations, ..Options::single() },
                level: self.run.level,
            }
            .run();
        }
    }

    fn settle(&self, tile: &mut Tile, settled: &mut Settled, reweigh: bool) {
        Settle {
            sight: self.sight,
            x: &tile.x,
            y: &tile.y,
            places: &tile.places,
            ambient: self.options.ambient,
            reweigh,
            plate: &mut tile.colour,
            settled,
            lobes: self.options.lobes,
            level: self.run.level,
        }
        .run();
    }

    fn write(&self, scratch: &Scratch, fine: &[usize], mut sheet: Sheet<'_>) {
        let Scratch { tile, settled } = scratch;
        let bands = tile.colour.bands;
        let numbers = M::NAMES.len();
        for pixel in 0..tile.count {
            if sheet.status[pixel] < Status::Dark.code() && fine.binary_search(&pixel).is_err() {
                sheet.status[pixel] = Status::TooFewSamples.code();
            }
            // Of a pixel without light this much is known: it reflects none.
            if sheet.status[pixel] == Status::Dark.code() {
                let colours = [&mut sheet.diffuse, &mut sheet.ambient, &mut sheet.specular];
                colours.into_iter().flatten().for_each(|plane| plane[pixel] = 0.0);
            }
        }
        for &pixel in fine {
            let place = &tile.places[pixel];
            let colour = |band: usize, column: usize| {
                settled.colours[(band * COLUMNS + column) * TILE + pixel]
            };
            for (plane, value) in sheet.normal.iter_mut().zip(place.normal) {
                plane[pixel] = value;
            }
            let mut order: Vec<usize> = (0..place.lobes).collect();
            let key = |lobe: usize| self.sight.model.order(place.shapes[lobe]);
            order.sort_by(|&a, &b| key(b).total_cmp(&key(a)));
            for band in 0..bands {
                sheet.diffuse[band][pixel] = colour(band, 0);
                sheet.ambient[band][pixel] = colour(band, COLUMNS - 1);
                for lobe in 0..self.options.lobes {
                    let value = order.get(lobe).map_or(0.0, |&lobe| colour(band, 1 + lobe));
                    sheet.specular[lobe * bands + band][pixel] = value;
                }
            }
            for (rank, &lobe) in order.iter().enumerate() {
                let tinted = bands > 1 && settled.neutral[lobe * TILE + pixel] == 0.0;
                sheet.tinted[rank][pixel] = u8::from(tinted);
                let mut told = [0.0; 4];
                self.sight.model.report(place.shapes[lobe], &mut told[..numbers]);
                for (number, &value) in told[..numbers].iter().enumerate() {
                    sheet.numbers[rank * numbers + number][pixel] = value;
                }
                sheet.spread[rank][pixel] = place.shape_spread[lobe];
            }
            // The photographs know less of every lobe than what is typical does.
            let typical = self.sight.model.spreads()[0] as f32 * TYPICAL;
            let pooled = place.shape_spread[..place.lobes].iter().all(|&s| s > typical);
            if pooled && place.lobes > 0 && sheet.status[pixel] == Status::Fitted.code() {
                sheet.status[pixel] = Status::Pooled.code();
            }
            sheet.lobes[pixel] = place.lobes as u8;
            sheet.converged[pixel] = u8::from(place.converged);
            sheet.residual[pixel] = settled.residual[pixel];
            // Case 27: a normal that nothing determines may lie anywhere in the hemisphere.
            sheet.sigma[pixel] = place.normal_spread.min(FRAC_PI_2);
        }
    }
}

/// Whether more lobes are worth their unknowns: BIC, `m ln(C / m) + p ln m`.
fn better(more: &Place, fewer: &Place, samples: usize, unknowns: usize) -> bool {
    let m = samples as f32;
    let gain = m * (fewer.cost.ln() - more.cost.ln());
    more.lobes > fewer.lobes && gain > unknowns as f32 * m.ln()
}
