//! Samples that a surface of Lafortune lobes would show.

use crate::brdf::lafortune::{Lobe, Pair};
use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real, Vec3};
use crate::pixels::{Run, TILE};

use super::lanes::{load, store};
use super::predict::{Job, jobs};

/// A painting's surface as maps; lobes in the gauge of [`crate::brdf::lafortune`].
#[derive(Clone, Copy, Debug)]
pub struct LobeSurface<'a> {
    /// `(3, y, x)` unit vectors.
    pub normal: &'a [f32],
    /// `(band, y, x)` diffuse reflectance relative to the white board.
    pub diffuse: &'a [f32],
    /// `(lobe, band, y, x)` strength; 0 where a pixel has fewer lobes.
    pub specular: &'a [f32],
    /// `(lobe, y, x)` weight of the tangential product.
    pub cxy: &'a [f32],
    /// `(lobe, y, x)` weight of the upright product.
    pub cz: &'a [f32],
    /// `(lobe, y, x)` sharpness.
    pub exponent: &'a [f32],
}

/// Writes the samples `(obs, band, y, x)` that a surface shows, white board 1.0: per light
/// `intensity * irradiance * (N.L) (S + sum over lobes of A d^n)`, 0 where the surface turns away
/// from the light, without lobes where it turns away from the view, NaN where the normal or the
/// diffuse reflectance is. Shapes of lobes without strength do not matter.
///
/// # Errors
/// If a map's size does not fit the rig's grid, or the run is cancelled.
pub fn predict_lobes(
    surface: &LobeSurface<'_>,
    rig: &Rig,
    intensities: &[f64],
    out: &mut [f32],
    run: &Run<'_>,
) -> Result<()> {
    let grid = rig.grid();
    let pixels = grid.width * grid.height;
    let observations = rig.observations();
    let bands = surface.diffuse.len() / pixels.max(1);
    let lobes = surface.exponent.len() / pixels.max(1);
    let sizes = [
        ("normal", surface.normal.len() == 3 * pixels),
        ("diffuse", surface.diffuse.len() == bands * pixels && bands > 0),
        ("specular", surface.specular.len() == lobes * bands * pixels),
        ("cxy", surface.cxy.len() == lobes * pixels),
        ("cz", surface.cz.len() == lobes * pixels),
        ("exponent", surface.exponent.len() == lobes * pixels),
        ("intensities", intensities.len() == observations),
        ("out", out.len() == observations * bands * pixels && pixels > 0),
    ];
    if let Some((name, _)) = sizes.iter().find(|(_, fits)| !fits) {
        let problem = format!(
            "its size does not fit {} x {} pixels, {bands} bands, {lobes} lobes and \
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
            level.run(Predict { surface, rig, lobes, pixels, intensity, x, y, job });
        },
    )
}

struct Predict<'a, 'b> {
    surface: &'a LobeSurface<'a>,
    rig: &'a Rig,
    lobes: usize,
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
        let Self { surface, rig, lobes, pixels, intensity, x, y, mut job } = self;
        let bands = job.out.len();
        let view = rig.views()[job.observation].splat::<I::F32>();
        let light = rig.lights()[job.observation];
        let zero = I::F32::zero();
        let (mut towards, mut irradiance) = light.at(zero, zero);
        let plane = |map: &'_ [f32], number: usize, pixel: usize| -> I::F32 {
            load(&map[number * pixels..(number + 1) * pixels], pixel)
        };
        let mut powers = vec![zero; lobes];
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
            }
            let pair = Pair::against(normal, towards, view, towards.dot(view));
            let seen = pair.cosine.gt(zero);
            for (number, power) in powers.iter_mut().enumerate() {
                let lobe = Lobe::of_coefficients(
                    I::F32::one(),
                    plane(surface.cxy, number, pixel),
                    plane(surface.cz, number, pixel),
                    plane(surface.exponent, number, pixel),
                );
                *power = I::F32::keep(seen, lobe.value(&pair));
            }
            let cosine = crate::brdf::lambert::cosine(normal, towards);
            let scale = cosine * irradiance * I::F32::splat(intensity);
            let known = (normal.x + normal.y + normal.z).is_finite();
            for (band, out) in job.out.iter_mut().enumerate() {
                let mut reflectance = plane(surface.diffuse, band, pixel);
                for (number, &power) in powers.iter().enumerate() {
                    let strength = plane(surface.specular, number * bands + band, pixel);
                    let lobe = I::F32::keep(strength.gt(zero), strength * power);
                    reflectance = reflectance + lobe;
                }
                let radiance = reflectance * scale;
                store(I::F32::select(known, radiance, I::F32::of(f64::NAN)), out, at);
            }
            at += I::F32::WIDTH;
        }
    }
}
