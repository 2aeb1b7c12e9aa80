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

use super::climb::{Climber, Trials};
use super::maps::{LobeMaps, MOST_LOBES, Sheet};
use super::model::LobeModel;
use super::options::{LobeOptions, Origin, Precision};
use super::prior::{Ask, FEWEST, Prior, Typical};
use super::pyramid::{Node, Pyramid};
use super::search::Search;
use super::seen::drop_unseen;
use super::settle::{COLUMNS, Settle, Settled};
use super::sight::Sight;
use super::tile::{Ladder, Place, TILE, Tile};

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
    let fit = Fit { stack, rig, start, sight: &sight, options, prior: None, pyramid: None, run };
    let nodes = if options.start == Origin::Pyramid { Some(fit.nodes()?) } else { None };
    // Nodes tell what is typical, too: where they are too few to tell, none is asked.
    let nodes = nodes.filter(|(_, places)| !options.typical || places.len() >= FEWEST);
    let (pyramid, known) = match nodes {
        Some((pyramid, places)) => (Some(pyramid), places),
        None if options.typical => (None, fit.sampled()?),
        None => (None, Vec::new()),
    };
    let prior = options.typical.then(|| Prior::of_places(&sight.model, &known));
    let fit = Fit { prior: prior.as_ref(), pyramid: pyramid.as_ref(), ..fit };
    let mut maps = LobeMaps::new(shape.bands, options.lobes, M::NAMES.len(), start.status, run)?;
    run.for_each(
        maps.sheets(TILE),
        || Scratch::new(stack),
        |scratch, sheet| {
            let (fine, _) = fit.settle_pixels(scratch, &fit.tile(sheet.start));
            fit.write(scratch, &fine, sheet);
        },
    )?;
    Ok(maps)
}

/// Tiles that tell what is typical of a painting, at most.
const SAMPLED: usize = 40;

/// Pixels that are fitted twice, at most, where searches start from a table: first those that tell
/// what is typical of a painting.
pub const TYPICAL_PIXELS: usize = SAMPLED * TILE;

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
    pyramid: Option<&'a Pyramid>,
    run: &'a Run<'a>,
}

impl<M: LobeModel> Fit<'_, M> {
    /// Where pixels stay that tell what is typical of the painting, from tiles spread over it.
    fn sampled(&self) -> Result<Vec<Place>> {
        let tiles = self.stack.shape().pixels().div_ceil(TILE);
        let starts: Vec<usize> =
            (0..tiles).step_by(tiles.div_ceil(SAMPLED)).map(|tile| tile * TILE).collect();
        let places = self.run.map(
            starts,
            || Scratch::new(self.stack),
            |scratch, start| {
                let (fine, _) = self.settle_pixels(scratch, &self.tile(start));
                fine.into_iter().map(|pixel| scratch.tile.places[pixel]).collect::<Vec<_>>()
            },
        )?;
        self.run.joined(places)
    }

    /// What the pixels of a coarse grid found, and where they stay.
    fn nodes(&self) -> Result<(Pyramid, Vec<Place>)> {
        let shape = self.stack.shape();
        let grid = Pyramid::grid(shape.width, shape.height);
        let found = self.run.map(
            grid.chunks(TILE).collect(),
            || Scratch::new(self.stack),
            |scratch, pixels| {
                let (fine, ladders) = self.settle_pixels(scratch, pixels);
                let mut nodes = vec![None; pixels.len()];
                for &pixel in &fine {
                    let ladder = ladders[pixel];
                    nodes[pixel] = Some(Node {
                        ladder,
                        normal: self.start.normal(pixels[pixel]),
                        misfit: ladder.top().cost / scratch.tile.rounding[pixel],
                    });
                }
                let places = fine.into_iter().map(|pixel| scratch.tile.places[pixel]);
                (nodes, places.collect::<Vec<_>>())
            },
        )?;
        let (nodes, places): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        Ok((Pyramid::new(shape.width, self.run.joined(nodes)?), self.run.joined(places)?))
    }

    /// The pixels of a tile.
    fn tile(&self, start: usize) -> Vec<usize> {
        (start..self.stack.shape().pixels().min(start + TILE)).collect()
    }

    /// Pixels brought to where they stay; returns those that can be fitted, and how they got their
    /// lobes.
    fn settle_pixels(&self, scratch: &mut Scratch, pixels: &[usize]) -> (Vec<usize>, Vec<Ladder>) {
        let Scratch { tile, settled } = scratch;
        tile.read(self.stack, self.rig, pixels, self.start, self.run.level);
        let status = self.start.status;
        let climber = self.climber();
        let fine: Vec<usize> = (0..pixels.len())
            .filter(|&pixel| {
                status[pixels[pixel]] < Status::Dark.code() && climber.supports(tile, pixel, 0)
            })
            .collect();
        let ladders = self.find(tile, &fine);
        for round in 1..=self.options.rounds {
            if self.run.cancelled() {
                return (fine, ladders);
            }
            self.settle(tile, settled, true);
            self.refine(tile, &fine, &settled.variance, round == self.options.rounds);
            drop_unseen(self.sight, tile, &fine, self.run.level);
        }
        self.settle(tile, settled, false);
        for (place, &variance) in tile.places.iter_mut().zip(&settled.variance) {
            let scale = variance.sqrt();
            place.normal_spread *= scale;
            place.shape_spread = place.shape_spread.map(|spread| spread * scale);
            place.seen_spread = place.seen_spread.map(|spread| spread * scale);
        }
        (fine, ladders)
    }

    fn climber(&self) -> Climber<'_, M> {
        let Self { sight, options, prior, run, .. } = *self;
        Climber { sight, options, prior, run }
    }

    /// Lobes as the mean of the bands asks for them.
    fn find(&self, tile: &mut Tile, fine: &[usize]) -> Vec<Ladder> {
        let climber = self.climber();
        let ladders = match self.pyramid {
            Some(pyramid) => climber.refined(tile, fine, pyramid),
            None => climber.climb(tile, fine, &Trials::Table),
        };
        for (place, ladder) in tile.places.iter_mut().zip(&ladders) {
            *place = self.ordered(ladder.top());
        }
        ladders
    }

    /// All bands from where the pixels stand, whose samples have these variances.
    fn refine(&self, tile: &mut Tile, fine: &[usize], variances: &[f32], last: bool) {
        let precision = self.options.precision;
        let typical = self.prior.map(|prior| {
            let (model, places) = (&self.sight.model, &tile.places);
            self.run.level.run(Ask { prior, model, places, variances })
        });
        let typical = typical.as_deref();
        self.search_all(tile, fine, typical, precision == Precision::Double);
        if last && precision == Precision::Polished && !self.run.cancelled() {
            self.search_all(tile, fine, typical, true);
        }
        for &pixel in fine {
            tile.places[pixel] = self.ordered(&tile.places[pixel]);
        }
    }

    /// One search for every pixel, whatever its number of lobes.
    fn search_all(
        &self,
        tile: &mut Tile,
        fine: &[usize],
        typical: Option<&[Typical]>,
        double: bool,
    ) {
        let starts = &tile.places.clone();
        let tolerances = if double { Options::default() } else { Options::single() };
        let options = &Options { max_iterations: self.options.iterations, ..tolerances };
        for place in &mut tile.places {
            place.cost = f32::INFINITY;
            place.converged = false;
        }
        for lobes in 0..=self.options.lobes {
            let with = |&pixel: &usize| starts[pixel].lobes == lobes;
            let pixels: Vec<usize> = fine.iter().copied().filter(with).collect();
            Search {
                sight: self.sight,
                plate: &tile.colour,
                x: &tile.x,
                y: &tile.y,
                ambient: self.options.ambient,
                free: self.options.normal,
                typical,
                starts,
                found: &mut tile.places,
                pixels: &pixels,
                lobes,
                double,
                options,
                level: self.run.level,
            }
            .run();
        }
    }

    /// A place with its lobes in the order in which they are numbered.
    fn ordered(&self, place: &Place) -> Place {
        let key = |lobe: usize| self.sight.model.order(place.shapes[lobe]);
        let mut order: Vec<usize> = (0..place.lobes).collect();
        order.sort_by(|&a, &b| key(b).total_cmp(&key(a)));
        let mut ordered = *place;
        for (rank, lobe) in order.into_iter().enumerate() {
            ordered.shapes[rank] = place.shapes[lobe];
            ordered.shape_spread[rank] = place.shape_spread[lobe];
            ordered.seen_spread[rank] = place.seen_spread[lobe];
        }
        ordered
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
        for pixel in 0..tile.pixels.len() {
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
            // Squares of samples beyond 1e19 are infinite in single precision.
            if !settled.residual[pixel].is_finite() {
                sheet.status[pixel] = Status::InvalidInput.code();
                continue;
            }
            let place = &tile.places[pixel];
            let colour = |band: usize, column: usize| {
                settled.colours[(band * COLUMNS + column) * TILE + pixel]
            };
            for (plane, value) in sheet.normal.iter_mut().zip(place.normal) {
                plane[pixel] = value;
            }
            for band in 0..bands {
                sheet.diffuse[band][pixel] = colour(band, 0);
                sheet.ambient[band][pixel] = colour(band, COLUMNS - 1);
                for lobe in 0..self.options.lobes {
                    let value = if lobe < place.lobes { colour(band, 1 + lobe) } else { 0.0 };
                    sheet.specular[lobe * bands + band][pixel] = value;
                }
            }
            for lobe in 0..place.lobes {
                let tinted = bands > 1 && settled.neutral[lobe * TILE + pixel] == 0.0;
                sheet.tinted[lobe][pixel] = u8::from(tinted);
                let mut told = [0.0; 4];
                self.sight.model.report(place.shapes[lobe], &mut told[..numbers]);
                for (number, &value) in told[..numbers].iter().enumerate() {
                    sheet.numbers[lobe * numbers + number][pixel] = value;
                }
                let spread = place.shape_spread[lobe];
                sheet.spread[lobe][pixel] = if spread.is_finite() { spread } else { f32::NAN };
            }
            // The photographs know less of every lobe than what is typical of a painting does.
            let usual = self.sight.model.spreads()[0] as f32;
            let pooled = place.seen_spread[..place.lobes].iter().all(|&s| s > usual);
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
