//! Samples that a surface would show: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper,
//! eq. 3 of the third.

use crate::brdf::lambert;
use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::math::lanes::Isa;
use crate::math::tail::{load, store};
use crate::math::{Kernel, Real, Vec3};
use crate::pixels::{Run, TILE, tiles};

use super::lobe::{Strength, scaled};
use super::lobe_model::LobeModel;
use super::maps::Surface;
use super::model::ModelVisitor;
use super::pairs::Pairs;

/// Writes the samples `(obs, band, y, x)` that a surface shows, white board 1.0: per light
/// `intensity * (irradiance * ((N.L) S + sum over lobes of their strength times what the model
/// says) + ambient)`, with `(N.L)` times what an interface transmits where the diffuse part is
/// [`coated`](Surface::coated); 0 where the surface turns away from the light, without lobes where it turns
/// away from the view, NaN where the normal or the diffuse reflectance is. Nothing is infinite: a
/// sum in the parentheses, or a sample, that single precision does not hold is its largest number.
///
/// # Errors
/// If a map's size does not fit the rig's grid, or the run is cancelled.
pub fn predict(
    surface: &Surface<'_>,
    rig: &Rig,
    intensities: &[f64],
    out: &mut [f32],
    run: &Run<'_>,
) -> Result<()> {
    let grid = rig.grid();
    let pixels = grid.width * grid.height;
    let observations = rig.observations();
    let bands = surface.bands(pixels)?;
    let sizes = [
        ("intensities", intensities.len() == observations),
        ("out", out.len() == observations * bands * pixels),
    ];
    if let Some((name, _)) = sizes.iter().find(|(_, fits)| !fits) {
        let problem = format!(
            "its size does not fit {} x {} pixels, {bands} bands and {observations} lights",
            grid.height, grid.width
        );
        return Err(Error::argument(name, problem));
    }
    surface.model.visit(Prediction { surface, rig, intensities, bands, out, run })
}

/// A call of [`predict`] whose sizes are right.
struct Prediction<'a, 'r> {
    surface: &'a Surface<'a>,
    rig: &'a Rig,
    intensities: &'a [f64],
    bands: usize,
    out: &'a mut [f32],
    run: &'a Run<'r>,
}

impl ModelVisitor for Prediction<'_, '_> {
    type Output = Result<()>;

    fn visit<M: LobeModel>(self, model: M) -> Result<()> {
        let Self { surface, rig, intensities, bands, out, run } = self;
        let (grid, level) = (rig.grid(), run.level);
        let pixels = grid.width * grid.height;
        let pairs = Pairs::of_rig(model, rig);
        run.for_each(
            jobs(out, bands, pixels),
            || (vec![0.0; TILE], vec![0.0; TILE]),
            |(x, y), job| {
                if !pairs.is_distant(job.observation) {
                    grid.coordinates(job.start, &mut x[..job.count], &mut y[..job.count]);
                }
                let intensity = intensities[job.observation] as f32;
                level.run(Predict { surface, pairs: &pairs, pixels, intensity, x, y, job });
            },
        )
    }
}

/// One tile of one observation.
struct Job<'a> {
    observation: usize,
    start: usize,
    count: usize,
    /// The tile in every band.
    out: Vec<&'a mut [f32]>,
}

/// Observations that show a tile one after another, so that the maps of the surface are read from the
/// cache. More of them have too many new pages at a time, which the system fills with zeros.
const TOGETHER: usize = 4;

/// Cuts `(obs, band, y, x)` into tiles of observations.
fn jobs(out: &mut [f32], bands: usize, pixels: usize) -> Vec<Job<'_>> {
    let mut jobs = Vec::new();
    for (group, planes) in out.chunks_mut(TOGETHER * bands * pixels).enumerate() {
        let mut planes: Vec<_> = planes.chunks_mut(pixels).map(|p| p.chunks_mut(TILE)).collect();
        for (start, count) in tiles(pixels) {
            for (one, planes) in planes.chunks_mut(bands).enumerate() {
                let out = planes.iter_mut().filter_map(Iterator::next).collect();
                jobs.push(Job { observation: group * TOGETHER + one, start, count, out });
            }
        }
    }
    jobs
}

struct Predict<'a, 'b, M: LobeModel> {
    surface: &'a Surface<'a>,
    pairs: &'a Pairs<M>,
    pixels: usize,
    intensity: f32,
    x: &'a [f32],
    y: &'a [f32],
    job: Job<'b>,
}

impl<M: LobeModel> Kernel for Predict<'_, '_, M> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { surface, pairs, pixels, intensity, x, y, mut job } = self;
        let zero = I::F32::zero();
        let (start, count, bands) = (job.start, job.count, job.out.len());
        let tile = |map, planes| tile_of(map, planes, pixels, start, count);
        let (normals, colours) = (tile(surface.normal, 3), tile(surface.diffuse, bands));
        let ambient = surface.ambient.map(|map| tile(map, bands));
        let mut values = vec![zero; surface.lobes.len()];
        let tinted: Vec<_> = (surface.lobes.iter().enumerate())
            .filter_map(|(lobe, of)| match of.strength {
                Strength::Tinted(map) => Some((lobe, tile(map, bands))),
                Strength::Neutral(_) => None,
            })
            .collect();
        let near = !pairs.is_distant(job.observation);
        let (mut towards, mut irradiance, mut pair) = pairs.at(job.observation, zero, zero);
        let mut at = 0;
        while at < count {
            let pixel = start + at;
            let normal =
                Vec3::new(load(normals[0], at), load(normals[1], at), load(normals[2], at));
            if near {
                let (x, y) = (load(&x[..count], at), load(&y[..count], at));
                (towards, irradiance, pair) = pairs.at(job.observation, x, y);
            }
            let mut neutral = zero;
            for (lobe, value) in surface.lobes.iter().zip(&mut values) {
                *value = lobe.value(&pairs.model, pixel, &pair, normal);
                if let Strength::Neutral(strength) = lobe.strength {
                    neutral = neutral + scaled(strength.at(pixel), *value);
                }
            }
            let cosine = match &surface.coated {
                None => lambert::cosine(normal, towards),
                Some(coated) => coated.value(normal, towards, pairs.model.view(&pair)),
            };
            let intensity = I::F32::splat(intensity);
            let scale = irradiance * intensity;
            let known = (normal.x + normal.y + normal.z).is_finite();
            for (band, out) in job.out.iter_mut().enumerate() {
                let diffuse: I::F32 = load(colours[band], at);
                let mut radiance = diffuse.mul_add(cosine, neutral);
                for (lobe, strengths) in &tinted {
                    radiance = radiance + scaled(load(strengths[band], at), values[*lobe]);
                }
                // Infinite light times none would be NaN.
                let mut shown = held(radiance) * scale;
                if let Some(ambient) = &ambient {
                    shown = load::<I::F32>(ambient[band], at).mul_add(intensity, shown);
                }
                store(I::F32::select(known, held(shown), I::F32::of(f64::NAN)), out, at);
            }
            at += I::F32::WIDTH;
        }
    }
}

/// A tile in each plane of a map.
fn tile_of(map: &[f32], planes: usize, pixels: usize, start: usize, count: usize) -> Vec<&[f32]> {
    map.chunks(pixels).take(planes).map(|plane| &plane[start..start + count]).collect()
}

/// Nothing is brighter than the largest number; what is no number stays none.
#[inline(always)]
fn held<R: Real<Scalar = f32>>(value: R) -> R {
    R::splat(f32::MAX).min(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::coated_diffuse::CoatedDiffuse;
    use crate::geometry::{Grid, Light};
    use crate::math::Level;
    use crate::pixels::{Pool, Progress};
    use crate::surface::{Lobe, Model, Parameter};
    use core::sync::atomic::AtomicBool;

    /// Odd sizes: tiles and registers end in the middle of rows.
    const GRID: Grid = Grid::whole(131, 67, 0.5);
    const PIXELS: usize = GRID.width * GRID.height;

    fn every_level_and_thread_count_gives_the_same_bits(model: Model, shape: &[Parameter<'_>]) {
        for coated in [None, Some(CoatedDiffuse::new(1.45))] {
            levels_and_thread_counts_give_the_same_bits(model, shape, coated);
        }
    }

    fn levels_and_thread_counts_give_the_same_bits(
        model: Model,
        shape: &[Parameter<'_>],
        coated: Option<CoatedDiffuse>,
    ) {
        let mut normal = vec![0.0_f32; 3 * PIXELS];
        for pixel in 0..PIXELS {
            let t = pixel as f64;
            let n = Vec3::new(0.3 * (t * 0.71).sin(), 0.3 * (t * 0.37).cos(), 1.0).normalised();
            normal[pixel] = n.x as f32;
            normal[PIXELS + pixel] = n.y as f32;
            normal[2 * PIXELS + pixel] = n.z as f32;
        }
        normal[77] = f32::NAN;
        let diffuse: Vec<f32> =
            (0..2 * PIXELS).map(|i| 0.3 + (i as f32 * 0.1).sin() * 0.2).collect();
        let gold: Vec<f32> = (0..2 * PIXELS).map(|i| (i % 5) as f32).collect();
        let lights = vec![
            Light::Distant(Vec3::new(0.6, 0.0, 0.8)),
            Light::Point { position: Vec3::new(-30.0, 20.0, 60.0), falloff: true },
        ];
        let rig = Rig::new(lights, vec![Vec3::new(0.0, 0.0, 1.0); 2], GRID).unwrap();
        let lobe = |strength| Lobe { strength, shape: shape.to_vec() };
        let varnish = Strength::Neutral(Parameter::Everywhere(12.0));
        let surface = Surface {
            normal: &normal,
            diffuse: &diffuse,
            model,
            lobes: vec![lobe(varnish), lobe(Strength::Tinted(&gold))],
            ambient: Some(&diffuse),
            coated,
        };
        let bits = |level: Level, threads: usize| {
            let pool = Pool::new(threads).unwrap();
            let (cancel, progress) = (AtomicBool::new(false), Progress::default());
            let run = Run { pool: Some(&pool), level, cancel: &cancel, progress: &progress };
            let mut out = vec![0.0; 4 * PIXELS];
            predict(&surface, &rig, &[1.0, 0.7], &mut out, &run).unwrap();
            out.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        };
        let expected = bits(Level::Baseline, 1);
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            for threads in [1, 3] {
                assert!(bits(level, threads) == expected, "{level:?} {threads}");
            }
        }
        let nan = expected.iter().filter(|&&bits| f32::from_bits(bits).is_nan()).count();
        assert_eq!(nan, 4, "one pixel without a normal, in two photographs of two bands");
    }

    #[test]
    fn torrance_sparrow_lobes() {
        let gamma: Vec<f32> = (0..PIXELS).map(|i| 0.1 + (i % 7) as f32 * 0.02).collect();
        let model = Model::TorranceSparrow { index: 1.45 };
        every_level_and_thread_count_gives_the_same_bits(model, &[Parameter::Map(&gamma)]);
    }

    #[test]
    fn lafortune_lobes() {
        let exponent: Vec<f32> = (0..PIXELS).map(|i| 2.0 + (i % 7) as f32 * 9.0).collect();
        let shape = [-1.1, 0.9].map(Parameter::Everywhere);
        let shape = [shape[0], shape[1], Parameter::Map(&exponent)];
        every_level_and_thread_count_gives_the_same_bits(Model::Lafortune, &shape);
    }

    #[test]
    fn photographs_that_are_shown_together_are_those_shown_alone() {
        let (lights, bands) = (2 * TOGETHER + 3, 2);
        let light = |one: usize| {
            let angle = one as f64;
            Light::Distant(Vec3::new(0.6 * angle.cos(), 0.6 * angle.sin(), 0.8))
        };
        let normal: Vec<f32> =
            (0..3 * PIXELS).map(|i| f32::from(u8::from(i >= 2 * PIXELS))).collect();
        let diffuse: Vec<f32> = (0..bands * PIXELS).map(|i| i as f32).collect();
        let surface = Surface {
            normal: &normal,
            diffuse: &diffuse,
            model: Model::TorranceSparrow { index: 1.45 },
            lobes: Vec::new(),
            ambient: None,
            coated: None,
        };
        let (cancel, progress) = (AtomicBool::new(false), Progress::default());
        let run = Run { pool: None, level: Level::Baseline, cancel: &cancel, progress: &progress };
        let shown = |some: core::ops::Range<usize>| {
            let count = some.len();
            let intensities: Vec<f64> = some.clone().map(|one| 1.0 + one as f64).collect();
            let views = vec![Vec3::new(0.0, 0.0, 1.0); count];
            let rig = Rig::new(some.map(light).collect(), views, GRID).unwrap();
            let mut out = vec![0.0; count * bands * PIXELS];
            predict(&surface, &rig, &intensities, &mut out, &run).unwrap();
            out
        };
        let alone: Vec<f32> = (0..lights).flat_map(|one| shown(one..one + 1)).collect();
        assert!(shown(0..lights) == alone);
        assert!(alone.iter().any(|&sample| sample > 0.0));
    }
}
