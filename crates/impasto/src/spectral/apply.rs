//! Responses to coefficients, pixel by pixel in lanes.

use std::collections::HashMap;

use nalgebra::DMatrix;

use super::Estimator;
use super::features::Features;
use crate::error::{Error, Result};
use crate::maps::Status;
use crate::math::{Isa, Kernel, Mask, Real};
use crate::pixels::{Run, TILE};

/// Rows of the coefficient matrix that go through the features together: four accumulators hide
/// the latency of the multiply-add, and each feature is loaded once for four rows.
const ROWS: usize = 4;

/// Distinct sets of missing bands whose operators a worker keeps; with six bands there are 62.
const KEPT: usize = 1024;

/// Features and the matrix that makes coefficients of them.
#[derive(Clone, Debug)]
pub struct Operator {
    features: Features,
    /// `(k, features)`, row by row.
    matrix: Vec<f64>,
    /// `matrix` for single-precision lanes: `ROWS` rows side by side, padded with zeros.
    blocks: Vec<[f32; ROWS]>,
    rank: usize,
}

impl Operator {
    pub(super) fn new(features: Features, coefficients: &DMatrix<f64>) -> Self {
        let (rank, count) = coefficients.shape();
        let at = |row: usize, column: usize| {
            if row < rank { coefficients[(row, column)] as f32 } else { 0.0 }
        };
        let blocks = (0..rank.div_ceil(ROWS))
            .flat_map(|block| (0..count).map(move |column| (block * ROWS, column)))
            .map(|(row, column)| core::array::from_fn(|offset| at(row + offset, column)))
            .collect();
        Self { features, matrix: coefficients.transpose().as_slice().to_vec(), blocks, rank }
    }

    /// Camera bands.
    #[must_use]
    pub fn bands(&self) -> usize {
        self.features.bands()
    }

    /// Coefficients, in double precision: the reference for the lanes.
    #[must_use]
    pub fn evaluate(&self, rho: &[f64]) -> Vec<f64> {
        let mut features = vec![0.0; self.features.count()];
        self.features.evaluate(rho, &mut features);
        let product = |row: &[f64]| {
            row.iter().zip(&features).fold(0.0_f64, |sum, (&c, &feature)| c.mul_add(feature, sum))
        };
        self.matrix.chunks_exact(features.len()).map(product).collect()
    }

    /// [`Self::evaluate`] for `(N, band)` responses, row by row: `(N, k)`.
    ///
    /// # Errors
    /// If the responses do not fill rows of bands.
    pub fn evaluate_rows(&self, responses: &[f64]) -> Result<Vec<f64>> {
        if !responses.len().is_multiple_of(self.bands()) {
            let problem = format!("{} numbers are no rows of {}", responses.len(), self.bands());
            return Err(Error::argument("responses", problem));
        }
        Ok(responses.chunks_exact(self.bands()).flat_map(|rho| self.evaluate(rho)).collect())
    }

    /// Coefficients of a lane-full of pixels, padded to whole blocks.
    ///
    /// Slices in and out, no closures: a closure need not be inlined, and what is not inlined is
    /// not compiled for the instruction set.
    #[inline(always)]
    fn lanes<R: Real<Scalar = f32>>(&self, rho: &[R], features: &mut [R], out: &mut [R]) {
        self.features.evaluate(rho, features);
        let blocks = self.blocks.chunks_exact(features.len());
        for (out, rows) in out.chunks_exact_mut(ROWS).zip(blocks) {
            let [mut a, mut b, mut c, mut d] = [R::zero(); ROWS];
            for (&feature, row) in features.iter().zip(rows) {
                a = feature.mul_add(R::splat(row[0]), a);
                b = feature.mul_add(R::splat(row[1]), b);
                c = feature.mul_add(R::splat(row[2]), c);
                d = feature.mul_add(R::splat(row[3]), d);
            }
            out.copy_from_slice(&[a, b, c, d]);
        }
    }
}

/// Where the coefficients and statuses of a picture go.
#[derive(Debug)]
pub struct Output<'a> {
    /// `(k, pixels)`.
    pub coefficients: &'a mut [f32],
    /// `(pixels,)`.
    pub status: &'a mut [u8],
}

/// One tile's part of the output.
struct Tile<'a> {
    start: usize,
    planes: Vec<&'a mut [f32]>,
    status: &'a mut [u8],
}

/// Estimates the coefficients of every pixel.
///
/// `responses` is `(band, pixels)`; `status` says how each pixel's responses were estimated. A
/// pixel that was not estimated stays so, with its reason: NaN coefficients, except that a
/// [`Status::Dark`] one is black (all zero). Where some bands are not finite the others stand in
/// ([`Status::IllConditioned`]); where none is, the pixel is [`Status::Saturated`] if a band is
/// clipped, else [`Status::InvalidInput`].
///
/// # Errors
/// If a length disagrees, or the caller asked to stop.
pub fn apply(
    estimator: &Estimator,
    responses: &[f32],
    status: Option<&[u8]>,
    output: Output<'_>,
    run: &Run<'_>,
) -> Result<()> {
    let Output { coefficients, status: statuses } = output;
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
        .map(|(index, status)| Tile {
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
    tile: Tile<'b>,
    /// By the set of bands that are present.
    operators: &'a mut HashMap<Vec<usize>, Operator>,
}

impl Kernel for TileKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { estimator, responses, pixels, status, mut tile, operators } = self;
        let (bands, operator) = (estimator.bands(), &estimator.complete);
        let mut rho = vec![I::F32::zero(); bands];
        let mut features = vec![I::F32::zero(); operator.features.count()];
        let mut values = vec![I::F32::zero(); operator.rank.next_multiple_of(ROWS)];
        let count = tile.status.len();
        let mut first = 0;
        while first < count {
            let lanes = I::F32::WIDTH.min(count - first);
            let here = tile.start + first;
            let mut sound = I::F32::zero().le(I::F32::zero());
            for (band, rho) in rho.iter_mut().enumerate() {
                *rho = load(&responses[band * pixels + here..][..lanes]);
                sound = sound & rho.is_finite();
            }
            let mut size = I::F32::zero();
            operator.lanes(&rho, &mut features, &mut values);
            for (&value, plane) in values.iter().zip(&mut tile.planes) {
                size = size + value.abs();
                store(value, &mut plane[first..][..lanes]);
            }
            // Responses near the end of the range overflow on the way: that is no estimate.
            let sound = sound & size.is_finite();
            let before = status.map(|status| &status[here..][..lanes]);
            if sound.all() && before.is_none_or(|codes| codes.iter().all(|&code| code < 16)) {
                let out = &mut tile.status[first..][..lanes];
                match before {
                    Some(codes) => out.copy_from_slice(codes),
                    None => out.fill(Status::Fitted.code()),
                }
            } else {
                for lane in 0..lanes {
                    let code = before.map_or(0, |codes| codes[lane]);
                    if sound.lane(lane) && code < 16 {
                        tile.status[first + lane] = code;
                        continue;
                    }
                    let pixel: Vec<f32> =
                        (0..bands).map(|band| responses[band * pixels + here + lane]).collect();
                    let (code, values) = exception(estimator, operators, &pixel, code);
                    tile.status[first + lane] = code;
                    for (index, plane) in tile.planes.iter_mut().enumerate() {
                        plane[first + lane] = values.as_ref().map_or(f32::NAN, |v| v[index]);
                    }
                }
            }
            first += lanes;
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

/// A register of the values; what is left of it is zero.
#[inline(always)]
fn load<R: Real<Scalar = f32>>(values: &[f32]) -> R {
    if values.len() == R::WIDTH {
        return R::load(values);
    }
    let mut padded = [0.0; 64];
    padded[..values.len()].copy_from_slice(values);
    R::load(&padded)
}

#[inline(always)]
fn store<R: Real<Scalar = f32>>(value: R, out: &mut [f32]) {
    if out.len() == R::WIDTH {
        return value.store(out);
    }
    let mut padded = [0.0; 64];
    value.store(&mut padded);
    out.copy_from_slice(&padded[..out.len()]);
}
