//! The fit of a tile, or of the whole painting, with what was learned before.

use crate::error::Result;
use crate::geometry::{Grid, Rig};
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::learn::LearnedLobes;
use super::maps::LobeMapsMut;
use super::model::LobeEstimation;
use super::options::{LobeOptions, Origin};
use super::photographs::Photographs;
use super::seeds::{COARSE, FINE, SeedGrid};
use super::tile::TILE;
use super::tile_fit::{LobeFit, LobeScratch};

/// Lobes of every pixel, from the normals of photometric stereo: [`learn_lobes`] and [`apply_lobes`]
/// in a row, with the seeds of the first.
///
/// [`learn_lobes`]: super::learn_lobes
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit_lobes<M: LobeEstimation>(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    model: M,
    options: &LobeOptions,
    out: LobeMapsMut<'_>,
    run: &Run<'_>,
) -> Result<LearnedLobes> {
    let photographs = Photographs::new(model, rig, options.coated);
    let fit = LobeFit::new(stack, rig, start, &photographs, options, run)?;
    fit.check(rig.grid(), &out)?;
    let (learned, seeds) = fit.learn()?;
    let fit = LobeFit { prior: learned.prior.as_ref(), options: &learned.options, ..fit };
    LobeFit { seeds: seeds.as_ref(), ..fit }.fill(rig.grid(), out)?;
    Ok(learned)
}

/// Lobes of the pixels of a tile, with what was learned about the whole painting.
///
/// `stack`, `rig` and `start` hold the tile and, where the fit starts from neighbours, [`HALO`]
/// pixels more on every side as far as the painting reaches; `tile` says which pixels to fit. The
/// maps are those that [`fit_lobes`] of the whole painting has there, bit for bit, if
/// `learned` was learned from the whole painting.
///
/// [`HALO`]: super::HALO
///
/// # Errors
/// If sizes disagree, the stack does not hold the tile with what is around it, or the run is
/// cancelled.
#[allow(clippy::too_many_arguments, reason = "a fit's own, and a tile")]
pub fn apply_lobes<M: LobeEstimation>(
    learned: &LearnedLobes,
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    model: M,
    tile: Grid,
    out: LobeMapsMut<'_>,
    run: &Run<'_>,
) -> Result<()> {
    let photographs = Photographs::new(model, rig, learned.options.coated);
    let fit = LobeFit::new(stack, rig, start, &photographs, &learned.options, run)?;
    fit.check(tile, &out)?;
    let seeds = match learned.options.start {
        Origin::Neighbours | Origin::NeighboursOnly => {
            Some(fit.seeds([COARSE, FINE].map(|step| SeedGrid::around(tile, step)))?)
        }
        Origin::Multistart => None,
    };
    let fit = LobeFit { prior: learned.prior.as_ref(), ..fit };
    LobeFit { seeds: seeds.as_ref(), ..fit }.fill(tile, out)
}

impl<M: LobeEstimation> LobeFit<'_, M> {
    /// Whether the stack has the tile's pixels, and the maps their size.
    fn check(&self, tile: Grid, out: &LobeMapsMut<'_>) -> Result<()> {
        let grid = self.rig.grid();
        let from = [0, 1].map(|axis| tile.origin[axis].wrapping_sub(grid.origin[axis]));
        grid.tile(from, tile.width, tile.height)?;
        let bands = self.stack.shape().bands;
        out.check(tile.width * tile.height, bands, self.options.lobes, M::NAMES.len())
    }

    /// Fits a tile's pixels and writes their maps.
    fn fill(&self, tile: Grid, out: LobeMapsMut<'_>) -> Result<()> {
        self.run.for_each(
            out.tiles(self.run.piece(tile.width * tile.height, TILE)),
            || LobeScratch::new(self.stack),
            |scratch, mut out| {
                let pixels: Vec<usize> = (out.start..out.start + out.len())
                    .filter_map(|pixel| self.rig.grid().pixel(tile.place(pixel)))
                    .collect();
                out.reset(pixels.iter().map(|&pixel| self.start.status[pixel]));
                let fitted = self.fit_pixels(scratch, &pixels);
                self.predict_errors(scratch);
                self.write(scratch, &fitted, &mut out);
            },
        )
    }
}
