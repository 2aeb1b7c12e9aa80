//! What the fit learns about the whole painting before it is applied to a tile.

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::model::LobeEstimation;
use super::options::{LobeOptions, Origin};
use super::photographs::Photographs;
use super::prior::{FEWEST, Prior, PriorNumbers};
use super::seeds::{COARSE, FINE, SeedGrid, Seeds};
use super::tile::{Estimate, TILE, Unbounded};
use super::tile_fit::{LobeFit, LobeScratch};

/// Most tiles from which the prior is made.
const SAMPLED: usize = 40;

/// Lobes are not bounded where lobes and normal free of the bound lower the sum of squares of pixels
/// that reach it by more than this many variances, on average. Where no lobe is broader the bound
/// costs a pixel less than that: it takes one unknown away, of which a part comes back with the width
/// about the kept normal. The mean, not the median: of a painting in several materials a few may be
/// broad.
const GAIN: f64 = 1.0;

/// ... of which one pixel counts this many at most: those that the model does not describe gain
/// hundreds. If a tenth of them do, their residuals are alike.
const GAIN_OF_ONE: f32 = 10.0;

/// ... and the residuals that are left correlate less than this between pixels, on average. Broad
/// lobes that are there leave noise. What lobes that stand for errors of the diffuse part cannot
/// explain is the same in all pixels: 0.1 to 0.9 under varnish, path-traced or simulated, with
/// noise of up to 1 % of white.
const ALIKE: f64 = 0.05;

/// ... or they leave less than this share of the cost, noise or not: without noise, that of searches
/// that end early. Errors of the diffuse part leave 0.4 of it at the least.
const LITTLE: f32 = 0.05;

/// Fewest pixels, and their least fraction of all, that say so.
const FEWEST_BROAD: usize = 5;
const BROAD_FRACTION: f64 = 0.05;

/// Most pixels that multistart fits twice: once for the prior, once with it.
pub const TYPICAL_PIXELS: usize = SAMPLED * TILE;

/// What the fit of a tile needs to know about the whole painting: small plain data.
#[derive(Clone, Debug)]
pub struct LearnedLobes {
    /// The options with which it was learned; its start is multistart where the sample had too few
    /// seeds for a prior.
    pub options: LobeOptions,
    /// How many pixels were fitted to learn it.
    pub pixels: usize,
    pub(super) prior: Option<Prior>,
}

impl LearnedLobes {
    /// The sampled pixels from which priors are made; none with [`LobeOptions::typical`] off.
    #[must_use]
    pub fn prior(&self) -> Option<PriorNumbers> {
        self.prior.as_ref().map(Prior::to_numbers)
    }

    /// What was saved, again.
    ///
    /// # Errors
    /// If the numbers are not those of a prior, or their being there disagrees with the options.
    pub fn new(options: LobeOptions, pixels: usize, prior: Option<&PriorNumbers>) -> Result<Self> {
        if prior.is_some() != options.typical {
            return Err(Error::argument(
                "prior",
                "expected one just where the options call for it",
            ));
        }
        Ok(Self { options, pixels, prior: prior.map(Prior::from_numbers).transpose()? })
    }
}

/// Learns what the fit of a tile needs to know about the whole painting.
///
/// `stack`, `rig` and `start` may be those of the whole painting, or of a tile of it as a sample.
/// Seeds, or with multistart up to [`TYPICAL_PIXELS`] spread over the sample, are fitted; the prior
/// is made from their estimates.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn learn_lobes<M: LobeEstimation>(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    model: M,
    options: &LobeOptions,
    run: &Run<'_>,
) -> Result<LearnedLobes> {
    let photographs = Photographs::new(model, rig, options.coated);
    LobeFit::new(stack, rig, start, &photographs, options, run)?.learn().map(|(learned, _)| learned)
}

/// Whether pixels say that their lobes are broader than the bound.
fn has_broad_lobes(estimates: &[Estimate]) -> bool {
    let fewest = FEWEST_BROAD.max((BROAD_FRACTION * estimates.len() as f64) as usize);
    let said = |number: fn(&Unbounded) -> f32| -> Vec<f32> {
        let all = estimates.iter().map(|one| number(&one.unbounded));
        all.filter(|value| !value.is_nan()).collect()
    };
    let mut left = said(|one| one.left);
    if left.len() < fewest {
        return false;
    }
    let gain = said(|one| one.gain).into_iter().map(|gain| gain.min(GAIN_OF_ONE));
    let alike = said(|one| one.alike).into_iter();
    median(&mut left) < LITTLE || mean(gain) > GAIN && mean(alike) < ALIKE
}

fn mean(values: impl ExactSizeIterator<Item = f32>) -> f64 {
    let count = values.len() as f64;
    values.map(f64::from).sum::<f64>() / count
}

/// NaN of none.
fn median(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return f32::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

impl<M: LobeEstimation> LobeFit<'_, M> {
    /// What is learned from this fit's stack, and the seeds that were fitted for it.
    pub(super) fn learn(&self) -> Result<(LearnedLobes, Option<Seeds>)> {
        let learning = self.options.normal && self.options.bounded;
        let (learned, seeds, estimates) = LobeFit { learning, ..*self }.learn_bounded()?;
        if !has_broad_lobes(&estimates) {
            return Ok((learned, seeds));
        }
        let options = LobeOptions { bounded: false, ..*self.options };
        let (learned, seeds, _) = LobeFit { options: &options, ..*self }.learn_bounded()?;
        Ok((learned, seeds))
    }

    /// The same with lobes bounded as the options say, and the estimates of the sample.
    fn learn_bounded(&self) -> Result<(LearnedLobes, Option<Seeds>, Vec<Estimate>)> {
        let grids = [COARSE, FINE].map(|step| SeedGrid::inside(self.rig.grid(), step));
        let seeds = match self.options.start {
            Origin::Neighbours | Origin::NeighboursOnly => Some(self.fitted_seeds(grids)?),
            Origin::Multistart => None,
        };
        // The seeds also give the prior; with too few seeds for one, multistart is used.
        let enough = |estimates: &[Estimate]| !self.options.typical || estimates.len() >= FEWEST;
        let (seeds, estimates) = match seeds {
            Some((seeds, estimates)) if enough(&estimates) => (Some(seeds), estimates),
            _ if self.options.typical || self.learning => (None, self.sampled()?),
            _ => (None, Vec::new()),
        };
        let start = if seeds.is_some() { self.options.start } else { Origin::Multistart };
        let prior =
            self.options.typical.then(|| Prior::of_estimates(&self.photographs.model, &estimates));
        let options = LobeOptions { start, ..*self.options };
        Ok((LearnedLobes { options, pixels: estimates.len(), prior }, seeds, estimates))
    }

    /// Estimates of tiles spread over the painting.
    fn sampled(&self) -> Result<Vec<Estimate>> {
        let pixels = self.stack.shape().pixels();
        let tiles = pixels.div_ceil(TILE);
        let starts = (0..tiles).step_by(tiles.div_ceil(SAMPLED)).map(|tile| tile * TILE);
        let estimates = self.run.map(
            starts.collect(),
            || LobeScratch::new(self.stack),
            |scratch, start| {
                let tile: Vec<usize> = (start..pixels.min(start + TILE)).collect();
                let fitted = self.fit_pixels(scratch, &tile);
                fitted.into_iter().map(|pixel| scratch.tile.estimates[pixel]).collect::<Vec<_>>()
            },
        )?;
        self.run.joined(estimates)
    }
}
