//! A painting fitted tile by tile is the painting fitted as a whole.

use super::*;
use crate::brdf::coated_diffuse::CoatedDiffuse;
use crate::error::Error;
use crate::geometry::{Grid, Light, Rig};
use crate::math::Vec3;
use crate::pixels::serially;
use crate::sbrdf::Start;
use crate::stack::{Decode, Samples, Shape, Stack};
use crate::surface::TorranceSparrow;

const WIDTH: usize = 43;
const HEIGHT: usize = 29;
const LIGHTS: usize = 14;
const BANDS: usize = 2;
const LOBES: usize = 2;
/// Distance of two normals in standard deviations that ends of searches explain. A search ends where a
/// step lowers the cost by a millionth: of 24 degrees of freedom that is a step of 0.005 deviations,
/// and weights that follow the residuals make a few such steps of it. Weights of outliers have more
/// than one fixed point, so that some pixels lie further apart.
const NEAR: f64 = 0.02;
const MODEL: TorranceSparrow = TorranceSparrow { index: 1.45 };

/// Maps of some pixels in memory of their own.
pub(in crate::sbrdf) struct Buffers {
    planes: [Vec<f32>; 8],
    codes: [Vec<u8>; 4],
}

impl Buffers {
    /// With numbers in them that no fit may leave.
    pub(in crate::sbrdf) fn new(pixels: usize, bands: usize, lobes: usize) -> Self {
        let planes = [3, bands, bands, lobes * bands, lobes, lobes, 1, 1];
        Self {
            planes: planes.map(|planes| vec![-7.0; planes * pixels]),
            codes: [lobes, 1, 1, 1].map(|planes| vec![77; planes * pixels]),
        }
    }

    pub(in crate::sbrdf) fn maps(&mut self) -> LobeMapsMut<'_> {
        let [normal, diffuse, ambient, specular, parameters, deviation, residual, sigma] =
            &mut self.planes;
        let [tinted, lobes, converged, status] = &mut self.codes;
        LobeMapsMut {
            normal,
            diffuse,
            ambient,
            specular,
            parameters,
            deviation,
            tinted,
            lobes,
            residual,
            sigma,
            converged,
            status,
        }
    }

    /// The bits of all planes.
    fn bits(&self) -> Vec<u32> {
        let planes = self.planes.iter().flatten().map(|value| value.to_bits());
        planes.chain(self.codes.iter().flatten().map(|&code| u32::from(code))).collect()
    }

    /// The same of a tile of a painting of [`WIDTH`] by [`HEIGHT`] pixels.
    fn cut(&self, tile: Grid) -> Self {
        Self {
            planes: self.planes.each_ref().map(|map| cut(map, tile)),
            codes: self.codes.each_ref().map(|map| cut(map, tile)),
        }
    }
}

/// A tile of a map.
fn cut<T: Copy>(map: &[T], tile: Grid) -> Vec<T> {
    let rows = map
        .chunks(WIDTH * HEIGHT)
        .flat_map(|plane| plane.chunks(WIDTH).skip(tile.origin[1]).take(tile.height));
    rows.flat_map(|row| &row[tile.origin[0]..][..tile.width]).copied().collect()
}

/// A painting, or a tile of one: two varnishes under lamps, of which some are near.
struct Scene {
    grid: Grid,
    samples: Vec<f32>,
    normal: Vec<f32>,
    diffuse: Vec<f32>,
    status: Vec<u8>,
}

impl Scene {
    fn whole() -> Self {
        let grid = Grid::whole(WIDTH, HEIGHT, 1.0);
        let pixels = WIDTH * HEIGHT;
        let normal = |pixel: usize| {
            let t = pixel as f64;
            Vec3::new(0.15 * (0.71 * t).sin(), 0.15 * (0.37 * t).cos(), 1.0).normalised()
        };
        let [mut x, mut y] = [(); 2].map(|()| vec![0.0; pixels]);
        grid.coordinates(0, &mut x, &mut y);
        let mut samples = Vec::new();
        for (number, light) in lights().iter().enumerate() {
            for colour in [0.3, 0.5] {
                samples.extend((0..pixels).map(|pixel| {
                    let (towards, _) = light.at(f64::from(x[pixel]), f64::from(y[pixel]));
                    let half = (towards + Vec3::new(0.0, 0.0, 1.0)).normalised();
                    let sharpness = if pixel % WIDTH < 20 { 60.0 } else { 25.0 };
                    let glint = 0.6 * (sharpness * (normal(pixel).dot(half) - 1.0)).exp();
                    let noise = 1e-5 * ((pixel * 7919 + number * 104_729) % 101) as f64;
                    (colour * normal(pixel).dot(towards).max(0.0) + glint + noise) as f32
                }));
            }
        }
        let mut status = vec![0; pixels];
        // A seed that cannot be fitted, and pixels without a fit.
        status[8 * WIDTH + 12] = 32;
        status[500..503].fill(32);
        Self {
            grid,
            samples,
            normal: (0..3)
                .flat_map(|axis| (0..pixels).map(move |p| normal(p).array()[axis] as f32))
                .collect(),
            diffuse: [vec![0.3; pixels], vec![0.5; pixels]].concat(),
            status,
        }
    }

    fn cut(&self, tile: Grid) -> Self {
        Self {
            grid: tile,
            samples: cut(&self.samples, tile),
            normal: cut(&self.normal, tile),
            diffuse: cut(&self.diffuse, tile),
            status: cut(&self.status, tile),
        }
    }

    /// Calls `work` with what a fit takes.
    fn with<A>(&self, work: impl FnOnce(&Stack<'_>, &Rig, &Start<'_>) -> A) -> A {
        let Grid { width, height, .. } = self.grid;
        let shape = Shape { observations: LIGHTS, bands: BANDS, height, width };
        let decode = [Decode { gain: 1.0, offset: 0.0, saturation: f32::INFINITY }; LIGHTS * BANDS];
        let stack = Stack::new(Samples::F32(&self.samples), shape, &decode, None).unwrap();
        let rig = Rig::new(lights(), vec![Vec3::new(0.0, 0.0, 1.0); LIGHTS], self.grid).unwrap();
        let start = Start { normal: &self.normal, diffuse: &self.diffuse, status: &self.status };
        work(&stack, &rig, &start)
    }
}

fn lights() -> Vec<Light> {
    (0..LIGHTS)
        .map(|i| {
            let (turn, out) = (2.4 * i as f64, 0.15 + 0.05 * i as f64);
            let direction = Vec3::new(out * turn.cos(), out * turn.sin(), 1.0).normalised();
            if i % 3 == 0 {
                Light::Point { position: direction.scale(120.0), falloff: false }
            } else {
                Light::Distant(direction)
            }
        })
        .collect()
}

pub(in crate::sbrdf) fn options(start: Origin) -> LobeOptions {
    LobeOptions {
        lobes: LOBES,
        ambient: true,
        coated: None,
        normal: true,
        bounded: true,
        rounds: 1,
        typical: true,
        sparing: true,
        iterations: 4,
        colour_iterations: 4,
        start,
        precision: Precision::Single,
    }
}

/// What a fit of the whole finds, and what it has learned.
fn fit_whole(scene: &Scene, options: &LobeOptions) -> (Buffers, LearnedLobes) {
    let mut whole = Buffers::new(WIDTH * HEIGHT, BANDS, LOBES);
    let learned = scene.with(|stack, rig, start| {
        serially(|run| fit_lobes(stack, rig, start, MODEL, options, whole.maps(), run))
    });
    (whole, learned.unwrap())
}

fn apply(scene: &Scene, learned: &LearnedLobes, tile: Grid) -> Result<Buffers, Error> {
    let mut part = Buffers::new(tile.width * tile.height, BANDS, LOBES);
    scene.with(|stack, rig, start| {
        serially(|run| apply_lobes(learned, stack, rig, start, MODEL, tile, part.maps(), run))
    })?;
    Ok(part)
}

#[test]
fn tiles_are_the_whole_bit_for_bit() {
    let scene = Scene::whole();
    let varnish = Some(CoatedDiffuse::new(1.45));
    for (start, coated, colour_iterations) in [
        (Origin::Neighbours, None, 4),
        (Origin::Multistart, None, 4),
        (Origin::Neighbours, varnish, 4),
        (Origin::NeighboursOnly, None, 4),
        (Origin::Neighbours, None, 1),
    ] {
        let options = LobeOptions { coated, colour_iterations, ..options(start) };
        let (whole, learned) = fit_whole(&scene, &options);
        assert!(whole.codes[1].iter().filter(|&&lobes| lobes > 0).count() > 1000);
        // Saved and read again.
        let numbers = learned.prior().unwrap();
        assert!(numbers.counts.iter().any(|&count| count > 0));
        let again = LearnedLobes::new(learned.options, learned.pixels, Some(&numbers)).unwrap();
        assert_eq!(again.prior(), Some(numbers));
        assert_eq!(apply(&scene, &again, scene.grid).unwrap().bits(), whole.bits());
        for (origin, width, height) in [
            ([0, 0], 17, 11),
            ([17, 0], 26, 11),
            ([5, 9], 7, 1),
            ([3, 13], 40, 16),
            ([42, 28], 1, 1),
        ] {
            let tile = scene.grid.tile(origin, width, height).unwrap();
            let halo = if start == Origin::Multistart { 0 } else { HALO };
            let from = origin.map(|start| start.saturating_sub(halo));
            let [right, below] = [origin[0] + width + halo, origin[1] + height + halo];
            let wide = scene
                .grid
                .tile(from, right.min(WIDTH) - from[0], below.min(HEIGHT) - from[1])
                .unwrap();
            let part = apply(&scene.cut(wide), &again, tile).unwrap();
            assert_eq!(part.bits(), whole.cut(tile).bits(), "{start:?} {tile:?}");
        }
    }
}

/// Rounds of one step and rounds of whole searches have the same fixed point.
#[test]
fn fused_rounds_end_where_searches_end() {
    let scene = Scene::whole();
    // Searches in single precision leave out what noise hides: the last ones go on in double.
    let ways = [(1, Precision::Single), (6, Precision::Polished)];
    let [fused, searched] = ways.map(|(colour_iterations, precision)| {
        let options = LobeOptions { colour_iterations, precision, ..options(Origin::Neighbours) };
        fit_whole(&scene, &LobeOptions { rounds: 40, typical: false, ..options }).0
    });
    let pixels = WIDTH * HEIGHT;
    let fitted: Vec<usize> = (0..pixels)
        .filter(|&pixel| fused.codes[3][pixel] < 32 && searched.codes[3][pixel] < 32)
        .collect();
    // The lobes are chosen before the rounds; the last of them may fade in one and not in the other.
    let same = |&&pixel: &&usize| fused.codes[1][pixel] == searched.codes[1][pixel];
    let kept: Vec<usize> = fitted.iter().filter(same).copied().collect();
    assert!(kept.len() > fitted.len() * 95 / 100, "{} of {}", kept.len(), fitted.len());
    let sigma = &searched.planes[7];
    let mut apart: Vec<f64> = kept
        .iter()
        .map(|pixel| {
            let off = |axis: usize| {
                let at = axis * pixels + pixel;
                f64::from(fused.planes[0][at] - searched.planes[0][at])
            };
            (0..3).map(|axis| off(axis) * off(axis)).sum::<f64>().sqrt() / f64::from(sigma[*pixel])
        })
        .collect();
    apart.sort_by(f64::total_cmp);
    let within = |limit: f64| apart.partition_point(|&one| one < limit) * 100 / apart.len();
    assert!(within(NEAR) > 50, "{} %", within(NEAR));
    assert!(within(5.0 * NEAR) > 90, "{} %", within(5.0 * NEAR));
}

#[test]
fn a_tile_without_what_is_around_it_is_refused() {
    let scene = Scene::whole();
    let (_, learned) = fit_whole(&scene, &options(Origin::Neighbours));
    let tile = scene.grid.tile([5, 9], 7, 4).unwrap();
    let refused = |scene: &Scene, tile: Grid| match apply(scene, &learned, tile) {
        Err(error) => error.to_string(),
        Ok(_) => String::new(),
    };
    assert!(refused(&scene.cut(tile), tile).contains(&format!("{HALO} pixels farther")));
    // The stack lacks pixels of the tile itself.
    let elsewhere = scene.grid.tile([7, 9], 20, 8).unwrap();
    assert!(refused(&scene.cut(elsewhere), tile).contains("reach beyond"));
}

#[test]
fn a_part_tells_what_is_typical_too() {
    let scene = Scene::whole();
    let part = scene.cut(scene.grid.tile([2, 3], 39, 25).unwrap());
    let learn = |scene: &Scene, options: &LobeOptions| {
        scene.with(|stack, rig, start| {
            serially(|run| learn_lobes(stack, rig, start, MODEL, options, run))
        })
    };
    let learned = learn(&part, &options(Origin::Neighbours)).unwrap();
    // Columns 4 to 40 and rows 4 to 24, every fourth, but for the one that cannot be fitted.
    assert_eq!(learned.pixels, 10 * 6 - 1);
    assert_eq!(learned.options.start, Origin::Neighbours);
    // Too few seeds for a prior: multistart, and all pixels tell what is typical.
    let small = scene.cut(scene.grid.tile([24, 3], 15, 10).unwrap());
    let learned = learn(&small, &options(Origin::Neighbours)).unwrap();
    // Three of them cannot be fitted.
    assert_eq!((learned.options.start, learned.pixels), (Origin::Multistart, 15 * 10 - 3));
}

#[test]
fn numbers_that_are_no_prior_are_refused() {
    let (_, learned) = fit_whole(&Scene::whole(), &options(Origin::Neighbours));
    let numbers = learned.prior().unwrap();
    let refused = |change: &dyn Fn(&mut PriorNumbers)| {
        let mut numbers = numbers.clone();
        change(&mut numbers);
        LearnedLobes::new(learned.options, learned.pixels, Some(&numbers)).is_err()
    };
    assert!(!refused(&|_| {}));
    assert!(refused(&|numbers| numbers.counts[0] = 33));
    assert!(refused(&|numbers| numbers.shapes.truncate(5)));
    assert!(refused(&|numbers| numbers.shapes[0] = f32::NAN));
    assert!(refused(&|numbers| numbers.variances[0] = -1.0));
    assert!(LearnedLobes::new(learned.options, learned.pixels, None).is_err());
}
