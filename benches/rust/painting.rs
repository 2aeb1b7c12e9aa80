//! A small painting with known normals, for every benchmark the same.

use impasto::geometry::{Grid, Light, Rig};
use impasto::math::Vec3;

/// Pixels of a side.
pub(crate) const SIDE: usize = 256;

/// Lights of the six-band paper's rig.
pub(crate) const LIGHTS: usize = 16;

/// `(3, y, x)` unit normals of gentle waves.
pub(crate) fn normal() -> Vec<f32> {
    let mut planes = vec![0.0; 3 * SIDE * SIDE];
    for pixel in 0..SIDE * SIDE {
        let (x, y) = ((pixel % SIDE) as f64, (pixel / SIDE) as f64);
        let n = Vec3::new(0.2 * (0.71 * x).sin(), 0.2 * (0.37 * y).cos(), 1.0).normalised();
        for (plane, component) in [n.x, n.y, n.z].into_iter().enumerate() {
            planes[plane * SIDE * SIDE + pixel] = component as f32;
        }
    }
    planes
}

/// `(bands, y, x)` diffuse reflectance between 0.1 and 0.5.
pub(crate) fn diffuse(bands: usize) -> Vec<f32> {
    (0..bands * SIDE * SIDE).map(|i| 0.3 + 0.2 * (i as f32 * 0.13).sin()).collect()
}

/// Distant lights in a ring at 45 degrees, seen from the front.
pub(crate) fn rig() -> Rig {
    let lights = (0..LIGHTS)
        .map(|i| (i as f64 / LIGHTS as f64 * core::f64::consts::TAU).sin_cos())
        .map(|(sine, cosine)| Light::Distant(Vec3::new(cosine, sine, 1.0).normalised()))
        .collect();
    let grid = Grid::whole(SIDE, SIDE, 0.1);
    Rig::new(lights, vec![Vec3::new(0.0, 0.0, 1.0); LIGHTS], grid).expect("the rig is sound")
}
