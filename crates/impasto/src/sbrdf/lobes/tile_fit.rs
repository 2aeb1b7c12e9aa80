//! The fit of a tile: forward selection of lobes on the mean of the bands, then rounds of
//! reweighting and search on all bands together.

use core::f32::consts::FRAC_PI_2;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm::Options;
use crate::maps::Status;
use crate::math::Vec3;
use crate::passes::Purpose;
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;
use crate::surface::MAX_PARAMETERS;

use super::forward_selection::{ForwardSelection, Starts};
use super::fused::FusedRounds;
use super::jackknife::Jackknife;
use super::maps::{MOST_LOBES, TileMaps};
use super::model::LobeEstimation;
use super::options::{LobeOptions, Precision};
use super::photographs::Photographs;
use super::prior::{Prior, ShapePrior, ShapePriors};
use super::residuals::{Residuals, likeness};
use super::reweight::{COLUMNS, Reweight, Solution};
use super::search::{Freedom, Search};
use super::seeds::{HALO, Seed, SeedGrid, Seeds};
use super::support::{SEEN, drop_unsupported};
use super::tile::{ByLobeCount, Estimate, LobeFitTile, STRIDE, TILE, Unbounded};

/// A logarithm of a sharpness so near its bound counts as at the bound: a per cent of the width.
const AT_BOUND: f32 = 0.02;

/// Memory of a worker.
pub(super) struct LobeScratch {
    pub(super) tile: LobeFitTile,
    solution: Solution,
}

impl LobeScratch {
    pub(super) fn new(stack: &Stack<'_>) -> Self {
        Self { tile: LobeFitTile::new(stack), solution: Solution::new(stack.shape().bands) }
    }
}

/// The fit of some pixels at a time.
#[derive(Clone, Copy)]
pub(super) struct LobeFit<'a, M: LobeEstimation> {
    pub(super) stack: &'a Stack<'a>,
    pub(super) rig: &'a Rig,
    pub(super) start: &'a Start<'a>,
    pub(super) photographs: &'a Photographs<M>,
    pub(super) options: &'a LobeOptions,
    pub(super) prior: Option<&'a Prior>,
    pub(super) seeds: Option<&'a Seeds>,
    /// Whether pixels say what the bound of their lobes costs.
    pub(super) learning: bool,
    pub(super) run: &'a Run<'a>,
}

impl<'a, M: LobeEstimation> LobeFit<'a, M> {
    /// A fit without a prior and without seeds, after a check of its arguments.
    pub(super) fn new(
        stack: &'a Stack<'a>,
        rig: &'a Rig,
        start: &'a Start<'a>,
        photographs: &'a Photographs<M>,
        options: &'a LobeOptions,
        run: &'a Run<'a>,
    ) -> Result<Self> {
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
        Ok(Self {
            stack,
            rig,
            start,
            photographs,
            options,
            prior: None,
            seeds: None,
            learning: false,
            run,
        })
    }

    /// Selects the lobes of the seeds of a fine grid, starting from those of a coarse one.
    pub(super) fn seeds(&self, grids: [SeedGrid; 2]) -> Result<Seeds> {
        self.seeds_then(grids, |_, _, _| ()).map(|(seeds, _)| seeds)
    }

    /// Selects the lobes of seeds like [`Self::seeds`], fits the fine ones to all bands and returns
    /// their estimates.
    pub(super) fn fitted_seeds(&self, grids: [SeedGrid; 2]) -> Result<(Seeds, Vec<Estimate>)> {
        let (seeds, estimates) = self.seeds_then(grids, |fit, scratch, fitted| {
            fit.fit_all_bands(scratch, fitted);
            fitted.iter().map(|&pixel| scratch.tile.estimates[pixel]).collect::<Vec<_>>()
        })?;
        Ok((seeds, self.run.joined(estimates)?))
    }

    /// Selects the lobes of seeds; `then` goes on with pieces of those of the fine grid.
    fn seeds_then<T: Send>(
        &self,
        [coarse, fine]: [SeedGrid; 2],
        then: impl Fn(&LobeFit<'_, M>, &mut LobeScratch, &[usize]) -> T + Sync,
    ) -> Result<(Seeds, Vec<T>)> {
        let (coarse, _) = self.seeds_of(coarse, |_, _, _| ())?;
        LobeFit { seeds: Some(&coarse), ..*self }.seeds_of(fine, then)
    }

    /// Selects the lobes of the seeds of one grid, from this fit's seeds or by multistart; `then` goes
    /// on with pieces of them.
    fn seeds_of<T: Send>(
        &self,
        grid: SeedGrid,
        then: impl Fn(&LobeFit<'_, M>, &mut LobeScratch, &[usize]) -> T + Sync,
    ) -> Result<(Seeds, Vec<T>)> {
        let pixels: Option<Vec<usize>> =
            grid.places().map(|place| self.rig.grid().pixel(place)).collect();
        let Some(pixels) = pixels else {
            let problem = format!(
                "its stack must reach {HALO} pixels farther on every side where the painting does"
            );
            return Err(Error::geometry("tile", problem));
        };
        // What is learned from the fine seeds compares a pixel with those before it in its piece.
        let compares = self.learning && self.seeds.is_some();
        let piece = if compares { TILE } else { self.run.piece(pixels.len(), TILE) };
        let found = self.run.map(
            pixels.chunks(piece).collect(),
            || LobeScratch::new(self.stack),
            |scratch, pixels| {
                let (fitted, by_count) = self.select_lobes(scratch, pixels);
                let mut seeds = vec![None; pixels.len()];
                for &pixel in &fitted {
                    let by_count = by_count[pixel];
                    seeds[pixel] = Some(Seed {
                        by_count,
                        normal: self.start.normal(pixels[pixel]),
                        misfit: by_count.chosen().cost / scratch.tile.rounding[pixel],
                    });
                }
                (seeds, then(self, scratch, &fitted))
            },
        )?;
        let (seeds, rest): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        Ok((Seeds::new(grid, self.run.joined(seeds)?), rest))
    }

    /// Fits some pixels; returns those that can be fitted.
    pub(super) fn fit_pixels(&self, scratch: &mut LobeScratch, pixels: &[usize]) -> Vec<usize> {
        let (fitted, _) = self.select_lobes(scratch, pixels);
        self.fit_all_bands(scratch, &fitted);
        fitted
    }

    /// Selects the lobes of some pixels on the mean of the bands; returns those that can be fitted,
    /// and the forward selection of all.
    fn select_lobes(
        &self,
        scratch: &mut LobeScratch,
        pixels: &[usize],
    ) -> (Vec<usize>, Vec<ByLobeCount>) {
        let tile = &mut scratch.tile;
        tile.read(self.stack, self.rig, pixels, self.start, self.run.level);
        let status = self.start.status;
        let selection = self.selection();
        let fitted: Vec<usize> = (0..pixels.len())
            .filter(|&pixel| {
                status[pixels[pixel]] < Status::Dark.code() && selection.supports(tile, pixel, 0)
            })
            .collect();
        let by_count = match self.seeds {
            Some(seeds) => selection.select_from_seeds(tile, &fitted, seeds, self.rig.grid()),
            None => selection.select(tile, &fitted, &Starts::Multistart),
        };
        for (estimate, by_count) in tile.estimates.iter_mut().zip(&by_count) {
            *estimate = self.ordered(by_count.chosen());
        }
        (fitted, by_count)
    }

    /// Fits all bands of the pixels whose lobes have been selected.
    fn fit_all_bands(&self, scratch: &mut LobeScratch, fitted: &[usize]) {
        let LobeScratch { tile, solution } = scratch;
        // Without a round no residuals are known, and the prior has no weight.
        solution.variance.fill(0.0);
        if self.options.colour_iterations == 1 && self.options.precision == Precision::Single {
            self.fused_rounds(tile, solution, fitted);
        } else {
            self.rounds(tile, solution, fitted);
        }
        if self.run.cancelled() {
            return;
        }
        if self.options.normal && self.options.bounded {
            self.widen(tile, fitted, &solution.variance);
        }
        self.reweight(tile, solution, false);
        self.limit_strengths(tile, solution, fitted);
        for (estimate, &variance) in tile.estimates.iter_mut().zip(&solution.variance) {
            let scale = variance.sqrt();
            estimate.normal_deviation *= scale;
            estimate.shape_deviation = estimate.shape_deviation.map(|spread| spread * scale);
            estimate.own_deviation = estimate.own_deviation.map(|spread| spread * scale);
        }
    }

    /// Rounds of one step each.
    fn fused_rounds(&self, tile: &mut LobeFitTile, solution: &mut Solution, fitted: &[usize]) {
        // The last place is looked at, too.
        let passes = ((self.options.rounds + 1) * tile.pixels.len()) as u64;
        self.selection().count(Purpose::AllBands, || {
            FusedRounds {
                photographs: self.photographs,
                x: &tile.x,
                y: &tile.y,
                estimates: &mut tile.estimates,
                samples: &mut tile.colour,
                ambient: self.options.ambient,
                freedom: Freedom::of_options(self.options),
                prior: self.prior,
                rounds: self.options.rounds,
                variances: &mut solution.variance,
                level: self.run.level,
            }
            .run();
            [passes; 2]
        });
        drop_unsupported(self.photographs, tile, fitted, self.run.level);
        for &pixel in fitted {
            tile.estimates[pixel] = self.ordered(&tile.estimates[pixel]);
        }
    }

    /// Rounds of searches.
    fn rounds(&self, tile: &mut LobeFitTile, solution: &mut Solution, fitted: &[usize]) {
        for round in 1..=self.options.rounds {
            if self.run.cancelled() {
                return;
            }
            self.reweight(tile, solution, true);
            let freedom = Freedom::of_options(self.options);
            let last = round == self.options.rounds;
            self.refine(tile, fitted, &solution.variance, freedom, last);
            drop_unsupported(self.photographs, tile, fitted, self.run.level);
        }
    }

    fn selection(&self) -> ForwardSelection<'_, M> {
        let Self { photographs, options, prior, run, .. } = *self;
        ForwardSelection { photographs, options, prior, run }
    }

    /// Searches on all bands from the present estimates, whose samples have these variances.
    fn refine(
        &self,
        tile: &mut LobeFitTile,
        fitted: &[usize],
        variances: &[f32],
        freedom: Freedom,
        last: bool,
    ) {
        let precision = self.options.precision;
        let typical = self.prior.map(|prior| {
            let (model, estimates) = (&self.photographs.model, &tile.estimates);
            self.run.level.run(ShapePriors { prior, model, estimates, variances })
        });
        let typical = typical.as_deref();
        self.search_all(tile, fitted, typical, freedom, precision == Precision::Double);
        if last && precision == Precision::Polished && !self.run.cancelled() {
            self.search_all(tile, fitted, typical, freedom, true);
        }
        for &pixel in fitted {
            tile.estimates[pixel] = self.ordered(&tile.estimates[pixel]);
        }
    }

    /// Lobes about the normals that were found, without the bound, of the pixels that reach it.
    fn widen(&self, tile: &mut LobeFitTile, fitted: &[usize], variances: &[f32]) {
        let widest = self.photographs.model.widest_with_normal()[0] as f32;
        let at_bound = |pixel: &usize| {
            let Estimate { shapes, lobes, .. } = &tile.estimates[*pixel];
            shapes[..*lobes].iter().any(|shape| shape[0] <= widest + AT_BOUND)
        };
        let pixels: Vec<usize> = fitted.iter().copied().filter(at_bound).collect();
        if pixels.is_empty() || self.run.cancelled() {
            return;
        }
        let bounded = tile.estimates.clone();
        self.refine(tile, &pixels, variances, Freedom::Shapes, true);
        for &pixel in &pixels {
            tile.estimates[pixel].normal_deviation = bounded[pixel].normal_deviation;
        }
        if self.learning {
            let about = tile.estimates.clone();
            self.refine(tile, &pixels, variances, Freedom::All, true);
            let mut residuals = Vec::with_capacity(pixels.len());
            for &pixel in &pixels {
                let free = tile.estimates[pixel];
                let (photographs, level) = (self.photographs, self.run.level);
                let ambient = self.options.ambient;
                let own = Residuals { photographs, tile, ambient, pixel, level };
                residuals.push(own.weighted());
                let unknowns = tile.colour.bands * (1 + free.lobes + usize::from(ambient))
                    + free.lobes * M::SHAPES
                    + 2;
                let samples = tile.colour.bands * tile.usable[pixel];
                // Two less: over a variance of d estimated residuals, a gain by chance has a mean of
                // d / (d - 2) (the F distribution), and none where d is 2 or less.
                let variance = free.cost / samples.saturating_sub(unknowns + 2) as f32;
                let unbounded = Unbounded {
                    left: free.cost / about[pixel].cost,
                    gain: (about[pixel].cost - free.cost) / variance,
                    alike: likeness(&residuals),
                };
                tile.estimates[pixel] = Estimate { unbounded, ..about[pixel] };
            }
        }
        drop_unsupported(self.photographs, tile, &pixels, self.run.level);
    }

    /// One search for some pixels, whatever their number of lobes.
    fn search_all(
        &self,
        tile: &mut LobeFitTile,
        fitted: &[usize],
        typical: Option<&[ShapePrior]>,
        freedom: Freedom,
        double: bool,
    ) {
        let starts = &tile.estimates.clone();
        let tolerances = if double { Options::default() } else { Options::single() };
        let options = &Options { max_iterations: self.options.colour_iterations, ..tolerances };
        for &pixel in fitted {
            tile.estimates[pixel].cost = f32::INFINITY;
            tile.estimates[pixel].converged = false;
        }
        for lobes in 0..=self.options.lobes {
            let with = |&pixel: &usize| starts[pixel].lobes == lobes;
            let pixels: Vec<usize> = fitted.iter().copied().filter(with).collect();
            self.selection().count(Purpose::AllBands, || {
                Search {
                    photographs: self.photographs,
                    samples: &tile.colour,
                    x: &tile.x,
                    y: &tile.y,
                    ambient: self.options.ambient,
                    freedom,
                    typical,
                    starts,
                    found: &mut tile.estimates,
                    pixels: &pixels,
                    lobes,
                    double,
                    options,
                    level: self.run.level,
                }
                .run()
            });
        }
    }

    /// An estimate with its lobes in the order in which they are numbered.
    fn ordered(&self, estimate: &Estimate) -> Estimate {
        let key = |lobe: usize| self.photographs.model.order(estimate.shapes[lobe]);
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
        let pixels = tile.pixels.len() as u64;
        self.selection().count(Purpose::Weights, || {
            Reweight {
                photographs: self.photographs,
                x: &tile.x,
                y: &tile.y,
                estimates: &tile.estimates,
                ambient: self.options.ambient,
                renew,
                samples: &mut tile.colour,
                solution,
                level: self.run.level,
            }
            .run();
            [pixels; 2]
        });
    }

    /// Lowers strengths by which a lobe's peak would be more than [`SEEN`] says of the most light that
    /// any photograph shows.
    ///
    /// Where all photographs near the peak are clipped, these are lower bounds, and the strength has no
    /// other limit (hard case 4). So low a peak still satisfies the bound of the nearest photograph.
    fn limit_strengths(&self, tile: &LobeFitTile, solution: &mut Solution, fitted: &[usize]) {
        let model = &self.photographs.model;
        let front = Vec3::new(0.0, 0.0, 1.0);
        let pair = model.pair(front, front);
        let bands = tile.colour.bands;
        for &pixel in fitted {
            let estimate = &tile.estimates[pixel];
            for lobe in 0..estimate.lobes {
                let peak: f32 =
                    model.value(&model.lobe_from_unknowns(estimate.shapes[lobe]), &pair, front);
                let colours = &mut solution.colours;
                let places =
                    |column: usize| (0..bands).map(move |b| (b * COLUMNS + column) * TILE + pixel);
                let largest = |column| places(column).map(|at| colours[at]).fold(0.0, f32::max);
                let (strength, most) = (largest(1 + lobe), 1.0 / (SEEN as f32 * peak));
                // Nearly all are below this: photographs show the diffuse colour, too.
                if strength <= most * largest(0) {
                    continue;
                }
                let most = most * self.most_light(tile, pixel);
                if strength > most {
                    places(1 + lobe).for_each(|at| colours[at] *= most / strength);
                }
            }
        }
    }

    /// The largest sample of a pixel under unit irradiance, a clipped one at its ceiling.
    fn most_light(&self, tile: &LobeFitTile, pixel: usize) -> f32 {
        let bands = tile.colour.bands;
        let place = (tile.x[pixel], tile.y[pixel]);
        let of = |photograph: usize| {
            let planes = photograph * bands..(photograph + 1) * bands;
            let light = planes.map(|plane| tile.colour.samples[plane * STRIDE + pixel]);
            let (_, irradiance, _) = self.photographs.at(photograph, place.0, place.1);
            light.fold(0.0, f32::max) / irradiance
        };
        // False for what a lamp without light shows.
        (0..self.photographs.len()).map(of).filter(|light| light.is_finite()).fold(0.0, f32::max)
    }

    /// Adds what the model does not describe to the errors of fitted normals.
    pub(super) fn predict_errors(&self, scratch: &mut LobeScratch) {
        if !self.options.normal {
            return;
        }
        let LobeScratch { tile, solution } = scratch;
        let pixels = tile.pixels.len() as u64;
        self.selection().count(Purpose::Errors, || {
            Jackknife {
                photographs: self.photographs,
                x: &tile.x,
                y: &tile.y,
                estimates: &mut tile.estimates,
                samples: &tile.colour,
                solution,
                level: self.run.level,
            }
            .run();
            [pixels; 2]
        });
    }

    /// Writes the fitted pixels of a tile, and the statuses of the others.
    pub(super) fn write(&self, scratch: &LobeScratch, fitted: &[usize], out: &mut TileMaps<'_>) {
        let LobeScratch { tile, solution } = scratch;
        let bands = tile.colour.bands;
        for pixel in (0..tile.pixels.len()).filter(|pixel| fitted.binary_search(pixel).is_err()) {
            out.write_unfitted(pixel);
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
                self.write_shape(estimate, lobe, pixel, out);
            }
            // The photographs determine every lobe's shape less well than the prior does.
            let prior_deviation = self.photographs.model.deviations()[0] as f32;
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

    fn write_shape(&self, estimate: &Estimate, lobe: usize, pixel: usize, out: &mut TileMaps<'_>) {
        let mut parameters = [0.0; MAX_PARAMETERS];
        let parameters = &mut parameters[..M::NAMES.len()];
        self.photographs.model.parameters_from_unknowns(estimate.shapes[lobe], parameters);
        let first = lobe * parameters.len();
        for (plane, &mut value) in out.parameters[first..].iter_mut().zip(parameters) {
            plane[pixel] = value;
        }
        let deviation = self.photographs.model.width_deviation(estimate.shape_deviation[lobe]);
        out.deviation[lobe][pixel] = if deviation.is_finite() { deviation } else { f32::NAN };
    }
}
