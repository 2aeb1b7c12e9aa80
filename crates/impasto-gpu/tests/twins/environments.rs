//! Light of an environment against the CPU's: one comparison for each of its stages, and surfaces and
//! scenes at random.
//!
//! Both look up the same nodes with the same weights. A device may round the reciprocal square root
//! of the projection differently: a place among `size` nodes of a side is then another number of single
//! precision, up to `size * 6e-8` cells away, over which a lobe rises by no more than half of its
//! largest value per cell ([`SPACING`] of `environment/torrance_sparrow.rs`).

use std::sync::{Arc, OnceLock};

use super::common::*;
use impasto::geometry::{Light, View};
use impasto::math::Vec3;
use impasto::pixels::serially;
use impasto::relight::environment::{Environment, Map, Scheme};
use impasto::relight::scene::{Lamp, Scene, Surroundings};
use impasto::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface};

/// As of `stages.rs`, for light that is no brighter than white.
const TOLERANCE: f32 = 4e-6;

const TORRANCE_SPARROW: Model = Model::TorranceSparrow { index: 1.45 };

/// A room: every texel has a colour of its own, a window is bright, a spot brighter.
fn room() -> Arc<Environment> {
    static ROOM: OnceLock<Arc<Environment>> = OnceLock::new();
    Arc::clone(ROOM.get_or_init(|| Arc::new(built(64))))
}

fn built(width: usize) -> Environment {
    let texels = width * width / 2;
    let mut radiance: Vec<f32> =
        (0..3 * texels).map(|i| (0.25 + 0.2 * (i as f64 * 0.37).sin()) as f32).collect();
    for (channel, plane) in radiance.chunks_exact_mut(texels).enumerate() {
        for row in width / 8..width / 5 {
            for column in 5 * width / 8..6 * width / 8 {
                plane[row * width + column] = 2.0 + 0.3 * channel as f32;
            }
        }
        plane[width / 6 * width + 3 * width / 8] = 60.0 - 5.0 * channel as f32;
    }
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let map = Map::equirectangular(&radiance, width, &upright).unwrap();
    serially(|run| Environment::new(map, run)?.with_lobes(run)).unwrap()
}

fn scalar_room() -> Arc<Environment> {
    Arc::new(Environment::clone(&room()).with_scheme(Scheme::Scalar))
}

/// Lamps of strength 0.4 in an environment whose channels have the second, first and second colour.
fn around(
    environment: &Arc<Environment>,
    lights: &[Light],
    view: impl Into<View>,
    albedo: f64,
) -> Scene {
    let lamps = lights.iter().enumerate().map(|(index, &light)| Lamp {
        radius: 0.0,
        light,
        intensity: 0.4,
        colour: index % 2,
    });
    let colours = vec![colour(1.1, 2), colour(0.8, 2)];
    let surroundings =
        Surroundings { environment: Arc::clone(environment), colours: [1, 0, 1], albedo };
    Scene::surrounded(lamps.collect(), colours, view, Some(surroundings)).unwrap()
}

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

/// Under the room alone, with lamps, from the side and by a near eye.
fn compared(name: &str, surface: &Surface<'_>, room: &Arc<Environment>, height: Option<&[f32]>) {
    compared_within(TOLERANCE, name, surface, room, height);
}

fn compared_within(
    tolerance: f32,
    name: &str,
    surface: &Surface<'_>,
    room: &Arc<Environment>,
    height: Option<&[f32]>,
) {
    let Some(gpu) = gpu() else { return };
    let lamp = near(-30.0, 20.0, 60.0, true);
    let scenes: [(&[Light], View); 4] = [
        (&[], FRONTAL.into()),
        (&[distant(0.3, 0.4, 0.8), lamp], FRONTAL.into()),
        (&[lamp], unit(0.4, -0.2, 0.9).into()),
        (&[], View::Point(Vec3::new(20.0, -8.0, 150.0))),
    ];
    for (number, (lights, view)) in scenes.into_iter().enumerate() {
        let scene = around(room, lights, view, 0.4);
        agreed(&gpu, (name, number), surface, height, &scene, tolerance);
    }
}

#[test]
fn irradiance() {
    let maps = Maps::new();
    compared("irradiance", &matte(&maps), &room(), None);
    let coated = Some(CoatedDiffuse::new(1.45));
    compared("irradiance, coated", &Surface { coated, ..matte(&maps) }, &room(), None);
}

#[test]
fn torrance_sparrow_lobes() {
    let maps = Maps::new();
    let (beta, gamma) = (Parameter::Map(&maps.beta), Parameter::Map(&maps.gamma));
    let everywhere = Parameter::Everywhere;
    let coats: [&[(Strength<'_>, Parameter<'_>)]; 4] = [
        &[(Strength::Neutral(everywhere(8.0)), everywhere(0.12))],
        &[(Strength::Neutral(beta), gamma)],
        &[(Strength::Tinted(&maps.gold), everywhere(0.2))],
        // Narrower than the texels of the room, too.
        &[
            (Strength::Neutral(beta), everywhere(0.01)),
            (Strength::Tinted(&maps.gold), gamma),
            (Strength::Neutral(everywhere(2.0)), gamma),
        ],
    ];
    for (number, coat) in coats.into_iter().enumerate() {
        let lobes = coat.iter().map(|&(strength, gamma)| Lobe { strength, shape: vec![gamma] });
        let surface = Surface { lobes: lobes.collect(), ..matte(&maps) };
        compared(&format!("torrance-sparrow {number}"), &surface, &room(), None);
    }
}

fn lafortune_lobes_of(maps: &Maps) -> [Vec<Lobe<'_>>; 3] {
    let everywhere = Parameter::Everywhere;
    let phong = |exponent| vec![everywhere(-1.0), everywhere(1.0), exponent];
    let retro = vec![everywhere(0.9), everywhere(1.09), everywhere(5.0)];
    let map = Parameter::Map(&maps.exponent);
    let neutral = |strength, shape| Lobe { strength: Strength::Neutral(strength), shape };
    let gold = |shape| Lobe { strength: Strength::Tinted(&maps.gold), shape };
    [
        vec![neutral(everywhere(0.5), phong(everywhere(20.0)))],
        vec![gold(phong(map))],
        vec![gold(phong(everywhere(10.0))), neutral(everywhere(0.3), retro), gold(phong(map))],
    ]
}

#[test]
fn lafortune_lobes() {
    let maps = Maps::new();
    for (number, lobes) in lafortune_lobes_of(&maps).into_iter().enumerate() {
        let surface = Surface { model: Model::Lafortune, lobes, ..matte(&maps) };
        // |p|^n = exp(n ln |p|), as under lamps.
        let tolerance = TOLERANCE + 6e-8 * 60.0;
        let name = format!("lafortune {number}");
        compared_within(tolerance, &name, &surface, &room(), None);
        compared_within(tolerance, &format!("{name}, scalar"), &surface, &scalar_room(), None);
    }
}

/// A relief hides a part of the room and gives light back, and throws the lamps' shadows.
#[test]
fn sky_and_bounce() {
    let maps = Maps::new();
    let height = Some(&maps.height[..]);
    compared("sky", &matte(&maps), &room(), height);
    let (beta, gamma) = (Parameter::Map(&maps.beta), Parameter::Map(&maps.gamma));
    let lobes = vec![Lobe { strength: Strength::Neutral(beta), shape: vec![gamma] }];
    compared("sky, torrance-sparrow", &Surface { lobes, ..matte(&maps) }, &room(), height);
    let [_, _, lobes] = lafortune_lobes_of(&maps);
    let surface = Surface { model: Model::Lafortune, lobes, ..matte(&maps) };
    compared_within(TOLERANCE + 6e-8 * 60.0, "sky, lafortune", &surface, &room(), height);
}
