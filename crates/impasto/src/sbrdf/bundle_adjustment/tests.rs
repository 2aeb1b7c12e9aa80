//! Equations do not depend on the instruction set or on threads; what they are,
//! `tests/test_bundle_adjustment.py` says.

use core::sync::atomic::AtomicBool;

use super::{Adjustment, LobeProfile};
use crate::brdf::coated_diffuse::CoatedDiffuse;
use crate::geometry::{Grid, Light, Rig, View};
use crate::math::{Level, Vec3};
use crate::pixels::{Pool, Progress, Run};
use crate::surface::{Lobe, Model, Parameter, Strength, Surface};

/// Neither lanes nor parts divide it.
const GRID: Grid = Grid::whole(7, 5, 2.0);
const PIXELS: usize = GRID.width * GRID.height;
const LIGHTS: usize = 9;
const BANDS: usize = 2;

/// Lamps and a camera this many mm away.
fn rig(distance: f64) -> Rig {
    let lights = (0..LIGHTS).map(|light| {
        let angle = 2.4 * light as f64;
        let towards = Vec3::new(0.6 * angle.cos(), 0.6 * angle.sin(), 0.8);
        Light::Point { position: towards.scale(distance), falloff: true }
    });
    let eye = View::Point(Vec3::new(2.0, -1.0, distance));
    Rig::new(lights.collect(), vec![eye; LIGHTS], GRID).unwrap()
}

/// Of lobes about as wide as `middle`.
fn equations(level: Level, threads: usize, every: usize, middle: f32) -> Vec<u64> {
    let wave = |i: usize, by: f64| (i as f64 * by).sin();
    let mut normal = vec![0.0_f32; 3 * PIXELS];
    for pixel in 0..PIXELS {
        let n = Vec3::new(0.2 * wave(pixel, 0.7), 0.2 * wave(pixel, 1.3), 1.0).normalised();
        for (plane, value) in n.array().into_iter().enumerate() {
            normal[plane * PIXELS + pixel] = value as f32;
        }
    }
    let colours: Vec<f32> = (0..BANDS * PIXELS).map(|i| 0.5 + 0.3 * wave(i, 0.37) as f32).collect();
    let mut gamma: Vec<f32> =
        (0..PIXELS).map(|i| middle * (1.0 + 0.5 * wave(i, 0.9) as f32)).collect();
    gamma[11] = f32::NAN;
    let lobe = Lobe { strength: Strength::Tinted(&colours), shape: vec![Parameter::Map(&gamma)] };
    let surface = Surface {
        normal: &normal,
        diffuse: &colours,
        model: Model::TorranceSparrow { index: 1.45 },
        lobes: vec![lobe],
        ambient: Some(&colours),
        coated: Some(CoatedDiffuse::new(1.45)),
    };
    let samples = LIGHTS * BANDS * PIXELS;
    let used = |i: usize| i % 7 != 3;
    let of = |by: f64, middle: f64| -> Vec<f64> {
        (0..samples).map(|i| if used(i) { middle + wave(i, by) } else { 0.0 }).collect()
    };
    let adjustment = Adjustment {
        surface: &surface,
        profile: Some(LobeProfile { knots: &[0.1, 0.3], factors: &[1.5, 0.7] }),
        rig: &rig(40.0),
        intensities: &(0..LIGHTS).map(|i| 1.0 + 0.3 * wave(i, 1.0)).collect::<Vec<_>>(),
        moved: &[rig(38.0)],
        step: 0.01,
        strengths: true,
        errors: &of(0.11, 0.0),
        slopes: &of(0.23, 2.0),
        held: &(0..LIGHTS).map(|i| i % every == 0).collect::<Vec<_>>(),
    };
    let pool = Pool::new(threads).unwrap();
    let (cancel, progress) = (AtomicBool::new(false), Progress::default());
    let run = Run { pool: Some(&pool), level, cancel: &cancel, progress: &progress };
    let found = adjustment.equations(&run).unwrap();
    assert!(found.matrix.iter().chain(&found.right).all(|value| value.is_finite()));
    assert!(found.right.iter().all(|&value| value != 0.0));
    found.matrix.into_iter().chain(found.right).map(f64::to_bits).collect()
}

#[test]
fn every_level_and_thread_count_gives_the_same_bits() {
    for every in [1, 2] {
        let expected = equations(Level::Baseline, 1, every, 0.2);
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            for threads in [1, 3] {
                assert!(equations(level, threads, every, 0.2) == expected, "{level:?} {threads}");
            }
        }
    }
}

/// The inverse of a square of 1e-310 is no number. Lobes 0.3 rad away from the half vectors of all
/// lamps have such squares if they are 0.01 rad wide.
#[test]
fn lobes_that_no_lamp_shows_leave_equations_finite() {
    for every in [1, 2] {
        for step in 0..100 {
            equations(Level::Baseline, 1, every, 0.005 + 0.0002 * step as f32);
        }
    }
}
