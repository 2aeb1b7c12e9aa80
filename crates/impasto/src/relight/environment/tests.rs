//! Closed forms, brute force in double precision, and the same bits in all circumstances.

use core::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::*;
use crate::geometry::{Grid, View};
use crate::math::{Level, Vec3};
use crate::pixels::{Pool, Run, serially};
use crate::relight::plan::{Over, Plan};
use crate::relight::scene::{Colour, Scene, Surroundings};
use crate::relight::{Relief, render};
use crate::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface};

const UPRIGHT: Rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const WIDTH: usize = 32;

/// A dim sky with a few bright places, one of them behind the painting.
fn sky(width: usize) -> Vec<f32> {
    let height = width / 2;
    let mut radiance = Vec::new();
    for channel in 0..3 {
        for texel in 0..width * height {
            let bright = [height / 4 * width + width / 3, height / 3 * width + width / 2 + 3, 5];
            let dim = 0.1 + 0.05 * ((texel * (channel + 3)) % 7) as f32;
            let lamp = 20.0 / (channel + 1) as f32;
            radiance.push(if bright.contains(&texel) { lamp } else { dim });
        }
    }
    radiance
}

fn map() -> Map {
    Map::equirectangular(&sky(WIDTH), WIDTH, &UPRIGHT).unwrap()
}

/// The same, most of it dark: maps for lobes are then quick to filter.
fn dark_map() -> Map {
    let radiance: Vec<f32> =
        sky(WIDTH).iter().map(|&value| if value > 1.0 { value } else { 0.0 }).collect();
    Map::equirectangular(&radiance, WIDTH, &UPRIGHT).unwrap()
}

struct Maps {
    normal: Vec<f32>,
    diffuse: Vec<f32>,
    beta: Vec<f32>,
    gamma: Vec<f32>,
    gold: Vec<f32>,
    cxy: Vec<f32>,
    cz: Vec<f32>,
    exponent: Vec<f32>,
}

const GRID: Grid = Grid::whole(23, 13, 0.5);

fn maps() -> Maps {
    let pixels = GRID.width * GRID.height;
    let number =
        |i: usize, low: f32, high: f32| low + (high - low) * (((i * 7919) % 1009) as f32 / 1009.0);
    let plane = |seed: usize, low: f32, high: f32| -> Vec<f32> {
        (0..pixels).map(|i| number(i + 31 * seed, low, high)).collect()
    };
    let (x, y) = (plane(1, -0.5, 0.5), plane(2, -0.5, 0.5));
    let z: Vec<f32> = x.iter().zip(&y).map(|(x, y)| (1.0 - x * x - y * y).sqrt()).collect();
    Maps {
        normal: [x, y, z].concat(),
        diffuse: [plane(3, 0.1, 0.9), plane(4, 0.1, 0.9), plane(5, 0.1, 0.9)].concat(),
        beta: plane(6, 0.0, 2.0),
        gamma: plane(7, 0.05, 0.4),
        gold: [plane(8, 0.1, 1.0), plane(9, 0.1, 0.7), plane(10, 0.0, 0.2)].concat(),
        cxy: plane(11, -1.1, -0.9),
        cz: plane(12, 0.9, 1.1),
        exponent: plane(13, 3.0, 60.0),
    }
}

fn surface(maps: &Maps, model: Model) -> Surface<'_> {
    let lobes = match model {
        Model::TorranceSparrow { .. } => vec![
            Lobe {
                strength: Strength::Neutral(Parameter::Map(&maps.beta)),
                shape: vec![Parameter::Map(&maps.gamma)],
            },
            Lobe {
                strength: Strength::Tinted(&maps.gold),
                shape: vec![Parameter::Everywhere(0.2)],
            },
        ],
        Model::Lafortune => {
            [Strength::Neutral(Parameter::Map(&maps.beta)), Strength::Tinted(&maps.gold)]
                .map(|strength| Lobe {
                    strength,
                    shape: vec![
                        Parameter::Map(&maps.cxy),
                        Parameter::Map(&maps.cz),
                        Parameter::Map(&maps.exponent),
                    ],
                })
                .to_vec()
        }
    };
    Surface {
        normal: &maps.normal,
        diffuse: &maps.diffuse,
        model,
        lobes,
        ambient: None,
        coated: None,
    }
}

/// Each band lit by its own channel.
fn colours() -> Vec<Colour> {
    (0..3)
        .map(|channel| {
            let only = |band| if band == channel { 1.0 } else { 0.0 };
            let interface = [only(0), only(1), only(2)];
            let diffuse =
                (0..3).map(|band| if band == channel { interface } else { [0.0; 3] }).collect();
            Colour { diffuse, interface }
        })
        .collect()
}

fn scene(environment: Environment, view: impl Into<View>) -> Scene {
    let environment = Arc::new(environment);
    let around = Surroundings { environment, colours: [0, 1, 2], albedo: 0.0 };
    Scene::surrounded(Vec::new(), colours(), view, Some(around)).unwrap()
}

fn lit(surface: &Surface<'_>, grid: Grid, scene: &Scene, run: &Run<'_>) -> Vec<f32> {
    let plan = Plan::forced(surface, grid, scene, Over::default()).unwrap();
    render(surface, Relief { grid, height: None }, scene, &plan, [9.0; 3], run).unwrap().light
}

const VIEW: Vec3<f64> = Vec3::new(0.0, 0.0, 1.0);
const VARNISH: Model = Model::TorranceSparrow { index: 1.45 };

#[test]
fn an_even_sky_shows_a_white_board_as_white() {
    let radiance = vec![1.0 / PI as f32; 3 * 128 * 64];
    let map = Map::equirectangular(&radiance, 128, &UPRIGHT).unwrap();
    let environment = serially(|run| Environment::new(map, run)).unwrap();
    for (tilt, azimuth) in [(0.0_f64, 0.0_f64), (0.3, 1.0), (0.9, 4.0), (1.2, 2.0)] {
        let normal = Vec3::new(tilt.sin() * azimuth.cos(), tilt.sin() * azimuth.sin(), tilt.cos());
        let found = serially(|run| environment.irradiance(normal, run)).unwrap();
        // What a facet sees of a hemisphere that the wall clips: (1 + cos) / 2. The midpoints of texels
        // of 0.049 rad are off by 0.049^2 / 24, twice; those on the facet's horizon by a little more.
        for value in found {
            assert!((value / (0.5 * (1.0 + tilt.cos())) - 1.0).abs() < 5e-4, "{tilt} {value}");
        }
    }
}

#[test]
fn lobes_of_an_even_sky_have_their_closed_form() {
    let map = Map::equirectangular(&vec![1.0; 3 * 128 * 64], 128, &UPRIGHT).unwrap();
    // Lobes about z: the clipped half is dark for them anyway.
    for level in 0..lafortune::LEVELS {
        let n = (0.5 * level as f64 - 1.0).exp2();
        let found = lafortune::about_z(&map, level);
        for channel in 0..3 {
            // Sums over texels of 0.049 rad of a function as narrow as 1 / sqrt(n): exact to
            // exp(-2 (pi / 0.049)^2 / n) for sharp lobes, to 0.049^2 / 12 (n + 2) for broad ones.
            let tolerance = 2e-4 * (n + 2.0).min(12.0) + 5.0 * (-8000.0 / n).exp();
            assert!((found[8 + channel] / TAU - 1.0).abs() < tolerance, "{n} {found:?}");
            let scalar = TAU * (n + 2.0) / (n + 1.0);
            assert!((found[12 + channel] / scalar - 1.0).abs() < tolerance, "{n} {found:?}");
            assert!(found[channel].abs() < 1e-4 && found[4 + channel].abs() < 1e-4);
        }
    }
}

#[test]
fn every_level_and_any_threads_give_the_same_bits() {
    let maps = maps();
    let pool = Pool::new(3).unwrap();
    for (model, sky) in [(VARNISH, map()), (Model::Lafortune, dark_map())] {
        let surface = surface(&maps, model);
        let kept = serially(|run| {
            let environment = Environment::new(sky.clone(), run).unwrap();
            if model == Model::Lafortune {
                environment.with_lobes(run).unwrap()
            } else {
                environment
            }
        });
        let mut answers = Vec::new();
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            answers.push(serially(|run| {
                let run = Run { level, ..*run };
                let built = Environment::new(sky.clone(), &run).unwrap();
                assert_eq!(built.irradiance, kept.irradiance);
                lit(&surface, GRID, &scene(kept.clone(), VIEW), &run)
            }));
        }
        answers.push(serially(|run| {
            let run = Run { pool: Some(&pool), ..*run };
            let built = Environment::new(sky.clone(), &run).unwrap();
            // Those that were kept are those that are built.
            let built = match kept.lobes() {
                None => built,
                Some(nodes) => {
                    assert!(built.clone().with_lobes(&run).unwrap().lobes() == Some(nodes));
                    built.with_kept_lobes(nodes.to_vec()).unwrap()
                }
            };
            lit(&surface, GRID, &scene(built, VIEW), &run)
        }));
        assert!(answers[0].iter().all(|value| value.is_finite()));
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

#[test]
fn filters_have_the_same_bits_at_every_level() {
    let map = map();
    for level in [0, 3, 12, 23] {
        let mut answers = Vec::new();
        for isa in Level::ALL.into_iter().filter(|level| level.available()) {
            answers.push(lafortune::group_at(&map, level, isa));
        }
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

#[test]
fn a_pixel_does_not_know_its_neighbours_and_nan_stays_where_it_is() {
    let mut maps = maps();
    let [whole, part] = [map(), map()].map(|map| {
        let environment = serially(|run| Environment::new(map, run)).unwrap();
        scene(environment, VIEW)
    });
    let all = serially(|run| lit(&surface(&maps, VARNISH), GRID, &whole, run));
    let pixels = GRID.width * GRID.height;
    let at = 77;
    let one = |map: &[f32]| vec![map[at]];
    let three = |map: &[f32]| [0, 1, 2].map(|plane| map[plane * pixels + at]).to_vec();
    let single = Maps {
        normal: three(&maps.normal),
        diffuse: three(&maps.diffuse),
        beta: one(&maps.beta),
        gamma: one(&maps.gamma),
        gold: three(&maps.gold),
        cxy: one(&maps.cxy),
        cz: one(&maps.cz),
        exponent: one(&maps.exponent),
    };
    let grid = Grid::whole(1, 1, 0.5);
    let alone = serially(|run| lit(&surface(&single, VARNISH), grid, &part, run));
    assert_eq!(alone, three(&all));
    // A missing normal, a missing width and one that does not matter.
    maps.normal[40] = f32::NAN;
    maps.gamma[41] = f32::NAN;
    (maps.gamma[42], maps.beta[42]) = (f32::NAN, 0.0);
    let holed = serially(|run| lit(&surface(&maps, VARNISH), GRID, &whole, run));
    for channel in 0..3 {
        for pixel in 0..pixels {
            let (before, after) = (all[channel * pixels + pixel], holed[channel * pixels + pixel]);
            match pixel {
                40 | 41 => assert_eq!(after, 9.0),
                42 => assert!(after < before),
                _ => assert_eq!(after, before),
            }
        }
    }
}

#[test]
fn awkward_numbers_stay_finite() {
    let mut maps = maps();
    let pixels = GRID.width * GRID.height;
    let normals =
        [[1.0, 0.0, 0.0], [0.0, -1.0, 1e-30], [0.0, 0.0, 2.0], [0.3, 0.3, 0.3], [0.6, 0.0, -0.8]];
    for (pixel, normal) in normals.into_iter().enumerate() {
        for (axis, value) in normal.into_iter().enumerate() {
            maps.normal[axis * pixels + pixel] = value;
        }
    }
    (maps.gamma[9], maps.gamma[10], maps.gamma[11]) = (0.0, 1e9, -1.0);
    (maps.exponent[9], maps.exponent[10], maps.exponent[11]) = (16_600.0, 0.0, 1e30);
    (maps.cxy[12], maps.cz[12]) = (0.0, 0.0);
    (maps.cxy[13], maps.cz[13], maps.exponent[13]) = (1e3, -1e3, 5000.0);
    for view in [VIEW, Vec3::new(0.999, 0.0, 0.04).normalised()] {
        for model in [VARNISH, Model::Lafortune] {
            let environment = serially(|run| Environment::new(dark_map(), run)).unwrap();
            let mut surface = surface(&maps, model);
            surface.coated = Some(CoatedDiffuse::new(1.45));
            let found = serially(|run| lit(&surface, GRID, &scene(environment, view), run));
            assert!(found.iter().all(|value| value.is_finite() && *value >= 0.0 && *value != 9.0));
        }
    }
}

#[test]
fn a_near_eye_sees_torrance_sparrow_lobes_as_from_the_middle_and_others_from_each_pixel() {
    let maps = maps();
    let environment = || serially(|run| Environment::new(dark_map(), run)).unwrap();
    // In front: a picture from the side has other pixels.
    let place = Vec3::new(0.0, 0.0, 40.0);
    let seen = |model, view: View| {
        let around = scene(environment(), view);
        serially(|run| lit(&surface(&maps, model), GRID, &around, run))
    };
    let directed = |model| seen(model, View::Distant(place.normalised()));
    assert_eq!(seen(VARNISH, View::Point(place)), directed(VARNISH));
    assert_ne!(seen(Model::Lafortune, View::Point(place)), directed(Model::Lafortune));
}
