//! The maps of a fit, cut into tiles, and the samples of a tile.

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::maps::Status;
use crate::math::{Mask, Real, Vec3};
use crate::pixels;
use crate::stack::Stack;

use super::lanes::{load, store};

/// What all tiles share.
pub(super) struct Scene<'a> {
    pub(super) stack: &'a Stack<'a>,
    pub(super) rig: &'a Rig,
    pub(super) index: f64,
    pub(super) bands: usize,
}

/// Maps in the caller's memory: normals and colours are refined in place.
#[derive(Debug)]
pub struct Maps<'a> {
    /// `(3, y, x)`.
    pub normal: &'a mut [f32],
    /// `(band, y, x)`.
    pub diffuse: &'a mut [f32],
    /// `(y, x)` root mean square of the weighted residuals, linear light.
    pub residual: &'a mut [f32],
    /// `(y, x)` [`Status`] codes of the normals.
    pub status: &'a [u8],
}

/// The part of the maps that one tile holds.
pub(super) struct Tile<'a> {
    pub(super) start: usize,
    pub(super) count: usize,
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) residual: &'a mut [f32],
    pub(super) status: &'a [u8],
}

impl Maps<'_> {
    /// The maps cut into tiles, borrowed for one pass.
    pub(super) fn tiles(&mut self, pixels: usize, bands: usize) -> Result<Vec<Tile<'_>>> {
        let sizes = [
            ("normal", self.normal.len(), 3 * pixels),
            ("diffuse", self.diffuse.len(), bands * pixels),
            ("residual", self.residual.len(), pixels),
            ("status", self.status.len(), pixels),
        ];
        if let Some((name, found, expected)) = sizes.iter().find(|(_, a, b)| a != b) {
            return Err(Error::argument(name, format!("{found} values, expected {expected}")));
        }
        let cut = |map| <[f32]>::chunks_mut(map, pixels);
        let mut normal: Vec<_> = cut(self.normal).map(|p| p.chunks_mut(pixels::TILE)).collect();
        let mut diffuse: Vec<_> = cut(self.diffuse).map(|p| p.chunks_mut(pixels::TILE)).collect();
        Ok(pixels::tiles(pixels)
            .into_iter()
            .zip(self.residual.chunks_mut(pixels::TILE))
            .zip(self.status.chunks(pixels::TILE))
            .map(|(((start, count), residual), status)| Tile {
                start,
                count,
                normal: normal.iter_mut().filter_map(Iterator::next).collect(),
                diffuse: diffuse.iter_mut().filter_map(Iterator::next).collect(),
                residual,
                status,
            })
            .collect())
    }
}

impl Tile<'_> {
    #[inline(always)]
    pub(super) fn estimated(&self, pixel: usize) -> bool {
        self.status[pixel] < Status::Dark.code()
    }

    #[inline(always)]
    pub(super) fn normal_at<R: Real<Scalar = f32>>(&self, at: usize) -> Vec3<R> {
        Vec3::new(load(self.normal[0], at), load(self.normal[1], at), load(self.normal[2], at))
    }

    /// Writes lanes that hold finite results; the others keep what they had.
    #[inline(always)]
    pub(super) fn write_pixels<R: Real<Scalar = f32>>(
        &mut self,
        at: usize,
        normal: Vec3<R>,
        colours: &[R],
        fine: R::Mask,
    ) {
        if !fine.any() {
            return;
        }
        for (plane, value) in self.normal.iter_mut().zip([normal.x, normal.y, normal.z]) {
            let old: R = load(plane, at);
            store(R::select(fine, value, old), plane, at);
        }
        for (plane, &value) in self.diffuse.iter_mut().zip(colours) {
            let old: R = load(plane, at);
            store(R::select(fine, value, old), plane, at);
        }
    }

    /// NaN where the status says that nothing was estimated.
    pub(super) fn blank(&mut self) {
        for pixel in 0..self.count {
            if !self.estimated(pixel) {
                self.residual[pixel] = f32::NAN;
            }
        }
    }
}

/// Reads a tile's samples `(obs, band, pixel)` and coordinates in mm.
pub(super) struct Reader {
    pub(super) samples: Vec<f32>,
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
}

impl Reader {
    pub(super) fn new(scene: &Scene<'_>) -> Self {
        let planes = scene.bands * scene.rig.observations();
        Self {
            samples: vec![0.0; planes * pixels::TILE],
            x: vec![0.0; pixels::TILE],
            y: vec![0.0; pixels::TILE],
        }
    }

    pub(super) fn read(&mut self, scene: &Scene<'_>, start: usize) {
        for (plane, out) in self.samples.chunks_mut(pixels::TILE).enumerate() {
            scene.stack.read(plane / scene.bands, plane % scene.bands, start, out);
        }
        scene.rig.grid().coordinates(start, &mut self.x, &mut self.y);
    }
}
