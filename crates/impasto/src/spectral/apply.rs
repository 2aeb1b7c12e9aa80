//! From responses to coefficients, for every pixel: tiles, statuses, pixels with missing bands.

use std::collections::HashMap;

use super::estimator::Estimator;
use super::operator::{Operator, PANEL, Panel};
use crate::error::{Error, Result};
use crate::maps::Status;
use crate::math::{Isa, Kernel, Mask, Real};
use crate::pixels::{Run, TILE};

/// Distinct sets of missing bands whose operators a worker keeps; with six bands there are 62.
const KEPT: usize = 1024;

/// Where the coefficients and statuses of a picture go.
#[derive(Debug)]
pub struct ReflectanceMaps<'a> {
    /// `(k, pixels)`.
    pub coefficients: &'a mut [f32],
    /// `(pixels,)`.
    pub status: &'a mut [u8],
}

/// One tile's part of the output.
struct ReflectanceTile<'a> {
    start: usize,
    planes: Vec<&'a mut [f32]>,
    status: &'a mut [u8],
}

/// Estimates the coefficients of every pixel.
///
/// `responses` is `(band, pixels)`; `status` states how each pixel's responses were estimated. A
/// pixel that was not estimated stays so, with its reason: NaN coefficients, except that a
/// [`Status::Dark`] one is black (all zero). Where some bands are not finite the others stand in
/// ([`Status::IllConditioned`]); where none is, the pixel is [`Status::Saturated`] if a band is
/// clipped, else [`Status::InvalidInput`].
///
/// # Errors
/// If a length disagrees, or the call is cancelled.
pub fn apply(
    estimator: &Estimator,
    responses: &[f32],
    status: Option<&[u8]>,
    output: ReflectanceMaps<'_>,
    run: &Run<'_>,
) -> Result<()> {
    let ReflectanceMaps { coefficients, status: statuses } = output;
    let pixels = statuses.len();
    if responses.len() != estimator.bands() * pixels || pixels == 0 {
        let problem = format!(
            "expected {} bands of {pixels} pixels, found {} numbers",
            estimator.bands(),
            responses.len()
        );
        return Err(Error::argument("diffuse", problem));
    }
    if status.is_some_and(|status| status.len() != pixels)
        || coefficients.len() != estimator.rank() * pixels
    {
        return Err(Error::argument("status", "its size is not that of the responses"));
    }
    let mut planes: Vec<_> =
        coefficients.chunks_mut(pixels).map(|plane| plane.chunks_mut(TILE)).collect();
    let tiles = statuses
        .chunks_mut(TILE)
        .enumerate()
        .map(|(index, status)| ReflectanceTile {
            start: index * TILE,
            planes: planes.iter_mut().filter_map(Iterator::next).collect(),
            status,
        })
        .collect();
    run.for_each(tiles, HashMap::new, |operators, tile| {
        run.level.run(TileKernel { estimator, responses, pixels, status, tile, operators });
    })
}

struct TileKernel<'a, 'b> {
    estimator: &'a Estimator,
    responses: &'a [f32],
    pixels: usize,
    status: Option<&'a [u8]>,
    tile: ReflectanceTile<'b>,
    /// By the set of bands that are present.
    operators: &'a mut HashMap<Vec<usize>, Operator>,
}

impl Kernel for TileKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { estimator, responses, pixels, status, mut tile, operators } = self;
        let (bands, operator) = (estimator.bands(), estimator.operator());
        let (width, yes) = (I::F32::WIDTH, <I::F32 as Real>::Mask::splat(true));
        // Registers beyond the last pixel are left as they were: neither stored nor judged.
        let mut panel = Panel::<I::F32>::of(operator);
        let count = tile.status.len();
        for first in (0..count).step_by(PANEL * width) {
            let range = first..count.min(first + PANEL * width);
            let here = tile.start + range.start..tile.start + range.end;
            let mut sound = [yes; PANEL];
            let planes = responses.chunks_exact(pixels);
            for (plane, rho) in planes.zip(panel.rho.chunks_exact_mut(PANEL)) {
                load(&plane[here.clone()], rho);
                for (sound, rho) in sound.iter_mut().zip(rho) {
                    *sound = *sound & rho.is_finite();
                }
            }
            operator.estimate(&mut panel);
            let mut size = [I::F32::zero(); PANEL];
            for (plane, values) in tile.planes.iter_mut().zip(panel.values.chunks_exact(PANEL)) {
                store(values, &mut plane[range.clone()]);
                for (size, value) in size.iter_mut().zip(values) {
                    *size = *size + value.abs();
                }
            }
            let mut all = yes;
            for (sound, size) in sound.iter_mut().zip(size).take(range.len().div_ceil(width)) {
                // Responses near the end of the range overflow on the way: that is no estimate.
                *sound = *sound & size.is_finite();
                all = all & *sound;
            }
            let before = status.map(|status| &status[here]);
            match before {
                Some(codes) => tile.status[range.clone()].copy_from_slice(codes),
                None => tile.status[range.clone()].fill(Status::Fitted.code()),
            }
            if all.all() && before.is_none_or(|codes| codes.iter().all(|&code| code < 16)) {
                continue;
            }
            for pixel in range {
                let (lane, code) = (pixel % width, tile.status[pixel]);
                if sound[(pixel - first) / width].lane(lane) && code < 16 {
                    continue;
                }
                let rho: Vec<f32> =
                    (0..bands).map(|band| responses[band * pixels + tile.start + pixel]).collect();
                let (code, values) = exception(estimator, operators, &rho, code);
                tile.status[pixel] = code;
                for (index, plane) in tile.planes.iter_mut().enumerate() {
                    plane[pixel] = values.as_ref().map_or(f32::NAN, |v| v[index]);
                }
            }
        }
    }
}

/// A pixel that was not estimated before or misses a band.
fn exception(
    estimator: &Estimator,
    operators: &mut HashMap<Vec<usize>, Operator>,
    pixel: &[f32],
    code: u8,
) -> (u8, Option<Vec<f32>>) {
    if code == Status::Dark.code() {
        return (code, Some(vec![0.0; estimator.rank()]));
    }
    if code >= 16 {
        return (code, None);
    }
    let present: Vec<usize> = (0..pixel.len()).filter(|&band| pixel[band].is_finite()).collect();
    if present.is_empty() {
        let clipped = pixel.contains(&f32::INFINITY);
        let status = if clipped { Status::Saturated } else { Status::InvalidInput };
        return (status.code(), None);
    }
    if present.len() == pixel.len() {
        return (Status::InvalidInput.code(), None);
    }
    let rho: Vec<f64> = present.iter().map(|&band| f64::from(pixel[band])).collect();
    if operators.len() > KEPT {
        operators.clear();
    }
    let operator =
        operators.entry(present).or_insert_with_key(|present| estimator.operator_of(present));
    let values: Vec<f32> = operator.evaluate(&rho).into_iter().map(|value| value as f32).collect();
    if values.iter().all(|value| value.is_finite()) {
        (Status::IllConditioned.code(), Some(values))
    } else {
        (Status::InvalidInput.code(), None)
    }
}

/// As many registers as the values fill; what is left of the last is zero.
#[inline(always)]
fn load<R: Real<Scalar = f32>>(values: &[f32], out: &mut [R]) {
    let parts = values.chunks_exact(R::WIDTH);
    let rest = parts.remainder();
    if !rest.is_empty() {
        let mut padded = [0.0; 64];
        padded[..rest.len()].copy_from_slice(rest);
        out[parts.len()] = R::load(&padded);
    }
    for (out, part) in out.iter_mut().zip(parts) {
        *out = R::load(part);
    }
}

/// As many registers as there is room for, and a part of the next.
#[inline(always)]
fn store<R: Real<Scalar = f32>>(values: &[R], out: &mut [f32]) {
    let mut parts = out.chunks_exact_mut(R::WIDTH);
    let whole = parts.len();
    for (&value, part) in values.iter().zip(&mut parts) {
        value.store(part);
    }
    let rest = parts.into_remainder();
    if !rest.is_empty() {
        let mut padded = [0.0; 64];
        values[whole].store(&mut padded);
        rest.copy_from_slice(&padded[..rest.len()]);
    }
}
