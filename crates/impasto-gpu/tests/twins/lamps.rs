//! Lamps with a size against the CPU's: the points of a disc, lobes widened by a part of it, and the
//! share of it that each pixel sees.

use super::common::*;
use impasto::geometry::{Light, View};
use impasto::math::Vec3;
use impasto::relight::scene::{Lamp, Scene};
use impasto::surface::{Lobe, Model, Parameter, Strength, Surface};

/// As of `stages.rs`; a disc is the mean of sixteen points, each as far off as a lamp without a size.
const TOLERANCE: f32 = 4e-6;

fn discs(lights: &[(Light, f64)], view: impl Into<View>) -> Scene {
    let lamps = lights.iter().enumerate().map(|(index, &(light, radius))| Lamp {
        light,
        radius,
        intensity: 0.8,
        colour: index % 2,
    });
    Scene::new(lamps.collect(), vec![colour(1.1, 2), colour(0.8, 2)], view).unwrap()
}

fn compared(name: &str, surface: &Surface<'_>, height: Option<&[f32]>, tolerance: f32) {
    let Some(gpu) = gpu() else { return };
    let low = (distant(0.8, 0.3, 0.25), 0.1);
    let lamp = (near(-30.0, 20.0, 60.0, true), 9.0);
    let point = (distant(-0.2, 0.5, 0.9), 0.0);
    let scenes: [(&[(Light, f64)], View); 4] = [
        (&[low], FRONTAL.into()),
        (&[lamp], FRONTAL.into()),
        (&[low, point, lamp], unit(0.4, -0.2, 0.9).into()),
        // As small as no lamp with a size: a point.
        (&[(point.0, 1e-4), low], View::Point(Vec3::new(20.0, -8.0, 150.0))),
    ];
    for (number, (lights, view)) in scenes.into_iter().enumerate() {
        let scene = discs(lights, view);
        let expected = agreed(&gpu, (name, number), surface, height, &scene, tolerance);
        let points: Vec<_> = lights.iter().map(|&(light, _)| (light, 0.0)).collect();
        let hard = on_cpu(surface, height, &discs(&points, view), GRID);
        let changed = encoded_difference(&expected, &hard);
        let sized = height.is_some() || !surface.lobes.is_empty();
        assert!(!sized || changed > 1e-3, "{name}, scene {number}: the size does not show");
    }
}

fn surface<'a>(maps: &'a Maps, model: Model, lobes: Vec<Lobe<'a>>) -> Surface<'a> {
    let (normal, diffuse) = (&maps.normal[..], &maps.diffuse[..]);
    Surface { normal, diffuse, model, lobes, ambient: None, coated: None }
}

#[test]
fn soft_shadows() {
    let maps = Maps::new();
    let matte = surface(&maps, Model::TorranceSparrow { index: 1.45 }, Vec::new());
    compared("matte", &matte, None, TOLERANCE);
    compared("matte, shadows", &matte, Some(&maps.height), TOLERANCE);
}

#[test]
fn torrance_sparrow_lobes_of_discs() {
    let maps = Maps::new();
    let (beta, gamma) = (Parameter::Map(&maps.beta), Parameter::Map(&maps.gamma));
    let gold =
        Lobe { strength: Strength::Tinted(&maps.gold), shape: vec![Parameter::Everywhere(0.02)] };
    let lobes = vec![Lobe { strength: Strength::Neutral(beta), shape: vec![gamma] }, gold];
    let glossy = surface(&maps, Model::TorranceSparrow { index: 1.45 }, lobes);
    compared("torrance-sparrow", &glossy, None, TOLERANCE);
    compared("torrance-sparrow, shadows", &glossy, Some(&maps.height), TOLERANCE);
}

#[test]
fn lafortune_lobes_of_discs() {
    let maps = Maps::new();
    let everywhere = Parameter::Everywhere;
    let phong = |exponent| vec![everywhere(-1.0), everywhere(1.0), exponent];
    let lobes = vec![
        Lobe { strength: Strength::Neutral(everywhere(0.5)), shape: phong(everywhere(40.0)) },
        Lobe {
            strength: Strength::Tinted(&maps.gold),
            shape: phong(Parameter::Map(&maps.exponent)),
        },
    ];
    let glossy = surface(&maps, Model::Lafortune, lobes);
    // A rounding of the base is raised to the exponent, which is at most 60.
    let tolerance = TOLERANCE + 6e-8 * 60.0;
    compared("lafortune", &glossy, None, tolerance);
    compared("lafortune, shadows", &glossy, Some(&maps.height), tolerance);
}
