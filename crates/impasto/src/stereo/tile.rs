//! The result maps, cut into tiles.

use crate::error::{Error, Result};
use crate::maps::{Rejection, Status};
use crate::pixels;

/// Maps in the caller's memory.
///
/// `rejected` and `status` must hold zeros: registers of zeros are not written to them, so that
/// fresh memory in which nothing goes wrong is never touched. All other values are written. A map
/// without memory was not asked for, and is not made; `status` always is.
#[derive(Debug)]
pub struct NormalMaps<'a> {
    /// `(3, y, x)` unit vectors.
    pub normal: &'a mut [f32],
    /// `(band, y, x)` relative to the white board.
    pub albedo: &'a mut [f32],
    /// `(y, x)` samples that a rule kept.
    pub used: &'a mut [u16],
    /// `(4, y, x)` samples that were not used, by [`Rejection`].
    pub rejected: &'a mut [u16],
    /// `(y, x)` root mean square of the used samples' residuals, linear light.
    pub residual: &'a mut [f32],
    /// `(y, x)` condition number of the matrix whose rows are the used lights.
    pub condition: &'a mut [f32],
    /// `(y, x)` predicted standard deviation of the normal along its worst axis, rad.
    pub sigma: &'a mut [f32],
    /// `(y, x)` [`Status`](crate::maps::Status) codes.
    pub status: &'a mut [u8],
}

/// The part of the maps that one tile holds: no planes of a map that was not asked for.
pub(super) struct NormalTile<'a> {
    pub(super) start: usize,
    pub(super) count: usize,
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) albedo: Vec<&'a mut [f32]>,
    pub(super) used: Option<&'a mut [u16]>,
    pub(super) rejected: Vec<&'a mut [u16]>,
    pub(super) residual: Option<&'a mut [f32]>,
    pub(super) condition: Option<&'a mut [f32]>,
    pub(super) sigma: Option<&'a mut [f32]>,
    pub(super) status: &'a mut [u8],
    /// What the pixels of a sample say of the painting; else no planes.
    pub(super) statistics: Vec<&'a mut [f32]>,
}

impl NormalMaps<'_> {
    pub(super) fn tiles<'a>(
        &'a mut self,
        pixels: usize,
        bands: usize,
        statistics: Option<&'a mut [f32]>,
    ) -> Result<Vec<NormalTile<'a>>> {
        let sizes = [
            ("normal", self.normal.len(), 3 * pixels),
            ("albedo", self.albedo.len(), bands * pixels),
            ("used", self.used.len(), pixels),
            ("rejected", self.rejected.len(), Rejection::COUNT * pixels),
            ("residual", self.residual.len(), pixels),
            ("condition", self.condition.len(), pixels),
            ("sigma", self.sigma.len(), pixels),
            ("status", self.status.len(), pixels),
        ];
        let wrong = |&&(name, found, expected): &&(&str, usize, usize)| {
            found != expected && (found != 0 || name == "status")
        };
        if let Some((name, found, expected)) = sizes.iter().find(wrong) {
            return Err(Error::argument(name, format!("{found} values, expected {expected}")));
        }
        let mut normal = planes(self.normal, pixels);
        let mut albedo = planes(self.albedo, pixels);
        let mut rejected = planes(self.rejected, pixels);
        let mut statistics = planes(statistics.unwrap_or_default(), pixels);
        let mut used = self.used.chunks_mut(pixels::TILE);
        let mut residual = self.residual.chunks_mut(pixels::TILE);
        let mut condition = self.condition.chunks_mut(pixels::TILE);
        let mut sigma = self.sigma.chunks_mut(pixels::TILE);
        Ok(pixels::tiles(pixels)
            .into_iter()
            .zip(self.status.chunks_mut(pixels::TILE))
            .map(|((start, count), status)| NormalTile {
                start,
                count,
                normal: normal.iter_mut().filter_map(Iterator::next).collect(),
                albedo: albedo.iter_mut().filter_map(Iterator::next).collect(),
                used: used.next(),
                rejected: rejected.iter_mut().filter_map(Iterator::next).collect(),
                residual: residual.next(),
                condition: condition.next(),
                sigma: sigma.next(),
                status,
                statistics: statistics.iter_mut().filter_map(Iterator::next).collect(),
            })
            .collect())
    }
}

/// Each plane, cut into tiles.
fn planes<T>(map: &mut [T], pixels: usize) -> Vec<core::slice::ChunksMut<'_, T>> {
    map.chunks_mut(pixels).map(|plane| plane.chunks_mut(pixels::TILE)).collect()
}

impl NormalTile<'_> {
    /// What a pixel outside the mask shows.
    pub(super) fn mask(&mut self, pixel: usize) {
        for plane in self.normal.iter_mut().chain(&mut self.albedo) {
            plane[pixel] = f32::NAN;
        }
        let errors = [&mut self.residual, &mut self.condition, &mut self.sigma];
        for plane in errors.into_iter().flatten() {
            plane[pixel] = f32::NAN;
        }
        for plane in &mut self.rejected {
            plane[pixel] = 0;
        }
        if let Some(used) = &mut self.used {
            used[pixel] = 0;
        }
        self.status[pixel] = Status::Masked.code();
    }
}
