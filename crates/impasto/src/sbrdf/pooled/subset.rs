//! A random subset of the pixels, large enough to find the lobe.
//!
//! Sixty thousand pixels determine beta and gamma to a thousandth. A search therefore visits a
//! subset, gathered and decoded once. If the painting has fewer pixels than the subset may have, the
//! subset is all of them.

use crate::error::Result;
use crate::math::Kernel;
use crate::math::lanes::Isa;
use crate::pixels::{Run, TILE, tiles, zeros};
use crate::stack::{Decode, Samples, Shape, Stack};

use super::samples::{Begin, Photographs};

/// Samples at most, about: a quarter of a gibibyte. Many photographs of fewer pixels determine the
/// lobe as well.
const SAMPLES: usize = 1 << 26;

/// Neighbours that are taken or left together: they share cache lines in every photograph.
const RUN: usize = 16;

/// Some pixels of a painting as a painting of one row.
pub(super) struct Subset {
    samples: Vec<f32>,
    shape: Shape,
    decode: Vec<Decode>,
    x: Vec<f32>,
    y: Vec<f32>,
    normal: Vec<f32>,
    diffuse: Vec<f32>,
    status: Vec<u8>,
}

impl Subset {
    /// Gathers about `most` of `all` pixels whose normals were estimated.
    pub(super) fn gather(
        photographs: &Photographs<'_>,
        begin: Begin<'_>,
        most: usize,
        all: usize,
        run: &Run<'_>,
    ) -> Result<Self> {
        let picks = pick(photographs, most, all, run)?;
        let shape = Shape { height: 1, width: picks.len(), ..photographs.stack.shape() };
        let mut samples = zeros(shape.samples())?;
        let planes = samples.chunks_mut(picks.len().max(1)).enumerate().collect();
        run.for_each(
            planes,
            || vec![0.0; TILE],
            |row, (plane, out)| {
                let mut next = 0;
                for (first, count) in tiles(photographs.pixels()) {
                    if run.cancelled() {
                        return;
                    }
                    run.level.run(DecodeRow { photographs, plane, first, row });
                    while let Some(&pixel) = picks.get(next)
                        && pixel < first + count
                    {
                        out[next] = row[pixel - first];
                        next += 1;
                    }
                }
            },
        )?;
        let (mut x, mut y) = (vec![0.0; picks.len()], vec![0.0; picks.len()]);
        for ((x, y), &pixel) in x.iter_mut().zip(&mut y).zip(&picks) {
            photographs.coordinates(pixel, core::slice::from_mut(x), core::slice::from_mut(y));
        }
        let gathered = |map: &[f32], factor: f32| -> Vec<f32> {
            map.chunks(photographs.pixels())
                .flat_map(|plane| picks.iter().map(|&pixel| plane[pixel] * factor))
                .collect()
        };
        let plain = Decode { gain: 1.0, offset: 0.0, saturation: f32::INFINITY };
        Ok(Self {
            samples,
            decode: vec![plain; shape.observations * shape.bands],
            shape,
            x,
            y,
            normal: gathered(begin.normal, 1.0),
            diffuse: gathered(begin.diffuse, begin.factor),
            status: picks.iter().map(|&pixel| photographs.status[pixel]).collect(),
        })
    }

    pub(super) fn len(&self) -> usize {
        self.status.len()
    }

    pub(super) fn begin(&self) -> Begin<'_> {
        Begin { normal: &self.normal, diffuse: &self.diffuse, factor: 1.0 }
    }

    pub(super) fn stack(&self) -> Result<Stack<'_>> {
        Stack::new(Samples::F32(&self.samples), self.shape, &self.decode, None)
    }

    /// The painting's photographs, of this subset's pixels.
    pub(super) fn photographs<'a>(
        &'a self,
        whole: &Photographs<'a>,
        stack: &'a Stack<'a>,
    ) -> Photographs<'a> {
        Photographs { stack, status: &self.status, places: Some((&self.x, &self.y)), ..*whole }
    }
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct DecodeRow<'a> {
    photographs: &'a Photographs<'a>,
    /// A photograph and band.
    plane: usize,
    first: usize,
    row: &'a mut [f32],
}

impl Kernel for DecodeRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { photographs: Photographs { stack, bands, .. }, plane, first, row } = self;
        stack.read(plane / bands, plane % bands, first, row);
    }
}

/// How many pixels have normals that were estimated.
pub(super) fn estimated_pixels(photographs: &Photographs<'_>, run: &Run<'_>) -> Result<usize> {
    let mut all = 0;
    run.in_turn(tiles(photographs.pixels()), |(start, count)| {
        all += (start..start + count).filter(|&pixel| photographs.estimated(pixel)).count();
    })?;
    Ok(all)
}

/// Pixels in the order of the image: all, or runs of neighbours chosen by a hash of their number
/// (a fixed stride could follow the weave of a canvas). Fewer of them are among more.
fn pick(
    photographs: &Photographs<'_>,
    most: usize,
    all: usize,
    run: &Run<'_>,
) -> Result<Vec<usize>> {
    let estimated = |&pixel: &usize| photographs.estimated(pixel);
    let tiles = tiles(photographs.pixels());
    let planes = photographs.bands * photographs.rig.observations();
    let most = most.min(SAMPLES / planes.max(1)).max(RUN);
    let share = most as f64 / all.max(1) as f64;
    let threshold = if share >= 1.0 { u64::MAX } else { (share * u64::MAX as f64) as u64 };
    let mut picks = Vec::new();
    run.in_turn(&tiles, |&(start, count)| {
        let chosen = (start..start + count).filter(|pixel| hash((pixel / RUN) as u64) <= threshold);
        picks.extend(chosen.filter(estimated));
    })?;
    Ok(picks)
}

/// `splitmix64`: consecutive numbers become unrelated ones.
fn hash(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
