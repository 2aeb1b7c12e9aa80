//! The specular part of every sample: what the diffuse part does not explain.

use crate::brdf::lambert;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real};
use crate::pixels::Run;

use super::histogram::Histogram;
use super::outliers::{Limits, Sizes};
use super::samples::{Photographs, PooledTile, STRIDE, Samples};
use crate::math::lanes::MAX_LANES;
use crate::math::tail::load;

/// Which samples count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extraction {
    /// Every usable sample, by its residual against the diffuse fit. Samples darker than
    /// [`SHADOW`] of their diffuse part are shadows.
    Residual,
    /// The papers' "maximum minus diffuse": each pixel's brightest observation only.
    Maximum,
    /// The same, each divided by its geometry factor before the fit, that of eq. 1 and 9,
    /// `F G / (N.V)`: pixels whose highlight is weak by their geometry count as much as the others,
    /// with noise that is larger by as much.
    Papers,
    /// The same as eq. 10 and the text before eq. 6 print it, `(N.V) (N.L) / (F G)`: times a cosine
    /// of the light that eq. 1 and 9 do not have.
    Printed,
}

/// Share of its diffuse part below which a sample is a shadow (hard case 24).
const SHADOW: f64 = 0.5;

/// What becomes of the specular samples.
pub(super) trait Sink {
    /// Takes one: what is specular in it, the model's weight, its angle.
    fn take(&mut self, specular: f32, weight: f32, phi_squared: f32);
}

/// How large they are.
impl Sink for Sizes {
    fn take(&mut self, specular: f32, weight: f32, phi_squared: f32) {
        if weight > 0.0 {
            self.add(specular, phi_squared);
        }
    }
}

/// Sums, to which outliers contribute no more than other samples.
pub(super) struct Tempered<'a> {
    pub(super) histogram: Histogram,
    pub(super) limits: &'a Limits,
}

impl Sink for Tempered<'_> {
    fn take(&mut self, specular: f32, weight: f32, phi_squared: f32) {
        let share = self.limits.share(specular, phi_squared);
        self.histogram.add(specular * share, weight * share, phi_squared);
    }
}

pub(super) struct Extract<'a, 'b, 'c, S> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'c PooledTile<'b>,
    pub(super) samples: &'a Samples,
    pub(super) extraction: Extraction,
    pub(super) sink: S,
}

impl<S: Sink> Kernel for Extract<'_, '_, '_, S> {
    type Output = S;

    #[inline(always)]
    fn run<I: Isa>(self) -> S {
        let Self { photographs, run, tile, samples, extraction, mut sink } = self;
        let zero = I::F32::zero();
        let (bands, observations) = (photographs.bands, photographs.rig.observations());
        let share = I::F32::of(1.0 / bands as f64);
        let mut found = vec![[[0.0_f32; MAX_LANES]; 5]; observations];
        let mut at = 0;
        // A tile of hundreds of photographs takes long.
        while at < tile.count && !run.cancelled() {
            let normal = tile.normal_at::<I::F32>(at);
            let mut diffuse = zero;
            for plane in &tile.diffuse {
                diffuse = diffuse + load::<I::F32>(plane, at);
            }
            let diffuse = diffuse * share;
            for (i, found) in found.iter_mut().enumerate() {
                let (px, py) = (load(&samples.x, at), load::<I::F32>(&samples.y, at));
                let (towards, irradiance, facet) = photographs.pairs.at(i, px, py);
                let glint = facet.on(normal);
                let mut sample = zero;
                for band in 0..bands {
                    let plane = &samples.planes[(i * bands + band) * STRIDE..];
                    sample = sample + load::<I::F32>(plane, at);
                }
                let sample = sample * share;
                let cosine = lambert::cosine(normal, towards);
                let lambert = diffuse * photographs.diffuse(normal, towards, &facet) * irradiance;
                let lit = sample.is_finite() & sample.ge(lambert * I::F32::of(SHADOW));
                (sample - lambert).store(&mut found[0]);
                I::F32::keep(lit, glint.weight * irradiance).store(&mut found[1]);
                glint.phi_squared.store(&mut found[2]);
                sample.store(&mut found[3]);
                cosine.store(&mut found[4]);
            }
            for lane in 0..I::F32::WIDTH.min(tile.count - at) {
                let mut add = |f: &[[f32; MAX_LANES]; 5]| {
                    let [specular, weight, phi_squared, _, cosine] = f.each_ref().map(|f| f[lane]);
                    match extraction {
                        Extraction::Papers if weight > 0.0 => {
                            sink.take(specular / weight, 1.0, phi_squared);
                        }
                        Extraction::Printed if weight > 0.0 => {
                            sink.take(specular / weight * cosine, 1.0, phi_squared);
                        }
                        _ => sink.take(specular, weight, phi_squared),
                    }
                };
                match extraction {
                    Extraction::Residual => {
                        for found in &found {
                            add(found);
                        }
                    }
                    Extraction::Maximum | Extraction::Papers | Extraction::Printed => {
                        let brightest = found
                            .iter()
                            .filter(|found| found[1][lane] > 0.0)
                            .max_by(|a, b| a[3][lane].total_cmp(&b[3][lane]));
                        if let Some(brightest) = brightest {
                            add(brightest);
                        }
                    }
                }
            }
            at += I::F32::WIDTH;
        }
        sink
    }
}
