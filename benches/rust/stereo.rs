//! Normals from sixteen photographs of one band and 16 bits, by every method, on one thread; and
//! least squares by the product with the pseudo-inverse, which one would write first.

use divan::{Bencher, counter::ItemsCount};
use impasto::geometry::Rig;
use impasto::pixels::serially;
use impasto::stack::{Decode, Samples, Shape, Stack};
use impasto::stereo::{Learned, Method, NormalMaps, StereoOptions, fit_normals};
use impasto::surface::{Lobe, Model, Parameter, Strength, Surface, predict};
use nalgebra::{Matrix3, Vector3};

use crate::painting::{LIGHTS, SIDE, diffuse, normal, rig};

const PIXELS: usize = SIDE * SIDE;
const SHAPE: Shape = Shape { observations: LIGHTS, bands: 1, height: SIDE, width: SIDE };
const DECODE: Decode = Decode { gain: 1.0 / 65535.0, offset: 0.0, saturation: 65535.0 };
const LOW: f64 = 0.2;
const HIGH: f64 = 0.8;

const METHODS: [(&str, Method); 9] = [
    ("least squares", Method::LeastSquares),
    ("threshold", Method::Threshold { w1: 1.2, w2: 0.1 }),
    ("rank", Method::Rank { low: LOW, high: HIGH }),
    ("robust", Method::Robust),
    ("trimmed", Method::Trimmed { low: LOW, high: HIGH }),
    ("L1", Method::L1),
    ("Huber", Method::Huber),
    ("Cauchy", Method::Cauchy),
    ("Tukey", Method::Tukey),
];

/// Codes of a glossy painting: a highlight of up to the diffuse part, clipped nowhere.
fn photographs(rig: &Rig) -> Vec<u16> {
    let (normal, diffuse) = (normal(), diffuse(1));
    let surface = Surface {
        normal: &normal,
        diffuse: &diffuse,
        coated: None,
        model: Model::TorranceSparrow { index: 1.45 },
        lobes: vec![Lobe {
            strength: Strength::Neutral(Parameter::Everywhere(12.0)),
            shape: vec![Parameter::Everywhere(0.12)],
        }],
        ambient: None,
    };
    let mut samples = vec![0.0; LIGHTS * PIXELS];
    serially(|run| predict(&surface, rig, &[0.6; LIGHTS], &mut samples, run)).expect("it fits");
    samples.into_iter().map(|sample| (sample * 65535.0) as u16).collect()
}

#[divan::bench(args = METHODS.map(|(name, _)| name))]
fn impasto(bencher: Bencher<'_, '_>, name: &str) {
    let rig = rig();
    let codes = photographs(&rig);
    let decode = [DECODE; LIGHTS];
    let stack = Stack::new(Samples::U16(&codes), SHAPE, &decode, None).expect("it is sound");
    let (_, method) = METHODS.into_iter().find(|&(other, _)| other == name).expect("it is listed");
    let options = StereoOptions {
        method,
        steps: method.usual_steps(),
        selection: None,
        learned: Learned::default(),
    };
    let (mut vectors, mut albedo) = (vec![0.0; 3 * PIXELS], vec![0.0; PIXELS]);
    let (mut used, mut rejected) = (vec![0; PIXELS], vec![0; 4 * PIXELS]);
    let (mut residual, mut condition) = (vec![0.0; PIXELS], vec![0.0; PIXELS]);
    let (mut sigma, mut status) = (vec![0.0; PIXELS], vec![0; PIXELS]);
    let mut maps = NormalMaps {
        normal: &mut vectors,
        albedo: &mut albedo,
        used: &mut used,
        rejected: &mut rejected,
        residual: &mut residual,
        condition: &mut condition,
        sigma: &mut sigma,
        status: &mut status,
    };
    bencher.counter(ItemsCount::new(PIXELS)).bench_local(|| {
        serially(|run| fit_normals(&stack, &rig, &options, &mut maps, run)).expect("it fits");
    });
}

#[divan::bench]
fn plain_pseudo_inverse(bencher: Bencher<'_, '_>) {
    let rig = rig();
    let codes = photographs(&rig);
    let rows = rig.lights().iter().map(impasto::geometry::Light::direction);
    let rows: Vec<_> = rows.map(|l| Vector3::new(l.x, l.y, l.z)).collect();
    let normal_matrix: Matrix3<f64> = rows.iter().map(|l| l * l.transpose()).sum();
    let inverse = normal_matrix.try_inverse().expect("the lights span space");
    let inverse: Vec<Vector3<f32>> = rows.iter().map(|l| (inverse * l).cast()).collect();
    let (mut vectors, mut albedo) = (vec![0.0; 3 * PIXELS], vec![0.0; PIXELS]);
    bencher.counter(ItemsCount::new(PIXELS)).bench_local(|| {
        for pixel in 0..PIXELS {
            let samples = (0..LIGHTS).map(|light| f32::from(codes[light * PIXELS + pixel]));
            let sum: Vector3<f32> = samples.zip(&inverse).map(|(sample, row)| row * sample).sum();
            let length = sum.norm();
            albedo[pixel] = length;
            for axis in 0..3 {
                vectors[axis * PIXELS + pixel] = sum[axis] / length;
            }
        }
    });
}
