//! What the fit hands out.

use crate::error::Result;
use crate::pixels::Run;

/// Maps of a surface whose pixels have Lafortune lobes of their own; meanings stand in
/// `impasto.LafortuneSbrdf`.
#[derive(Clone, Debug)]
pub struct LafortuneMaps {
    /// `(3, y, x)`.
    pub normal: Vec<f32>,
    /// `(band, y, x)`.
    pub diffuse: Vec<f32>,
    /// `(lobe, band, y, x)`; 0 where a pixel has fewer lobes.
    pub specular: Vec<f32>,
    /// `(lobe, y, x)`; NaN where a pixel has fewer lobes, as the next two.
    pub cxy: Vec<f32>,
    /// `(lobe, y, x)`.
    pub cz: Vec<f32>,
    /// `(lobe, y, x)`.
    pub exponent: Vec<f32>,
    /// `(lobe, y, x)` standard deviation of the strength, the mean of the bands, relative to it; NaN
    /// where it is not determined, as the next two.
    pub specular_sigma: Vec<f32>,
    /// `(lobe, y, x)` standard deviation of the direction of (Cxy, Cz), rad.
    pub direction_sigma: Vec<f32>,
    /// `(lobe, y, x)` standard deviation of `ln n`.
    pub exponent_sigma: Vec<f32>,
    /// `(y, x)` how many lobes.
    pub lobes: Vec<u8>,
    /// `(y, x)` root mean square of the residuals, linear light.
    pub residual: Vec<f32>,
    /// `(y, x)` standard deviation of the normal along its worst axis, rad; NaN where the normal
    /// is that of photometric stereo.
    pub sigma: Vec<f32>,
    /// `(y, x)` [`Status`](crate::maps::Status) codes.
    pub status: Vec<u8>,
    /// Whether views separate normals from lobe axes; else normals are those of photometric stereo and
    /// lobes Phong's (hard case 18).
    pub views_differ: bool,
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

impl LafortuneMaps {
    /// Maps that hold NaN, no lobes, and the statuses to begin with.
    pub(super) fn new(bands: usize, lobes: usize, status: &[u8], run: &Run<'_>) -> Result<Self> {
        let unknown = |planes: usize| run.filled(f32::NAN, planes * status.len());
        Ok(Self {
            normal: unknown(3)?,
            diffuse: unknown(bands)?,
            specular: unknown(lobes * bands)?,
            cxy: unknown(lobes)?,
            cz: unknown(lobes)?,
            exponent: unknown(lobes)?,
            specular_sigma: unknown(lobes)?,
            direction_sigma: unknown(lobes)?,
            exponent_sigma: unknown(lobes)?,
            lobes: vec![0; status.len()],
            residual: unknown(1)?,
            sigma: unknown(1)?,
            status: run.copied(status)?,
            views_differ: true,
        })
    }

    /// The maps cut into tiles.
    pub(super) fn tiles(&mut self, tile: usize) -> Vec<LafortuneTile<'_>> {
        let pixels = self.status.len();
        let maps = [
            &mut self.normal,
            &mut self.diffuse,
            &mut self.specular,
            &mut self.cxy,
            &mut self.cz,
            &mut self.exponent,
            &mut self.specular_sigma,
            &mut self.direction_sigma,
            &mut self.exponent_sigma,
            &mut self.residual,
            &mut self.sigma,
        ];
        let mut planes = maps.map(|map| -> Vec<_> {
            map.chunks_mut(pixels).map(|plane| plane.chunks_mut(tile)).collect()
        });
        let mut lobes = self.lobes.chunks_mut(tile);
        let statuses = self.status.chunks_mut(tile).enumerate();
        statuses
            .map(|(number, status)| {
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
                    lobes: lobes.next().unwrap_or_default(),
                    status,
                }
            })
            .collect()
    }
}
