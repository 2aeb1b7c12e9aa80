//! From photographs to a picture under a light that nobody photographed.
//!
//! `cargo run --release --example photographs_to_picture [picture.ppm]`
//!
//! Twelve photographs of a small varnished relief are simulated; then normals, the diffuse part and
//! the lobe of the varnish are estimated from them alone, and the surface is lit anew. Files and
//! colour spaces are the caller's: a picture is written in five lines, as PPM.
#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_methods,
    reason = "an example prints and writes"
)]

use std::sync::atomic::AtomicBool;
use std::thread::available_parallelism;

use impasto::geometry::{Grid, Light, Rig};
use impasto::math::{Level, Vec3};
use impasto::pixels::{Pool, Progress, Run};
use impasto::relight::plan::{Over, Plan};
use impasto::relight::scene::{Colour, Lamp, Scene};
use impasto::relight::{Relief, render};
use impasto::sbrdf::Start;
use impasto::sbrdf::pooled::{self, Extraction, PooledMapsMut, PooledOptions};
use impasto::stack::{Decode, Samples, Shape, Stack};
use impasto::stereo::{Learned, Method, NormalMaps, StereoOptions, fit_normals};
use impasto::surface::{Lobe, Model, Parameter, Strength, Surface, predict};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const PIXELS: usize = WIDTH * HEIGHT;
const BANDS: usize = 3;
const LIGHTS: usize = 12;
/// Codes of the simulated camera per unit of light: a white board reads 20,000.
const WHITE: f32 = 20_000.0;
/// Strength and half-width (rad) of the varnish's lobe, and its index of refraction.
const BETA: f32 = 4.0;
const GAMMA: f32 = 0.15;
const INDEX: f64 = 1.5;

fn main() -> impasto::Result<()> {
    // Circumstances of all calls: they change how fast, never what.
    let threads = available_parallelism().map_or(1, Into::into);
    let (pool, cancel, progress) =
        (Pool::new(threads)?, AtomicBool::new(false), Progress::default());
    let run =
        Run { pool: Some(&pool), level: Level::detect(), cancel: &cancel, progress: &progress };

    // The painting, its photographs, and the rig that took them.
    let grid = Grid::whole(WIDTH, HEIGHT, 0.1);
    let lights = (0..LIGHTS).map(|i| {
        let (azimuth, elevation) =
            (core::f64::consts::FRAC_PI_6 * i as f64, if i % 2 == 0 { 0.7 } else { 1.1_f64 });
        let (across, up) = (elevation.cos(), elevation.sin());
        Light::Distant(Vec3::new(across * azimuth.cos(), across * azimuth.sin(), up))
    });
    let eye = Vec3::new(0.0, 0.0, 1.0);
    let rig = Rig::new(lights.collect(), vec![eye; LIGHTS], grid)?;
    let (normal, diffuse) = painting();
    let mut samples = vec![0.0; LIGHTS * BANDS * PIXELS];
    predict(&varnished(&normal, &diffuse, BETA, GAMMA), &rig, &[1.0; LIGHTS], &mut samples, &run)?;
    let photographs: Vec<u16> = samples.iter().map(|sample| (sample * WHITE) as u16).collect();

    // What the photographs tell: first normals and albedo, robust to the highlight ...
    let shape = Shape { observations: LIGHTS, bands: BANDS, height: HEIGHT, width: WIDTH };
    let camera = Decode { gain: 1.0 / WHITE, offset: 0.0, saturation: 65_535.0 };
    let decode = vec![camera; LIGHTS * BANDS];
    let stack = Stack::new(Samples::U16(&photographs), shape, &decode, None)?;
    let mut floats = [3, BANDS, 1, 1, 1].map(|planes| vec![0.0; planes * PIXELS]);
    let [stereo_normal, albedo, residual, condition, sigma] = floats.each_mut();
    let mut status = vec![0; PIXELS];
    let mut maps = NormalMaps {
        normal: stereo_normal,
        albedo,
        used: &mut vec![0; PIXELS],
        rejected: &mut vec![0; 4 * PIXELS],
        residual,
        condition,
        sigma,
        status: &mut status,
    };
    let method = Method::Robust;
    let options = StereoOptions {
        method,
        steps: method.usual_steps(),
        selection: None,
        learned: Learned::default(),
    };
    fit_normals(&stack, &rig, &options, &mut maps, &run)?;
    println!(
        "photometric stereo: normals off by {:.2} degrees (median)",
        median_angle(&floats[0], &normal)
    );

    // ... then the lobe of the whole painting, with normals and colours that go with it.
    let start = Start { normal: &floats[0], diffuse: &floats[1], status: &status };
    let options = PooledOptions {
        extraction: Extraction::Residual,
        peak: false,
        joint: true,
        coated: false,
        index: INDEX,
        pixels: 4096,
    };
    let mut fitted = [3, BANDS, 1, 1, 1].map(|planes| vec![0.0; planes * PIXELS]);
    let [fitted_normal, fitted_diffuse, residual, sigma, misfit] = &mut fitted;
    let mut out = PooledMapsMut {
        normal: fitted_normal,
        diffuse: fitted_diffuse,
        residual,
        sigma,
        misfit,
        status: &mut vec![0; PIXELS],
    };
    let learned = pooled::fit(&stack, &rig, &start, &options, &mut out, &run)?;
    println!(
        "with the lobe:      normals off by {:.2} degrees (median)",
        median_angle(&fitted[0], &normal)
    );
    let (beta, gamma) = (learned.lobe.beta as f32, learned.lobe.gamma() as f32);
    println!("lobe: beta {beta:.3} (truth {BETA}), gamma {gamma:.4} rad (truth {GAMMA})");

    // A raking light from a new direction. Colour is a matrix: here the bands are the display's.
    let surface = varnished(&fitted[0], &fitted[1], beta, gamma);
    let light = Light::Distant(Vec3::new(-0.85, 0.35, 0.4));
    let lamp = Lamp { light, intensity: 2.0, radius: 0.0, colour: 0 };
    let bands = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let colours = vec![Colour { diffuse: bands, interface: [1.0; 3] }];
    let scene = Scene::new(vec![lamp], colours, eye)?;
    let plan = Plan::forced(&surface, grid, &scene, Over::default())?;
    let relief = Relief { grid, height: None };
    let picture = render(&surface, relief, &scene, &plan, [0.0; 3], &run)?;
    let light = f64::from(picture.light.iter().sum::<f32>()) / picture.light.len() as f64;
    println!("picture: {WIDTH} x {HEIGHT}, mean light {light:.3}");

    if let Some(path) = std::env::args().nth(1) {
        let mut file = format!("P6\n{WIDTH} {HEIGHT}\n255\n").into_bytes();
        let code = |light: f32| (255.0 * light.clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8;
        file.extend((0..3 * PIXELS).map(|i| code(picture.light[i % 3 * PIXELS + i / 3])));
        std::fs::write(&path, file).unwrap_or_else(|error| println!("{path}: {error}"));
    }
    Ok(())
}

/// Normals `(3, y, x)` of brush strokes, and their diffuse reflectance `(band, y, x)`.
fn painting() -> (Vec<f32>, Vec<f32>) {
    let (mut normal, mut diffuse) = (vec![0.0; 3 * PIXELS], vec![0.0; BANDS * PIXELS]);
    for pixel in 0..PIXELS {
        let (x, y) = ((pixel % WIDTH) as f64, (pixel / WIDTH) as f64);
        let along = 0.3 * x + 0.17 * y;
        let slopes = [0.25 * along.cos() + 0.1 * (0.05 * y).sin(), 0.15 * (0.8 * along).sin()];
        let unit = Vec3::new(-slopes[0], -slopes[1], 1.0).normalised();
        for (axis, value) in unit.array().into_iter().enumerate() {
            normal[axis * PIXELS + pixel] = value as f32;
        }
        for band in 0..BANDS {
            let hue = (0.03 * x + 2.1 * band as f64).sin() * (0.04 * y).cos();
            diffuse[band * PIXELS + pixel] = (0.4 + 0.25 * hue) as f32;
        }
    }
    (normal, diffuse)
}

/// A painting under one coat of varnish.
fn varnished<'a>(normal: &'a [f32], diffuse: &'a [f32], beta: f32, gamma: f32) -> Surface<'a> {
    let strength = Strength::Neutral(Parameter::Everywhere(beta));
    let lobe = Lobe { strength, shape: vec![Parameter::Everywhere(gamma)] };
    let model = Model::TorranceSparrow { index: INDEX };
    Surface { normal, diffuse, model, lobes: vec![lobe], ambient: None, coated: None }
}

/// Median angle between two maps of unit normals, degrees.
fn median_angle(found: &[f32], truth: &[f32]) -> f64 {
    let mut angles: Vec<f64> = (0..PIXELS)
        .map(|pixel| {
            let [a, b] = [found, truth].map(|map| {
                let [x, y, z] = [0, 1, 2].map(|axis| f64::from(map[axis * PIXELS + pixel]));
                Vec3::new(x, y, z)
            });
            (a - b).length().to_degrees()
        })
        .collect();
    angles.sort_by(f64::total_cmp);
    angles[PIXELS / 2]
}
