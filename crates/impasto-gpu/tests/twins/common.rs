//! A painting, and the same picture by the CPU and by a graphics card.

use impasto::geometry::{Grid, Light, View};
use impasto::math::Vec3;
use impasto::pixels::serially;
use impasto::relight::plan::{Over, Plan};
use impasto::relight::scene::{Colour, Lamp, Scene};
use impasto::relight::{self, Picture, Relief};
use impasto::surface::Surface;
use impasto_gpu::{Choice, Gpu};

/// Odd sizes: workgroups and words of 32 pixels end in the middle of rows.
pub(crate) const GRID: Grid = Grid::whole(131, 67, 0.5);
pub(crate) const PIXELS: usize = GRID.width * GRID.height;
pub(crate) const BACKGROUND: [f32; 3] = [0.3, 0.2, 0.1];

/// Any graphics card. Where none is found the test is skipped, unless `IMPASTO_EXPECT_GPU` says
/// that there must be one.
pub(crate) fn gpu() -> Option<Gpu> {
    #[allow(clippy::disallowed_methods, reason = "a test, not the library")]
    let expected = std::env::var("IMPASTO_EXPECT_GPU").is_ok_and(|value| value == "1");
    match Gpu::open(Choice::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) if expected => panic!("IMPASTO_EXPECT_GPU=1, but {error}"),
        Err(_) => None,
    }
}

pub(crate) fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
    Vec3::new(x, y, z).normalised()
}

/// Maps of a painting with a hole.
pub(crate) struct Maps {
    pub(crate) normal: Vec<f32>,
    pub(crate) diffuse: Vec<f32>,
    pub(crate) gold: Vec<f32>,
    pub(crate) gamma: Vec<f32>,
    pub(crate) beta: Vec<f32>,
    pub(crate) exponent: Vec<f32>,
    pub(crate) height: Vec<f32>,
}

impl Maps {
    pub(crate) fn new() -> Self {
        let number = |pixel: usize| pixel as f64;
        let map = |of: &dyn Fn(f64) -> f64| (0..PIXELS).map(|p| of(number(p)) as f32).collect();
        let mut normal = vec![0.0_f32; 3 * PIXELS];
        for pixel in 0..PIXELS {
            let t = number(pixel);
            let n = unit(0.5 * (t * 0.71).sin(), 0.5 * (t * 0.37).cos(), 1.0);
            normal[pixel] = n.x as f32;
            normal[PIXELS + pixel] = n.y as f32;
            normal[2 * PIXELS + pixel] = n.z as f32;
        }
        normal[77] = f32::NAN;
        let planes = |scale: f64| {
            (0..2 * PIXELS).map(|i| (0.3 + (number(i) * 0.1).sin() * scale) as f32).collect()
        };
        let mut diffuse: Vec<f32> = planes(0.2);
        diffuse[PIXELS + 300] = f32::NAN;
        let mut gold: Vec<f32> = planes(0.25);
        gold[5] = 0.0;
        Self {
            normal,
            diffuse,
            gold,
            gamma: map(&|t| 0.05 + 0.3 * (t * 0.013).sin().abs()),
            beta: map(&|t| (20.0 * (t * 0.07).sin()).max(0.0)),
            exponent: map(&|t| 2.0 + 58.0 * (t * 0.017).sin().abs()),
            height: map(&|t| 0.8 * (t * 0.031).sin() + 0.2 * (t * 0.7).cos()),
        }
    }
}

pub(crate) fn distant(x: f64, y: f64, z: f64) -> Light {
    Light::Distant(unit(x, y, z))
}

pub(crate) fn near(x: f64, y: f64, z: f64, falloff: bool) -> Light {
    Light::Point { position: Vec3::new(x, y, z), falloff }
}

pub(crate) fn colour(warm: f64, coefficients: usize) -> Colour {
    let column = |k: usize| [0.9 / (k + 1) as f64, 0.5 + 0.1 * k as f64, 0.2 * warm];
    Colour { diffuse: (0..coefficients).map(column).collect(), interface: [warm, 1.0, 1.0 / warm] }
}

/// Lights of strength 0.8 and of two colours in turn, over two coefficients.
pub(crate) fn scene(lights: &[Light], view: impl Into<View>) -> Scene {
    let lamps = lights.iter().enumerate().map(|(index, &light)| Lamp {
        radius: 0.0,
        light,
        intensity: 0.8,
        colour: index % 2,
    });
    Scene::new(lamps.collect(), vec![colour(1.1, 2), colour(0.8, 2)], view).unwrap()
}

pub(crate) const FRONTAL: Vec3<f64> = Vec3::new(0.0, 0.0, 1.0);

pub(crate) fn on_cpu(
    surface: &Surface<'_>,
    height: Option<&[f32]>,
    scene: &Scene,
    grid: Grid,
) -> Picture {
    let over = Over { shadows: height.is_some(), parallax: height.is_some() };
    let plan = Plan::forced(surface, grid, scene, over).unwrap();
    serially(|run| relight::render(surface, Relief { grid, height }, scene, &plan, BACKGROUND, run))
        .unwrap()
}

pub(crate) fn on_gpu(
    gpu: &Gpu,
    surface: &Surface<'_>,
    height: Option<&[f32]>,
    scene: &Scene,
    grid: Grid,
) -> Picture {
    let over = Over { shadows: height.is_some(), parallax: height.is_some() };
    let plan = Plan::forced(surface, grid, scene, over).unwrap();
    let relief = Relief { grid, height };
    serially(|run| impasto_gpu::render(gpu, surface, relief, scene, &plan, BACKGROUND, run))
        .unwrap()
}

/// Largest difference in light after a display's curve, a square root (steeper than sRGB's above
/// 0.001); the coverage must be the same.
pub(crate) fn encoded_difference(one: &Picture, other: &Picture) -> f32 {
    assert_eq!(one.grid, other.grid);
    let apart = one.coverage.iter().zip(&other.coverage).filter(|(a, b)| a != b).count();
    assert_eq!(apart, 0, "coverage differs");
    let encoded = |light: f32| light.clamp(1e-3, 1.0).sqrt();
    assert!(other.light.iter().all(|value| value.is_finite()));
    one.light
        .iter()
        .zip(&other.light)
        .map(|(&a, &b)| (encoded(a) - encoded(b)).abs())
        .fold(0.0, f32::max)
}

/// The CPU's picture of a scene, from which the card's must not differ by more than `tolerance`.
pub(crate) fn agreed(
    gpu: &Gpu,
    (name, number): (&str, usize),
    surface: &Surface<'_>,
    height: Option<&[f32]>,
    scene: &Scene,
    tolerance: f32,
) -> Picture {
    let expected = on_cpu(surface, height, scene, GRID);
    let found = on_gpu(gpu, surface, height, scene, GRID);
    let difference = encoded_difference(&expected, &found);
    assert!(difference <= tolerance, "{name}, scene {number}: {difference:e}");
    // What is brighter than white is not compared.
    let lit = expected.light.iter().filter(|&light| (0.01..1.0).contains(light)).count();
    assert!(lit > PIXELS / 4, "{name}, scene {number}: too dark or too bright to tell, {lit}");
    expected
}
