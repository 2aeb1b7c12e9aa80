//! The maps of a pooled fit, in the caller's memory.

use crate::error::{Error, Result};
use crate::pixels::TILE;

use super::samples::planes;

/// Maps that a pooled fit fills.
#[derive(Debug)]
pub struct PooledMapsMut<'a> {
    /// `(3, y, x)`.
    pub normal: &'a mut [f32],
    /// `(band, y, x)`.
    pub diffuse: &'a mut [f32],
    /// `(y, x)` root mean square of the weighted residuals, linear light.
    pub residual: &'a mut [f32],
    /// `(y, x)` standard deviation of the normal along its worst axis, rad.
    pub sigma: &'a mut [f32],
    /// `(y, x)` by how much of the painting's strength the pixel's own differs from it, beyond the
    /// error of that difference; 0 to 1.
    pub misfit: &'a mut [f32],
    /// `(y, x)` [`Status`](crate::maps::Status) codes: [`Pooled`](crate::maps::Status::Pooled) where
    /// the lobe does not improve on the diffuse part alone, so that normal and colours are those of
    /// the start.
    pub status: &'a mut [u8],
}

impl PooledMapsMut<'_> {
    pub(super) fn check(&self, pixels: usize, bands: usize) -> Result<()> {
        let sizes = [
            ("normal", self.normal.len(), 3 * pixels),
            ("diffuse", self.diffuse.len(), bands * pixels),
            ("residual", self.residual.len(), pixels),
            ("sigma", self.sigma.len(), pixels),
            ("misfit", self.misfit.len(), pixels),
            ("status", self.status.len(), pixels),
        ];
        match sizes.iter().find(|(_, found, expected)| found != expected) {
            Some((name, found, expected)) => {
                Err(Error::argument(name, format!("{found} values, expected {expected}")))
            }
            None => Ok(()),
        }
    }

    /// The maps tile by tile.
    pub(super) fn tiles(&mut self) -> Vec<PooledMapsTile<'_>> {
        let pixels = self.status.len();
        planes(self.normal, pixels)
            .into_iter()
            .zip(planes(self.diffuse, pixels))
            .zip(self.residual.chunks_mut(TILE))
            .zip(self.sigma.chunks_mut(TILE))
            .zip(self.misfit.chunks_mut(TILE))
            .zip(self.status.chunks_mut(TILE))
            .map(|(((((normal, diffuse), residual), sigma), misfit), status)| PooledMapsTile {
                normal,
                diffuse,
                residual,
                sigma,
                misfit,
                status,
            })
            .collect()
    }
}

/// One tile of the maps.
pub(super) struct PooledMapsTile<'a> {
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) residual: &'a mut [f32],
    pub(super) sigma: &'a mut [f32],
    pub(super) misfit: &'a mut [f32],
    pub(super) status: &'a mut [u8],
}
