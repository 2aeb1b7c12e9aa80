//! The samples of a tile's estimated pixels, and where every pixel of a search stands.

use crate::brdf::coated_diffuse::CoatedDiffuse;
use crate::brdf::lambert;
use crate::brdf::torrance_sparrow::Facet;
use crate::error::Result;
use crate::geometry::Rig;
use crate::maps::Status;
use crate::math::tail::load;
use crate::math::{Isa, Kernel, Level, Real, Vec3};
use crate::pixels::{self, Run, TILE};
use crate::stack::Stack;
use crate::surface::{Pairs, TorranceSparrow};

/// Samples from one plane to the next.
pub(super) const STRIDE: usize = pixels::stride(TILE);

/// What all tiles of a painting share.
#[derive(Clone, Copy)]
pub(super) struct Photographs<'a> {
    pub(super) stack: &'a Stack<'a>,
    pub(super) rig: &'a Rig,
    pub(super) pairs: &'a Pairs<TorranceSparrow, f32>,
    pub(super) bands: usize,
    /// The smooth interface that diffuse light crosses.
    pub(super) coated: Option<CoatedDiffuse>,
    /// `(y, x)` [`Status`] codes of the normals that the fit begins with. Only pixels whose normal
    /// was estimated are read: a pass over a segment costs what the segment's pixels cost.
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

    /// The same without an interface above the diffuse part.
    pub(super) fn bare(&self) -> Self {
        Self { coated: None, ..*self }
    }

    /// The diffuse term of reflectance 1 under unit irradiance, 0 where the surface turns away.
    #[inline(always)]
    pub(super) fn diffuse<R: Real>(
        &self,
        normal: Vec3<R>,
        towards: Vec3<R>,
        facet: &Facet<R>,
    ) -> R {
        match &self.coated {
            None => lambert::cosine(normal, towards),
            Some(coated) => coated.value(normal, towards, facet.view()),
        }
    }

    /// Its derivative by the normal, where the surface does not turn away.
    #[inline(always)]
    pub(super) fn diffuse_slope<R: Real>(
        &self,
        normal: Vec3<R>,
        towards: Vec3<R>,
        facet: &Facet<R>,
    ) -> Vec3<R> {
        match &self.coated {
            None => towards,
            Some(coated) => coated.slope(normal, towards, facet.view()).normal,
        }
    }

    pub(super) fn estimated(&self, pixel: usize) -> bool {
        self.status[pixel] < Status::Dark.code()
    }
}

/// Normals and colours that a pass begins with.
#[derive(Clone, Copy)]
pub(super) struct Begin<'a> {
    /// `(3, y, x)`.
    pub(super) normal: &'a [f32],
    /// `(band, y, x)`.
    pub(super) diffuse: &'a [f32],
    /// What colours are multiplied by: a power of two.
    pub(super) factor: f32,
}

/// Normal, colours, and squared scale of the residuals of every pixel.
#[derive(Debug)]
pub(super) struct State {
    /// `(3, pixel)`.
    pub(super) normal: Vec<f32>,
    /// `(band, pixel)`.
    pub(super) diffuse: Vec<f32>,
    pub(super) scale: Vec<f32>,
}

impl State {
    /// Room for so many pixels.
    pub(super) fn sized(pixels: usize, bands: usize) -> Self {
        Self {
            normal: vec![0.0; 3 * pixels],
            diffuse: vec![0.0; bands * pixels],
            scale: vec![f32::NAN; pixels],
        }
    }

    pub(super) fn new(begin: Begin<'_>, pixels: usize, run: &Run<'_>) -> Result<Self> {
        let mut state = Self {
            normal: run.copied(begin.normal)?,
            diffuse: run.copied(begin.diffuse)?,
            scale: run.filled(f32::NAN, pixels)?,
        };
        run.in_turn(state.diffuse.chunks_mut(TILE), |part| {
            for value in part {
                *value *= begin.factor;
            }
        })?;
        Ok(state)
    }

    pub(super) fn copied(&self, run: &Run<'_>) -> Result<Self> {
        Ok(Self {
            normal: run.copied(&self.normal)?,
            diffuse: run.copied(&self.diffuse)?,
            scale: run.copied(&self.scale)?,
        })
    }

    /// Sum over the bands of a pixel's colours.
    pub(super) fn brightness(&self, pixel: usize) -> f32 {
        self.diffuse[pixel..].iter().step_by(self.scale.len()).sum()
    }

    /// The same numbers, in the same memory.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.normal.copy_from_slice(&other.normal);
        self.diffuse.copy_from_slice(&other.diffuse);
        self.scale.copy_from_slice(&other.scale);
    }

    /// Normal and colours of one pixel.
    pub(super) fn copy_pixel(&mut self, pixel: usize, other: &Self) {
        let pixels = self.scale.len();
        let maps = [(&mut self.normal, &other.normal), (&mut self.diffuse, &other.diffuse)];
        for (own, other) in maps {
            for place in (pixel..own.len()).step_by(pixels) {
                own[place] = other[place];
            }
        }
    }

    /// `count` pixels from `start` on, to read.
    pub(super) fn tile<'a>(&'a self, start: usize, count: usize) -> PooledTile<'a> {
        let pixels = self.scale.len();
        let cut = |map: &'a [f32]| -> Vec<&'a [f32]> {
            map.chunks(pixels).map(|plane| &plane[start..start + count]).collect()
        };
        PooledTile { count, normal: cut(&self.normal), diffuse: cut(&self.diffuse) }
    }

    /// The first `count` pixels, to write.
    pub(super) fn first_mut(&mut self, count: usize) -> TileMut<'_> {
        let pixels = self.scale.len();
        TileMut {
            normal: firsts(&mut self.normal, pixels, count),
            diffuse: firsts(&mut self.diffuse, pixels, count),
            scale: &mut self.scale[..count],
        }
    }

    /// The parts that all tiles write.
    pub(super) fn tiles_mut(&mut self) -> Vec<TileMut<'_>> {
        let pixels = self.scale.len();
        let normal = planes(&mut self.normal, pixels);
        let diffuse = planes(&mut self.diffuse, pixels);
        let scale = self.scale.chunks_mut(TILE);
        normal
            .into_iter()
            .zip(diffuse)
            .zip(scale)
            .map(|((normal, diffuse), scale)| TileMut { normal, diffuse, scale })
            .collect()
    }
}

/// The first `count` pixels of every plane.
fn firsts(map: &mut [f32], pixels: usize, count: usize) -> Vec<&mut [f32]> {
    map.chunks_mut(pixels).map(|plane| &mut plane[..count]).collect()
}

/// The planes of a map, tile by tile.
pub(super) fn planes<T>(map: &mut [T], pixels: usize) -> Vec<Vec<&mut [T]>> {
    let mut planes: Vec<_> =
        map.chunks_mut(pixels.max(1)).map(|plane| plane.chunks_mut(TILE)).collect();
    (0..pixels::tiles(pixels).len())
        .map(|_| planes.iter_mut().filter_map(Iterator::next).collect())
        .collect()
}

/// A tile to read.
pub(super) struct PooledTile<'a> {
    pub(super) count: usize,
    pub(super) normal: Vec<&'a [f32]>,
    pub(super) diffuse: Vec<&'a [f32]>,
}

impl PooledTile<'_> {
    #[inline(always)]
    pub(super) fn normal_at<R: Real<Scalar = f32>>(&self, at: usize) -> Vec3<R> {
        Vec3::new(load(self.normal[0], at), load(self.normal[1], at), load(self.normal[2], at))
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn colours_at<R: Real<Scalar = f32>>(&self, at: usize, colours: &mut [R]) {
        for band in 0..colours.len() {
            colours[band] = load(self.diffuse[band], at);
        }
    }
}

/// A tile to write.
pub(super) struct TileMut<'a> {
    pub(super) normal: Vec<&'a mut [f32]>,
    pub(super) diffuse: Vec<&'a mut [f32]>,
    pub(super) scale: &'a mut [f32],
}

impl TileMut<'_> {
    /// To read what was written.
    pub(super) fn tile(&self) -> PooledTile<'_> {
        PooledTile {
            count: self.scale.len(),
            normal: self.normal.iter().map(|plane| &**plane).collect(),
            diffuse: self.diffuse.iter().map(|plane| &**plane).collect(),
        }
    }
}

/// The samples of a tile's estimated pixels, side by side.
pub(super) struct Samples {
    /// `(obs, band, pixel)`, [`STRIDE`] apart.
    pub(super) planes: Vec<f32>,
    /// Coordinates in mm.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    /// Which pixels of the tile these are.
    pub(super) picks: Vec<usize>,
}

/// Planes of samples, and where their pixels lie, to load registers from.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a> {
    /// `(obs, band, pixel)`, `stride` apart.
    pub(super) planes: &'a [f32],
    pub(super) stride: usize,
    /// Coordinates in mm.
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
}

/// Reads tiles.
pub(super) struct Reader {
    pub(super) samples: Samples,
    /// What the pass begins with, of the same pixels.
    pub(super) begin: State,
}

impl Reader {
    pub(super) fn new(photographs: &Photographs<'_>) -> Self {
        let begin = State::sized(TILE, photographs.bands);
        Self { samples: Samples::new(photographs), begin }
    }

    /// Decodes the estimated pixels of the `count` from `start` on, and takes what they begin with.
    pub(super) fn read(
        &mut self,
        photographs: &Photographs<'_>,
        begin: Begin<'_>,
        [start, count]: [usize; 2],
        level: Level,
    ) {
        let Self { samples, begin: own } = self;
        samples.read(photographs, [start, count], level);
        let pixels = photographs.pixels();
        let gather = |to: &mut [f32], from: &[f32], factor: f32| {
            for (to, from) in to.chunks_mut(TILE).zip(from.chunks(pixels)) {
                for (to, &pixel) in to.iter_mut().zip(&samples.picks) {
                    *to = from[start + pixel] * factor;
                }
            }
        };
        gather(&mut own.normal, begin.normal, 1.0);
        gather(&mut own.diffuse, begin.diffuse, begin.factor);
        own.scale.fill(f32::NAN);
    }

    /// What the pass begins with.
    pub(super) fn tile(&self) -> PooledTile<'_> {
        self.begin.tile(0, self.samples.picks.len())
    }
}

impl Samples {
    pub(super) fn new(photographs: &Photographs<'_>) -> Self {
        let planes = photographs.bands * photographs.rig.observations();
        Self {
            planes: vec![0.0; planes * STRIDE],
            x: vec![0.0; TILE],
            y: vec![0.0; TILE],
            picks: Vec::with_capacity(TILE),
        }
    }

    pub(super) fn rows(&self) -> Rows<'_> {
        Rows { planes: &self.planes, stride: STRIDE, x: &self.x, y: &self.y }
    }

    /// Decodes the estimated pixels of the `count` from `start` on.
    pub(super) fn read(
        &mut self,
        photographs: &Photographs<'_>,
        [start, count]: [usize; 2],
        level: Level,
    ) {
        self.picks.clear();
        self.picks.extend((0..count).filter(|pixel| photographs.estimated(start + pixel)));
        if self.picks.is_empty() {
            return;
        }
        level.run(DecodeTile { photographs, start, planes: &mut self.planes });
        photographs.coordinates(start, &mut self.x, &mut self.y);
        if self.picks.len() == count {
            return;
        }
        let rows = self.planes.chunks_mut(STRIDE).chain([&mut self.x[..], &mut self.y[..]]);
        for row in rows {
            for (place, &pixel) in self.picks.iter().enumerate() {
                row[place] = row[pixel];
            }
        }
    }
}

/// A kernel, for a product-sum outside of one is a call where not every processor of the target
/// has it.
struct DecodeTile<'a> {
    photographs: &'a Photographs<'a>,
    start: usize,
    planes: &'a mut [f32],
}

impl Kernel for DecodeTile<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let bands = self.photographs.bands;
        for (plane, out) in self.planes.chunks_mut(STRIDE).enumerate() {
            let out = &mut out[..TILE];
            self.photographs.stack.read(plane / bands, plane % bands, self.start, out);
        }
    }
}
