//! Variable projection [@golub1973varpro] in Levenberg-Marquardt steps [@levenberg1944; @marquardt1963]:
//! one Torrance-Sparrow lobe [@torrance1967theory] per pixel through samples whose angle is known.
//!
//! `y = beta exp(-k phi^2)`, `k = ln 2 / gamma^2`: what is left of eq. 9 of the RGB-camera paper
//! once its diffuse part is taken off and `F G / (N.V)` is one. The amplitude follows the width in
//! every pass ([`Normal::project`](crate::lm::Normal::project)), so that the search is one of the width alone.
//!
//! Every pixel is searched at the scale of its own largest sample, to a power of two, and scaled
//! back at the end: no square of a sample leaves the range of single precision, and samples scaled
//! by a power of two give the same lobe to the last bit.

mod kernels;
mod samples;
mod search;
mod tile;

use crate::error::{Error, Result};
use crate::lm::Occupancy;
use crate::pixels::{Run, TILE, tiles};

pub use samples::Highlights;
use tile::{HighlightTile, HighlightTileMaps};

/// What is written, pixel by pixel; NaN where the status says that it is not known.
#[derive(Debug)]
pub struct HighlightMaps<'a> {
    /// Strength.
    pub beta: &'a mut [f32],
    /// Half-width, rad.
    pub gamma: &'a mut [f32],
    /// `(3, pixel)`: variance of beta, covariance, variance of gamma.
    pub covariance: &'a mut [f32],
    /// Root mean square of the residuals.
    pub residual: &'a mut [f32],
    /// [`Status`](crate::maps::Status) codes.
    pub status: &'a mut [u8],
}

/// Fits (beta, gamma) of every pixel; returns how busy the lanes were.
///
/// Statuses: `Fitted`; `Exact` from two samples (no residual, no covariance); `IllConditioned`
/// where gamma is at its bound, its standard deviation exceeds itself or the search has not
/// converged; `Dark` where no sample is
/// positive or no lobe helps to explain them (beta 0); `RankDeficient` where the samples determine
/// no width, or all lie so far from the facet's mirror that no number holds the strength or its
/// variance; `TooFewSamples`; `InvalidInput` where no sample is finite, or where the samples are so
/// large that single precision does not hold the variance of their strength (from some 1e19 on).
/// A variance below the smallest normal number (1.2e-38) is given as that number: an upper limit.
///
/// # Errors
/// If a size does not fit, or the run is cancelled.
pub fn fit_highlight(
    highlights: &Highlights<'_>,
    maps: &mut HighlightMaps<'_>,
    run: &Run<'_>,
) -> Result<Occupancy> {
    let Highlights { samples, phi, pixels } = *highlights;
    let observations = samples.len() / pixels.max(1);
    let sizes = [
        ("samples", samples.len(), observations * pixels),
        ("phi", phi.len(), samples.len()),
        ("beta", maps.beta.len(), pixels),
        ("gamma", maps.gamma.len(), pixels),
        ("covariance", maps.covariance.len(), 3 * pixels),
        ("residual", maps.residual.len(), pixels),
        ("status", maps.status.len(), pixels),
    ];
    if let Some((name, found, expected)) = sizes.iter().find(|(_, found, fits)| found != fits) {
        return Err(Error::argument(name, format!("{found} values, expected {expected}")));
    }
    let mut covariance = maps.covariance.chunks_mut(pixels.max(1)).map(|p| p.chunks_mut(TILE));
    let mut planes = [covariance.next(), covariance.next(), covariance.next()];
    let mut next = || planes.each_mut().map(|p| p.as_mut().and_then(Iterator::next));
    let jobs: Vec<_> = tiles(pixels)
        .into_iter()
        .zip(maps.beta.chunks_mut(TILE))
        .zip(maps.gamma.chunks_mut(TILE))
        .zip(maps.residual.chunks_mut(TILE))
        .zip(maps.status.chunks_mut(TILE))
        .map(|(((((start, _), beta), gamma), residual), status)| HighlightTileMaps {
            start,
            beta,
            gamma,
            covariance: next().map(Option::unwrap_or_default),
            residual,
            status,
        })
        .collect();
    let tile = |maps| HighlightTile::new(highlights, observations, maps, run.level);
    let busy = run.map(jobs, || (), |(), maps| tile(maps).fit())?;
    Ok(busy.iter().fold(Occupancy::default(), |sum, tile| Occupancy {
        lanes: sum.lanes + tile.lanes,
        useful: sum.useful + tile.useful,
    }))
}
