//! Result maps of the fit.

use crate::error::Result;
use crate::pixels::Run;

/// Most lobes that a pixel may have.
pub const MOST_LOBES: usize = 3;

/// Maps of a surface whose pixels have lobes of their own; meanings stand in `impasto.LobeSbrdf`.
#[derive(Clone, Debug)]
pub struct LobeMaps {
    /// `(3, y, x)`.
    pub normal: Vec<f32>,
    /// `(band, y, x)`.
    pub diffuse: Vec<f32>,
    /// `(band, y, x)`.
    pub ambient: Vec<f32>,
    /// `(lobe, band, y, x)`.
    pub specular: Vec<f32>,
    /// `(lobe, number, y, x)`: what [`LobeModel::NAMES`](super::LobeModel::NAMES) names.
    pub numbers: Vec<f32>,
    /// `(lobe, y, x)` standard deviation of the first number of a lobe's shape.
    pub spread: Vec<f32>,
    /// `(lobe, y, x)` 1 where a lobe's strengths differ from band to band, 0 where one will do.
    pub tinted: Vec<u8>,
    /// `(y, x)` how many lobes.
    pub lobes: Vec<u8>,
    /// `(y, x)` root mean square of the residuals, linear light.
    pub residual: Vec<f32>,
    /// `(y, x)` standard deviation of the normal along its worst axis, rad.
    pub sigma: Vec<f32>,
    /// `(y, x)` 1 where the search ended by its own tests, 0 where its iterations were used up.
    pub converged: Vec<u8>,
    /// `(y, x)` [`Status`](crate::maps::Status) codes.
    pub status: Vec<u8>,
}

/// The part of every map that one tile writes.
pub(super) struct TileMaps<'a> {
    pub(super) start: usize,
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) ambient: Vec<&'a mut [f32]>,
    pub(super) specular: Vec<&'a mut [f32]>,
    pub(super) numbers: Vec<&'a mut [f32]>,
    pub(super) spread: Vec<&'a mut [f32]>,
    pub(super) tinted: Vec<&'a mut [u8]>,
    pub(super) lobes: &'a mut [u8],
    pub(super) residual: &'a mut [f32],
    pub(super) sigma: &'a mut [f32],
    pub(super) converged: &'a mut [u8],
    pub(super) status: &'a mut [u8],
}

impl LobeMaps {
    /// Maps that hold NaN, no lobes, and the statuses to begin with.
    pub(super) fn new(
        bands: usize,
        lobes: usize,
        numbers: usize,
        status: &[u8],
        run: &Run<'_>,
    ) -> Result<Self> {
        let pixels = status.len();
        let unknown = |planes: usize| run.filled(f32::NAN, planes * pixels);
        Ok(Self {
            normal: unknown(3)?,
            diffuse: unknown(bands)?,
            ambient: unknown(bands)?,
            specular: unknown(lobes * bands)?,
            numbers: unknown(lobes * numbers)?,
            spread: unknown(lobes)?,
            tinted: vec![0; lobes * pixels],
            lobes: vec![0; pixels],
            residual: unknown(1)?,
            sigma: unknown(1)?,
            converged: vec![0; pixels],
            status: run.copied(status)?,
        })
    }

    /// The maps cut into tiles.
    pub(super) fn tiles(&mut self, tile: usize) -> Vec<TileMaps<'_>> {
        let pixels = self.status.len();
        let mut normal = cut(&mut self.normal, pixels, tile);
        let mut diffuse = cut(&mut self.diffuse, pixels, tile);
        let mut ambient = cut(&mut self.ambient, pixels, tile);
        let mut specular = cut(&mut self.specular, pixels, tile);
        let mut numbers = cut(&mut self.numbers, pixels, tile);
        let mut spread = cut(&mut self.spread, pixels, tile);
        let mut residual = self.residual.chunks_mut(tile);
        let mut sigma = self.sigma.chunks_mut(tile);
        let mut tinted = cut(&mut self.tinted, pixels, tile);
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
                numbers: take(&mut numbers),
                spread: take(&mut spread),
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

/// The planes of a map, each in tiles.
fn cut<T>(map: &mut [T], pixels: usize, tile: usize) -> Vec<core::slice::ChunksMut<'_, T>> {
    map.chunks_mut(pixels).map(|plane| plane.chunks_mut(tile)).collect()
}

/// The next tile of every plane.
fn take<'a, T>(planes: &mut [core::slice::ChunksMut<'a, T>]) -> Vec<&'a mut [T]> {
    planes.iter_mut().filter_map(Iterator::next).collect()
}
