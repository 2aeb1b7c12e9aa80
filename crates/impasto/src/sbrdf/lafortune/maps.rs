//! The result maps, in the caller's memory, cut into tiles.

use crate::error::{Error, Result};

/// Maps of a surface whose pixels have Lafortune lobes of their own, in the caller's memory.
///
/// All values are written, whatever the memory holds; after a cancelled call some are not.
#[derive(Debug)]
pub struct LafortuneMapsMut<'a> {
    /// `(3, y, x)`.
    pub normal: &'a mut [f32],
    /// `(band, y, x)`.
    pub diffuse: &'a mut [f32],
    /// `(lobe, band, y, x)`; 0 where a pixel has fewer lobes.
    pub specular: &'a mut [f32],
    /// `(lobe, y, x)`; NaN where a pixel has fewer lobes, as the next two.
    pub cxy: &'a mut [f32],
    /// `(lobe, y, x)`.
    pub cz: &'a mut [f32],
    /// `(lobe, y, x)`.
    pub exponent: &'a mut [f32],
    /// `(lobe, y, x)` standard deviation of the strength, the mean of the bands, relative to it; NaN
    /// where it is not determined, as the next two.
    pub specular_sigma: &'a mut [f32],
    /// `(lobe, y, x)` standard deviation of the direction of (Cxy, Cz), rad.
    pub direction_sigma: &'a mut [f32],
    /// `(lobe, y, x)` standard deviation of `ln n`.
    pub exponent_sigma: &'a mut [f32],
    /// `(y, x)` how many lobes.
    pub lobes: &'a mut [u8],
    /// `(y, x)` root mean square of the residuals, linear light.
    pub residual: &'a mut [f32],
    /// `(y, x)` standard deviation of the normal along its worst axis, rad; NaN where the normal
    /// is that of photometric stereo.
    pub sigma: &'a mut [f32],
    /// `(y, x)` [`Status`](crate::maps::Status) codes.
    pub status: &'a mut [u8],
}

/// A tile of every map, to be written.
pub(super) struct LafortuneTile<'a> {
    pub(super) start: usize,
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) specular: Vec<&'a mut [f32]>,
    pub(super) cxy: Vec<&'a mut [f32]>,
    pub(super) cz: Vec<&'a mut [f32]>,
    pub(super) exponent: Vec<&'a mut [f32]>,
    pub(super) specular_sigma: Vec<&'a mut [f32]>,
    pub(super) direction_sigma: Vec<&'a mut [f32]>,
    pub(super) exponent_sigma: Vec<&'a mut [f32]>,
    pub(super) lobes: &'a mut [u8],
    pub(super) residual: &'a mut [f32],
    pub(super) sigma: &'a mut [f32],
    pub(super) status: &'a mut [u8],
}

impl<'a> LafortuneMapsMut<'a> {
    /// The maps cut into tiles.
    pub(super) fn tiles(
        self,
        pixels: usize,
        bands: usize,
        lobes: usize,
        tile: usize,
    ) -> Result<Vec<LafortuneTile<'a>>> {
        let floats = [
            ("normal", self.normal, 3),
            ("diffuse", self.diffuse, bands),
            ("specular", self.specular, lobes * bands),
            ("cxy", self.cxy, lobes),
            ("cz", self.cz, lobes),
            ("exponent", self.exponent, lobes),
            ("specular_sigma", self.specular_sigma, lobes),
            ("direction_sigma", self.direction_sigma, lobes),
            ("exponent_sigma", self.exponent_sigma, lobes),
            ("residual", self.residual, 1),
            ("sigma", self.sigma, 1),
        ];
        let sizes = floats.iter().map(|(name, map, planes)| (*name, map.len(), planes * pixels));
        let codes = [("lobes", self.lobes.len(), pixels), ("status", self.status.len(), pixels)];
        if let Some((name, found, expected)) = sizes.chain(codes).find(|(_, a, b)| a != b) {
            return Err(Error::argument(name, format!("{found} values, expected {expected}")));
        }
        let mut planes = floats.map(|(_, map, _)| -> Vec<_> {
            map.chunks_mut(pixels).map(|plane| plane.chunks_mut(tile)).collect()
        });
        let counts = self.lobes.chunks_mut(tile);
        let tiles = self.status.chunks_mut(tile).zip(counts).enumerate();
        Ok(tiles
            .map(|(number, (status, lobes))| {
                let mut next = planes.iter_mut().map(|planes| -> Vec<_> {
                    planes.iter_mut().filter_map(Iterator::next).collect()
                });
                let mut map = || next.next().unwrap_or_default();
                LafortuneTile {
                    start: number * tile,
                    normal: map(),
                    diffuse: map(),
                    specular: map(),
                    cxy: map(),
                    cz: map(),
                    exponent: map(),
                    specular_sigma: map(),
                    direction_sigma: map(),
                    exponent_sigma: map(),
                    residual: map().pop().unwrap_or_default(),
                    sigma: map().pop().unwrap_or_default(),
                    lobes,
                    status,
                }
            })
            .collect())
    }
}

impl LafortuneTile<'_> {
    /// Fills the maps with NaN, no lobes, and the statuses of photometric stereo.
    pub(super) fn clear(&mut self, status: &[u8]) {
        let planes = [
            &mut self.normal,
            &mut self.diffuse,
            &mut self.specular,
            &mut self.cxy,
            &mut self.cz,
            &mut self.exponent,
            &mut self.specular_sigma,
            &mut self.direction_sigma,
            &mut self.exponent_sigma,
        ];
        planes.into_iter().flatten().for_each(|plane| plane.fill(f32::NAN));
        self.residual.fill(f32::NAN);
        self.sigma.fill(f32::NAN);
        self.lobes.fill(0);
        self.status.copy_from_slice(status);
    }
}
