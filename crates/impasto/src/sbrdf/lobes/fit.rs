//! The fit of a tile: forward selection of lobes on the mean of the bands, then rounds of
//! reweighting and search on all bands together.

use core::f32::consts::FRAC_PI_2;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm::Options;
use crate::maps::Status;
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::forward_selection::{ForwardSelection, Starts};
use super::maps::{LobeMaps, MOST_LOBES, TileMaps};
use super::model::LobeModel;
use super::options::{LobeOptions, Origin, Precision};
use super::prior::{FEWEST, Prior, ShapePrior, ShapePriors};
use super::reweight::{COLUMNS, Reweight, Solution};
use super::search::Search;
use super::seeds::{Seed, Seeds};
use super::sight::Sight;
use super::support::drop_unsupported;
use super::tile::{ByLobeCount, Estimate, LobeFitTile, TILE};

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
    let fit = LobeFit { stack, rig, start, sight: &sight, options, prior: None, seeds: None, run };
    let seeds = if options.start == Origin::Neighbours { Some(fit.seeds()?) } else { None };
    // The seeds also give the prior; with too few seeds for one, multistart is used.
    let seeds = seeds.filter(|(_, estimates)| !options.typical || estimates.len() >= FEWEST);
    let (seeds, known) = match seeds {
        Some((seeds, estimates)) => (Some(seeds), estimates),
        None if options.typical => (None, fit.sampled()?),
        None => (None, Vec::new()),
    };
    let prior = options.typical.then(|| Prior::of_estimates(&sight.model, &known));
    let fit = LobeFit { prior: prior.as_ref(), seeds: seeds.as_ref(), ..fit };
    let mut maps = LobeMaps::new(shape.bands, options.lobes, M::NAMES.len(), start.status, run)?;
    run.for_each(
        maps.tiles(TILE),
        || Scratch::new(stack),
        |scratch, out| {
            let (fitted, _) = fit.fit_pixels(scratch, &fit.tile(out.start));
            fit.write(scratch, &fitted, out);
        },
    )?;
    Ok(maps)
}

/// Most tiles from which the prior is made.
const SAMPLED: usize = 40;

/// Most pixels that multistart fits twice: once for the prior, once with it.
pub const TYPICAL_PIXELS: usize = SAMPLED * TILE;

struct Scratch {
    tile: LobeFitTile,
    solution: Solution,
}

impl Scratch {
    fn new(stack: &Stack<'_>) -> Self {
        Self { tile: LobeFitTile::new(stack), solution: Solution::new(stack.shape().bands) }
    }
}

#[derive(Clone, Copy)]
struct LobeFit<'a, M: LobeModel> {
    stack: &'a Stack<'a>,
    rig: &'a Rig,
    start: &'a Start<'a>,
    sight: &'a Sight<'a, M>,
    options: &'a LobeOptions,
    prior: Option<&'a Prior>,
    seeds: Option<&'a Seeds>,
    run: &'a Run<'a>,
}

impl<M: LobeModel> LobeFit<'_, M> {
    /// Estimates from which the prior is made, of tiles spread over the painting.
    fn sampled(&self) -> Result<Vec<Estimate>> {
        let tiles = self.stack.shape().pixels().div_ceil(TILE);
        let starts: Vec<usize> =
            (0..tiles).step_by(tiles.div_ceil(SAMPLED)).map(|tile| tile * TILE).collect();
        let estimates = self.run.map(
            starts,
            || Scratch::new(self.stack),
            |scratch, start| {
                let (fitted, _) = self.fit_pixels(scratch, &self.tile(start));
                fitted.into_iter().map(|pixel| scratch.tile.estimates[pixel]).collect::<Vec<_>>()
            },
        )?;
        self.run.joined(estimates)
    }

    /// The seeds, and their estimates.
    fn seeds(&self) -> Result<(Seeds, Vec<Estimate>)> {
        let shape = self.stack.shape();
        let grid = Seeds::grid(shape.width, shape.height);
        let found = self.run.map(
            grid.chunks(TILE).collect(),
            || Scratch::new(self.stack),
            |scratch, pixels| {
                let (fitted, by_count) = self.fit_pixels(scratch, pixels);
                let mut seeds = vec![None; pixels.len()];
                for &pixel in &fitted {
                    let by_count = by_count[pixel];
                    seeds[pixel] = Some(Seed {
                        by_count,
                        normal: self.start.normal(pixels[pixel]),
                        misfit: by_count.chosen().cost / scratch.tile.rounding[pixel],
                    });
                }
                let estimates = fitted.into_iter().map(|pixel| scratch.tile.estimates[pixel]);
                (seeds, estimates.collect::<Vec<_>>())
            },
        )?;
        let (seeds, estimates): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        Ok((Seeds::new(shape.width, self.run.joined(seeds)?), self.run.joined(estimates)?))
    }

    /// The pixels of a tile.
    fn tile(&self, start: usize) -> Vec<usize> {
        (start..self.stack.shape().pixels().min(start + TILE)).collect()
    }

    /// Fits some pixels; returns those that can be fitted, and the forward selection of all.
    fn fit_pixels(
        &self,
        scratch: &mut Scratch,
        pixels: &[usize],
    ) -> (Vec<usize>, Vec<ByLobeCount>) {
        let Scratch { tile, solution } = scratch;
        tile.read(self.stack, self.rig, pixels, self.start, self.run.level);
        let status = self.start.status;
        let selection = self.selection();
        let fitted: Vec<usize> = (0..pixels.len())
            .filter(|&pixel| {
                status[pixels[pixel]] < Status::Dark.code() && selection.supports(tile, pixel, 0)
            })
            .collect();
        let by_count = self.select_lobes(tile, &fitted);
        for round in 1..=self.options.rounds {
            if self.run.cancelled() {
                return (fitted, by_count);
            }
            self.reweight(tile, solution, true);
            self.refine(tile, &fitted, &solution.variance, round == self.options.rounds);
            drop_unsupported(self.sight, tile, &fitted, self.run.level);
        }
        self.reweight(tile, solution, false);
        for (estimate, &variance) in tile.estimates.iter_mut().zip(&solution.variance) {
            let scale = variance.sqrt();
            estimate.normal_deviation *= scale;
            estimate.shape_deviation = estimate.shape_deviation.map(|spread| spread * scale);
            estimate.own_deviation = estimate.own_deviation.map(|spread| spread * scale);
        }
        (fitted, by_count)
    }

    fn selection(&self) -> ForwardSelection<'_, M> {
        let Self { sight, options, prior, run, .. } = *self;
        ForwardSelection { sight, options, prior, run }
    }

    /// Selects the lobes on the mean of the bands.
    fn select_lobes(&self, tile: &mut LobeFitTile, fitted: &[usize]) -> Vec<ByLobeCount> {
        let selection = self.selection();
        let by_count = match self.seeds {
            Some(seeds) => selection.select_from_seeds(tile, fitted, seeds),
            None => selection.select(tile, fitted, &Starts::Multistart),
        };
        for (estimate, by_count) in tile.estimates.iter_mut().zip(&by_count) {
            *estimate = self.ordered(by_count.chosen());
        }
        by_count
    }

    /// Searches on all bands from the present estimates, whose samples have these variances.
    fn refine(&self, tile: &mut LobeFitTile, fitted: &[usize], variances: &[f32], last: bool) {
        let precision = self.options.precision;
        let typical = self.prior.map(|prior| {
            let (model, estimates) = (&self.sight.model, &tile.estimates);
            self.run.level.run(ShapePriors { prior, model, estimates, variances })
        });
        let typical = typical.as_deref();
        self.search_all(tile, fitted, typical, precision == Precision::Double);
        if last && precision == Precision::Polished && !self.run.cancelled() {
            self.search_all(tile, fitted, typical, true);
        }
        for &pixel in fitted {
            tile.estimates[pixel] = self.ordered(&tile.estimates[pixel]);
        }
    }

    /// One search for every pixel, whatever its number of lobes.
    fn search_all(
        &self,
        tile: &mut LobeFitTile,
        fitted: &[usize],
        typical: Option<&[ShapePrior]>,
        double: bool,
    ) {
        let starts = &tile.estimates.clone();
        let tolerances = if double { Options::default() } else { Options::single() };
        let options = &Options { max_iterations: self.options.iterations, ..tolerances };
        for estimate in &mut tile.estimates {
            estimate.cost = f32::INFINITY;
            estimate.converged = false;
        }
        for lobes in 0..=self.options.lobes {
            let with = |&pixel: &usize| starts[pixel].lobes == lobes;
            let pixels: Vec<usize> = fitted.iter().copied().filter(with).collect();
            Search {
                sight: self.sight,
                samples: &tile.colour,
                x: &tile.x,
                y: &tile.y,
                ambient: self.options.ambient,
                free: self.options.normal,
                typical,
                starts,
                found: &mut tile.estimates,
                pixels: &pixels,
                lobes,
                double,
                options,
                level: self.run.level,
            }
            .run();
        }
    }

    /// An estimate with its lobes in the order in which they are numbered.
    fn ordered(&self, estimate: &Estimate) -> Estimate {
        let key = |lobe: usize| self.sight.model.order(estimate.shapes[lobe]);
        let mut order: Vec<usize> = (0..estimate.lobes).collect();
        order.sort_by(|&a, &b| key(b).total_cmp(&key(a)));
        let mut ordered = *estimate;
        for (rank, lobe) in order.into_iter().enumerate() {
            ordered.shapes[rank] = estimate.shapes[lobe];
            ordered.shape_deviation[rank] = estimate.shape_deviation[lobe];
            ordered.own_deviation[rank] = estimate.own_deviation[lobe];
        }
        ordered
    }

    fn reweight(&self, tile: &mut LobeFitTile, solution: &mut Solution, renew: bool) {
        Reweight {
            sight: self.sight,
            x: &tile.x,
            y: &tile.y,
            estimates: &tile.estimates,
            ambient: self.options.ambient,
            renew,
            samples: &mut tile.colour,
            solution,
            lobes: self.options.lobes,
            level: self.run.level,
        }
        .run();
    }

    fn write(&self, scratch: &Scratch, fitted: &[usize], mut out: TileMaps<'_>) {
        let Scratch { tile, solution } = scratch;
        let bands = tile.colour.bands;
        let numbers = M::NAMES.len();
        for pixel in 0..tile.pixels.len() {
            if out.status[pixel] < Status::Dark.code() && fitted.binary_search(&pixel).is_err() {
                out.status[pixel] = Status::TooFewSamples.code();
            }
            // A pixel without light reflects none.
            if out.status[pixel] == Status::Dark.code() {
                let colours = [&mut out.diffuse, &mut out.ambient, &mut out.specular];
                colours.into_iter().flatten().for_each(|plane| plane[pixel] = 0.0);
            }
        }
        for &pixel in fitted {
            // Squares of samples beyond 1e19 are infinite in single precision.
            if !solution.residual[pixel].is_finite() {
                out.status[pixel] = Status::InvalidInput.code();
                continue;
            }
            let estimate = &tile.estimates[pixel];
            let colour = |band: usize, column: usize| {
                solution.colours[(band * COLUMNS + column) * TILE + pixel]
            };
            for (plane, value) in out.normal.iter_mut().zip(estimate.normal) {
                plane[pixel] = value;
            }
            for band in 0..bands {
                out.diffuse[band][pixel] = colour(band, 0);
                out.ambient[band][pixel] = colour(band, COLUMNS - 1);
                for lobe in 0..self.options.lobes {
                    let value = if lobe < estimate.lobes { colour(band, 1 + lobe) } else { 0.0 };
                    out.specular[lobe * bands + band][pixel] = value;
                }
            }
            for lobe in 0..estimate.lobes {
                let tinted = bands > 1 && solution.neutral[lobe * TILE + pixel] == 0.0;
                out.tinted[lobe][pixel] = u8::from(tinted);
                let mut parameters = [0.0; 4];
                self.sight.model.report(estimate.shapes[lobe], &mut parameters[..numbers]);
                for (number, &value) in parameters[..numbers].iter().enumerate() {
                    out.numbers[lobe * numbers + number][pixel] = value;
                }
                let spread = estimate.shape_deviation[lobe];
                out.spread[lobe][pixel] = if spread.is_finite() { spread } else { f32::NAN };
            }
            // The photographs determine every lobe's shape less well than the prior does.
            let prior_deviation = self.sight.model.spreads()[0] as f32;
            let pooled =
                estimate.own_deviation[..estimate.lobes].iter().all(|&own| own > prior_deviation);
            if pooled && estimate.lobes > 0 && out.status[pixel] == Status::Fitted.code() {
                out.status[pixel] = Status::Pooled.code();
            }
            out.lobes[pixel] = estimate.lobes as u8;
            out.converged[pixel] = u8::from(estimate.converged);
            out.residual[pixel] = solution.residual[pixel];
            // Hard case 27: an undetermined normal may lie anywhere in the hemisphere.
            out.sigma[pixel] = estimate.normal_deviation.min(FRAC_PI_2);
        }
    }
}
