//! The passes on pixels of known lobes; samples come from the f64 model, fits are f32 lanes.

use super::*;
use crate::brdf::lafortune::{Lobe, Pair};
use crate::geometry::{Grid, Light, Rig};
use crate::lm::Options;
use crate::math::{Level, Vec3};

/// Numbers that look random and never change.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        // Knuth's MMIX generator; the upper bits are the good ones.
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (high - low).mul_add((self.0 >> 11) as f64 / (1_u64 << 53) as f64, low)
    }
    /// Nearly normal: a sum of twelve has variance 1, and no tails to speak of.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.between(-0.5, 0.5)).sum()
    }
    fn unit(&mut self, spread: f64) -> Vec3<f64> {
        Vec3::new(spread * self.normal(), spread * self.normal(), 1.0).normalised()
    }
}

/// Pixels under 100 lights, half of the views near the mirror direction.
struct Scene {
    rig: Rig,
    normals: Vec<[f32; 3]>,
    places: Vec<[f32; 2]>,
    samples: Vec<f32>,
}

const OBSERVATIONS: usize = 100;

impl Scene {
    /// Lobes `[strength, turn, ln n]` per pixel on a diffuse part of 0.3.
    fn new(noise: f64, lobes: impl Fn(usize, &mut Random) -> Vec<[f64; 3]>, pixels: usize) -> Self {
        let mut random = Random(5);
        let (mut lights, mut views) = (Vec::new(), Vec::new());
        for i in 0..OBSERVATIONS {
            let light = random.unit(0.6);
            let mut view = random.unit(0.6);
            if i % 2 == 0 {
                let off = random.unit(0.3);
                view = Vec3::new(off.x - light.x, off.y - light.y, light.z).normalised();
            }
            lights.push(Light::Distant(light));
            views.push(view);
        }
        let rig = Rig::new(lights, views, Grid::whole(pixels, 1, 1.0)).unwrap();
        let mut samples = vec![0.0; OBSERVATIONS * pixels];
        let mut normals = Vec::new();
        for pixel in 0..pixels {
            let n = random.unit(0.15).array().map(|v| v as f32);
            let normal = Vec3::new(n[0].into(), n[1].into(), n[2].into());
            let lobes = lobes(pixel, &mut random);
            for (i, (light, view)) in rig.lights().iter().zip(rig.views()).enumerate() {
                let light = light.direction();
                let view = view.direction();
                let pair = Pair::against(normal, light, view, light.dot(view));
                let sum: f64 = lobes.iter().map(|&[a, t, n]| Lobe::new(a, t, n).value(&pair)).sum();
                let value = noise.mul_add(random.normal(), pair.cosine * (0.3 + sum));
                samples[i * pixels + pixel] = value as f32;
            }
            normals.push(n);
        }
        Self { rig, normals, places: vec![[0.0; 2]; pixels], samples }
    }

    fn luminance(&self) -> Luminance<'_> {
        Luminance {
            rig: &self.rig,
            samples: &self.samples,
            stride: self.normals.len(),
            normals: &self.normals,
            places: &self.places,
        }
    }

    fn fit(&self, lobes: usize, select: bool) -> Vec<LafortuneEstimate> {
        self.fit_on(Level::detect(), lobes, select)
    }

    fn fit_on(&self, level: Level, lobes: usize, select: bool) -> Vec<LafortuneEstimate> {
        let options = Options { damping: 1.0, max_iterations: 200, ..Options::single() };
        let sequence = LafortuneSelection { lobes, select, turning: true, options };
        let pixels: Vec<usize> = (0..self.normals.len()).collect();
        sequence.fit(level, &self.luminance(), &pixels, &|| false).0
    }
}

fn three(_: usize, random: &mut Random) -> Vec<[f64; 3]> {
    let lobe = |n: f64, random: &mut Random| {
        let n = n * random.between(0.6, 1.4);
        [random.between(0.1, 0.6), random.between(-1.0, 1.0) / n, n.ln()]
    };
    vec![lobe(60.0, random), lobe(6.0, random), lobe(20.0, random)]
}

#[test]
fn three_lobes_leave_only_the_noise() {
    let found = Scene::new(0.005, three, 96).fit(3, false);
    let near = found.iter().filter(|found| {
        // 100 samples less 10 unknowns: the sum has 90 degrees of freedom, a deviation of 15 %.
        found.cost < 0.005_f64.powi(2) * 90.0 * 1.6
    });
    assert!(near.count() >= 95);
    for found in &found {
        assert!(found.at.iter().all(|value| value.is_finite()));
        assert!((1..3).all(|j| found.lobe(j - 1)[2] >= found.lobe(j)[2]), "sharpest first");
    }
}

#[test]
fn a_sequence_of_no_lobes_finds_the_diffuse_part_alone() {
    for select in [false, true] {
        let glossy = Scene::new(0.0, three, 9).fit(0, select);
        let matte = Scene::new(0.0, |_, _| Vec::new(), 9).fit(0, select);
        for found in glossy.iter().chain(&matte) {
            assert_eq!(found.lobes, 0);
            assert!(found.at[1..].iter().all(|&number| number == 0.0));
        }
        // Samples are singles, 6e-8 each, their sums doubles; what a lobe adds is taken for diffuse.
        assert!(matte.iter().all(|found| (found.at[0] / 0.3 - 1.0).abs() < 1e-7));
        assert!(glossy.iter().all(|found| found.at[0] > 0.3));
    }
}

#[test]
fn hard_case_14_one_lobe_is_not_split_in_two() {
    let one = |_: usize, random: &mut Random| {
        vec![[random.between(0.1, 0.6), 0.0, random.between(5.0, 80.0).ln()]]
    };
    let found = Scene::new(0.005, one, 100).fit(3, true);
    let single = found.iter().filter(|found| found.lobes == 1).count();
    assert!(single >= 98, "{single}");
}

#[test]
fn hard_cases_13_and_27_what_is_diffuse_has_no_lobe() {
    // A matte surface, and one with a lobe broader than a cosine.
    for lobes in [vec![], vec![[0.2, 0.0, 0.3_f64.ln()]]] {
        let found = Scene::new(0.005, |_, _| lobes.clone(), 60).fit(3, true);
        let plain = found.iter().filter(|found| found.lobes == 0).count();
        assert!(plain >= 57, "{plain}");
        for found in found {
            assert!((0..found.lobes).all(|j| found.lobe(j)[2] > 0.0), "exponents above 1");
        }
    }
}

#[test]
fn hard_case_15_no_strength_is_negative() {
    for select in [false, true] {
        for found in Scene::new(0.02, three, 96).fit(3, select) {
            assert!(found.at[0] >= 0.0);
            assert!((0..found.lobes).all(|j| found.lobe(j)[0] >= 0.0));
        }
    }
}

#[test]
fn hard_case_16_turns_stay_where_lobes_are() {
    // Mirror, off-mirror and retro-reflecting lobes: (Cxy, Cz) of Ngan's paints, and of clay.
    for (cxy, cz, n) in [(-1.0, 1.0, 40.0_f64), (-0.65, 0.42, 20.0), (0.87, 0.8, 5.0)] {
        let [turn, _] = crate::brdf::lafortune::turn_and_log_length(cxy, cz);
        let found = Scene::new(0.0, |_, _| vec![[0.4, turn, n.ln()]], 20).fit(1, false);
        for found in found {
            let [x, z, exponent] = found.shape(0);
            assert!((x * x + z * z - 2.0).abs() < 1e-12);
            assert!((exponent / n - 1.0).abs() < 0.05, "{exponent} {n}");
            assert!((z / x - cz / cxy).abs() < 0.05 * (cz / cxy).abs(), "{z} {x} {cz} {cxy}");
        }
    }
}

#[test]
fn hard_case_9_and_26_dark_and_missing_samples_weigh_nothing() {
    let mut scene = Scene::new(0.005, three, 20);
    let whole = scene.fit(3, true);
    for i in (0..OBSERVATIONS).step_by(9) {
        scene.samples[i * 20 + 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][i % 3];
    }
    let hurt = scene.fit(3, true);
    assert!(hurt[3].samples == OBSERVATIONS - OBSERVATIONS.div_ceil(9));
    assert!(hurt[3].cost.is_finite());
    for pixel in (0..20).filter(|&pixel| pixel != 3) {
        assert_eq!(hurt[pixel], whole[pixel], "{pixel}");
    }
}

#[test]
fn hard_case_14_two_lobes_of_one_are_searched_on_in_double_precision() {
    // The light of one lobe in two equal ones: single precision meets a singular matrix.
    let one = |_: usize, _: &mut Random| vec![[0.4, 0.0, 20.0_f64.ln()]];
    let scene = Scene::new(0.005, one, 20);
    let single = scene.fit(1, false);
    let mut double: Vec<_> = single
        .iter()
        .map(|found| {
            let mut twice = *found;
            twice.at[1] *= 0.5;
            twice.at.copy_within(1..4, 4);
            LafortuneEstimate { lobes: 2, cost: f64::MAX, ..twice }
        })
        .collect();
    let pixels: Vec<usize> = (0..20).collect();
    let options = Options::single();
    let data = scene.luminance();
    let search = lobes::LafortuneSearch {
        data: &data,
        turning: true,
        level: Level::detect(),
        options: &options,
        photographs: OBSERVATIONS,
        stopped: &|| false,
    };
    joint::fit_jointly(&search, &pixels, &mut double);
    for (single, double) in single.iter().zip(&double) {
        assert!(double.at.iter().all(|value| value.is_finite()));
        // More is free than in the search on the known normal: no more is left.
        assert!(double.cost <= 1.0001 * single.cost, "{} {}", double.cost, single.cost);
        assert!(double.bic() > single.bic(), "and it is not worth a lobe");
    }
}

#[test]
fn hard_case_23_a_light_opposite_the_view_turns_no_normal() {
    let mut scene = Scene::new(0.005, three, 20);
    let grazing = Vec3::new(1.0, 0.0, 0.01).normalised();
    let (mut lights, mut views) = (scene.rig.lights().to_vec(), scene.rig.views().to_vec());
    lights.push(Light::Distant(grazing));
    views.push(Vec3::new(-grazing.x, -grazing.y, -grazing.z).into());
    scene.rig = Rig::new(lights, views, Grid::whole(20, 1, 1.0)).unwrap();
    // As bright as nothing else: no half vector may be made of it.
    scene.samples.extend([100.0; 20]);
    let pixels: Vec<usize> = (0..20).collect();
    let data = scene.luminance();
    let geometries = luminance::Geometries::<f32>::all(&scene.rig);
    for pixel in 0..20 {
        assert!(data.brightest(pixel, &geometries).iter().all(|v| v.is_finite()));
    }
    let options = Options::single();
    let facing = fit_normal(Level::detect(), &data, &pixels, &options, &|| false);
    assert!(facing.iter().all(|f| f.normal.iter().all(|v| v.is_finite())));
    for found in scene.fit(3, true) {
        assert!(found.at.iter().all(|v| v.is_finite()) && found.cost.is_finite());
    }
}

#[test]
fn hard_case_24_a_view_from_behind_shows_the_diffuse_part_alone() {
    let normal = Vec3::new(0.6, 0.0, 0.8);
    let (light, view) = (Vec3::new(0.0, 0.0, 1.0), Vec3::new(-0.9, 0.0, 0.19_f64.sqrt()));
    assert!(normal.dot(view) < 0.0);
    let pair = Pair::against(normal, light, view, light.dot(view));
    assert!((pair.cosine - 0.8).abs() < 1e-15);
    for turn in [0.0, 0.3, 1.0] {
        let gradient = Lobe::new(0.5, turn, 0.5).gradient(&pair);
        assert_eq!([gradient.value, gradient.amplitude, gradient.normal], [0.0; 3]);
    }
}

#[test]
fn every_level_finds_the_same_bits() {
    let scene = Scene::new(0.005, three, 40);
    let expected = scene.fit_on(Level::Baseline, 3, true);
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        assert_eq!(scene.fit_on(level, 3, true), expected, "{level:?}");
    }
}

#[test]
fn hard_case_28_a_power_of_two_changes_no_bit_of_a_shape() {
    let mut scene = Scene::new(0.005, three, 20);
    let plain = scene.fit(3, true);
    scene.samples.iter_mut().for_each(|sample| *sample *= 1024.0);
    for (a, b) in plain.iter().zip(scene.fit(3, true)) {
        assert_eq!((a.lobes, a.at[0] * 1024.0), (b.lobes, b.at[0]));
        for lobe in 0..a.lobes {
            let ([s, t, n], [scaled, turn, exponent]) = (a.lobe(lobe), b.lobe(lobe));
            assert_eq!((s * 1024.0, t, n), (scaled, turn, exponent));
        }
    }
}
