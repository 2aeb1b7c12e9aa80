//! Passes over all pixels of a painting, tile by tile; sums over tiles are taken in tile order.

use crate::error::Result;
use crate::pixels::{Run, TILE, tiles};

use super::extract::{Extract, Extraction, Sink, Tempered};
use super::histogram::Histogram;
use super::irls::{Irls, LobeEquations, ScaleReference};
use super::measure::{Measure, Plates};
use super::outliers::{Limits, Sizes};
use super::pixel::Lobe;
use super::samples::{Photographs, Reader, State};
use super::scale::Gaussian;

/// Tiles that tell how large samples are, about.
const SOME_TILES: usize = 16;

/// Tiles whose histograms wait to be summed: enough for any number of threads, 40 MiB.
const WAITING: usize = 256;

/// A fit under way.
#[derive(Clone, Copy)]
pub(super) struct Fit<'a> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) scale_reference: ScaleReference,
}

impl Fit<'_> {
    pub(super) fn with_noise_floor(self, noise_floor: f64) -> Self {
        Self { scale_reference: ScaleReference { noise_floor, ..self.scale_reference }, ..self }
    }

    /// What is specular in all samples, gross ones tempered.
    pub(super) fn extract(&self, state: &State, extraction: Extraction) -> Result<Histogram> {
        let all = tiles(self.photographs.pixels());
        let some = all.iter().copied().step_by(all.len().div_ceil(SOME_TILES)).collect();
        let mut sizes = Sizes::new();
        for part in self.gather(state, extraction, some, Sizes::new)? {
            sizes.merge(&part);
        }
        let limits: &Limits = &sizes.limits();
        let tempered = || Tempered { histogram: Histogram::default(), limits };
        let mut sum = Histogram::default();
        for places in all.chunks(WAITING) {
            for part in self.gather(state, extraction, places.to_vec(), tempered)? {
                sum.merge(&part.histogram);
            }
        }
        Ok(sum)
    }

    /// The specular samples of some tiles, tile by tile.
    fn gather<S: Sink + Send>(
        &self,
        state: &State,
        extraction: Extraction,
        places: Vec<(usize, usize)>,
        sink: impl Fn() -> S + Sync,
    ) -> Result<Vec<S>> {
        let (photographs, run) = (self.photographs, self.run);
        let level = run.level;
        run.map(
            places,
            || Reader::new(photographs),
            |reader, (start, _)| {
                reader.read(photographs, start, level);
                let Reader { samples, x, y } = reader;
                let tile = &state.tile(photographs.status, start);
                let (stride, sink) = (TILE, sink());
                level.run(Extract {
                    photographs,
                    run,
                    tile,
                    samples,
                    stride,
                    x,
                    y,
                    extraction,
                    sink,
                })
            },
        )
    }

    /// Settles all pixels under a lobe.
    pub(super) fn settle(
        &self,
        from: &State,
        to: &mut State,
        lobe: Lobe,
        steps: usize,
        restart: bool,
    ) -> Result<LobeEquations> {
        let Self { photographs, run, scale_reference } = *self;
        let level = run.level;
        let jobs = tiles(photographs.pixels()).into_iter().zip(to.tiles_mut()).collect();
        let parts = run.map(
            jobs,
            || Reader::new(photographs),
            |reader, ((start, _), out)| {
                reader.read(photographs, start, level);
                let Reader { samples, x, y } = reader;
                let tile = &from.tile(photographs.status, start);
                let stride = TILE;
                level.run(Irls {
                    photographs,
                    run,
                    tile,
                    out,
                    samples,
                    stride,
                    x,
                    y,
                    lobe,
                    steps,
                    restart,
                    scale_reference,
                })
            },
        )?;
        let mut sum = LobeEquations::zero();
        for part in &parts {
            sum.merge(part);
        }
        Ok(sum)
    }

    /// Sum over the bands of the diffuse colours.
    pub(super) fn brightness(&self, state: &State) -> Result<Vec<f32>> {
        let pixels = self.photographs.pixels();
        let sum = |pixel: usize| state.diffuse[pixel..].iter().step_by(pixels).sum::<f32>();
        let mut light = Vec::with_capacity(pixels);
        self.run.in_turn(tiles(pixels), |(start, count)| {
            light.extend((start..start + count).map(sum));
        })?;
        Ok(light)
    }

    /// Residual, sigma, noise, what is apart, and the doubt about it.
    pub(super) fn measure(&self, state: &State, lobe: Lobe) -> Result<[Vec<f32>; 5]> {
        let (photographs, run) = (self.photographs, self.run);
        let level = run.level;
        let gaussian = Gaussian::of(photographs.bands);
        let mut maps = [(); 5].map(|()| vec![0.0; photographs.pixels()]);
        let mut plates = maps.each_mut().map(|map| map.chunks_mut(TILE));
        let jobs = tiles(photographs.pixels())
            .into_iter()
            .filter_map(|(start, _)| {
                let [residual, sigma, noise, apart, doubt] = plates.each_mut().map(Iterator::next);
                Some((
                    start,
                    Plates {
                        residual: residual?,
                        sigma: sigma?,
                        noise: noise?,
                        apart: apart?,
                        doubt: doubt?,
                    },
                ))
            })
            .collect();
        run.for_each(
            jobs,
            || Reader::new(photographs),
            |reader, (start, out)| {
                reader.read(photographs, start, level);
                let Reader { samples, x, y } = reader;
                let tile = &state.tile(photographs.status, start);
                let stride = TILE;
                level.run(Measure {
                    photographs,
                    run,
                    tile,
                    out,
                    samples,
                    stride,
                    x,
                    y,
                    lobe,
                    gaussian,
                });
            },
        )?;
        Ok(maps)
    }
}
