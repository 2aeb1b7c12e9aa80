//! The second half of the pooled fit: every pixel of a tile under a known lobe.

use crate::brdf::coated_diffuse::CoatedDiffuse;
use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::maps::Status;
use crate::pixels::{Run, TILE, tiles};
use crate::sbrdf::Start;
use crate::sbrdf::neighbouring_lights::NeighbouringLights;
use crate::stack::{Decode, Stack};
use crate::surface::{Pairs, TorranceSparrow};

use super::descent::Stopping;
use super::irls::Irls;
use super::joint::FIRST_STEPS;
use super::learned::PooledLobe;
use super::lobe_equations::{Cost, ScaleReference};
use super::maps::{PooledMapsMut, PooledMapsTile};
use super::measure::{Measure, Measured};
use super::outliers::CLASSES;
use super::passes::Passes;
use super::pixel::CommonLobe;
use super::samples::{Begin, Photographs, Reader, State};
use super::scale::Gaussian;
use super::verdict::{Strength, Strengths};

/// Where a pixel's path ends. The squared distance from the minimum in standard deviations is about the
/// number of samples times the share by which the squared scale is still to fall. Where steps shrink to a
/// third from one to the next, an eighth of the last fall is left: with 144 samples a twentieth of a deviation.
pub(super) const APPLIED: Stopping = Stopping { steps: FIRST_STEPS, tolerance: 1e-4 };

/// What a search that stopped early may have left of the squared scale.
const LEFT: f32 = 1.001;

/// Fits the normals and colours of a tile under the painting's lobe, and measures their errors.
///
/// Each pixel depends on its own samples, its place in the painting (the rig's
/// [`Grid`](crate::geometry::Grid)) and `lobe` only: a tile's maps are, to the bit, those of the
/// whole.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn apply(
    lobe: &PooledLobe,
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    out: &mut PooledMapsMut<'_>,
    run: &Run<'_>,
) -> Result<()> {
    check(stack, rig, start, out)?;
    if lobe.noise.len() != CLASSES {
        let problem = format!("{} classes of brightness, expected {CLASSES}", lobe.noise.len());
        return Err(Error::argument("noise", problem));
    }
    let unit = unit_of(lobe.brightness);
    let decode = in_unit(stack, unit);
    let stack = &stack.decoded(&decode)?;
    let pairs = &Pairs::of_rig(TorranceSparrow { index: lobe.index }, rig);
    let photographs = &photographs(stack, rig, start, pairs, lobe.coated);
    let brightness = lobe.brightness / f64::from(unit);
    let scale_reference = ScaleReference { brightness, noise_floor: lobe.noise_floor };
    let application = Application {
        passes: Passes {
            photographs,
            run,
            scale_reference,
            gaussian: Gaussian::of(photographs.bands),
        },
        begin: begin(start, unit),
        lobe: CommonLobe { beta: lobe.beta / f64::from(unit), log_sharpness: lobe.log_sharpness },
        refined: lobe.refined,
        unit,
    };
    let beta = application.lobe.beta as f32;
    run.for_each(
        tiles(photographs.pixels()).into_iter().zip(out.tiles()).collect(),
        || PooledScratch::new(photographs),
        |scratch, (tile, mut out)| {
            application
                .tile(scratch, tile, &mut out, |_, strength| strength.misfit(beta, &lobe.noise).0);
        },
    )
}

/// Exponents of two that a painting's bright colours may have without another unit.
const NEAR_ONE: core::ops::RangeInclusive<i32> = -16..=16;

/// The unit that samples are counted in: 1 unless squares and fourth powers of bright colours come
/// near the ends of single precision; then the power of two below them, which changes no digit.
pub(super) fn unit_of(brightness: f64) -> f32 {
    let exponent = brightness.log2().floor() as i32;
    if NEAR_ONE.contains(&exponent) { 1.0 } else { 2.0_f32.powi(exponent.clamp(-100, 100)) }
}

/// How stored numbers become samples in a unit.
pub(super) fn in_unit(stack: &Stack<'_>, unit: f32) -> Vec<Decode> {
    stack.decode().iter().map(|decode| decode.times(unit.recip())).collect()
}

/// The maps of the start in a unit.
pub(super) fn begin<'a>(start: &Start<'a>, unit: f32) -> Begin<'a> {
    Begin { normal: start.normal, diffuse: start.diffuse, factor: unit.recip() }
}

pub(super) fn photographs<'a>(
    stack: &'a Stack<'a>,
    rig: &'a Rig,
    start: &Start<'a>,
    pairs: &'a Pairs<TorranceSparrow, f32>,
    coated: bool,
) -> Photographs<'a> {
    let bands = stack.shape().bands;
    let coated = coated.then(|| CoatedDiffuse::new(pairs.model.index));
    Photographs { stack, rig, pairs, bands, coated, status: start.status, places: None }
}

pub(super) fn check(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    out: &PooledMapsMut<'_>,
) -> Result<()> {
    let shape = stack.shape();
    if rig.observations() != shape.observations {
        let problem =
            format!("{} lights for {} photographs", rig.observations(), shape.observations);
        return Err(Error::geometry("lights", problem));
    }
    start.check(shape.pixels(), shape.bands)?;
    out.check(shape.pixels(), shape.bands)
}

/// A lobe that is applied, in the unit of the samples.
pub(super) struct Application<'a> {
    pub(super) passes: Passes<'a>,
    pub(super) begin: Begin<'a>,
    pub(super) lobe: CommonLobe,
    pub(super) refined: bool,
    pub(super) unit: f32,
}

/// Memory of one worker.
pub(super) struct PooledScratch {
    reader: Reader,
    state: State,
    /// Squared scales without a lobe.
    plain: Vec<f32>,
    /// Normals and colours without a lobe.
    matte: State,
    measured: Measured,
    neighbours: NeighbouringLights,
}

impl PooledScratch {
    pub(super) fn new(photographs: &Photographs<'_>) -> Self {
        Self {
            reader: Reader::new(photographs),
            state: State::sized(TILE, photographs.bands),
            plain: vec![0.0; TILE],
            matte: State::sized(TILE, photographs.bands),
            measured: Measured::default(),
            neighbours: NeighbouringLights::new(photographs.rig),
        }
    }
}

impl Application<'_> {
    /// Fills the maps of all pixels but `misfit`, and the strengths of single pixels; returns the
    /// cost without and with the lobe, if pixels are refined.
    pub(super) fn whole(
        &self,
        out: &mut PooledMapsMut<'_>,
        strengths: &mut Strengths,
    ) -> Result<[Cost; 2]> {
        let photographs = self.passes.photographs;
        let jobs = tiles(photographs.pixels()).into_iter().zip(out.tiles()).zip(strengths.tiles());
        let parts = self.passes.run.map(
            jobs.collect(),
            || PooledScratch::new(photographs),
            |scratch, ((tile, mut out), strengths)| {
                strengths.fill(Strength::UNKNOWN);
                self.tile(scratch, tile, &mut out, |pixel, strength| {
                    strengths[pixel] = strength;
                    f32::NAN
                })
            },
        )?;
        let mut sums = [Cost::default(); 2];
        for part in &parts {
            for (sum, part) in sums.iter_mut().zip(part) {
                sum.merge(*part);
            }
        }
        Ok(sums)
    }

    /// Fills the maps of one tile; `misfit` is called with every estimated pixel and its strength.
    fn tile(
        &self,
        scratch: &mut PooledScratch,
        (start, count): (usize, usize),
        out: &mut PooledMapsTile<'_>,
        mut misfit: impl FnMut(usize, Strength) -> f32,
    ) -> [Cost; 2] {
        let Passes { photographs, run, scale_reference, gaussian } = self.passes;
        let PooledScratch { reader, state, plain, matte, measured, neighbours } = scratch;
        reader.read(photographs, self.begin, [start, count], run.level);
        out.begin(self.begin, &photographs.status[start..start + count], start);
        state.copy_from(&reader.begin);
        let mut costs = [Cost::default(); 2];
        if self.refined {
            let flat = CommonLobe { beta: 0.0, ..self.lobe };
            self.irls(reader, state, flat, false);
            plain.copy_from_slice(&state.scale);
            matte.copy_from(state);
            self.irls(reader, state, self.lobe, true);
        }
        let samples = &reader.samples;
        for (place, &pixel) in samples.picks.iter().enumerate().filter(|_| self.refined) {
            if state.scale[place] <= plain[place] * LEFT {
                continue;
            }
            // The lobe does not help to explain the pixel's samples.
            // Photometric stereo knows no interface.
            let without = if photographs.coated.is_some() { &*matte } else { &reader.begin };
            state.copy_pixel(place, without);
            if out.status[pixel] == Status::Fitted.code() {
                out.status[pixel] = Status::Pooled.code();
            }
        }
        measured.resize(samples.picks.len());
        let tile = &state.tile(0, samples.picks.len());
        let lobe = self.lobe;
        run.level.run(Measure {
            photographs,
            run,
            tile,
            out: measured,
            samples,
            lobe,
            gaussian,
            neighbours,
        });
        for (place, &pixel) in samples.picks.iter().enumerate() {
            let used = f64::from(measured.used[place]);
            for (sum, scales) in costs.iter_mut().zip([&*plain, &state.scale]) {
                let scale = f64::from(scales[place]);
                if let Some(cost) = Cost::of(scale, used, photographs.bands, scale_reference) {
                    sum.merge(cost);
                }
            }
            let residual = measured.residual[place];
            // Too few of the samples have finite squares: the pixel has no residual.
            if !residual.is_finite() && out.status[pixel] != Status::Exact.code() {
                out.give_up(pixel);
                continue;
            }
            for (map, plane) in out.normal.iter_mut().zip(&tile.normal) {
                map[pixel] = plane[place];
            }
            for (map, plane) in out.diffuse.iter_mut().zip(&tile.diffuse) {
                map[pixel] = plane[place] * self.unit;
            }
            out.residual[pixel] = residual * self.unit;
            out.sigma[pixel] = measured.sigma[place];
            let strength = Strength {
                brightness: state.brightness(place),
                noise: measured.noise[place],
                apart: measured.apart[place],
                doubt: measured.doubt[place],
            };
            out.misfit[pixel] = misfit(pixel, strength);
        }
        costs
    }

    /// Every estimated pixel of a tile from where it begins.
    fn irls(&self, reader: &Reader, state: &mut State, lobe: CommonLobe, restart: bool) {
        let Passes { photographs, run, scale_reference, gaussian } = self.passes;
        run.level.run(Irls {
            photographs,
            run,
            tile: &reader.tile(),
            out: &mut state.first_mut(reader.samples.picks.len()),
            samples: &reader.samples,
            lobe,
            stopping: APPLIED,
            restart,
            noise_floor: scale_reference.noise_floor,
            gaussian,
        });
    }
}

impl PooledMapsTile<'_> {
    /// What every map holds where nothing is estimated.
    fn begin(&mut self, begin: Begin<'_>, status: &[u8], start: usize) {
        let count = status.len();
        self.status.copy_from_slice(status);
        let maps = [(&mut self.normal, begin.normal), (&mut self.diffuse, begin.diffuse)];
        for (planes, from) in maps {
            let pixels = from.len() / planes.len();
            for (plane, from) in planes.iter_mut().zip(from.chunks(pixels)) {
                plane.copy_from_slice(&from[start..start + count]);
            }
        }
        for map in [&mut *self.residual, &mut *self.sigma, &mut *self.misfit] {
            map.fill(f32::NAN);
        }
    }

    fn give_up(&mut self, pixel: usize) {
        self.status[pixel] = Status::InvalidInput.code();
        for plane in self.normal.iter_mut().chain(&mut self.diffuse) {
            plane[pixel] = f32::NAN;
        }
    }
}
