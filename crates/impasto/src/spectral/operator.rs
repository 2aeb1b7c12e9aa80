//! One linear operator on features: coefficients of one pixel, or of panels of pixels in lanes.

use nalgebra::DMatrix;

use super::features::Features;
use crate::error::{Error, Result};
use crate::math::Real;

/// Rows of the coefficient matrix that go through the features together, for [`ACROSS`] lane-fulls of
/// pixels: twelve accumulators hide the latency of the multiply-add, and each coefficient is loaded once
/// for four lane-fulls. Three and six bands have three and six coefficients.
const ROWS: usize = 3;

/// Lane-fulls of pixels that go through the features together.
const ACROSS: usize = 4;

/// Lane-fulls of pixels that are estimated together: what is found out once for all of them (which
/// features, which planes, whether all is sound) takes longer than to estimate one.
pub(super) const PANEL: usize = 16;
const _: () = assert!(PANEL.is_multiple_of(ACROSS), "lane-fulls are estimated four by four");

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

    /// Whether features can be finite where a response is not: those of roots count NaN, and what is
    /// below zero, as zero. Sums of the responses themselves cannot.
    #[inline]
    pub(super) fn hides(&self) -> bool {
        !matches!(self.features, Features::Linear { .. })
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
    #[allow(clippy::needless_range_loop, reason = "only loops with indices stay in line")]
    #[inline(always)]
    pub(super) fn estimate<R: Real<Scalar = f32>>(&self, panel: &mut Panel<R>) {
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
            for here in (0..PANEL).step_by(ACROSS) {
                let mut sums = [[R::zero(); ACROSS]; ROWS];
                for index in 0..features.len() {
                    let (feature, weights) = (&features[index], &weights[index]);
                    for row in 0..ROWS {
                        let weight = R::splat(weights[row]);
                        for one in 0..ACROSS {
                            sums[row][one] = feature[here + one].mul_add(weight, sums[row][one]);
                        }
                    }
                }
                for row in 0..ROWS {
                    for one in 0..ACROSS {
                        values[row][here + one] = sums[row][one];
                    }
                }
            }
        }
    }
}

/// [`PANEL`] lane-fulls of pixels on their way through an operator.
pub(super) struct Panel<R> {
    /// `(band, PANEL)`.
    pub(super) rho: Vec<R>,
    /// `(feature, PANEL)`; empty where the responses themselves are the features.
    features: Vec<R>,
    /// `(row, PANEL)`, rows in whole blocks of [`ROWS`].
    pub(super) values: Vec<R>,
    /// Responses and features of one lane-full.
    bands: Vec<R>,
    column: Vec<R>,
}

impl<R: Real> Panel<R> {
    pub(super) fn of(operator: &Operator) -> Self {
        let lanes = |count| vec![R::zero(); count];
        let bands = operator.bands();
        let features = match operator.features {
            Features::Linear { .. } => 0,
            _ => operator.features.count(),
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
