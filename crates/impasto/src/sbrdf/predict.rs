//! Samples that a surface would show: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper.

use crate::brdf::lambert;
use crate::brdf::torrance_sparrow::{Facet, sharpness};
use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real, Vec3};
use crate::pixels::{Run, TILE, tiles};

use super::lanes::{load, store};

/// Parameters of the interface reflection, coat by coat.
#[derive(Clone, Copy, Debug)]
pub enum Coats<'a> {
    /// `(coat,)`: one number per coat for the whole painting.
    Uniform(&'a [f32]),
    /// `(coat, y, x)`.
    Maps(&'a [f32]),
}

impl Coats<'_> {
    fn count(&self, pixels: usize) -> usize {
        match self {
            Self::Uniform(values) => values.len(),
            Self::Maps(values) => values.len() / pixels,
        }
    }

    fn fits(&self, coats: usize, pixels: usize) -> bool {
        match self {
            Self::Uniform(values) => values.len() == coats,
            Self::Maps(values) => values.len() == coats * pixels,
        }
    }

    #[inline(always)]
    fn at<R: Real<Scalar = f32>>(&self, coat: usize, pixels: usize, pixel: usize) -> R {
        match self {
            Self::Uniform(values) => R::splat(values[coat]),
            Self::Maps(values) => load(&values[coat * pixels..(coat + 1) * pixels], pixel),
        }
    }
}

/// A painting's surface as maps.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// `(3, y, x)` unit vectors.
    pub normal: &'a [f32],
    /// `(band, y, x)` diffuse reflectance relative to the white board.
    pub diffuse: &'a [f32],
    /// Strength of each coat.
    pub beta: Coats<'a>,
    /// Half-width of each coat's facets, rad.
    pub gamma: Coats<'a>,
    /// Index of refraction of the coats.
    pub index: f64,
}

/// Writes the samples `(obs, band, y, x)` that a surface shows, white board 1.0: per light
/// `intensity * irradiance * ((N.L) S + sum over coats of beta D F G / (N.V))`, 0 where the surface
/// turns away from the light, without interface reflection where it turns away from the view, NaN
/// where the normal or the diffuse reflectance is.
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
    let bands = surface.diffuse.len() / pixels.max(1);
    let coats = surface.beta.count(pixels.max(1));
    let sizes = [
        ("normal", surface.normal.len() == 3 * pixels),
        ("diffuse", surface.diffuse.len() == bands * pixels && bands > 0),
        ("beta", surface.beta.fits(coats, pixels)),
        ("gamma", surface.gamma.fits(coats, pixels)),
        ("intensities", intensities.len() == observations),
        ("out", out.len() == observations * bands * pixels && pixels > 0),
    ];
    if let Some((name, _)) = sizes.iter().find(|(_, fits)| !fits) {
        let problem = format!(
            "its size does not fit {} x {} pixels, {bands} bands, {coats} coats and \
             {observations} lights",
            grid.height, grid.width
        );
        return Err(Error::argument(name, problem));
    }
    let level = run.level;
    run.for_each(
        jobs(out, bands, pixels),
        || (vec![0.0; TILE], vec![0.0; TILE]),
        |(x, y), job| {
            grid.coordinates(job.start, &mut x[..job.count], &mut y[..job.count]);
            let intensity = intensities[job.observation] as f32;
            level.run(Predict { surface, rig, coats, pixels, intensity, x, y, job });
        },
    )
}

/// One tile of one observation.
pub(super) struct Job<'a> {
    pub(super) observation: usize,
    pub(super) start: usize,
    pub(super) count: usize,
    /// The tile in every band.
    pub(super) out: Vec<&'a mut [f32]>,
}

/// Cuts `(obs, band, y, x)` into tiles of observations.
pub(super) fn jobs(out: &mut [f32], bands: usize, pixels: usize) -> Vec<Job<'_>> {
    let mut jobs = Vec::new();
    for (observation, planes) in out.chunks_mut(bands * pixels).enumerate() {
        let mut planes: Vec<_> = planes.chunks_mut(pixels).map(|p| p.chunks_mut(TILE)).collect();
        for (start, count) in tiles(pixels) {
            let out = planes.iter_mut().filter_map(Iterator::next).collect();
            jobs.push(Job { observation, start, count, out });
        }
    }
    jobs
}

struct Predict<'a, 'b> {
    surface: &'a Surface<'a>,
    rig: &'a Rig,
    coats: usize,
    pixels: usize,
    intensity: f32,
    x: &'a [f32],
    y: &'a [f32],
    job: Job<'b>,
}

impl Kernel for Predict<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { surface, rig, coats, pixels, intensity, x, y, mut job } = self;
        let view = rig.views()[job.observation].splat::<I::F32>();
        let light = rig.lights()[job.observation];
        let index = I::F32::of(surface.index);
        let zero = I::F32::zero();
        let (mut towards, mut irradiance) = light.at(zero, zero);
        let mut facet = Facet::between(towards, view, index);
        let plane = |map: &'_ [f32], number: usize, pixel: usize| -> I::F32 {
            load(&map[number * pixels..(number + 1) * pixels], pixel)
        };
        let mut at = 0;
        while at < job.count {
            let pixel = job.start + at;
            let normal = Vec3::new(
                plane(surface.normal, 0, pixel),
                plane(surface.normal, 1, pixel),
                plane(surface.normal, 2, pixel),
            );
            if !light.is_distant() {
                (towards, irradiance) =
                    light.at(load(&x[..job.count], at), load(&y[..job.count], at));
                facet = Facet::between(towards, view, index);
            }
            let glint = facet.on(normal);
            let mut specular = zero;
            for coat in 0..coats {
                let beta = surface.beta.at::<I::F32>(coat, pixels, pixel);
                let gamma = surface.gamma.at::<I::F32>(coat, pixels, pixel);
                specular = specular + glint.value(beta, sharpness(gamma));
            }
            let cosine = lambert::cosine(normal, towards);
            let scale = irradiance * I::F32::splat(intensity);
            let known = (normal.x + normal.y + normal.z).is_finite();
            for (band, out) in job.out.iter_mut().enumerate() {
                let diffuse = plane(surface.diffuse, band, pixel);
                let radiance = diffuse.mul_add(cosine, specular) * scale;
                store(I::F32::select(known, radiance, I::F32::of(f64::NAN)), out, at);
            }
            at += I::F32::WIDTH;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Grid, Light};
    use crate::math::Level;
    use crate::pixels::{Pool, Progress};
    use core::sync::atomic::AtomicBool;

    #[test]
    fn every_level_and_thread_count_gives_the_same_bits() {
        // Odd sizes: tiles and registers end in the middle of rows.
        let grid = Grid { width: 131, height: 67, pitch: 0.5 };
        let pixels = grid.width * grid.height;
        let mut normal = vec![0.0_f32; 3 * pixels];
        for pixel in 0..pixels {
            let t = pixel as f64;
            let n = Vec3::new(0.3 * (t * 0.71).sin(), 0.3 * (t * 0.37).cos(), 1.0).normalised();
            normal[pixel] = n.x as f32;
            normal[pixels + pixel] = n.y as f32;
            normal[2 * pixels + pixel] = n.z as f32;
        }
        normal[77] = f32::NAN;
        let diffuse: Vec<f32> =
            (0..2 * pixels).map(|i| 0.3 + (i as f32 * 0.1).sin() * 0.2).collect();
        let gamma: Vec<f32> = (0..pixels).map(|i| 0.1 + (i % 7) as f32 * 0.02).collect();
        let lights = vec![
            Light::Distant(Vec3::new(0.6, 0.0, 0.8)),
            Light::Point { position: Vec3::new(-30.0, 20.0, 60.0), falloff: true },
        ];
        let rig = Rig::new(lights, vec![Vec3::new(0.0, 0.0, 1.0); 2], grid).unwrap();
        let surface = Surface {
            normal: &normal,
            diffuse: &diffuse,
            beta: Coats::Uniform(&[12.0]),
            gamma: Coats::Maps(&gamma),
            index: 1.45,
        };
        let bits = |level: Level, threads: usize| {
            let pool = Pool::new(threads).unwrap();
            let (cancel, progress) = (AtomicBool::new(false), Progress::default());
            let run = Run { pool: Some(&pool), level, cancel: &cancel, progress: &progress };
            let mut out = vec![0.0; 4 * pixels];
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
}
