//! Responses to coefficients, pixel by pixel in lanes.

use std::collections::HashMap;

use nalgebra::DMatrix;

use super::Estimator;
use super::features::Features;
use crate::error::{Error, Result};
use crate::maps::Status;
use crate::math::{Isa, Kernel, Mask, Real};
use crate::pixels::{Run, TILE};

/// Rows of the coefficient matrix that go through the features together, for two lane-fulls of
/// pixels: eight accumulators hide the latency of the multiply-add, each feature is loaded once for
/// four rows and each coefficient once for two lane-fulls.
const ROWS: usize = 4;

/// Lane-fulls of pixels that are estimated together: what is found out once for all of them (which
/// features, which planes, whether all is sound) takes longer than to estimate one.
const PANEL: usize = 16;
const _: () = assert!(PANEL.is_multiple_of(2), "lane-fulls are estimated two by two");

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

    /// Estimates a panel: its coefficients from its responses.
    ///
    /// No closures: a closure need not be inlined, and what is not inlined is not compiled for the
    /// instruction set.
    #[inline(always)]
    fn estimate<R: Real<Scalar = f32>>(&self, panel: &mut Panel<R>) {
        let (rho, _) = panel.rho.as_chunks::<PANEL>();
        let (features, _) = panel.features.as_chunks_mut::<PANEL>();
        let features: &[[R; PANEL]] = if features.is_empty() {
            rho
        } else {
            for here in 0..PANEL {
                for (band, rho) in panel.bands.iter_mut().zip(rho) {
                    *band = rho[here];
                }
                self.features.evaluate(&panel.bands, &mut panel.column);
                for (feature, &value) in features.iter_mut().zip(&panel.column) {
                    feature[here] = value;
                }
            }
            features
        };
        let (values, _) = panel.values.as_chunks_mut::<PANEL>();
        let (blocks, _) = values.as_chunks_mut::<ROWS>();
        for (values, weights) in blocks.iter_mut().zip(self.blocks.chunks_exact(features.len())) {
            for here in (0..PANEL).step_by(2) {
                let [mut a, mut b] = [[R::zero(); ROWS]; 2];
                for (feature, weights) in features.iter().zip(weights) {
                    for row in 0..ROWS {
                        let weight = R::splat(weights[row]);
                        a[row] = feature[here].mul_add(weight, a[row]);
                        b[row] = feature[here + 1].mul_add(weight, b[row]);
                    }
                }
                for (value, (a, b)) in values.iter_mut().zip(a.into_iter().zip(b)) {
                    [value[here], value[here + 1]] = [a, b];
                }
            }
        }
    }
}

/// [`PANEL`] lane-fulls of pixels on their way through an operator.
struct Panel<R> {
    /// `(band, PANEL)`.
    rho: Vec<R>,
    /// `(feature, PANEL)`; empty where the responses themselves are the features.
    features: Vec<R>,
    /// `(row, PANEL)`, rows in whole blocks of [`ROWS`].
    values: Vec<R>,
    /// Responses and features of one lane-full.
    bands: Vec<R>,
    column: Vec<R>,
}

impl<R: Real> Panel<R> {
    fn of(operator: &Operator) -> Self {
        let lanes = |count| vec![R::zero(); count];
        let bands = operator.bands();
        let features = match operator.features {
            Features::Linear { .. } => 0,
            Features::RootPolynomial { .. } | Features::RadialBasis(_) => operator.features.count(),
        };
        Self {
            rho: lanes(bands * PANEL),
            features: lanes(features * PANEL),
            values: lanes(operator.rank.next_multiple_of(ROWS) * PANEL),
            bands: lanes(bands),
            column: lanes(features),
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
