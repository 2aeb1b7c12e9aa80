//! Iteratively reweighted least squares [@holland1977robust]: every pixel's normal and colours under
//! the painting's lobe, and the equations of the lobe that remain when they are eliminated (variable
//! projection [@golub1973varpro]).
//!
//! A pixel's estimate is the S-estimate [@rousseeuw1984s], of smallest robust scale
//! ([`scale`](super::scale)). Gauss-Newton steps on the weighted sum of squares lead to it; a step
//! that does not lower the scale is shortened. The colours are eliminated first, then the normal;
//! the Schur complement that is left is the pixel's 2 x 2 part of the normal equations of
//! (beta, log k). The pooled step thereby accounts for normals and colours that will follow it
//! (variable projection [@golub1973varpro]); a separate fit of the lobe does not.

use crate::lm::Normal;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Mask, Real, Vec3};
use crate::pixels::Run;

use super::pixel::{CommonLobe, Equations, Pixels, Reduced, tangents};
use super::samples::{Photographs, PooledTile, Samples, TileMut};
use crate::math::lanes::MAX_LANES;
use crate::math::tail::load;

/// Longest step of a normal, rad: a lobe is not linear for longer.
const LONGEST_STEP: f64 = 0.1;

/// Added to diagonals, relative: enough to keep an undetermined direction (coplanar lights, hard
/// case 19) from moving, too little to slow the others down.
const RIDGE: f64 = 1e-3;

/// A pixel has converged when a step lowers its squared scale by less than this share.
const CONVERGED: f64 = 2e-5;

/// A path from another start that comes as near to a place that is known, rad, with less than this
/// many times its squared scale, would end there.
const MET: f64 = 1e-3;
const MET_SCALE: f64 = 1.01;

/// What the scales of pixels are compared with.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaleReference {
    /// A bright colour of the painting, the unit of scales.
    pub(super) brightness: f64,
    /// Added to every squared scale before its logarithm is taken: a pixel whose few codes the model
    /// happens to meet exactly determines no more than the noise of the painting permits.
    pub(super) noise_floor: f64,
}

/// The normal equations of (beta, log k), a sum over pixels, each in units of its own scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct LobeEquations {
    /// Samples.
    pub(super) count: f64,
    /// Samples times the logarithm of squared scale plus noise floor, over the brightness squared.
    pub(super) log_scale: f64,
    pub(super) descent: [f64; 2],
    pub(super) matrix: [[f64; 2]; 2],
    /// The same of pixels whose residuals are rounding: they contribute to no step, but determine
    /// (beta, log k) as well as rounding permits.
    pub(super) exact: [[f64; 2]; 2],
    /// Sum of the outer products of the pixels' gradients, or the expected value of those.
    pub(super) scatter: [[f64; 2]; 2],
}

impl LobeEquations {
    pub(super) fn zero() -> Self {
        let zero = [[0.0; 2]; 2];
        Self {
            count: 0.0,
            log_scale: 0.0,
            descent: [0.0; 2],
            matrix: zero,
            exact: zero,
            scatter: zero,
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.log_scale += other.log_scale;
        for i in 0..2 {
            self.descent[i] += other.descent[i];
            for j in 0..=i {
                self.matrix[i][j] += other.matrix[i][j];
                self.exact[i][j] += other.exact[i][j];
                self.scatter[i][j] += other.scatter[i][j];
            }
        }
    }

    /// Information of all pixels about (beta, log k).
    pub(super) fn information(&self) -> [[f64; 2]; 2] {
        core::array::from_fn(|i| core::array::from_fn(|j| self.matrix[i][j] + self.exact[i][j]))
    }

    /// As a sum of squares: the number of samples times the geometric mean over the pixels of squared
    /// scale plus noise floor. Where all pixels are equally noisy it is the weighted sum of squares; a
    /// pixel that the model does not describe cannot outweigh the others.
    pub(super) fn normal(&self, brightness: f64) -> Normal<f64, 2> {
        let mean = if self.count > 0.0 { (self.log_scale / self.count).exp() } else { 0.0 };
        let mean = mean * brightness * brightness;
        Normal {
            cost: mean * self.count,
            descent: self.descent.map(|v| v * mean),
            matrix: self.matrix.map(|row| row.map(|v| v * mean)),
        }
    }
}

pub(super) struct Irls<'a, 'b> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'b PooledTile<'a>,
    pub(super) out: TileMut<'b>,
    pub(super) samples: &'a Samples,
    pub(super) lobe: CommonLobe,
    /// Steps at most.
    pub(super) steps: usize,
    /// Whether pixels that are not well described, or not in so many steps, start from two more
    /// normals, one that faces the viewer and the facet that mirrors the brightest photograph: a
    /// highlight that photometric stereo took for the diffuse part turns a normal far away, where no
    /// small step leads back.
    pub(super) restart: bool,
    pub(super) scale_reference: ScaleReference,
}

/// Scratch memory for the colours of one register of pixels.
struct Colours<R> {
    best: Vec<R>,
    trial: Vec<R>,
    changes: Vec<R>,
    fresh: Vec<R>,
    pulls: Vec<R>,
    kept: Vec<R>,
}

impl Kernel for Irls<'_, '_> {
    type Output = LobeEquations;

    #[inline(always)]
    fn run<I: Isa>(self) -> LobeEquations {
        let Self { photographs, run, tile, mut out, samples, steps, restart, .. } = self;
        let (zero, one) = (I::F32::zero(), I::F32::one());
        let mut pixels = Pixels::<I::F32>::new(photographs, self.lobe);
        let none = || vec![zero; photographs.bands];
        let mut colours = Colours {
            best: none(),
            trial: none(),
            changes: none(),
            fresh: none(),
            pulls: none(),
            kept: none(),
        };
        let mut equations = LobeEquations::zero();
        let mut at = 0;
        // A tile of hundreds of photographs takes long.
        while at < tile.count && !run.cancelled() {
            pixels.look(samples, at);
            for (band, colour) in colours.best.iter_mut().enumerate() {
                *colour = load(tile.diffuse[band], at);
            }
            let start = tile.normal_at::<I::F32>(at);
            let first = if self.lobe.beta > 0.0 {
                descend::<_, true, 2>(&mut pixels, &mut colours, start, steps, None)
            } else {
                descend::<_, false, 0>(&mut pixels, &mut colours, start, steps, None)
            };
            let Descent { mut normal, mut scale, .. } = first;
            let mut last_scale = pixels.visit::<true>(normal, &colours.best, Some(scale));
            let described =
                pixels.described(last_scale, self.scale_reference.noise_floor) & first.converged;
            if restart && !described.all() {
                let up = Vec3::new(zero, zero, one);
                for start in [up, pixels.brightest_facet()] {
                    colours.kept.copy_from_slice(&colours.best);
                    let other = descend::<_, true, 2>(
                        &mut pixels,
                        &mut colours,
                        start,
                        steps,
                        Some(&first),
                    );
                    let better = other.scale.lt(scale) & !described;
                    normal = Vec3::select(better, other.normal, normal);
                    scale = I::F32::select(better, other.scale, scale);
                    for (best, &kept) in colours.best.iter_mut().zip(&colours.kept) {
                        *best = I::F32::select(better, *best, kept);
                    }
                }
                last_scale = pixels.visit::<true>(normal, &colours.best, Some(scale));
            }
            let fine = scale.is_finite() & (normal.x + normal.y + normal.z).is_finite();
            out.write(at, normal, &colours.best, scale, fine);

            let sums = pixels.equations::<4>(normal, &colours.best, last_scale, &mut colours.pulls);
            let reduced = sums.reduced(&colours.best, &colours.pulls);
            let lobe = eliminate_tilts(&reduced);
            let values = [
                last_scale,
                pixels.floor,
                pixels.used,
                sums.square,
                lobe.descent[0],
                lobe.descent[1],
                lobe.matrix[0],
                lobe.matrix[1],
                lobe.matrix[2],
            ];
            let mut lanes = [[0.0_f32; MAX_LANES]; 9];
            for (lanes, value) in lanes.iter_mut().zip(values) {
                value.store(lanes);
            }
            for lane in 0..I::F32::WIDTH.min(tile.count - at) {
                let values = lanes.map(|values| f64::from(values[lane]));
                equations.merge(&equations_of(values, photographs.bands, self.scale_reference));
            }
            at += I::F32::WIDTH;
        }
        equations
    }
}

/// One pixel's part of the equations.
fn equations_of(values: [f64; 9], bands: usize, scale_reference: ScaleReference) -> LobeEquations {
    let [scale, floor, used, square, db, dk, bb, kb, kk] = values;
    let count = used * bands as f64;
    // As many samples as unknowns determine no scale (hard case 30); NaN fails the tests (hard case 26).
    let determined =
        count > (bands + 2) as f64 && scale > 0.0 && values.iter().all(|value| value.is_finite());
    if !determined {
        return LobeEquations::zero();
    }
    let ScaleReference { brightness, noise_floor } = scale_reference;
    // d log s^2 = -2 sum(w r dr) / sum(w r^2), and the pixel counts with its samples. At the floor
    // the scale moves no more.
    let moves = scale > floor && square > 0.0;
    let share = if moves { scale / (scale + noise_floor) } else { 0.0 };
    let rate = share * count / (square * bands as f64).max(f64::MIN_POSITIVE);
    let descent = [db * rate, dk * rate];
    let known = |rate: f64| [[bb * rate, 0.0], [kb * rate, kk * rate]];
    // A sample within one scale counts for more where the scale moves: this errs on the safe side.
    let exact = known(if moves { 0.0 } else { (scale + noise_floor).recip() });
    LobeEquations {
        count,
        log_scale: count * ((scale + noise_floor) / (brightness * brightness)).ln(),
        descent,
        matrix: known(rate),
        exact,
        // Rounding has no gradient: its scatter is the information (Fisher's identity).
        scatter: [
            [descent[0] * descent[0] + exact[0][0], 0.0],
            [descent[1] * descent[0] + exact[1][0], descent[1] * descent[1] + exact[1][1]],
        ],
    }
}

/// Where a path of steps ended.
struct Descent<R: Real> {
    normal: Vec3<R>,
    scale: R,
    /// Whether further steps would change nothing.
    converged: R::Mask,
}

/// Steps down from `start` and `colours.best`; returns the best normal and its squared scale, with
/// its colours in `colours.best`. `GLOSS` and `SLOPES` as in [`Pixels::visit`] and
/// [`Pixels::equations`]. A path that meets the end of a `known` one ends there.
#[inline(always)]
fn descend<R: Real<Scalar = f32>, const GLOSS: bool, const SLOPES: usize>(
    pixels: &mut Pixels<'_, R>,
    colours: &mut Colours<R>,
    start: Vec3<R>,
    steps: usize,
    known: Option<&Descent<R>>,
) -> Descent<R> {
    let (zero, quarter) = (R::zero(), R::of(0.25));
    let mut best = start;
    let mut trial = start;
    colours.trial.copy_from_slice(&colours.best);
    let mut least = pixels.visit::<GLOSS>(trial, &colours.trial, None);
    let mut better = least.is_finite();
    let mut active = better;
    let mut ended = zero.lt(zero);
    let mut step = [zero; 2];
    for pass in 0..steps {
        let sums = pixels.equations::<SLOPES>(trial, &colours.trial, least, &mut colours.pulls);
        let fresh = step_of(&sums, &colours.trial, &colours.pulls);
        sums.follow(fresh, &colours.trial, &colours.pulls, &mut colours.fresh);
        // Lanes that did not get better go a quarter of their last step from where they were best.
        let half = |fresh: R, last: R| R::select(better, fresh, last * quarter);
        step = [half(fresh[0], step[0]), half(fresh[1], step[1])];
        for (change, &fresh) in colours.changes.iter_mut().zip(&colours.fresh) {
            *change = R::select(better, fresh, *change * quarter);
        }
        let tilt = tangents(best);
        trial = tilt[1].mul_add(step[1], tilt[0].mul_add(step[0], best)).normalised();
        trial = Vec3::select(active, trial, best);
        for ((trial, &best), &change) in
            colours.trial.iter_mut().zip(&colours.best).zip(&colours.changes)
        {
            *trial = R::select(active, (best + change).max(zero), best);
        }
        let scale = pixels.visit::<GLOSS>(trial, &colours.trial, Some(least));
        let whole = better;
        better = active & scale.lt(least);
        // A lane stops on its own account: how many lanes share a register changes no result. The
        // gain of a shortened step is no test of convergence.
        let converged = whole
            & scale.lt(least * R::of(1.0 + CONVERGED))
            & scale.gt(least * R::of(1.0 - CONVERGED));
        ended = ended | (active & converged);
        active = active & !converged;
        if let Some(known) = known {
            let met = (trial - known.normal).length_squared().lt(R::of(MET * MET))
                & scale.lt(known.scale * R::of(MET_SCALE));
            active = active & !(met & better & known.converged);
        }
        best = Vec3::select(better, trial, best);
        least = R::select(better, scale, least);
        for (best, &trial) in colours.best.iter_mut().zip(&colours.trial) {
            *best = R::select(better, trial, *best);
        }
        if pass + 1 == steps || !active.any() {
            break;
        }
    }
    Descent { normal: best, scale: least, converged: ended }
}

/// The tilt that solves the equations, not too long; none for too few samples (hard case 30).
#[inline(always)]
fn step_of<R: Real>(sums: &Equations<R>, colours: &[R], pulls: &[R]) -> [R; 2] {
    let reduced = sums.reduced(colours, pulls);
    let [xx, xy, yy, ..] = reduced.matrix;
    let ridge = R::of(1.0 + RIDGE);
    let [dx, dy] = solve(xx * ridge, xy, yy * ridge, reduced.descent[0], reduced.descent[1]);
    let length = dx.mul_add(dx, dy * dy).sqrt();
    let longest = R::of(LONGEST_STEP);
    let short = R::select(length.gt(longest), longest / length, R::one());
    [dx * short, dy * short]
}

/// Solves a symmetric 2 x 2 system; 0 where it has no inverse.
#[inline(always)]
fn solve<R: Real>(xx: R, xy: R, yy: R, a: R, b: R) -> [R; 2] {
    let determinant = xx.mul_add(yy, -(xy * xy));
    let inverse = R::keep(determinant.gt(R::zero()), determinant.recip());
    [yy.mul_add(a, -(xy * b)) * inverse, xx.mul_add(b, -(xy * a)) * inverse]
}

/// A pixel's equations of (beta, log k), colours and normal following.
pub(super) struct PixelEquations<R> {
    pub(super) descent: [R; 2],
    /// beta beta, log k beta, log k log k.
    pub(super) matrix: [R; 3],
}

#[inline(always)]
pub(super) fn eliminate_tilts<R: Real>(reduced: &Reduced<R>) -> PixelEquations<R> {
    let [xx, xy, yy, bx, by, bb, kx, ky, kb, kk] = reduced.matrix;
    let [gx, gy, gb, gk] = reduced.descent;
    let ridge = R::of(1.0 + RIDGE);
    let (rx, ry) = (xx * ridge, yy * ridge);
    let [b0, b1] = solve(rx, xy, ry, bx, by);
    let [k0, k1] = solve(rx, xy, ry, kx, ky);
    PixelEquations {
        descent: [
            (-b0).mul_add(gx, (-b1).mul_add(gy, gb)),
            (-k0).mul_add(gx, (-k1).mul_add(gy, gk)),
        ],
        matrix: [
            (-b0).mul_add(bx, (-b1).mul_add(by, bb)),
            (-b0).mul_add(kx, (-b1).mul_add(ky, kb)),
            (-k0).mul_add(kx, (-k1).mul_add(ky, kk)),
        ],
    }
}
