//! Samples that a surface shows, six bands under sixteen lights: ours at every instruction set, and
//! the loop over pixels that one would write first.

use core::sync::atomic::AtomicBool;

use divan::{Bencher, counter::ItemsCount};
use impasto::math::Level;
use impasto::pixels::{Progress, Run};
use impasto::surface::{Lobe, Model, Parameter, Strength, Surface, predict};

use crate::painting::{LIGHTS, SIDE, diffuse, normal, rig};

const BANDS: usize = 6;
const PIXELS: usize = SIDE * SIDE;
const BETA: f32 = 3.0;
const GAMMA: f32 = 0.15;
const INDEX: f32 = 1.45;

fn levels() -> impl Iterator<Item = Level> {
    Level::ALL.into_iter().filter(|level| level.available())
}

#[divan::bench(args = levels())]
fn impasto(bencher: Bencher<'_, '_>, level: Level) {
    let (normal, diffuse, rig) = (normal(), diffuse(BANDS), rig());
    let surface = Surface {
        normal: &normal,
        diffuse: &diffuse,
        coated: None,
        model: Model::TorranceSparrow { index: f64::from(INDEX) },
        lobes: vec![Lobe {
            strength: Strength::Neutral(Parameter::Everywhere(BETA)),
            shape: vec![Parameter::Everywhere(GAMMA)],
        }],
        ambient: None,
    };
    let (cancel, progress) = (AtomicBool::new(false), Progress::default());
    let run = Run { pool: None, level, cancel: &cancel, progress: &progress };
    let mut out = vec![0.0; LIGHTS * BANDS * PIXELS];
    bencher
        .counter(ItemsCount::new(LIGHTS * BANDS * PIXELS))
        .bench_local(|| predict(&surface, &rig, &[1.0; LIGHTS], &mut out, &run).expect("it fits"));
}

#[divan::bench]
fn plain_loop(bencher: Bencher<'_, '_>) {
    let (normal, diffuse, rig) = (normal(), diffuse(BANDS), rig());
    let lights: Vec<[f32; 3]> = rig
        .lights()
        .iter()
        .map(impasto::geometry::Light::direction)
        .map(|l| [l.x as f32, l.y as f32, l.z as f32])
        .collect();
    let mut out = vec![0.0; LIGHTS * BANDS * PIXELS];
    bencher.counter(ItemsCount::new(LIGHTS * BANDS * PIXELS)).bench_local(|| {
        for (light, planes) in lights.iter().zip(out.chunks_mut(BANDS * PIXELS)) {
            for pixel in 0..PIXELS {
                let n = [normal[pixel], normal[PIXELS + pixel], normal[2 * PIXELS + pixel]];
                let (cosine, specular) = torrance_sparrow(n, *light);
                for band in 0..BANDS {
                    let at = band * PIXELS + pixel;
                    planes[at] = diffuse[at] * cosine + specular;
                }
            }
        }
    });
}

/// Cosine of the light and interface reflection, seen from the front: eq. 9 as it is printed.
fn torrance_sparrow(n: [f32; 3], l: [f32; 3]) -> (f32, f32) {
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let sum = [l[0], l[1], l[2] + 1.0];
    let length = dot(sum, sum).sqrt();
    let h = sum.map(|v| v / length);
    let (nl, nv, nh, vh) = (dot(n, l), n[2], dot(n, h), h[2]);
    if nl <= 0.0 {
        return (0.0, 0.0);
    }
    let phi = nh.min(1.0).acos();
    let facets = (-core::f32::consts::LN_2 * (phi / GAMMA).powi(2)).exp();
    let shading = (2.0 * nh * nv / vh).min(2.0 * nh * nl / vh).min(1.0);
    let g = (INDEX * INDEX + vh * vh - 1.0).sqrt();
    let (minus, plus) = (g - vh, g + vh);
    let quotient = (vh * plus - 1.0) / (vh * minus + 1.0);
    let fresnel = 0.5 * (minus / plus).powi(2) * (1.0 + quotient * quotient);
    (nl, BETA * facets * shading * fresnel / nv)
}
