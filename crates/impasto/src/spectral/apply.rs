//! From responses to coefficients, for every pixel: tiles, statuses, pixels with missing bands.

use std::collections::HashMap;

use super::estimator::Estimator;
use super::operator::{Operator, PANEL, Panel};
use crate::error::{Error, Result};
use crate::maps::Status;
use crate::math::lanes::prefetch;
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

    #[allow(clippy::needless_range_loop, reason = "only loops with indices stay in line")]
    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { estimator, responses, pixels, status, mut tile, operators } = self;
        let (bands, operator) = (estimator.bands(), estimator.operator());
        let (width, yes) = (I::F32::WIDTH, <I::F32 as Real>::Mask::splat(true));
        let hides = operator.hides();
        // Registers beyond the last pixel are left as they were: neither stored nor judged.
        let mut panel = Panel::<I::F32>::of(operator);
        let count = tile.status.len();
        for first in (0..count).step_by(PANEL * width) {
            let range = first..count.min(first + PANEL * width);
            let here = tile.start + range.start..tile.start + range.end;
            let mut sound = [yes; PANEL];
            let next = here.end.min(pixels)..(here.end + PANEL * width).min(pixels);
            for band in 0..bands {
                let plane = &responses[band * pixels..][..pixels];
                let rho = &mut panel.rho[band * PANEL..][..PANEL];
                prefetch(&plane[next.clone()]);
                load(&plane[here.clone()], rho);
                if hides {
                    for register in 0..PANEL {
                        sound[register] = sound[register] & rho[register].is_finite();
                    }
                }
            }
            operator.estimate(&mut panel);
            let mut size = [I::F32::zero(); PANEL];
            for index in 0..tile.planes.len() {
                let values = &panel.values[index * PANEL..][..PANEL];
                store(values, &mut tile.planes[index][range.clone()]);
                for register in 0..PANEL {
                    size[register] = size[register] + values[register].abs();
                }
            }
            let mut all = yes;
            for register in 0..range.len().div_ceil(width) {
                // Responses near the end of the range overflow on the way: that is no estimate.
                sound[register] = sound[register] & size[register].is_finite();
                all = all & sound[register];
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
#[allow(clippy::needless_range_loop, reason = "only loops with indices stay in line")]
#[inline(always)]
fn load<R: Real<Scalar = f32>>(values: &[f32], out: &mut [R]) {
    let whole = values.len() / R::WIDTH;
    for register in 0..whole {
        out[register] = R::load(&values[register * R::WIDTH..]);
    }
    let rest = &values[whole * R::WIDTH..];
    if !rest.is_empty() {
        let mut padded = [0.0; 64];
        padded[..rest.len()].copy_from_slice(rest);
        out[whole] = R::load(&padded);
    }
}

/// As many registers as there is room for, and a part of the next.
#[allow(clippy::needless_range_loop, reason = "only loops with indices stay in line")]
#[inline(always)]
fn store<R: Real<Scalar = f32>>(values: &[R], out: &mut [f32]) {
    let whole = out.len() / R::WIDTH;
    for register in 0..whole {
        values[register].store(&mut out[register * R::WIDTH..]);
    }
    let rest = &mut out[whole * R::WIDTH..];
    if !rest.is_empty() {
        let mut padded = [0.0; 64];
        values[whole].store(&mut padded);
        rest.copy_from_slice(&padded[..rest.len()]);
    }
}
