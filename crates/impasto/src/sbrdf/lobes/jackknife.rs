//! The error of a normal by the delete-a-group jackknife [@kott2001jackknife]: with what the model does
//! not describe.
//!
//! The covariance of weighted least squares takes every sample for independent. What a model lacks is
//! a smooth function of the light instead, alike in all bands: hundreds of samples then say little
//! more than a dozen would. Groups of neighbouring lights, sectors of azimuth, are therefore taken for
//! the independent samples: a cluster-robust covariance. Without a group the normal would move, to
//! first order, by the inverse of what the other groups know times what the group pulled, the
//! colours following:
//!
//! ```text
//! d_g = -(H - H_g)^-1 u_g,     e_g = -H^-1 u_g,     C = sum over groups of (d_g e_g' + e_g d_g') / 2
//! ```
//!
//! The jackknife's `d d'` is too large where groups have leverage, as they have with few lights, and the
//! plain sandwich `e e'` too small. Half way, as `C`, is the bias-reduced one [@bell2002cluster].
//!
//! What is smoother than a sector is wide stays: an error that all lights share moves every `d_g`
//! alike. It is the larger, the more of the residuals is an error of the model
//! ([`coherence`](crate::sbrdf::coherence)), and the further the normal leans away from that of the
//! painting, which the view is near: residuals of lobes and of reflected light are mostly symmetric about it, and so are lights. The
//! deviation is multiplied by `1 + kappa sin(t) coherence`.

use core::ops::Range;

use crate::lm;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Mask, Real, Vec3};
use crate::sbrdf::coherence::Coherence;
use crate::sbrdf::neighbouring_lights::SECTORS;
use crate::sbrdf::pooled::tangents;

use super::bounds::light_of;
use super::model::{LobeEstimation, Visit};
use super::photographs::Photographs;
use super::reweight::{COLUMNS, Solution};
use super::tile::{
    Estimate, TILE, TileSamples, gather, gather_lobes, gather_normal, runs_by_lobes,
};

/// `kappa`, calibrated on path-traced objects of known normals (docs/numerics.md).
const SMOOTH: f64 = 4.0;

/// The weights were renewed by the residuals: the cost bends less than its weights say. With normal
/// noise and weights that have settled the deviation is 1.36 times that of fixed weights (the mean of the
/// weight over that of the slope of weight times residual); after the usual rounds 1.2 is found.
const REWEIGHTED: f64 = 1.2;

/// Share of its diagonal that is added to every equation: without a group the others may say
/// nothing of a parameter, and subtraction leaves rounding.
const RIDGE: f64 = 1e-6;

/// Standard deviation of a shape's unknown before any photograph is seen: a factor of e in sharpness.
const SHAPE_DEVIATION: f64 = 1.0;

/// Largest tilt that a first-order step means anything for.
const LONGEST: f64 = 1.0;

/// Predicts the errors of a tile's normals.
pub(super) struct Jackknife<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    /// Their deviations become the larger of their own and the jackknife's, in radians.
    pub(super) estimates: &'a mut [Estimate],
    pub(super) samples: &'a TileSamples,
    pub(super) solution: &'a Solution,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Jackknife<'_, M> {
    pub(super) fn run(mut self) {
        for (lobes, range) in runs_by_lobes(self.estimates) {
            M::dispatch(lobes, Part { jackknife: &mut self, range });
        }
    }
}

/// Some of the pixels, with at most so many lobes.
struct Part<'a, 'b, M: LobeEstimation> {
    jackknife: &'a mut Jackknife<'b, M>,
    range: Range<usize>,
}

impl<M: LobeEstimation> Visit for Part<'_, '_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.jackknife.level;
        level.run(JackknifePass::<M, J, K, N>(self));
    }
}

struct JackknifePass<'a, 'b, M: LobeEstimation, const J: usize, const K: usize, const N: usize>(
    Part<'a, 'b, M>,
);

impl<M: LobeEstimation, const J: usize, const K: usize, const N: usize> Kernel
    for JackknifePass<'_, '_, M, J, K, N>
{
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn run<I: Isa>(self) {
        let Part { jackknife, range } = self.0;
        let Jackknife { photographs, x, y, samples, solution, .. } = *jackknife;
        let estimates = &mut *jackknife.estimates;
        let zero = I::F32::zero();
        let lights = &photographs.neighbours;
        let mut equations = Equations::<I::F32, K, N>::new(samples.bands);
        let mut coherence = Coherence::new(photographs.len(), samples.bands);
        let mut colours = vec![[zero; K]; samples.bands];
        for at in range.step_by(I::F32::WIDTH) {
            equations.clear();
            coherence.clear();
            for band in 0..samples.bands {
                for i in 0..K {
                    let column = if i == K - 1 { COLUMNS - 1 } else { i };
                    let place = (band * COLUMNS + column) * TILE + at;
                    colours[band][i] = I::F32::load(&solution.colours[place..]).max(zero);
                }
            }
            let pixels = Pixels::<I::F32, M, J>::gathered(photographs, estimates, at);
            let place = (I::F32::load(&x[at..]), I::F32::load(&y[at..]));
            for photograph in 0..photographs.len() {
                let (units, slopes) = pixels.look::<K, N>(photographs, photograph, place);
                for band in 0..samples.bands {
                    let colours = &colours[band];
                    let plane = photograph * samples.bands + band;
                    let (sample, weight) = samples.at::<I::F32>(plane, at);
                    let counts = weight.gt(zero);
                    let mut columns = units;
                    let mut slope = [zero; N];
                    for i in 0..K {
                        // A colour at its bound of 0 does not follow.
                        columns[i] = I::F32::keep(colours[i].gt(zero), columns[i]);
                        for j in 0..N {
                            slope[j] = colours[i].mul_add(slopes[i][j], slope[j]);
                        }
                    }
                    let residual = I::F32::keep(counts, sample - light_of(&columns, colours));
                    coherence.add(photograph, weight.sqrt() * residual, counts);
                    let sector = lights.sector[photograph];
                    equations.add([sector, band], &columns, &slope, weight, residual);
                }
                coherence.end_photograph();
            }
            equations.sum();
            let variance = I::F32::load(&solution.variance[at..]);
            let typical = variance * I::F32::of(1.0 / (SHAPE_DEVIATION * SHAPE_DEVIATION));
            let [xx, xy, yy] = equations.covariance(typical);
            let half = I::F32::of(0.5);
            let (middle, apart) = ((xx + yy) * half, (xx - yy) * half);
            let worst = middle + apart.mul_add(apart, xy * xy).sqrt();
            let spread = worst.max(zero).sqrt() * I::F32::of(REWEIGHTED);
            let normal = pixels.normal;
            let tilt = normal.x.mul_add(normal.x, normal.y * normal.y).sqrt();
            let smooth = tilt * I::F32::of(SMOOTH) * coherence.share(&lights.nearest);
            let [mut jackknife, mut factor] = [[0.0; MAX_LANES]; 2];
            spread.store(&mut jackknife);
            (I::F32::one() + smooth).store(&mut factor);
            for (lane, estimate) in estimates[at..].iter_mut().take(I::F32::WIDTH).enumerate() {
                // A deviation that is no number, or endless, says that nothing is known.
                let own = estimate.normal_deviation;
                let both = if jackknife[lane].is_finite() {
                    own.max(jackknife[lane])
                } else {
                    f32::INFINITY
                };
                let known = if own.is_finite() { both } else { own };
                estimate.normal_deviation = known * factor[lane];
            }
        }
    }
}

/// Normals and lobes of a register of pixels.
struct Pixels<R: Real, M: LobeEstimation, const J: usize> {
    normal: Vec3<R>,
    tilts: [Vec3<R>; 2],
    /// How many lobes each has.
    count: R,
    lobes: [M::Lobe<R>; J],
}

impl<R: Real<Scalar = f32>, M: LobeEstimation, const J: usize> Pixels<R, M, J> {
    #[inline(always)]
    fn gathered(photographs: &Photographs<M>, estimates: &[Estimate], at: usize) -> Self {
        let normal = gather_normal(estimates, at);
        let lobes = gather_lobes(&photographs.model, estimates, at);
        let count = gather(estimates, at, |p| p.lobes as f32);
        Self { normal, tilts: tangents(normal), count, lobes }
    }

    /// The columns of a photograph, and their slopes by tilts and shapes.
    #[inline(always)]
    fn look<const K: usize, const N: usize>(
        &self,
        photographs: &Photographs<M>,
        photograph: usize,
        (x, y): (R, R),
    ) -> ([R; K], [[R; N]; K]) {
        let zero = R::zero();
        let (towards, irradiance, pair) = photographs.at(photograph, x, y);
        let lit = R::keep(self.normal.dot(towards).gt(zero), irradiance);
        let diffuse = photographs.diffuse(self.normal, towards, &pair);
        let mut units = [R::one(); K];
        let mut slopes = [[zero; N]; K];
        units[0] = diffuse.value * lit;
        slopes[0][0] = self.tilts[0].dot(diffuse.normal) * lit;
        slopes[0][1] = self.tilts[1].dot(diffuse.normal) * lit;
        for j in 0..J {
            let irradiance = R::keep(self.count.gt(R::of(j as f64)), irradiance);
            let slope = photographs.model.slope(&self.lobes[j], &pair, self.normal);
            units[1 + j] = slope.value * irradiance;
            slopes[1 + j][0] = self.tilts[0].dot(slope.normal) * irradiance;
            slopes[1 + j][1] = self.tilts[1].dot(slope.normal) * irradiance;
            for s in 0..M::SHAPES {
                slopes[1 + j][2 + j * M::SHAPES + s] = slope.shape[s] * irradiance;
            }
        }
        (units, slopes)
    }
}

/// The equations of one band, `K` colours and `N` other unknowns.
#[derive(Clone, Copy)]
struct BandEquations<R, const K: usize, const N: usize> {
    gram: [[R; K]; K],
    mixed: [[R; K]; N],
    pull: [R; K],
}

/// Those of the unknowns that all bands share.
#[derive(Clone, Copy)]
struct SharedEquations<R, const N: usize> {
    matrix: [[R; N]; N],
    pull: [R; N],
}

/// The equations of every sector of lights, and behind them their sum.
struct Equations<R: Real, const K: usize, const N: usize> {
    bands: usize,
    by_band: Vec<BandEquations<R, K, N>>,
    shared: Vec<SharedEquations<R, N>>,
    /// Of the last [`Self::eliminate`], by band: the factor of the colours, and what couples them.
    eliminated: Vec<(lm::Factor<R, K>, [[R; K]; N])>,
}

impl<R: Real, const K: usize, const N: usize> Equations<R, K, N> {
    fn new(bands: usize) -> Self {
        let zero = R::zero();
        let band = BandEquations { gram: [[zero; K]; K], mixed: [[zero; K]; N], pull: [zero; K] };
        let shared = SharedEquations { matrix: [[zero; N]; N], pull: [zero; N] };
        Self {
            bands,
            by_band: vec![band; (SECTORS + 1) * bands],
            shared: vec![shared; SECTORS + 1],
            eliminated: Vec::with_capacity(bands),
        }
    }

    #[inline(always)]
    fn clear(&mut self) {
        let zero = R::zero();
        self.by_band.fill(BandEquations {
            gram: [[zero; K]; K],
            mixed: [[zero; K]; N],
            pull: [zero; K],
        });
        self.shared.fill(SharedEquations { matrix: [[zero; N]; N], pull: [zero; N] });
    }

    /// Adds a sample of a sector and band.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn add(
        &mut self,
        [sector, band]: [usize; 2],
        columns: &[R; K],
        slope: &[R; N],
        weight: R,
        residual: R,
    ) {
        let pull = weight * residual;
        let own = &mut self.by_band[sector * self.bands + band];
        let shared = &mut self.shared[sector];
        for i in 0..K {
            let heavy = weight * columns[i];
            own.pull[i] = pull.mul_add(columns[i], own.pull[i]);
            for j in 0..=i {
                own.gram[i][j] = heavy.mul_add(columns[j], own.gram[i][j]);
            }
        }
        for i in 0..N {
            let heavy = weight * slope[i];
            shared.pull[i] = pull.mul_add(slope[i], shared.pull[i]);
            for j in 0..=i {
                shared.matrix[i][j] = heavy.mul_add(slope[j], shared.matrix[i][j]);
            }
            for column in 0..K {
                own.mixed[i][column] = heavy.mul_add(columns[column], own.mixed[i][column]);
            }
        }
    }

    /// Must follow the last sample.
    #[inline(always)]
    fn sum(&mut self) {
        let (some, all) = self.shared.split_at_mut(SECTORS);
        for own in some {
            all[0] = all[0].with(R::one(), own);
        }
        let (some, all) = self.by_band.split_at_mut(SECTORS * self.bands);
        for own in some.chunks(self.bands) {
            for (all, own) in all.iter_mut().zip(own) {
                *all = all.with(R::one(), own);
            }
        }
    }

    /// The covariance of two tilts (xx, xy, yy). `typical` is what is known of shapes without any
    /// photograph.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn covariance(&mut self, typical: R) -> [R; 3] {
        let (zero, half) = (R::zero(), R::of(0.5));
        let mut plain = [[zero; 2]; SECTORS];
        let all = self.eliminate(None, typical);
        for sector in 0..SECTORS {
            plain[sector] = self.tilt(sector, &all);
        }
        let [mut xx, mut xy, mut yy] = [zero; 3];
        for sector in 0..SECTORS {
            let [u, v] = plain[sector];
            let others = self.eliminate(Some(sector), typical);
            let [p, q] = self.tilt(sector, &others);
            xx = p.mul_add(u, xx);
            xy = half.mul_add(p.mul_add(v, q * u), xy);
            yy = q.mul_add(v, yy);
        }
        [xx, xy, yy]
    }

    /// Eliminates the colours from the equations of all sectors, or of all but one.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn eliminate(&mut self, without: Option<usize>, typical: R) -> lm::Factor<R, N> {
        let (zero, ridge) = (R::zero(), R::of(RIDGE));
        let all = &self.shared[SECTORS];
        let mut left = *all;
        if let Some(sector) = without {
            left = all.with(-R::one(), &self.shared[sector]);
        }
        let matrix = &mut left.matrix;
        self.eliminated.clear();
        for band in 0..self.bands {
            let all = &self.by_band[SECTORS * self.bands + band];
            let mut left = *all;
            if let Some(sector) = without {
                let own = &self.by_band[sector * self.bands + band];
                left = all.with(-R::one(), own);
            }
            let BandEquations { mut gram, mixed, .. } = left;
            for i in 0..K {
                gram[i][i] = all.gram[i][i].mul_add(ridge, gram[i][i]);
            }
            let factor = lm::factor(&gram, zero, &[R::Mask::splat(false); K]);
            for i in 0..N {
                let follow = factor.solve(&mixed[i]);
                for column in 0..K {
                    for j in 0..=i {
                        matrix[i][j] = (-mixed[j][column]).mul_add(follow[column], matrix[i][j]);
                    }
                }
            }
            self.eliminated.push((factor, mixed));
        }
        for i in 0..N {
            matrix[i][i] = all.matrix[i][i].mul_add(ridge, matrix[i][i]);
            if i >= 2 {
                matrix[i][i] = matrix[i][i] + typical;
            }
        }
        lm::factor(matrix, zero, &[R::Mask::splat(false); N])
    }

    /// How far the normal tilts without the pulls of a sector, by the equations of the last
    /// [`Self::eliminate`] and their factor.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn tilt(&self, sector: usize, factor: &lm::Factor<R, N>) -> [R; 2] {
        let mut pull = [R::zero(); N];
        for i in 0..N {
            pull[i] = -self.shared[sector].pull[i];
        }
        let by_band = &self.by_band[sector * self.bands..];
        for ((colours, mixed), own) in self.eliminated.iter().zip(by_band) {
            let along = colours.solve(&own.pull);
            for i in 0..N {
                for column in 0..K {
                    pull[i] = mixed[i][column].mul_add(along[column], pull[i]);
                }
            }
        }
        let step = factor.solve(&pull);
        let length = step[0].mul_add(step[0], step[1] * step[1]).sqrt();
        let longest = R::of(LONGEST);
        let short = R::select(length.gt(longest), longest / length, R::one());
        [step[0] * short, step[1] * short]
    }
}

impl<R: Real, const K: usize, const N: usize> BandEquations<R, K, N> {
    /// This and `sign` times the other; of the triangle, what is below the diagonal.
    #[inline(always)]
    fn with(&self, sign: R, other: &Self) -> Self {
        let mut found = *self;
        for i in 0..K {
            found.pull[i] = sign.mul_add(other.pull[i], self.pull[i]);
            for j in 0..=i {
                found.gram[i][j] = sign.mul_add(other.gram[i][j], self.gram[i][j]);
            }
            for j in 0..N {
                found.mixed[j][i] = sign.mul_add(other.mixed[j][i], self.mixed[j][i]);
            }
        }
        found
    }
}

impl<R: Real, const N: usize> SharedEquations<R, N> {
    /// This and `sign` times the other.
    #[inline(always)]
    fn with(&self, sign: R, other: &Self) -> Self {
        let mut found = *self;
        for i in 0..N {
            found.pull[i] = sign.mul_add(other.pull[i], self.pull[i]);
            for j in 0..=i {
                found.matrix[i][j] = sign.mul_add(other.matrix[i][j], self.matrix[i][j]);
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 3;
    const K: usize = 2;
    const BANDS: usize = 2;
    /// Shared unknowns, then the colours of each band.
    const ALL: usize = N + BANDS * K;

    struct Row {
        group: usize,
        band: usize,
        slope: [f64; N],
        columns: [f64; K],
        weight: f64,
        sample: f64,
    }

    fn rows() -> Vec<Row> {
        let mut seed = 11_u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
            (seed >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let row = |i: usize| Row {
            group: i / BANDS % 4,
            band: i % BANDS,
            slope: core::array::from_fn(|_| 0.3 * random()),
            columns: core::array::from_fn(|_| 1.0 + random()),
            weight: 1.0 + random(),
            sample: 0.1 * random(),
        };
        (0..48).map(row).collect()
    }

    /// All unknowns by one dense system, without elimination.
    fn solved<'a>(rows: impl Iterator<Item = &'a Row>) -> [f64; ALL] {
        let mut matrix = [[0.0; ALL]; ALL];
        let mut right = [0.0; ALL];
        for row in rows {
            let mut full = [0.0; ALL];
            full[..N].copy_from_slice(&row.slope);
            full[N + row.band * K..][..K].copy_from_slice(&row.columns);
            for i in 0..ALL {
                right[i] += row.weight * full[i] * row.sample;
                for j in 0..=i {
                    matrix[i][j] += row.weight * full[i] * full[j];
                }
            }
        }
        lm::factor(&matrix, 0.0, &[false; ALL]).solve(&right)
    }

    #[test]
    fn a_linear_problem_without_a_group_has_the_solution_of_the_other_groups() {
        let rows = rows();
        let whole = solved(rows.iter());
        let mut equations = Equations::<f64, K, N>::new(BANDS);
        for row in &rows {
            let model: f64 = row.slope.iter().zip(&whole).map(|(s, x)| s * x).sum::<f64>()
                + row
                    .columns
                    .iter()
                    .zip(&whole[N + row.band * K..])
                    .map(|(c, x)| c * x)
                    .sum::<f64>();
            let place = [row.group, row.band];
            equations.add(place, &row.columns, &row.slope, row.weight, row.sample - model);
        }
        equations.sum();
        for group in 0..4 {
            let expected = solved(rows.iter().filter(|row| row.group != group));
            let others = equations.eliminate(Some(group), 0.0);
            let found = equations.tilt(group, &others);
            for k in 0..2 {
                // The ridge is a millionth of what the others know.
                let moved = expected[k] - whole[k];
                assert!((found[k] - moved).abs() < 1e-4 * moved.abs().max(1e-3), "{group} {k}");
            }
        }
    }
}
