//! The covariance of a pixel's normal and lobes: `variance (J'J)^-1` at the minimum.
//!
//! Once normal, lobes and the choice of samples are final, one pass in double precision over the
//! samples that count gives the covariance of all unknowns, with the noise that the residuals show.
//! An unknown that ended at a bound is not determined by the photographs: it has no deviation, and
//! those of the others are computed as if there were no bound. Under one view normal and turns are
//! given (hard case 18): the deviations of the others treat them as known.

use crate::lm::{Batch, Bounds, Column, Columns, Normal, Options, Outcome, Rows, fit};
use crate::math::{Level, Real};

use super::estimate::{LafortuneEstimate, TURN};
use super::joint::JointModel;
use super::lobes::LOG_EXPONENT;
use super::luminance::{Geometries, Luminance};
use super::maps::LafortuneTile;
use super::normal::{facing, slopes};

/// By how much a variance may exceed that with all others known: beyond, 12 of the matrix's 16
/// digits are gone, and another parameter does as well (hard case 14).
const LOST: f64 = 1e12;

/// Single precision stops some roundings short of a bound.
const SHORT: f64 = 1.0 - 1e-5;

/// No step is taken.
const STAY: Options = Options {
    max_iterations: 0,
    cost: 0.0,
    step: 0.0,
    gradient: 0.0,
    offset: 0.0,
    damping: 1.0,
    memory: 0.0,
};

/// Pixels of a tile whose normals and lobes have settled.
pub(super) struct Covariance<'a> {
    pub(super) data: &'a Luminance<'a>,
    /// Whether normals and turns were searched for.
    pub(super) turning: bool,
    pub(super) pixels: &'a [usize],
    pub(super) found: &'a [LafortuneEstimate],
    pub(super) stopped: &'a (dyn Fn() -> bool + Sync),
}

impl Covariance<'_> {
    /// Writes the standard deviations of normals and lobes.
    pub(super) fn write(&self, level: Level, tile: &mut LafortuneTile<'_>) {
        self.run::<6>(level, tile);
        self.run::<9>(level, tile);
        self.run::<12>(level, tile);
    }

    /// The pixels with `N / 3 - 1` lobes.
    fn run<const N: usize>(&self, level: Level, tile: &mut LafortuneTile<'_>) {
        let these = (0..self.pixels.len()).filter(|&i| self.found[i].lobes == N / 3 - 1);
        let mut lanes =
            CovarianceBatch { covariance: self, geometries: Geometries::all(self.data.rig), tile };
        let these = these.take_while(|_| !(self.stopped)());
        fit::<f64, N>(level, &mut lanes, these, &Bounds::none(), &STAY);
    }
}

struct CovarianceBatch<'a, 'tile> {
    covariance: &'a Covariance<'a>,
    geometries: Geometries<f64>,
    tile: &'a mut LafortuneTile<'tile>,
}

impl<const N: usize> Batch<f64, N> for CovarianceBatch<'_, '_> {
    const COVARIANCE: bool = true;

    fn rows(&self) -> usize {
        self.geometries.rows()
    }
    fn load(&mut self, i: usize, column: &mut Column<'_, f64>) -> [f64; N] {
        let Covariance { data, pixels, found, .. } = *self.covariance;
        data.load(pixels[i], &self.geometries, column);
        let [p, q] = slopes(data.normals[pixels[i]]).map(f64::from);
        core::array::from_fn(|unknown| match unknown {
            0 => p,
            1 => q,
            _ => found[i].at[unknown - 2],
        })
    }
    fn load_rows(&mut self, columns: &mut Columns<'_, f64>) {
        let Covariance { data, pixels, .. } = *self.covariance;
        data.load_rows(|i| pixels[i], &self.geometries, columns);
    }
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "a matrix is written with its indices")]
    fn normal<R: Real<Scalar = f64>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        let model = JointModel::new(&at);
        let mut normal = self.geometries.equations(rows, |light, view, light_view, irradiance| {
            model.gradient(light, view, light_view, irradiance)
        });
        let given = |i: usize| i < 2 || i % 3 == 1;
        if !self.covariance.turning {
            // Nothing depends on what is given.
            for i in 0..N {
                for j in (0..=i).filter(|&j| given(i) || given(j)) {
                    normal.matrix[i][j] = R::zero();
                }
            }
        }
        normal
    }
    fn store(&mut self, i: usize, outcome: &Outcome<f64, N>) {
        let (pixel, found) = (self.covariance.pixels[i], &self.covariance.found[i]);
        let covariance =
            PixelCovariance::of(outcome, self.covariance.data.count(pixel, &self.geometries));
        let normal = covariance.normal(outcome);
        // Where a lobe's parameter is confounded with the normal, the search's own deviation stays.
        if normal.is_finite() {
            self.tile.sigma[pixel] = normal;
        }
        for lobe in 0..found.lobes {
            let [strength, direction, exponent] = covariance.lobe(found, lobe);
            self.tile.specular_sigma[lobe][pixel] = strength as f32;
            self.tile.direction_sigma[lobe][pixel] = direction as f32;
            self.tile.exponent_sigma[lobe][pixel] = exponent as f32;
        }
    }
}

/// Covariance of two slopes, the diffuse part, and (strength, n times turn, ln n) of every lobe.
struct PixelCovariance<const N: usize> {
    /// 0 for what is given; NaN for what the samples do not separate from others.
    covariance: [[f64; N]; N],
    given: [bool; N],
}

impl<const N: usize> PixelCovariance<N> {
    fn of(outcome: &Outcome<f64, N>, samples: usize) -> Self {
        let alone: [f64; N] = core::array::from_fn(|i| outcome.normal.matrix[i][i]);
        let given = alone.map(|own| own <= 0.0);
        let free = samples as f64 - given.iter().filter(|&&given| !given).count() as f64;
        // As many samples as unknowns leave no noise to judge by (hard case 30).
        let noise = if free > 0.0 { outcome.normal.cost / free } else { f64::NAN };
        let unit = outcome.covariance(1.0);
        let separable = |i: usize| alone[i] * unit[i][i] < LOST;
        let entry = |i: usize, j: usize| {
            if given[i] || given[j] {
                0.0
            } else if separable(i) && separable(j) {
                unit[i][j] * noise
            } else {
                f64::NAN
            }
        };
        Self { covariance: core::array::from_fn(|i| core::array::from_fn(|j| entry(i, j))), given }
    }

    /// Standard deviation of the normal along its worst axis; NaN where it is given.
    fn normal(&self, outcome: &Outcome<f64, N>) -> f32 {
        if self.given[0] || self.given[1] {
            return f32::NAN;
        }
        let slopes = [outcome.parameters[0], outcome.parameters[1]].map(|slope| slope as f32);
        let own = [(0, 0), (1, 0), (1, 1)].map(|(i, j)| self.covariance[i][j] as f32);
        facing(slopes, own, f32::NAN).sigma
    }

    /// Standard deviations of a lobe: of its strength, relative; of the direction of (Cxy, Cz),
    /// radians; of `ln n`.
    fn lobe(&self, found: &LafortuneEstimate, lobe: usize) -> [f64; 3] {
        let [strength, turning, log_exponent] = found.lobe(lobe);
        let first = 3 + 3 * lobe;
        let [of_strength, of_turning, of_exponent] =
            [0, 1, 2].map(|i| self.covariance[first + i][first + i]);
        let both = self.covariance[first + 1][first + 2];
        // psi = 2 atan(turn), turn = turning / n.
        let turn = turning / log_exponent.exp();
        let rate = 2.0 / (turn.mul_add(turn, 1.0) * log_exponent.exp());
        let bent = turning.mul_add(turning.mul_add(of_exponent, -2.0 * both), of_turning);
        let sigmas = [of_strength.sqrt() / strength, rate * bent.sqrt(), of_exponent.sqrt()];
        let [broadest, sharpest] = LOG_EXPONENT.map(|bound| SHORT * bound);
        let open = [
            strength > 0.0,
            turning.abs() < SHORT * TURN,
            broadest < log_exponent && log_exponent < sharpest,
        ];
        let determined = |i: usize| open[i] && !self.given[first + i];
        core::array::from_fn(|i| if determined(i) { sigmas[i] } else { f64::NAN })
    }
}
