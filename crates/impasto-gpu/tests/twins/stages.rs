//! Every stage of the kernel against its twin on the CPU.
//!
//! Both compute in single precision from the same formulas, in the same order; a device may round a
//! division or a square root differently. A handful of such roundings of 6e-8 in light, of which the
//! display's curve makes up to 5 times as much in the dark: 4e-6 of the encoded value.

use super::common::*;
use impasto::geometry::{Grid, Light, View};
use impasto::math::Vec3;
use impasto::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface};

const TOLERANCE: f32 = 4e-6;

const TORRANCE_SPARROW: Model = Model::TorranceSparrow { index: 1.45 };

fn matte(maps: &Maps) -> Surface<'_> {
    Surface {
        normal: &maps.normal,
        diffuse: &maps.diffuse,
        model: TORRANCE_SPARROW,
        lobes: Vec::new(),
        ambient: None,
        coated: None,
    }
}

/// Compares under several lights and views; the picture must not be dark.
fn compared(name: &str, surface: &Surface<'_>, height: Option<&[f32]>) {
    compared_within(TOLERANCE, name, surface, height);
}

fn compared_within(tolerance: f32, name: &str, surface: &Surface<'_>, height: Option<&[f32]>) {
    let Some(gpu) = gpu() else { return };
    let sun = distant(0.3, 0.4, 0.8);
    let lamp = near(-30.0, 20.0, 60.0, true);
    let scenes: [(&[Light], View); 6] = [
        (&[sun], FRONTAL.into()),
        (&[lamp], FRONTAL.into()),
        (&[near(10.0, -20.0, 90.0, false)], View::Point(Vec3::new(5.0, -8.0, 300.0))),
        (&[sun], View::Point(Vec3::new(20.0, 0.0, 150.0))),
        (&[sun, distant(-0.9, 0.1, 0.3), lamp, distant(0.0, -0.5, 0.5)], FRONTAL.into()),
        (&[lamp, sun], unit(0.4, -0.2, 0.9).into()),
    ];
    for (number, (lights, view)) in scenes.into_iter().enumerate() {
        let scene = scene(lights, view);
        agreed(&gpu, (name, number), surface, height, &scene, tolerance);
    }
}

#[test]
fn diffuse_of_distant_and_near_lights_in_several_colours() {
    let maps = Maps::new();
    compared("diffuse", &matte(&maps), None);
}

#[test]
fn diffuse_under_an_interface() {
    let maps = Maps::new();
    for index in [1.0, 1.45, 2.4] {
        let coated = Some(CoatedDiffuse::new(index));
        compared("coated", &Surface { coated, ..matte(&maps) }, None);
    }
}

#[test]
fn ambient_light() {
    let maps = Maps::new();
    compared("ambient", &Surface { ambient: Some(&maps.gold), ..matte(&maps) }, None);
}

#[test]
fn torrance_sparrow_lobes() {
    let maps = Maps::new();
    let (beta, gamma) = (Parameter::Map(&maps.beta), Parameter::Map(&maps.gamma));
    let everywhere = Parameter::Everywhere;
    let coats: [&[(Strength<'_>, Parameter<'_>)]; 5] = [
        &[(Strength::Neutral(everywhere(8.0)), everywhere(0.12))],
        &[(Strength::Neutral(beta), gamma)],
        &[(Strength::Neutral(everywhere(5.0)), gamma)],
        &[(Strength::Tinted(&maps.gold), everywhere(0.2))],
        &[
            (Strength::Neutral(beta), everywhere(0.05)),
            (Strength::Tinted(&maps.gold), gamma),
            (Strength::Neutral(everywhere(2.0)), gamma),
        ],
    ];
    for coat in coats {
        let lobes = coat.iter().map(|&(strength, gamma)| Lobe { strength, shape: vec![gamma] });
        let surface = Surface { lobes: lobes.collect(), ..matte(&maps) };
        compared("torrance-sparrow", &surface, None);
    }
}

#[test]
fn lafortune_lobes() {
    let maps = Maps::new();
    let everywhere = Parameter::Everywhere;
    let phong = |exponent| vec![everywhere(-1.0), everywhere(1.0), exponent];
    let retro = vec![everywhere(0.9), everywhere(1.09), everywhere(5.0)];
    let map = Parameter::Map(&maps.exponent);
    let neutral = |strength, shape| Lobe { strength: Strength::Neutral(strength), shape };
    let gold = |shape| Lobe { strength: Strength::Tinted(&maps.gold), shape };
    let beta = Parameter::Map(&maps.beta);
    let all: [Vec<Lobe<'_>>; 4] = [
        vec![neutral(everywhere(0.5), phong(everywhere(20.0)))],
        vec![neutral(beta, phong(map))],
        vec![gold(phong(map))],
        vec![gold(phong(everywhere(10.0))), neutral(everywhere(0.3), retro), gold(phong(map))],
    ];
    for lobes in all {
        let surface = Surface { model: Model::Lafortune, lobes, ..matte(&maps) };
        // d^n = exp(n ln d): what d is off by becomes n times as much of the light, half of that of
        // its root. From directions to a near lamp and a near eye, three inner products and their
        // sum some 8 roundings of 6e-8 remain in d; a card that joins other products and sums than
        // the CPU shares none of them. (An NVIDIA H200 was 9.4e-6 off.)
        compared_within(TOLERANCE + 0.5 * 8.0 * 6e-8 * 60.0, "lafortune", &surface, None);
    }
}

#[test]
fn sharp_lafortune_lobes_agree_as_far_as_single_precision_determines_them() {
    let Some(gpu) = gpu() else { return };
    let maps = Maps::new();
    for exponent in [300.0, 5_000.0, 16_600.0] {
        let shape = [-1.0, 1.0, exponent].map(Parameter::Everywhere).to_vec();
        let strength = Strength::Neutral(Parameter::Everywhere(0.5));
        let lobes = vec![Lobe { strength, shape }];
        let surface = Surface { model: Model::Lafortune, lobes, ..matte(&maps) };
        let scene = scene(&[distant(0.3, 0.2, 0.9)], FRONTAL);
        let difference = encoded_difference(
            &on_cpu(&surface, None, &scene, GRID),
            &on_gpu(&gpu, &surface, None, &scene, GRID),
        );
        // d^n = exp(n ln d): a rounding of d, 6e-8, becomes n times as much.
        assert!(difference <= TOLERANCE.max(2.0 * 6e-8 * exponent), "{exponent}: {difference:e}");
    }
}

#[test]
fn cast_shadows() {
    let maps = Maps::new();
    compared("shadows", &matte(&maps), Some(&maps.height));
}

#[test]
fn cast_shadows_of_every_azimuth() {
    let Some(gpu) = gpu() else { return };
    let mut maps = Maps::new();
    maps.height[20 * GRID.width + 30] = f32::NAN;
    for (width, height) in [(131, 67), (67, 131), (1, 90), (90, 1)] {
        let grid = Grid::whole(width, height, 0.5);
        let pixels = width * height;
        let part = |map: &[f32], planes: usize| -> Vec<f32> {
            map.chunks(PIXELS).take(planes).flat_map(|plane| plane[..pixels].to_vec()).collect()
        };
        let (normal, diffuse) = (part(&maps.normal, 3), part(&maps.diffuse, 2));
        let surface = Surface { normal: &normal, diffuse: &diffuse, ..matte(&maps) };
        let relief = Some(&maps.height[..pixels]);
        let mut dark = 0;
        for step in 0..32 {
            let angle = f64::from(step) * core::f64::consts::TAU / 32.0;
            let scene = scene(&[distant(angle.cos(), angle.sin(), 0.25)], FRONTAL);
            let expected = on_cpu(&surface, relief, &scene, grid);
            let found = on_gpu(&gpu, &surface, relief, &scene, grid);
            let pairs = expected.light.iter().zip(&found.light);
            let different = pairs.clone().filter(|(a, b)| (*a - *b).abs() > 1e-6).count();
            dark += expected.light.iter().filter(|&&light| light == 0.0).count();
            // A pixel whose depth in shadow is a rounding either way may be lit or not: with heights
            // of 1 mm and roundings of 1e-7 that is one in a million.
            assert!(different <= 3, "{width} x {height}, {step}: {different}");
        }
        assert!(width * height < 100 || dark > pixels, "no shadows");
    }
}
