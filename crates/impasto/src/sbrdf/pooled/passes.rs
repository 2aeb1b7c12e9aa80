//! Passes over the pixels, tile by tile; sums over tiles are taken in tile order.

use crate::error::Result;
use crate::pixels::{Run, check_room, tiles};

use super::descent::Stopping;
use super::extract::{Extract, Extraction, Sink, Tempered};
use super::histogram::Histogram;
use super::irls::Irls;
use super::lobe_equations::{Equate, LobeEquations, ScaleReference};
use super::outliers::{Limits, Sizes};
use super::pixel::CommonLobe;
use super::samples::{Begin, Photographs, Reader, Samples, State};
use super::scale::Gaussian;

/// Tiles that show how large samples are, about.
const SOME_TILES: usize = 16;

/// Tiles whose histograms wait to be summed: enough for any number of threads, 40 MiB.
const WAITING: usize = 256;

/// What all passes of a fit share.
#[derive(Clone, Copy)]
pub(super) struct Passes<'a> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) scale_reference: ScaleReference,
    pub(super) gaussian: Gaussian,
}

impl Passes<'_> {
    pub(super) fn with_noise_floor(self, noise_floor: f64) -> Self {
        let scale_reference = ScaleReference { noise_floor, ..self.scale_reference };
        Self { scale_reference, ..self }
    }

    /// The same passes over other photographs.
    pub(super) fn on<'a>(&'a self, photographs: &'a Photographs<'a>) -> Passes<'a> {
        Passes { photographs, ..*self }
    }

    /// The specular part of all samples, outliers tempered.
    pub(super) fn extract(&self, begin: Begin<'_>, extraction: Extraction) -> Result<Histogram> {
        let all = tiles(self.photographs.pixels());
        let some = all.iter().copied().step_by(all.len().div_ceil(SOME_TILES)).collect();
        let mut sizes = Sizes::new();
        for part in self.gather(begin, extraction, some, Sizes::new)? {
            sizes.merge(&part);
        }
        let limits: &Limits = &sizes.limits();
        let tempered = || Tempered { histogram: Histogram::default(), limits };
        let mut sum = Histogram::default();
        for places in all.chunks(WAITING) {
            for part in self.gather(begin, extraction, places.to_vec(), tempered)? {
                sum.merge(&part.histogram);
            }
        }
        Ok(sum)
    }

    /// The specular samples of some tiles, tile by tile.
    fn gather<S: Sink + Send>(
        &self,
        begin: Begin<'_>,
        extraction: Extraction,
        places: Vec<(usize, usize)>,
        sink: impl Fn() -> S + Sync,
    ) -> Result<Vec<S>> {
        let (photographs, run) = (self.photographs, self.run);
        let level = run.level;
        run.map(
            places,
            || Reader::new(photographs),
            |reader, (start, count)| {
                reader.read(photographs, begin, [start, count], level);
                let (tile, samples) = (&reader.tile(), &reader.samples);
                level.run(Extract { photographs, run, tile, samples, extraction, sink: sink() })
            },
        )
    }

    /// Iteratively reweighted least squares for all pixels of `from`, each of which is estimated,
    /// under one lobe.
    pub(super) fn irls(
        &self,
        from: &State,
        to: &mut State,
        lobe: CommonLobe,
        stopping: Stopping,
        restart: bool,
    ) -> Result<LobeEquations> {
        let Self { photographs, run, scale_reference, gaussian } = *self;
        let level = run.level;
        let jobs = tiles(photographs.pixels()).into_iter().zip(to.tiles_mut()).collect();
        let parts = run.map(
            jobs,
            || Samples::new(photographs),
            |samples, ((start, count), mut out)| {
                samples.read(photographs, [start, count], level);
                let tile = &from.tile(start, count);
                level.run(Irls {
                    photographs,
                    run,
                    tile,
                    out: &mut out,
                    samples,
                    lobe,
                    stopping,
                    restart,
                    noise_floor: scale_reference.noise_floor,
                    gaussian,
                });
                let (tile, scales) = (&out.tile(), &*out.scale);
                level.run(Equate { photographs, run, tile, scales, samples, lobe, scale_reference })
            },
        )?;
        let mut sum = LobeEquations::default();
        for part in &parts {
            sum.merge(part);
        }
        Ok(sum)
    }

    /// Sum over the bands of the diffuse colours.
    pub(super) fn brightness(&self, state: &State) -> Result<Vec<f32>> {
        check_room::<f32>(state.scale.len())?;
        let mut light = Vec::with_capacity(state.scale.len());
        self.run.in_turn(tiles(state.scale.len()), |(start, count)| {
            light.extend((start..start + count).map(|pixel| state.brightness(pixel)));
        })?;
        Ok(light)
    }
}
