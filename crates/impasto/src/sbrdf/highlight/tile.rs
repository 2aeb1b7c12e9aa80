//! One tile of pixels: samples, starts, and the part of the maps.

use crate::brdf::torrance_sparrow::sharpness;
use crate::maps::Status;
use crate::math::Level;

use super::samples::Highlights;

/// Every search starts from this half-width, rad, and the pixel's brightest sample.
const START: f64 = 0.15;

/// Pixels that are made ready together: a few lines of the cache from every plane, so that what
/// the lanes then pick from stays in the first-level cache whatever the planes' distance.
pub(super) const STAGE: usize = 64;

/// A tile's part of the maps.
pub(super) struct HighlightTileMaps<'a> {
    pub(super) start: usize,
    pub(super) beta: &'a mut [f32],
    pub(super) gamma: &'a mut [f32],
    pub(super) covariance: [&'a mut [f32]; 3],
    pub(super) residual: &'a mut [f32],
    pub(super) status: &'a mut [u8],
}

pub(super) struct HighlightTile<'a> {
    pub(super) highlights: &'a Highlights<'a>,
    pub(super) observations: usize,
    pub(super) maps: HighlightTileMaps<'a>,
    /// Samples that count, the largest of them, and the largest of their magnitudes.
    pub(super) used: Vec<u32>,
    pub(super) top: Vec<f32>,
    pub(super) size: Vec<f32>,
    /// Samples, then squared angles, of the pixels from `staged` on; strengths to start from.
    pub(super) stage: Vec<[f32; STAGE]>,
    pub(super) strengths: [f32; STAGE],
    pub(super) staged: usize,
    pub(super) width: f32,
    pub(super) level: Level,
}

impl<'a> HighlightTile<'a> {
    pub(super) fn new(
        highlights: &'a Highlights<'a>,
        observations: usize,
        maps: HighlightTileMaps<'a>,
        level: Level,
    ) -> Self {
        let count = maps.status.len();
        Self {
            highlights,
            observations,
            maps,
            used: vec![0; count],
            top: vec![0.0; count],
            size: vec![0.0; count],
            stage: vec![[0.0; STAGE]; 2 * observations],
            strengths: [0.0; STAGE],
            staged: usize::MAX,
            width: sharpness(START).ln() as f32,
            level,
        }
    }

    pub(super) fn give_up(&mut self, pixel: usize, status: Status) {
        let maps = &mut self.maps;
        maps.beta[pixel] = if status == Status::Dark { 0.0 } else { f32::NAN };
        maps.gamma[pixel] = f32::NAN;
        maps.residual[pixel] = f32::NAN;
        for plane in &mut maps.covariance {
            plane[pixel] = f32::NAN;
        }
        maps.status[pixel] = status.code();
    }
}
