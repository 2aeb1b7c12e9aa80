//! Pixels and scenes at the ends of what the formulas allow: finite, and what the CPU shows.

use super::common::*;
use impasto::geometry::Grid;
use impasto::math::Vec3;
use impasto::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface};

/// Light differs by a handful of roundings of 6e-8 of the brightest lobe here, 1e3.
fn close(surface: &Surface<'_>, scene: &impasto::relight::scene::Scene, grid: Grid, what: &str) {
    let Some(gpu) = gpu() else { return };
    let expected = on_cpu(surface, None, scene, grid);
    let found = on_gpu(&gpu, surface, None, scene, grid);
    assert_eq!(expected.coverage, found.coverage, "{what}");
    for (a, b) in expected.light.iter().zip(&found.light) {
        assert!(b.is_finite() && (a - b).abs() <= 1e-6 * a.abs().max(1.0), "{what}: {a} {b}");
    }
}

/// Normals one by one, of a row of pixels.
fn normals(all: &[Vec3<f64>]) -> Vec<f32> {
    let plane = |axis: usize| all.iter().map(move |n| n.array()[axis] as f32);
    (0..3).flat_map(plane).collect()
}

fn awkward_normals() -> Vec<f32> {
    normals(&[
        Vec3::new(0.0, 0.0, 1.0),
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(1.0, 0.0, 1e-30),
        Vec3::new(-0.8, 0.0, 0.6),
        Vec3::new(0.0, 0.0, -1.0),
        Vec3::new(0.0, 0.0, 2.0),
        Vec3::new(0.3, -0.2, 0.1),
        Vec3::new(0.0, 0.0, 0.0),
        Vec3::new(f64::NAN, 0.0, 1.0),
        Vec3::new(0.0, f64::NAN, f64::NAN),
        Vec3::new(f64::INFINITY, 0.0, 1.0),
        unit(0.9, 0.1, 0.0001),
    ])
}

#[test]
fn grazing_opposed_and_overhead_directions() {
    let normal = awkward_normals();
    let pixels = normal.len() / 3;
    let grid = Grid::whole(pixels, 1, 0.5);
    let diffuse = vec![0.5; 2 * pixels];
    let everywhere = Parameter::Everywhere;
    let lafortune = [-1.0, 1.0, 16_600.0].map(everywhere).to_vec();
    let views = [FRONTAL, unit(0.9, 0.0, 1e-3), unit(-1.0, 0.0, 1e-6)];
    let lights = [
        distant(0.0, 0.0, 1.0),
        distant(1.0, 0.0, 1e-3),
        distant(1.0, 0.0, 1e-6),
        distant(-0.5, 0.5, 0.7),
    ];
    for gamma in [0.0, 5e-4, 1.25, 1e9, -1.0] {
        for beta in [0.0, 200.0] {
            let lobes = |shape: Vec<Parameter<'static>>| {
                vec![Lobe { strength: Strength::Neutral(everywhere(beta)), shape }]
            };
            let torrance_sparrow = Surface {
                normal: &normal,
                diffuse: &diffuse,
                model: Model::TorranceSparrow { index: 1.45 },
                lobes: lobes(vec![everywhere(gamma)]),
                ambient: None,
                coated: Some(CoatedDiffuse::new(1.45)),
            };
            let lafortune = Surface {
                model: Model::Lafortune,
                lobes: lobes(lafortune.clone()),
                coated: None,
                ..torrance_sparrow.clone()
            };
            // A near eye sees the painting's own pixels from any side.
            for view in views.map(|view| impasto::geometry::View::Point(view.scale(1e9))) {
                let what = format!("{gamma} {beta} {view:?}");
                close(&torrance_sparrow, &scene(&lights, view), grid, &what);
                if gamma == 0.0 {
                    close(&lafortune, &scene(&lights[..1], view), grid, &what);
                }
            }
        }
    }
}

#[test]
fn no_number_is_shown_as_the_background_and_nowhere_else() {
    const NAN: f32 = f32::NAN;
    const INFINITE: f32 = f32::INFINITY;
    let pixels = 8;
    let grid = Grid::whole(4, 2, 0.5);
    let normal = normals(&vec![Vec3::new(0.0, 0.0, 1.0); pixels]);
    let mut diffuse = vec![0.5; 2 * pixels];
    (diffuse[0], diffuse[pixels + 1]) = (NAN, INFINITE);
    // Strength and width: no lobe needs no width, a lobe does, and a strength is needed always.
    let beta = [1.0, 1.0, 0.0, 0.0, 1.0, NAN, INFINITE, 1.0];
    let gamma = [0.1, 0.1, NAN, INFINITE, NAN, 0.1, 0.1, INFINITE];
    let tint: Vec<f32> = beta.iter().chain(&[0.0; 8]).copied().collect();
    let strengths = [Strength::Neutral(Parameter::Map(&beta)), Strength::Tinted(&tint)];
    for strength in strengths {
        let shape = vec![Parameter::Map(&gamma)];
        let surface = Surface {
            normal: &normal,
            diffuse: &diffuse,
            model: Model::TorranceSparrow { index: 1.45 },
            lobes: vec![Lobe { strength, shape }],
            ambient: None,
            coated: None,
        };
        let scene = scene(&[distant(0.1, 0.1, 0.9), near(9.0, 2.0, 50.0, true)], FRONTAL);
        close(&surface, &scene, grid, "maps without numbers");
        let Some(gpu) = gpu() else { return };
        let picture = on_gpu(&gpu, &surface, None, &scene, grid);
        assert_eq!(picture.coverage, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(picture.light[5], BACKGROUND[0]);
    }
    let mut ambient = vec![0.1; 2 * pixels];
    ambient[pixels + 6] = NAN;
    let plain = vec![0.5; 2 * pixels];
    let surface = Surface {
        normal: &normal,
        diffuse: &plain,
        model: Model::Lafortune,
        lobes: Vec::new(),
        ambient: Some(&ambient),
        coated: None,
    };
    close(&surface, &scene(&[distant(0.1, 0.1, 0.9)], FRONTAL), grid, "ambient");
}

#[test]
fn one_pixel() {
    let (normal, diffuse) = (normals(&[Vec3::new(0.0, 0.0, 1.0)]), [0.5; 2]);
    let strength = Strength::Neutral(Parameter::Everywhere(4.0));
    let surface = Surface {
        normal: &normal,
        diffuse: &diffuse,
        model: Model::TorranceSparrow { index: 1.45 },
        lobes: vec![Lobe { strength, shape: vec![Parameter::Everywhere(0.1)] }],
        ambient: None,
        coated: None,
    };
    let grid = Grid::whole(1, 1, 0.5);
    let lights = [distant(0.0, 0.6, 0.8), near(1.0, 2.0, 30.0, true)];
    close(&surface, &scene(&lights, FRONTAL), grid, "one pixel");
    let Some(gpu) = gpu() else { return };
    let scene = scene(&lights, FRONTAL);
    let height = Some(&[0.5_f32][..]);
    let (a, b) =
        (on_cpu(&surface, height, &scene, grid), on_gpu(&gpu, &surface, height, &scene, grid));
    assert!(encoded_difference(&a, &b) < 4e-6);
}
