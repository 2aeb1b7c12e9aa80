//! The state of all pixels, cut into tiles, and the samples of a tile.

use crate::error::Result;
use crate::geometry::Rig;
use crate::maps::Status;
use crate::math::{Isa, Kernel, Level, Mask, Real, Vec3};
use crate::pixels::{self, Run};
use crate::sbrdf::Start;
use crate::sbrdf::lanes::{load, store};
use crate::stack::Stack;

/// The samples with all that was known of them beforehand: what all tiles share.
#[derive(Clone, Copy)]
pub(super) struct Photographs<'a> {
    pub(super) stack: &'a Stack<'a>,
    pub(super) rig: &'a Rig,
    pub(super) index: f64,
    pub(super) bands: usize,
    /// `(y, x)` [`Status`] codes of the normals that the fit begins with.
    pub(super) status: &'a [u8],
    /// Coordinates of the pixels in mm; none: those of the rig's grid.
    pub(super) places: Option<(&'a [f32], &'a [f32])>,
}

impl Photographs<'_> {
    pub(super) fn pixels(&self) -> usize {
        self.stack.shape().pixels()
    }

    /// Coordinates of the pixels from `start` on, as many as there is room for.
    pub(super) fn coordinates(&self, start: usize, x: &mut [f32], y: &mut [f32]) {
        if let Some((all_x, all_y)) = self.places {
            let count = x.len().min(all_x.len() - start);
            x[..count].copy_from_slice(&all_x[start..start + count]);
            y[..count].copy_from_slice(&all_y[start..start + count]);
        } else {
            self.rig.grid().coordinates(start, x, y);
        }
    }
}

/// Where every pixel stands: its normal, its colours, and the squared scale of its residuals.
#[derive(Debug)]
pub(super) struct State {
    pub(super) normal: Vec<f32>,
    pub(super) diffuse: Vec<f32>,
    pub(super) scale: Vec<f32>,
}

impl State {
    pub(super) fn new(start: &Start<'_>, run: &Run<'_>) -> Result<Self> {
        Ok(Self {
            normal: run.copied(start.normal)?,
            diffuse: run.copied(start.diffuse)?,
            scale: run.filled(f32::NAN, start.status.len())?,
        })
    }

    pub(super) fn copied(&self, run: &Run<'_>) -> Result<Self> {
        Ok(Self {
            normal: run.copied(&self.normal)?,
            diffuse: run.copied(&self.diffuse)?,
            scale: run.copied(&self.scale)?,
        })
    }

    /// The part that one tile reads.
    pub(super) fn tile<'a>(&'a self, status: &'a [u8], start: usize) -> Tile<'a> {
        let pixels = status.len();
        let end = (start + pixels::TILE).min(pixels);
        let cut = |map: &'a [f32]| -> Vec<&'a [f32]> {
            map.chunks(pixels).map(|plane| &plane[start..end]).collect()
        };
        Tile {
            count: end - start,
            normal: cut(&self.normal),
            diffuse: cut(&self.diffuse),
            status: &status[start..end],
        }
    }

    /// The parts that all tiles write.
    pub(super) fn tiles_mut(&mut self) -> Vec<TileMut<'_>> {
        let pixels = self.scale.len();
        let normal = planes(&mut self.normal, pixels);
        let diffuse = planes(&mut self.diffuse, pixels);
        let scale = self.scale.chunks_mut(pixels::TILE);
        normal
            .into_iter()
            .zip(diffuse)
            .zip(scale)
            .map(|((normal, diffuse), scale)| TileMut { normal, diffuse, scale })
            .collect()
    }
}

/// The planes of a map, tile by tile.
pub(super) fn planes(map: &mut [f32], pixels: usize) -> Vec<Vec<&mut [f32]>> {
    let mut planes: Vec<_> = map.chunks_mut(pixels).map(|p| p.chunks_mut(pixels::TILE)).collect();
    (0..pixels::tiles(pixels).len())
        .map(|_| planes.iter_mut().filter_map(Iterator::next).collect())
        .collect()
}

/// A tile to read.
pub(super) struct Tile<'a> {
    pub(super) count: usize,
    pub(super) normal: Vec<&'a [f32]>,
    pub(super) diffuse: Vec<&'a [f32]>,
    pub(super) status: &'a [u8],
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
}

/// A tile to write.
pub(super) struct TileMut<'a> {
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) scale: &'a mut [f32],
}

impl TileMut<'_> {
    /// Writes the lanes of `fine`; the others keep what they had.
    #[inline(always)]
    pub(super) fn write<R: Real<Scalar = f32>>(
        &mut self,
        at: usize,
        normal: Vec3<R>,
        colours: &[R],
        scale: R,
        fine: R::Mask,
    ) {
        if !fine.any() {
            return;
        }
        let put = |plane: &mut [f32], value: R| {
            let old: R = load(plane, at);
            store(R::select(fine, value, old), plane, at);
        };
        for (plane, value) in self.normal.iter_mut().zip([normal.x, normal.y, normal.z]) {
            put(plane, value);
        }
        for (plane, &value) in self.diffuse.iter_mut().zip(colours) {
            put(plane, value);
        }
        put(self.scale, scale);
    }
}

/// Reads a tile's samples `(obs, band, pixel)` and coordinates in mm.
pub(super) struct Reader {
    pub(super) samples: Vec<f32>,
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
}

impl Reader {
    pub(super) fn new(photographs: &Photographs<'_>) -> Self {
        let planes = photographs.bands * photographs.rig.observations();
        Self {
            samples: vec![0.0; planes * pixels::TILE],
            x: vec![0.0; pixels::TILE],
            y: vec![0.0; pixels::TILE],
        }
    }

    /// Decodes the pixels from `start` on.
    pub(super) fn read(&mut self, photographs: &Photographs<'_>, start: usize, level: Level) {
        level.run(Decode { photographs, start, samples: &mut self.samples });
        photographs.coordinates(start, &mut self.x, &mut self.y);
    }
}

/// A kernel, for a product-sum outside of one is a call where not every processor of the target
/// has it.
struct Decode<'a> {
    photographs: &'a Photographs<'a>,
    start: usize,
    samples: &'a mut [f32],
}

impl Kernel for Decode<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let bands = self.photographs.bands;
        for (plane, out) in self.samples.chunks_mut(pixels::TILE).enumerate() {
            self.photographs.stack.read(plane / bands, plane % bands, self.start, out);
        }
    }
}
