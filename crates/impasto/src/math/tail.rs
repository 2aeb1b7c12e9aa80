//! Registers in and out of memory whose last values may be fewer than a register's lanes.

use super::lanes::MAX_LANES;
use super::real::Real;

/// Values from `at` on; lanes beyond the end repeat the last value.
#[inline(always)]
pub(crate) fn load<R: Real<Scalar = f32>>(values: &[f32], at: usize) -> R {
    let values = &values[at..];
    if values.len() >= R::WIDTH {
        return R::load(values);
    }
    let mut padded = [values[values.len() - 1]; MAX_LANES];
    padded[..values.len()].copy_from_slice(values);
    R::load(&padded)
}

/// Writes lanes from `at` on, as many as there is room for.
#[inline(always)]
pub(crate) fn store<R: Real<Scalar = f32>>(lanes: R, values: &mut [f32], at: usize) {
    let values = &mut values[at..];
    if values.len() >= R::WIDTH {
        return lanes.store(values);
    }
    let mut padded = [0.0; MAX_LANES];
    lanes.store(&mut padded);
    let count = values.len();
    values.copy_from_slice(&padded[..count]);
}
