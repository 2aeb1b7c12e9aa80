//! Registers in and out of memory.

use crate::math::lanes::{self, LINE};
use crate::math::{Mask, Real};

/// Lanes of the widest registers, which go in pairs.
pub(super) const MAX_LANES: usize = 2 * lanes::MAX_LANES;

/// One register of pixels from each of several planes that lie `stride` apart.
#[derive(Clone, Copy)]
pub(super) struct PlaneRows<'a> {
    values: &'a [f32],
    stride: usize,
}

impl<'a> PlaneRows<'a> {
    #[inline(always)]
    pub(super) fn new(values: &'a [f32], stride: usize) -> Self {
        Self { values, stride }
    }

    /// The register of pixels that lies so many pixels further on.
    #[inline(always)]
    pub(super) fn from(&self, at: usize) -> Self {
        Self { values: &self.values[at..], stride: self.stride }
    }

    #[inline(always)]
    pub(super) fn at<R: Real<Scalar = f32>>(&self, plane: usize) -> R {
        R::load(&self.values[plane * self.stride..])
    }

    /// One lane only.
    #[inline(always)]
    pub(super) fn lane(&self, plane: usize, lane: usize) -> f32 {
        self.values[plane * self.stride + lane]
    }
}

/// Memory in which no register of whole lanes lies across two lines of the cache.
pub(super) struct Aligned {
    values: Vec<f32>,
    first: usize,
}

impl Aligned {
    pub(super) fn new(length: usize) -> Self {
        let values = vec![0.0; length + LINE / size_of::<f32>()];
        let first = values.as_ptr().align_offset(LINE).min(LINE / size_of::<f32>());
        Self { values, first }
    }

    #[inline(always)]
    pub(super) fn get(&self) -> &[f32] {
        &self.values[self.first..]
    }

    #[inline(always)]
    pub(super) fn get_mut(&mut self) -> &mut [f32] {
        &mut self.values[self.first..]
    }
}

/// The lanes as an array, zeros behind them.
#[inline(always)]
pub(super) fn lanes<R: Real<Scalar = f32>>(value: R) -> [f32; MAX_LANES] {
    let mut lanes = [0.0; MAX_LANES];
    value.store(&mut lanes);
    lanes
}

/// Writes lanes from `at` on, as many as there is room for.
#[inline(always)]
pub(super) fn store<R: Real<Scalar = f32>>(value: R, map: &mut [f32], at: usize) {
    let map = &mut map[at..];
    if map.len() >= R::WIDTH {
        return value.store(map);
    }
    let count = map.len();
    map.copy_from_slice(&lanes(value)[..count]);
}

/// Writes counts: lanes that hold small whole numbers.
#[inline(always)]
pub(super) fn store_counts<R: Real<Scalar = f32>>(value: R, map: &mut [u16], at: usize) {
    let (map, lanes) = (&mut map[at..], lanes(value));
    if map.len() >= R::WIDTH {
        // A length known when this is compiled.
        for (out, &lane) in map[..R::WIDTH].iter_mut().zip(&lanes) {
            *out = lane as u16;
        }
        return;
    }
    for (out, &lane) in map.iter_mut().zip(&lanes) {
        *out = lane as u16;
    }
}

/// Writes codes: lanes that hold whole numbers below 256.
#[inline(always)]
pub(super) fn store_codes<R: Real<Scalar = f32>>(value: R, map: &mut [u8], at: usize) {
    let count = R::WIDTH.min(map.len() - at);
    let lanes = lanes(value);
    for (out, &lane) in map[at..at + count].iter_mut().zip(&lanes) {
        *out = lane as u8;
    }
}

/// Whether any lane differs from zero.
#[inline(always)]
pub(super) fn any<R: Real>(value: R) -> bool {
    value.abs().gt(R::zero()).any()
}
