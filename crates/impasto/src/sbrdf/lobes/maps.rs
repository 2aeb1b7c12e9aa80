//! Result maps of the fit, in the caller's memory.

use core::slice::ChunksMut;

use crate::error::{Error, Result};
use crate::maps::Status;

/// Most lobes that a pixel may have.
pub const MOST_LOBES: usize = 3;

/// Maps of a surface whose pixels have lobes of their own, to be filled; what they mean stands in
/// `impasto.LobeSbrdf`. What they hold before does not matter.
#[derive(Debug)]
pub struct LobeMapsMut<'a> {
    /// `(3, y, x)`.
    pub normal: &'a mut [f32],
    /// `(band, y, x)`.
    pub diffuse: &'a mut [f32],
    /// `(band, y, x)`.
    pub ambient: &'a mut [f32],
    /// `(lobe, band, y, x)`.
    pub specular: &'a mut [f32],
    /// `(lobe, parameter, y, x)`: what [`LobeModel::NAMES`](crate::surface::LobeModel::NAMES) names.
    pub parameters: &'a mut [f32],
    /// `(lobe, y, x)` standard deviation of the logarithm of a lobe's width.
    pub deviation: &'a mut [f32],
    /// `(lobe, y, x)` 1 where a lobe's strengths differ from band to band, 0 where one is enough.
    pub tinted: &'a mut [u8],
    /// `(y, x)` number of lobes.
    pub lobes: &'a mut [u8],
    /// `(y, x)` root mean square of the residuals, linear light.
    pub residual: &'a mut [f32],
    /// `(y, x)` standard deviation of the normal along its worst axis, rad.
    pub sigma: &'a mut [f32],
    /// `(y, x)` 1 where the search ended by its own tests, 0 where its iterations were used up.
    pub converged: &'a mut [u8],
    /// `(y, x)` [`Status`] codes.
    pub status: &'a mut [u8],
}

/// The part of every map that one tile writes.
pub(super) struct TileMaps<'a> {
    /// The tile's first pixel.
    pub(super) start: usize,
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) ambient: Vec<&'a mut [f32]>,
    pub(super) specular: Vec<&'a mut [f32]>,
    pub(super) parameters: Vec<&'a mut [f32]>,
    pub(super) deviation: Vec<&'a mut [f32]>,
    pub(super) tinted: Vec<&'a mut [u8]>,
    pub(super) lobes: &'a mut [u8],
    pub(super) residual: &'a mut [f32],
    pub(super) sigma: &'a mut [f32],
    pub(super) converged: &'a mut [u8],
    pub(super) status: &'a mut [u8],
}

impl<'a> LobeMapsMut<'a> {
    /// Whether every map has its size.
    pub(super) fn check(
        &self,
        pixels: usize,
        bands: usize,
        lobes: usize,
        parameters: usize,
    ) -> Result<()> {
        let sizes = [
            ("normal", self.normal.len(), 3),
            ("diffuse", self.diffuse.len(), bands),
            ("ambient", self.ambient.len(), bands),
            ("specular", self.specular.len(), lobes * bands),
            ("parameters", self.parameters.len(), lobes * parameters),
            ("deviation", self.deviation.len(), lobes),
            ("tinted", self.tinted.len(), lobes),
            ("lobes", self.lobes.len(), 1),
            ("residual", self.residual.len(), 1),
            ("sigma", self.sigma.len(), 1),
            ("converged", self.converged.len(), 1),
            ("status", self.status.len(), 1),
        ];
        match sizes.iter().find(|(_, size, planes)| *size != planes * pixels) {
            None => Ok(()),
            Some((name, size, planes)) => {
                let problem =
                    format!("expected {planes} planes of {pixels} pixels, found {size} numbers");
                Err(Error::argument(name, problem))
            }
        }
    }

    /// The maps cut into tiles.
    pub(super) fn tiles(self, tile: usize) -> Vec<TileMaps<'a>> {
        let pixels = self.status.len();
        let mut normal = cut(self.normal, pixels, tile);
        let mut diffuse = cut(self.diffuse, pixels, tile);
        let mut ambient = cut(self.ambient, pixels, tile);
        let mut specular = cut(self.specular, pixels, tile);
        let mut parameters = cut(self.parameters, pixels, tile);
        let mut deviation = cut(self.deviation, pixels, tile);
        let mut tinted = cut(self.tinted, pixels, tile);
        let mut residual = self.residual.chunks_mut(tile);
        let mut sigma = self.sigma.chunks_mut(tile);
        let mut lobes = self.lobes.chunks_mut(tile);
        let mut converged = self.converged.chunks_mut(tile);
        self.status
            .chunks_mut(tile)
            .enumerate()
            .map(|(number, status)| TileMaps {
                start: number * tile,
                normal: take(&mut normal),
                diffuse: take(&mut diffuse),
                ambient: take(&mut ambient),
                specular: take(&mut specular),
                parameters: take(&mut parameters),
                deviation: take(&mut deviation),
                tinted: take(&mut tinted),
                lobes: lobes.next().unwrap_or_default(),
                residual: residual.next().unwrap_or_default(),
                sigma: sigma.next().unwrap_or_default(),
                converged: converged.next().unwrap_or_default(),
                status,
            })
            .collect()
    }
}

impl TileMaps<'_> {
    /// How many pixels the tile has.
    pub(super) fn len(&self) -> usize {
        self.status.len()
    }

    /// Sets all pixels to NaN, no lobes and their statuses to begin with.
    pub(super) fn reset(&mut self, status: impl Iterator<Item = u8>) {
        let planes = [
            &mut self.normal,
            &mut self.diffuse,
            &mut self.ambient,
            &mut self.specular,
            &mut self.parameters,
            &mut self.deviation,
        ];
        planes.into_iter().flatten().for_each(|plane| plane.fill(f32::NAN));
        self.residual.fill(f32::NAN);
        self.sigma.fill(f32::NAN);
        self.tinted.iter_mut().for_each(|plane| plane.fill(0));
        self.lobes.fill(0);
        self.converged.fill(0);
        self.status.iter_mut().zip(status).for_each(|(to, from)| *to = from);
    }

    /// Writes a pixel that is not estimated: one without light reflects none.
    pub(super) fn write_unfitted(&mut self, pixel: usize) {
        if self.status[pixel] < Status::Dark.code() {
            self.status[pixel] = Status::TooFewSamples.code();
        }
        if self.status[pixel] == Status::Dark.code() {
            let colours = [&mut self.diffuse, &mut self.ambient, &mut self.specular];
            colours.into_iter().flatten().for_each(|plane| plane[pixel] = 0.0);
        }
    }
}

/// The planes of a map, each in tiles.
fn cut<T>(map: &mut [T], pixels: usize, tile: usize) -> Vec<ChunksMut<'_, T>> {
    map.chunks_mut(pixels).map(|plane| plane.chunks_mut(tile)).collect()
}

/// The next tile of every plane.
fn take<'a, T>(planes: &mut [ChunksMut<'a, T>]) -> Vec<&'a mut [T]> {
    planes.iter_mut().filter_map(Iterator::next).collect()
}
