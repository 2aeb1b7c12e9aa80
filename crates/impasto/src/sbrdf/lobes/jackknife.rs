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
//! ([`coherence`](crate::sbrdf::coherence)), and the further the normal points away from the view:
//! residuals of lobes and of reflected light are mostly symmetric about it, and so are lights. The
//! deviation is multiplied by `1 + kappa sin(t) coherence`.

use crate::lm;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Mask, Real, Vec3};
use crate::sbrdf::coherence::Coherence;
use crate::sbrdf::neighbouring_lights::SECTORS;
use crate::sbrdf::pooled::tangents;

use super::model::{LobeEstimation, MAX_SHAPES, Visit};
use super::photographs::Photographs;
use super::reweight::{COLUMNS, Solution, light_of, look};
use super::tile::{Estimate, TILE, TileSamples, gather};

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
    pub(super) lobes: usize,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Jackknife<'_, M> {
    pub(super) fn run(self) {
        M::dispatch(self.lobes, self);
    }
}

impl<M: LobeEstimation> Visit for Jackknife<'_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        let level = self.level;
        level.run(JackknifePass::<M, J, K, N>(self));
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

struct JackknifePass<'a, M: LobeEstimation, const J: usize, const K: usize, const N: usize>(
    Jackknife<'a, M>,
);

impl<M: LobeEstimation, const J: usize, const K: usize, const N: usize> Kernel
    for JackknifePass<'_, M, J, K, N>
{
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn run<I: Isa>(self) {
        let Jackknife { photographs, x, y, estimates, samples, solution, .. } = self.0;
        let zero = I::F32::zero();
        let bands = samples.bands;
        let lights = &photographs.neighbours;
        // Behind the sectors stands the sum of all.
        let all = SECTORS;
        let no_band =
            BandEquations { gram: [[zero; K]; K], mixed: [[zero; K]; N], pull: [zero; K] };
        let nothing = SharedEquations { matrix: [[zero; N]; N], pull: [zero; N] };
        let mut by_band = vec![no_band; (all + 1) * bands];
        let mut shared = vec![nothing; all + 1];
        let mut coherence = Coherence::new(photographs.len(), bands);
        let mut at = 0;
        while at < estimates.len() {
            by_band.fill(no_band);
            shared.fill(nothing);
            coherence.clear();
            let normal = Vec3::new(
                gather::<I::F32>(estimates, at, |p| p.normal[0]),
                gather(estimates, at, |p| p.normal[1]),
                gather(estimates, at, |p| p.normal[2]),
            );
            let tilts = tangents(normal);
            let count: I::F32 = gather(estimates, at, |p| p.lobes as f32);
            let mut lobes = [photographs.model.lobe_from_unknowns([zero; MAX_SHAPES]); J];
            for (j, lobe) in lobes.iter_mut().enumerate() {
                let mut shape = [zero; MAX_SHAPES];
                for (s, shape) in shape.iter_mut().enumerate() {
                    *shape = gather(estimates, at, |p| p.shapes[j][s]);
                }
                *lobe = photographs.model.lobe_from_unknowns(shape);
            }
            let (px, py) = (I::F32::load(&x[at..]), I::F32::load(&y[at..]));
            for photograph in 0..photographs.len() {
                let (towards, irradiance, pair) = photographs.at(photograph, px, py);
                let lit = I::F32::keep(normal.dot(towards).gt(zero), irradiance);
                let diffuse = photographs.diffuse(normal, towards, &pair);
                // Of unit strength, and by what the bands share.
                let mut units = [I::F32::one(); K];
                let mut slopes = [[zero; N]; K];
                units[0] = diffuse.value * lit;
                slopes[0][0] = tilts[0].dot(diffuse.normal) * lit;
                slopes[0][1] = tilts[1].dot(diffuse.normal) * lit;
                for (j, lobe) in lobes.iter().enumerate() {
                    let present = count.gt(I::F32::of(j as f64));
                    let irradiance = I::F32::keep(present, irradiance);
                    let slope = photographs.model.slope(lobe, &pair, normal);
                    units[1 + j] = slope.value * irradiance;
                    slopes[1 + j][0] = tilts[0].dot(slope.normal) * irradiance;
                    slopes[1 + j][1] = tilts[1].dot(slope.normal) * irradiance;
                    for s in 0..M::SHAPES {
                        slopes[1 + j][2 + j * M::SHAPES + s] = slope.shape[s] * irradiance;
                    }
                }
                let group = lights.sector[photograph];
                let own = &mut shared[group];
                for band in 0..bands {
                    let plane = photograph * bands + band;
                    let (sample, weight, _) = look::<I::F32>(samples, plane, at);
                    let counts = weight.gt(zero);
                    let mut columns = units;
                    let mut colours = [zero; K];
                    let mut slope = [zero; N];
                    for column in 0..K {
                        let source = if column == K - 1 { COLUMNS - 1 } else { column };
                        let place = (band * COLUMNS + source) * TILE + at;
                        let colour = I::F32::load(&solution.colours[place..]);
                        // A colour at its bound of 0 does not follow.
                        let free = colour.gt(zero);
                        colours[column] = I::F32::keep(free, colour);
                        columns[column] = I::F32::keep(free, columns[column]);
                        for i in 0..N {
                            slope[i] = colours[column].mul_add(slopes[column][i], slope[i]);
                        }
                    }
                    let residual = I::F32::keep(counts, sample - light_of(&columns, &colours));
                    coherence.add(photograph, weight.sqrt() * residual, counts);
                    let pull = weight * residual;
                    let equations = &mut by_band[group * bands + band];
                    for i in 0..K {
                        let heavy = weight * columns[i];
                        equations.pull[i] = pull.mul_add(columns[i], equations.pull[i]);
                        for j in 0..=i {
                            equations.gram[i][j] = heavy.mul_add(columns[j], equations.gram[i][j]);
                        }
                    }
                    for i in 0..N {
                        let heavy = weight * slope[i];
                        own.pull[i] = pull.mul_add(slope[i], own.pull[i]);
                        for j in 0..=i {
                            own.matrix[i][j] = heavy.mul_add(slope[j], own.matrix[i][j]);
                        }
                        for column in 0..K {
                            equations.mixed[i][column] =
                                heavy.mul_add(columns[column], equations.mixed[i][column]);
                        }
                    }
                }
                coherence.end_photograph();
            }
            let variance = I::F32::load(&solution.variance[at..]);
            let typical = variance * I::F32::of(1.0 / (SHAPE_DEVIATION * SHAPE_DEVIATION));
            for group in 0..all {
                let (some, total) = shared.split_at_mut(all);
                total[0] = total[0].plus(&some[group]);
                let (some, total) = by_band.split_at_mut(all * bands);
                for (band, total) in total.iter_mut().enumerate() {
                    *total = total.plus(&some[group * bands + band]);
                }
            }
            let whole = Without::group(&shared, &by_band, None, typical);
            let half = I::F32::of(0.5);
            let [mut xx, mut xy, mut yy] = [zero; 3];
            for group in 0..all {
                let others = Without::group(&shared, &by_band, Some(group), typical);
                let own = &by_band[group * bands..][..bands];
                let [p, q] = others.tilt(&shared[group].pull, own);
                let [u, v] = whole.tilt(&shared[group].pull, own);
                xx = p.mul_add(u, xx);
                xy = half.mul_add(p.mul_add(v, q * u), xy);
                yy = q.mul_add(v, yy);
            }
            let (middle, apart) = ((xx + yy) * half, (xx - yy) * half);
            let worst = middle + apart.mul_add(apart, xy * xy).sqrt();
            let spread = worst.max(zero).sqrt() * I::F32::of(REWEIGHTED);
            let tilt = normal.x.mul_add(normal.x, normal.y * normal.y).sqrt();
            let smooth = tilt * I::F32::of(SMOOTH) * coherence.share(&lights.nearest);
            let [mut jackknife, mut factor] = [[0.0; MAX_LANES]; 2];
            spread.store(&mut jackknife);
            (I::F32::one() + smooth).store(&mut factor);
            for (lane, estimate) in estimates[at..].iter_mut().take(I::F32::WIDTH).enumerate() {
                // A deviation that is no number, or endless, says that nothing is known.
                let own = estimate.normal_deviation;
                let known = if own.is_finite() { own.max(jackknife[lane]) } else { own };
                estimate.normal_deviation = known * factor[lane];
            }
            at += I::F32::WIDTH;
        }
    }
}

/// What all groups but one know, the colours eliminated.
struct Without<R: Real, const K: usize, const N: usize> {
    bands: Vec<(lm::Factor<R, K>, [[R; K]; N])>,
    factor: lm::Factor<R, N>,
}

impl<R: Real, const K: usize, const N: usize> Without<R, K, N> {
    /// Of the sums of all groups, the last of `shared` and of `by_band`, less those of `group`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn group(
        shared: &[SharedEquations<R, N>],
        by_band: &[BandEquations<R, K, N>],
        group: Option<usize>,
        typical: R,
    ) -> Self {
        let zero = R::zero();
        let ridge = R::of(RIDGE);
        let groups = shared.len() - 1;
        let count = by_band.len() / shared.len();
        let all = &shared[groups];
        let mut matrix = match group {
            Some(group) => all.less(&shared[group]),
            None => all.matrix,
        };
        let mut bands = Vec::with_capacity(count);
        for band in 0..count {
            let all = &by_band[groups * count + band];
            let BandEquations { mut gram, mixed, .. } = match group {
                Some(group) => all.less(&by_band[group * count + band]),
                None => *all,
            };
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
            bands.push((factor, mixed));
        }
        for i in 0..N {
            matrix[i][i] = all.matrix[i][i].mul_add(ridge, matrix[i][i]);
            if i >= 2 {
                matrix[i][i] = matrix[i][i] + typical;
            }
        }
        Self { bands, factor: lm::factor(&matrix, zero, &[R::Mask::splat(false); N]) }
    }

    /// How far the normal tilts without the pulls of a group.
    #[inline(always)]
    fn tilt(&self, pull: &[R; N], by_band: &[BandEquations<R, K, N>]) -> [R; 2] {
        let mut pull = pull.map(|pull| -pull);
        for ((factor, mixed), own) in self.bands.iter().zip(by_band) {
            let along = factor.solve(&own.pull);
            for (pull, mixed) in pull.iter_mut().zip(mixed) {
                for (&mixed, &along) in mixed.iter().zip(&along) {
                    *pull = mixed.mul_add(along, *pull);
                }
            }
        }
        let step = self.factor.solve(&pull);
        let length = step[0].mul_add(step[0], step[1] * step[1]).sqrt();
        let longest = R::of(LONGEST);
        let short = R::select(length.gt(longest), longest / length, R::one());
        [step[0] * short, step[1] * short]
    }
}

impl<R: Real, const K: usize, const N: usize> BandEquations<R, K, N> {
    #[inline(always)]
    fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        for i in 0..K {
            sum.pull[i] = self.pull[i] + other.pull[i];
            for j in 0..=i {
                sum.gram[i][j] = self.gram[i][j] + other.gram[i][j];
            }
            for j in 0..N {
                sum.mixed[j][i] = self.mixed[j][i] + other.mixed[j][i];
            }
        }
        sum
    }

    #[inline(always)]
    fn less(&self, other: &Self) -> Self {
        let mut left = *self;
        for i in 0..K {
            for j in 0..=i {
                left.gram[i][j] = self.gram[i][j] - other.gram[i][j];
            }
            for j in 0..N {
                left.mixed[j][i] = self.mixed[j][i] - other.mixed[j][i];
            }
        }
        left
    }
}

impl<R: Real, const N: usize> SharedEquations<R, N> {
    #[inline(always)]
    fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        for i in 0..N {
            sum.pull[i] = self.pull[i] + other.pull[i];
            for j in 0..=i {
                sum.matrix[i][j] = self.matrix[i][j] + other.matrix[i][j];
            }
        }
        sum
    }

    #[inline(always)]
    fn less(&self, other: &Self) -> [[R; N]; N] {
        let mut left = self.matrix;
        for i in 0..N {
            for j in 0..=i {
                left[i][j] = self.matrix[i][j] - other.matrix[i][j];
            }
        }
        left
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
        let no_band = BandEquations { gram: [[0.0; K]; K], mixed: [[0.0; K]; N], pull: [0.0; K] };
        let nothing = SharedEquations { matrix: [[0.0; N]; N], pull: [0.0; N] };
        let mut by_band = [no_band; 5 * BANDS];
        let mut shared = [nothing; 5];
        for row in &rows {
            let model: f64 = row.slope.iter().zip(&whole).map(|(s, x)| s * x).sum::<f64>()
                + row
                    .columns
                    .iter()
                    .zip(&whole[N + row.band * K..])
                    .map(|(c, x)| c * x)
                    .sum::<f64>();
            let residual = row.sample - model;
            for group in [row.group, 4] {
                let (own, band) = (&mut shared[group], &mut by_band[group * BANDS + row.band]);
                for i in 0..N {
                    own.pull[i] += row.weight * row.slope[i] * residual;
                    for j in 0..=i {
                        own.matrix[i][j] += row.weight * row.slope[i] * row.slope[j];
                    }
                    for k in 0..K {
                        band.mixed[i][k] += row.weight * row.slope[i] * row.columns[k];
                    }
                }
                for i in 0..K {
                    band.pull[i] += row.weight * row.columns[i] * residual;
                    for j in 0..=i {
                        band.gram[i][j] += row.weight * row.columns[i] * row.columns[j];
                    }
                }
            }
        }
        for group in 0..4 {
            let expected = solved(rows.iter().filter(|row| row.group != group));
            let others = Without::group(&shared, &by_band, Some(group), 0.0);
            let found = others.tilt(&shared[group].pull, &by_band[group * BANDS..][..BANDS]);
            for k in 0..2 {
                // The ridge is a millionth of what the others know.
                let moved = expected[k] - whole[k];
                assert!((found[k] - moved).abs() < 1e-4 * moved.abs().max(1e-3), "{group} {k}");
            }
        }
    }
}
