//! One surface, many pictures: bands, display codes, shadows that are kept, and cards that fail.

use super::common::*;
use impasto::geometry::Light;
use impasto::pixels::{Progress, Run, serially};
use impasto::relight::Relief;
use impasto::relight::curve::{CELLS, Curve};
use impasto::relight::plan::{Effect, Over, Plan};
use impasto::relight::show::{Codes, Display, codes_from_planes};
use impasto::surface::{Lobe, Model, Parameter, Strength, Surface};
use impasto_gpu::{Choice, Error, Gpu, Renderer, adapters};

fn varnished(maps: &Maps) -> Surface<'_> {
    let strength = Strength::Neutral(Parameter::Map(&maps.beta));
    Surface {
        normal: &maps.normal,
        diffuse: &maps.diffuse,
        model: Model::TorranceSparrow { index: 1.45 },
        lobes: vec![Lobe { strength, shape: vec![Parameter::Map(&maps.gamma)] }],
        ambient: None,
        coated: None,
    }
}

fn rakings(count: usize) -> Vec<Light> {
    let angle = |step: usize| step as f64 * core::f64::consts::TAU / count as f64;
    (0..count).map(|step| distant(angle(step).cos(), angle(step).sin(), 0.4)).collect()
}

#[test]
fn a_painting_in_bands_is_the_painting() {
    let Some(gpu) = gpu() else { return };
    let maps = Maps::new();
    let surface = varnished(&maps);
    let lights = [distant(0.8, 0.2, 0.4), near(-30.0, 20.0, 60.0, true)];
    let scene = scene(&lights, FRONTAL);
    for height in [None, Some(&maps.height[..])] {
        let whole = on_gpu(&gpu, &surface, height, &scene, GRID);
        // Seven planes: 7 rows of 131 pixels, then one.
        for bytes in [4 * 7 * 131 * 7 + 100, 4 * 7 * 131] {
            let small = gpu.limited_to(bytes);
            let banded = on_gpu(&small, &surface, height, &scene, GRID);
            assert!(whole.light == banded.light && whole.coverage == banded.coverage, "{bytes}");
            let relief = Relief { grid: GRID, height };
            let mut renderer = Renderer::new(&small, &surface, relief).unwrap();
            let frame = serially(|run| renderer.light(&scene, BACKGROUND, run)).unwrap();
            assert!(whole.light == frame.light, "{bytes}");
        }
    }
    let relief = Relief { grid: GRID, height: None };
    let refused = Renderer::new(&gpu.limited_to(100), &surface, relief);
    assert!(matches!(refused, Err(Error::Unsupported(_))), "a row does not fit");
}

#[test]
fn what_a_plan_does_without_is_not_drawn() {
    let Some(gpu) = gpu() else { return };
    let maps = Maps::new();
    let surface = varnished(&maps);
    let scene = scene(&[distant(0.8, 0.2, 0.4)], FRONTAL);
    let relief = Relief { grid: GRID, height: Some(&maps.height) };
    let over = Over { shadows: true, parallax: true };
    let forced = Plan::forced(&surface, GRID, &scene, over).unwrap();
    let drawn = |plan: &Plan| {
        serially(|run| impasto_gpu::render(&gpu, &surface, relief, &scene, plan, BACKGROUND, run))
            .unwrap()
            .light
    };
    let matte = Surface { lobes: Vec::new(), ..surface.clone() };
    let without = drawn(&forced.clone().without(Effect::Lobe(0)));
    assert_eq!(without, on_gpu(&gpu, &matte, relief.height, &scene, GRID).light);
    let lit = drawn(&forced.clone().without(Effect::CastShadows));
    assert_eq!(lit, on_gpu(&gpu, &surface, None, &scene, GRID).light);
    assert!(drawn(&forced) != without && drawn(&forced) != lit);
}

#[test]
fn frames_follow_the_scene_and_codes_are_the_cpus() {
    let Some(gpu) = gpu() else { return };
    let maps = Maps::new();
    let surface = varnished(&maps);
    let encode = |light: f64| {
        if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
    };
    let table: Vec<f32> =
        (0..=CELLS).map(|i| encode((i as f64 / CELLS as f64).powi(2)) as f32).collect();
    // Channels of their own, so that none can stand for another.
    let three = [table.clone(), table.iter().map(|v| 0.9 * v).collect(), table].concat();
    let curve = Curve::new(&three).unwrap();
    let columns = [[1.2, -0.3, 0.1], [-0.2, 1.1, 0.0], [0.05, -0.1, 1.3]];
    let display = Display { matrix: &columns, curve: &curve };
    let relief = Relief { grid: GRID, height: Some(&maps.height) };
    let mut renderer = Renderer::new(&gpu, &surface, relief).unwrap();
    let mut codes_seen = std::collections::HashSet::new();
    for (number, light) in rakings(5).into_iter().enumerate() {
        for view in [FRONTAL, unit(0.3, 0.1, 0.9)] {
            let scene = scene(&[light], view);
            let screen = serially(|run| renderer.codes(&scene, BACKGROUND, &display, run)).unwrap();
            let picture = on_cpu(&surface, Some(&maps.height), &scene, GRID);
            assert_eq!((screen.width, screen.height), (picture.grid.width, picture.grid.height));
            let mut codes = vec![0; picture.light.len()];
            serially(|run| {
                codes_from_planes(&picture.light, &columns, &curve, Codes::Eight(&mut codes), run)
            })
            .unwrap();
            let mut different = 0;
            for ((found, expected), covered) in
                screen.codes.chunks_exact(4).zip(codes.chunks_exact(3)).zip(&picture.coverage)
            {
                assert_eq!(found[3], (255.0 * covered).round() as u8);
                for channel in 0..3 {
                    let one = found[channel].abs_diff(expected[channel]);
                    assert!(one <= 1, "{number}: {found:?} {expected:?}");
                    different += usize::from(one);
                }
            }
            // Codes differ where the light is a rounding from the middle between two.
            assert!(different < PIXELS / 1000, "{different}");
            codes_seen.insert(screen.codes);
        }
    }
    assert_eq!(codes_seen.len(), 10, "every frame is a picture of its own");
}

#[test]
fn a_wrong_call_is_refused_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let maps = Maps::new();
    let mut surface = varnished(&maps);
    let relief = Relief { grid: GRID, height: None };
    let scene = scene(&[distant(0.1, 0.2, 0.9)], FRONTAL);
    let mut renderer = Renderer::new(&gpu, &surface, relief).unwrap();
    // One coefficient where the scene has two.
    let single = impasto::relight::scene::Colour { diffuse: vec![[1.0; 3]], interface: [1.0; 3] };
    let other =
        impasto::relight::scene::Scene::new(scene.lamps()[..1].to_vec(), vec![single], FRONTAL);
    let refused = serially(|run| renderer.light(&other.unwrap(), BACKGROUND, run));
    assert!(matches!(refused, Err(Error::Refused(_))), "{refused:?}");
    let cancel = core::sync::atomic::AtomicBool::new(true);
    let progress = Progress::default();
    let level = impasto::math::Level::detect();
    let run = Run { pool: None, level, cancel: &cancel, progress: &progress };
    let stopped = renderer.light(&scene, BACKGROUND, &run);
    assert_eq!(stopped.unwrap_err(), Error::Refused(impasto::Error::Cancelled));
    let short = Relief { grid: GRID, height: Some(&maps.height[1..]) };
    assert!(matches!(Renderer::new(&gpu, &surface, short), Err(Error::Refused(_))));
    surface.lobes = vec![surface.lobes[0].clone(); 9];
    assert!(matches!(Renderer::new(&gpu, &surface, relief), Err(Error::Unsupported(_))));
}

#[test]
fn a_lost_card_is_an_error_and_a_new_one_works() {
    let Some(gpu) = gpu() else { return };
    let maps = Maps::new();
    let surface = varnished(&maps);
    let relief = Relief { grid: GRID, height: None };
    let scene = scene(&[distant(0.1, 0.2, 0.9)], FRONTAL);
    let mut renderer = Renderer::new(&gpu, &surface, relief).unwrap();
    assert!(serially(|run| renderer.light(&scene, BACKGROUND, run)).is_ok());
    assert!(gpu.is_usable());
    gpu.close();
    assert!(!gpu.is_usable());
    let lost = serially(|run| renderer.light(&scene, BACKGROUND, run));
    assert!(matches!(lost, Err(Error::DeviceLost { .. })), "{lost:?}");
    assert!(matches!(Renderer::new(&gpu, &surface, relief), Err(Error::DeviceLost { .. })));
    let again = Gpu::open(Choice::Any).unwrap();
    assert!(Renderer::new(&again, &surface, relief).is_ok());
}

#[test]
fn cards_are_listed_the_best_first() {
    let all = adapters();
    assert!(all.is_sorted_by_key(|adapter| adapter.kind));
    if gpu().is_some() {
        assert!(!all.is_empty() && all.iter().all(|adapter| adapter.largest_binding >= 1 << 27));
    }
    let nobody = Gpu::open(Choice::Named("no such card"));
    assert!(matches!(nobody, Err(Error::NoAdapter(message)) if message.contains("no such card")));
}
