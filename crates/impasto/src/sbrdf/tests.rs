//! How soon fits stop, by looks at the caller's flag instead of a clock.

use super::lafortune::{LafortuneMapsMut, LafortuneOptions, fit_lafortune};
use super::lobes::tests::{Buffers, options as lobe_options};
use super::pooled::{Extraction, PooledOptions, learn};
use super::{LobeOptions, Origin, Precision, Start, fit_lobes};
use crate::error::{Error, Result};
use crate::geometry::{Grid, Light, Rig};
use crate::math::Vec3;
use crate::pixels::{Run, looks};
use crate::stack::{Decode, Samples, Shape, Stack};
use crate::stereo::{self, Learned, Method, StereoOptions};
use crate::surface::TorranceSparrow;

const OBSERVATIONS: usize = 12;
pub(super) const SHAPE: Shape =
    Shape { observations: OBSERVATIONS, bands: 2, height: 16, width: 40 };
pub(super) const PIXELS: usize = 640;

/// One lobe for [`Painting`], fitted to all of its pixels.
pub(super) fn pooled_options(joint: bool) -> PooledOptions {
    PooledOptions {
        extraction: Extraction::Residual,
        peak: false,
        joint,
        coated: false,
        index: 1.45,
        pixels: PIXELS,
    }
}

/// A slightly curved, glossy painting of one tile.
#[derive(Clone)]
pub(super) struct Painting {
    pub(super) samples: Vec<f32>,
    pub(super) decode: Vec<Decode>,
    pub(super) rig: Rig,
    normal: Vec<f32>,
    diffuse: Vec<f32>,
    status: Vec<u8>,
}

impl Painting {
    pub(super) fn new() -> Self {
        let lights: Vec<Vec3<f64>> = (0..OBSERVATIONS)
            .map(|i| {
                let (turn, out) = (2.4 * i as f64, 0.15 + 0.06 * i as f64);
                Vec3::new(out * turn.cos(), out * turn.sin(), 1.0).normalised()
            })
            .collect();
        let normal = |pixel: usize| {
            let (x, y) = ((pixel % 40) as f64, (pixel / 40) as f64);
            Vec3::new(0.01 * (x - 20.0), 0.02 * (y - 8.0), 1.0).normalised()
        };
        let mut samples = Vec::new();
        for (i, light) in lights.iter().enumerate() {
            let half = Vec3::new(light.x, light.y, light.z + 1.0).normalised();
            for colour in [0.3_f64, 0.5] {
                samples.extend((0..PIXELS).map(|pixel| {
                    let normal = normal(pixel);
                    let glint = 0.6 * (-40.0 * (1.0 - normal.dot(half))).exp();
                    let noise = 1e-3 * ((pixel * 7919 + i * 104_729) % 101) as f64;
                    colour.mul_add(normal.dot(*light), glint + noise) as f32
                }));
            }
        }
        let plain = Decode { gain: 1.0, offset: 0.0, saturation: f32::INFINITY };
        let axis = |axis: usize| (0..PIXELS).map(move |p| normal(p).array()[axis] as f32);
        let lights = lights.into_iter().map(Light::Distant).collect();
        let views = vec![Vec3::new(0.0, 0.0, 1.0); OBSERVATIONS];
        Self {
            samples,
            decode: vec![plain; OBSERVATIONS * 2],
            rig: Rig::new(lights, views, Grid::whole(40, 16, 1.0)).unwrap(),
            normal: (0..3).flat_map(axis).collect(),
            diffuse: [[0.3; PIXELS], [0.5; PIXELS]].concat(),
            status: vec![0; PIXELS],
        }
    }

    pub(super) fn stack(&self) -> Stack<'_> {
        Stack::new(Samples::F32(&self.samples), SHAPE, &self.decode, None).unwrap()
    }

    pub(super) fn start(&self) -> Start<'_> {
        Start { normal: &self.normal, diffuse: &self.diffuse, status: &self.status }
    }

    fn pooled(&self, joint: bool, run: &Run<'_>) -> Result<()> {
        learn(&self.stack(), &self.rig, &self.start(), &pooled_options(joint), run).map(drop)
    }

    fn lobes(&self, start: Origin, precision: Precision, run: &Run<'_>) -> Result<()> {
        let options = LobeOptions { lobes: 1, precision, ..lobe_options(start) };
        let model = TorranceSparrow { index: 1.45 };
        let mut found = Buffers::new(PIXELS, 2, 1);
        let (stack, start, out) = (self.stack(), self.start(), found.maps());
        fit_lobes(&stack, &self.rig, &start, model, &options, out, run).map(drop)
    }

    fn lafortune(&self, run: &Run<'_>) -> Result<()> {
        let options = LafortuneOptions { lobes: 1, rounds: 1 };
        let mut planes = [3, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1].map(|planes| vec![0.0; planes * PIXELS]);
        let [normal, diffuse, specular, cxy, cz, exponent, strength, direction, width, rest @ ..] =
            planes.each_mut();
        let [residual, sigma] = rest;
        let maps = LafortuneMapsMut {
            normal,
            diffuse,
            specular,
            cxy,
            cz,
            exponent,
            specular_sigma: strength,
            direction_sigma: direction,
            exponent_sigma: width,
            lobes: &mut vec![0; PIXELS],
            residual,
            sigma,
            status: &mut vec![0; PIXELS],
        };
        fit_lafortune(&self.stack(), &self.rig, &self.start(), options, maps, run)
    }

    fn stereo(&self, method: Method, run: &Run<'_>) -> Result<()> {
        let (mut normal, mut albedo) = (vec![0.0; 3 * PIXELS], vec![0.0; 2 * PIXELS]);
        let (mut used, mut rejected) = (vec![0; PIXELS], vec![0; 4 * PIXELS]);
        let mut planes = [(); 3].map(|()| vec![0.0; PIXELS]);
        let [residual, condition, sigma] = planes.each_mut();
        let mut maps = stereo::NormalMaps {
            normal: &mut normal,
            albedo: &mut albedo,
            used: &mut used,
            rejected: &mut rejected,
            residual,
            condition,
            sigma,
            status: &mut vec![0; PIXELS],
        };
        let options = StereoOptions {
            method,
            steps: method.usual_steps(),
            selection: None,
            learned: Learned::default(),
        };
        stereo::fit_normals(&self.stack(), &self.rig, &options, &mut maps, run)
    }
}

type Call<'a> = &'a dyn Fn(&Run<'_>) -> Result<()>;

#[test]
fn photometric_stereo_looks_before_every_block_of_a_tile() {
    let painting = Painting::new();
    for method in [Method::LeastSquares, Method::Rank { low: 0.1, high: 0.9 }, Method::Tukey] {
        // Before the tile and after it, and before each of two blocks.
        assert_eq!(looks::count(|run| painting.stereo(method, run)), 4);
    }
}

#[test]
fn a_tile_looks_before_every_search_for_a_lobe() {
    let painting = Painting::new();
    let looks = looks::count(|run| painting.lobes(Origin::Multistart, Precision::Double, run));
    // Three tiles, each fitted twice: from three widths about two normals.
    assert!(looks > 3 * 2 * 3 * 2, "{looks}");
}

/// Wherever the flag is found set, nothing is returned, and hardly anything is done any more: a
/// tile that was left is looked at once again, and so is the fit that it is a part of.
#[test]
fn a_fit_stops_at_the_look_that_tells_it() {
    let painting = Painting::new();
    let fits: [(&str, Call<'_>); 8] = [
        ("joint", &|run| painting.pooled(true, run)),
        ("separate", &|run| painting.pooled(false, run)),
        ("multistart", &|run| painting.lobes(Origin::Multistart, Precision::Single, run)),
        ("neighbours", &|run| painting.lobes(Origin::Neighbours, Precision::Single, run)),
        ("polished", &|run| painting.lobes(Origin::Neighbours, Precision::Polished, run)),
        ("double", &|run| painting.lobes(Origin::Multistart, Precision::Double, run)),
        ("lafortune", &|run| painting.lafortune(run)),
        ("stereo", &|run| painting.stereo(Method::Tukey, run)),
    ];
    for (name, fit) in fits {
        let all = looks::count(fit);
        for last in (1..=all).step_by(all.div_ceil(25)).chain([all]) {
            let (answer, looks) = looks::stopped_at(last, fit);
            assert_eq!(answer, Err(Error::Cancelled), "{name}, look {last} of {all}");
            assert!(looks <= last + 4, "{name}: {looks} looks, stopped at {last}");
        }
    }
}
