//! Six planes of coefficients to 8-bit codes of a display: ours and the loop one would write first.

use divan::{Bencher, counter::ItemsCount};
use impasto::pixels::serially;
use impasto::relight::curve::{CELLS, Curve};
use impasto::relight::show::{Codes, codes_from_planes};

const BANDS: usize = 6;
const PIXELS: usize = 1 << 20;
const MATRIX: [[f64; 3]; BANDS] = [
    [0.1, -0.1, 0.5],
    [0.0, 0.2, 0.4],
    [-0.1, 0.5, 0.1],
    [0.2, 0.4, -0.1],
    [0.5, 0.1, 0.0],
    [0.3, -0.1, 0.0],
];

fn srgb(light: f32) -> f32 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

fn planes() -> Vec<f32> {
    (0..BANDS * PIXELS).map(|i| 0.4 + 0.3 * (i as f32 * 0.013).sin()).collect()
}

#[divan::bench]
fn impasto(bencher: Bencher<'_, '_>) {
    let table: Vec<f32> = (0..=CELLS).map(|i| srgb((i as f32 / CELLS as f32).powi(2))).collect();
    let curve = Curve::new(&table).expect("the curve rises");
    let (planes, mut codes) = (planes(), vec![0_u8; 3 * PIXELS]);
    bencher.counter(ItemsCount::new(PIXELS)).bench_local(|| {
        serially(|run| {
            codes_from_planes(&planes, &MATRIX, &curve, Codes::Eight(&mut codes), run)
                .expect("the sizes agree")
        })
    });
}

#[divan::bench]
fn plain_loop(bencher: Bencher<'_, '_>) {
    let matrix = MATRIX.map(|row| row.map(|v| v as f32));
    let (planes, mut codes) = (planes(), vec![0_u8; 3 * PIXELS]);
    bencher.counter(ItemsCount::new(PIXELS)).bench_local(|| {
        for (pixel, code) in codes.chunks_exact_mut(3).enumerate() {
            for (channel, code) in code.iter_mut().enumerate() {
                let light: f32 = (0..BANDS)
                    .map(|band| matrix[band][channel] * planes[band * PIXELS + pixel])
                    .sum();
                *code = (255.0 * srgb(light.clamp(0.0, 1.0)) + 0.5) as u8;
            }
        }
    });
}
