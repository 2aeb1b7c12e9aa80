//! One pass of the joint fit: every pixel's normal and diffuse colour given the painting's
//! (beta, gamma), and what all pixels together say about (beta, gamma).
//!
//! Least squares over all unsaturated samples of `y = rho_b (N.L) + beta D F G / (N.V)`, Cauchy
//! weights against shadows and inter-reflections. A pixel's diffuse colours are eliminated first,
//! then its normal; what is left is its 2 x 2 share of the normal equations of (beta, log k). So
//! the pooled step knows that normals and colours will follow (a Schur complement), which a
//! subtraction of one part from the other does not.

use crate::brdf::lambert;
use crate::brdf::torrance_sparrow::Facet;
use crate::lm::Normal;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real, Vec3};

use super::lanes::{MAX_LANES, load, store};
use super::tile::{Scene, Tile};

/// Longest step of a normal in one pass, rad: a lobe is not linear for longer.
const LONGEST_STEP: f64 = 0.1;

/// Cauchy's constant for 95 % efficiency on normal noise.
const CAUCHY: f64 = 2.385;

/// Added to diagonals, relative: enough to keep an undetermined direction (coplanar lights, hard
/// case 19) from moving, too little to slow the others down.
const RIDGE: f64 = 1e-3;

/// More steps for a normal that starts from nowhere.
const RESTART_STEPS: usize = 4;

/// What the pixels of a tile say about (beta, log k).
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    pub(super) normal: Normal<f64, 2>,
    /// Samples minus unknowns.
    pub(super) freedom: f64,
}

impl Share {
    pub(super) fn zero() -> Self {
        Self { normal: Normal::zero(), freedom: 0.0 }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.freedom += other.freedom;
        self.normal.cost += other.normal.cost;
        for i in 0..2 {
            self.normal.descent[i] += other.normal.descent[i];
            for j in 0..=i {
                self.normal.matrix[i][j] += other.normal.matrix[i][j];
            }
        }
    }
}

pub(super) struct Refine<'a, 'b, 'c> {
    pub(super) scene: &'a Scene<'a>,
    pub(super) tile: &'c mut Tile<'b>,
    /// `(obs, band, pixel of the tile)`, padded to whole registers.
    pub(super) samples: &'a [f32],
    pub(super) stride: usize,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) beta: f64,
    pub(super) log_sharpness: f64,
    pub(super) steps: usize,
    /// Whether to try again from a normal that faces the viewer.
    pub(super) restart: bool,
}

/// Sums of one pixel: normal equations of (two tilts, beta, log k), lower triangle by rows.
#[derive(Clone, Copy)]
struct Sums<R> {
    matrix: [R; 10],
    descent: [R; 4],
}

/// One band's share: its own diagonal and descent, and what couples it to the four.
#[derive(Clone, Copy)]
struct Band<R> {
    own: R,
    descent: R,
    cross: [R; 4],
}

impl Kernel for Refine<'_, '_, '_> {
    type Output = Share;

    #[inline(always)]
    #[allow(clippy::too_many_lines, reason = "one fused pass; its parts share every register")]
    #[allow(clippy::needless_range_loop, reason = "several arrays share an index")]
    fn run<I: Isa>(self) -> Share {
        let Self { scene, tile, samples, stride, x, y, steps, restart, .. } = self;
        let zero = I::F32::zero();
        let one = I::F32::one();
        let (beta, log_k) = (I::F32::of(self.beta), self.log_sharpness);
        let sharpness = I::F32::of(log_k.exp());
        let index = I::F32::of(scene.index);
        let (bands, observations) = (scene.bands, scene.rig.observations());
        let middle: Vec<_> = (0..observations)
            .map(|i| {
                let (towards, irradiance) = scene.rig.lights()[i].at(zero, zero);
                let view = scene.rig.views()[i].splat::<I::F32>();
                (towards, irradiance, Facet::between(towards, view, index))
            })
            .collect();
        let empty = Band { own: zero, descent: zero, cross: [zero; 4] };
        let mut band_sums = vec![empty; bands];
        let mut colours = vec![zero; bands];
        let mut best_colours = vec![zero; bands];
        let mut weights = vec![one; observations];
        let mut misses = vec![zero; observations];
        let mut share = Share::zero();

        let mut at = 0;
        while at < tile.count {
            let mut normal = tile.normal_at::<I::F32>(at);
            for (band, colour) in colours.iter_mut().enumerate() {
                *colour = load(tile.diffuse[band], at);
            }
            weights.fill(one);
            let mut best = (normal, I::F32::of(f64::from(f32::MAX)), zero, zero);
            let mut best_share = [zero; 6];
            let last = if restart { 2 * steps + RESTART_STEPS } else { steps };
            for pass in 0..=last {
                let across = one / (one + normal.z);
                let bend = -(normal.x * normal.y * across);
                let tilt = [
                    Vec3::new((-(normal.x * normal.x)).mul_add(across, one), bend, -normal.x),
                    Vec3::new(bend, (-(normal.y * normal.y)).mul_add(across, one), -normal.y),
                ];
                let mut sums = Sums { matrix: [zero; 10], descent: [zero; 4] };
                band_sums.fill(empty);
                let (mut absolute, mut squares, mut weight_sum, mut used) =
                    (zero, zero, zero, zero);
                for i in 0..observations {
                    let (towards, irradiance, facet) = if scene.rig.lights()[i].is_distant() {
                        middle[i]
                    } else {
                        let (towards, irradiance) =
                            scene.rig.lights()[i].at(load(x, at), load(y, at));
                        let view = scene.rig.views()[i].splat::<I::F32>();
                        (towards, irradiance, Facet::between(towards, view, index))
                    };
                    let cosine = lambert::cosine(normal, towards) * irradiance;
                    let glint = facet.on(normal);
                    let specular = glint.value(beta, sharpness) * irradiance;
                    let slope = facet.gradient(normal, beta, sharpness);
                    let lit = I::F32::keep(cosine.gt(zero), irradiance);
                    let tilts = tilt.map(|t| t.dot(towards) * lit);
                    let gloss = tilt.map(|t| t.dot(slope.normal) * irradiance);
                    let by_beta = slope.beta * irradiance;
                    let by_k = slope.log_sharpness * irradiance;
                    // Clipped in any band, or never taken: weight 0, by selection (hard case 26).
                    let mut usable = one.gt(zero);
                    for band in 0..bands {
                        let sample: I::F32 = load(&samples[(i * bands + band) * stride..], at);
                        usable = usable & sample.is_finite();
                    }
                    let weight = I::F32::keep(usable, weights[i]);
                    let mut miss = zero;
                    for band in 0..bands {
                        let sample: I::F32 = load(&samples[(i * bands + band) * stride..], at);
                        let sample = I::F32::keep(usable, sample);
                        let colour = colours[band];
                        let residual =
                            I::F32::keep(usable, sample - colour.mul_add(cosine, specular));
                        miss = miss + residual.abs();
                        let slopes = [
                            colour.mul_add(tilts[0], gloss[0]),
                            colour.mul_add(tilts[1], gloss[1]),
                            by_beta,
                            by_k,
                        ];
                        let weighted = weight * residual;
                        squares = weighted.mul_add(residual, squares);
                        let b = &mut band_sums[band];
                        let heavy = weight * cosine;
                        b.own = heavy.mul_add(cosine, b.own);
                        b.descent = heavy.mul_add(residual, b.descent);
                        let mut place = 0;
                        for row in 0..4 {
                            b.cross[row] = heavy.mul_add(slopes[row], b.cross[row]);
                            sums.descent[row] = slopes[row].mul_add(weighted, sums.descent[row]);
                            let left = weight * slopes[row];
                            for &right in &slopes[..=row] {
                                sums.matrix[place] = left.mul_add(right, sums.matrix[place]);
                                place += 1;
                            }
                        }
                    }
                    misses[i] = miss;
                    absolute = weight.mul_add(miss, absolute);
                    weight_sum = weight_sum + weight;
                    used = used + I::F32::keep(usable, one);
                }
                // Eliminate the colours.
                for b in &band_sums {
                    let inverse = I::F32::keep(b.own.gt(zero), b.own.recip());
                    let mut place = 0;
                    for row in 0..4 {
                        let left = b.cross[row] * inverse;
                        sums.descent[row] = (-left).mul_add(b.descent, sums.descent[row]);
                        for column in 0..=row {
                            sums.matrix[place] =
                                (-left).mul_add(b.cross[column], sums.matrix[place]);
                            place += 1;
                        }
                    }
                }
                // Solve for the two tilts; eliminate them from (beta, log k).
                let [xx, xy, yy, bx, by, bb, kx, ky, kb, kk] = sums.matrix;
                let ridge = I::F32::of(1.0 + RIDGE);
                let (rx, ry) = (xx * ridge, yy * ridge);
                let determinant = rx.mul_add(ry, -(xy * xy));
                let solvable = determinant.gt(zero);
                let inverse = I::F32::keep(solvable, determinant.recip());
                let solve = |a: I::F32, b: I::F32| {
                    (ry.mul_add(a, -(xy * b)) * inverse, rx.mul_add(b, -(xy * a)) * inverse)
                };
                let (dx, dy) = solve(sums.descent[0], sums.descent[1]);
                let ((b0, b1), (k0, k1)) = (solve(bx, by), solve(kx, ky));
                let (gx, gy) = (sums.descent[0], sums.descent[1]);
                let reduced = [
                    squares,
                    (-b0).mul_add(gx, (-b1).mul_add(gy, sums.descent[2])),
                    (-k0).mul_add(gx, (-k1).mul_add(gy, sums.descent[3])),
                    (-b0).mul_add(bx, (-b1).mul_add(by, bb)),
                    (-b0).mul_add(kx, (-b1).mul_add(ky, kb)),
                    (-k0).mul_add(kx, (-k1).mul_add(ky, kk)),
                ];
                // Keep the best place by mean absolute residual.
                let mean = absolute / weight_sum.max(I::F32::of(1e-6));
                let plain = misses.iter().fold(zero, |sum, &miss| sum + miss);
                let better = plain.lt(best.1);
                let pick = |yes: I::F32, no: I::F32| I::F32::select(better, yes, no);
                best = (
                    Vec3::new(
                        pick(normal.x, best.0.x),
                        pick(normal.y, best.0.y),
                        pick(normal.z, best.0.z),
                    ),
                    pick(plain, best.1),
                    pick(squares / weight_sum.max(I::F32::of(1e-6)), best.2),
                    pick(used, best.3),
                );
                for (best, now) in best_share.iter_mut().zip(reduced) {
                    *best = pick(now, *best);
                }
                for (best, &now) in best_colours.iter_mut().zip(&colours) {
                    *best = pick(now, *best);
                }
                if pass == last {
                    break;
                }
                if restart && pass == steps {
                    // A highlight that photometric stereo took for the diffuse part turns a normal
                    // far away, where no small step leads back.
                    normal = Vec3::new(zero, zero, one);
                    weights.fill(one);
                    continue;
                }
                // Step, and weigh the samples for the next pass.
                let length = dx.mul_add(dx, dy * dy).sqrt();
                let longest = I::F32::of(LONGEST_STEP);
                let short = I::F32::select(length.gt(longest), longest / length, one);
                let enough = used.gt(I::F32::of(3.5));
                let (dx, dy) = (I::F32::keep(enough, dx * short), I::F32::keep(enough, dy * short));
                for (b, colour) in band_sums.iter().zip(&mut colours) {
                    let rest = (-b.cross[0]).mul_add(dx, (-b.cross[1]).mul_add(dy, b.descent));
                    let change = I::F32::keep(b.own.gt(zero), rest / b.own);
                    *colour = (*colour + change).max(zero);
                }
                normal = tilt[1].mul_add(dy, tilt[0].mul_add(dx, normal)).normalised();
                let scale = mean * I::F32::of(CAUCHY * 1.2533);
                let inverse = I::F32::keep(scale.gt(zero), scale.recip());
                for (weight, &miss) in weights.iter_mut().zip(&misses) {
                    let ratio = miss * inverse;
                    *weight = one / ratio.mul_add(ratio, one);
                }
            }
            let (normal, plain, squares, used) = best;
            let fine = plain.is_finite() & normal.z.is_finite();
            tile.write_pixels(at, normal, &best_colours, fine);
            let count = I::F32::of(1.0 / bands as f64);
            store((squares * count).sqrt(), tile.residual, at);

            let mut lanes = [[0.0_f32; MAX_LANES]; 7];
            for (lanes, value) in lanes.iter_mut().zip(best_share) {
                value.store(lanes);
            }
            used.store(&mut lanes[6]);
            for lane in 0..I::F32::WIDTH.min(tile.count - at) {
                let values: [f64; 7] = core::array::from_fn(|i| f64::from(lanes[i][lane]));
                let freedom = values[6] * bands as f64 - (bands + 2) as f64;
                // Pixels without an estimate say nothing; NaN fails the test (hard case 26).
                if tile.estimated(at + lane)
                    && freedom > 0.0
                    && values.iter().all(|value| value.is_finite())
                {
                    share.merge(&Share {
                        normal: Normal {
                            cost: values[0],
                            descent: [values[1], values[2]],
                            matrix: [[values[3], 0.0], [values[4], values[5]]],
                        },
                        freedom,
                    });
                }
            }
            at += I::F32::WIDTH;
        }
        tile.blank();
        share
    }
}
