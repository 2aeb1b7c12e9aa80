//! A predicted error of the default that contains what Lambert's law does not describe.
//!
//! The covariance of weighted least squares takes residuals for independent noise. What the law lacks is a smooth
//! function of the light instead, most of which the normal takes up: residuals show little of it, and no number of
//! photographs averages it out. Three causes are estimated for every pixel.
//!
//! - *Gloss, and diffuse light through a varnish.* Two more columns beside the light, as in a test for omitted variables
//!   [@ramsey1969specification]: a constant, for light that passes an interface grows more slowly than the cosine, and
//!   a lobe `(N.H)^16`. With `x` their coefficients, found from the residuals, the normal would move by `G x`, where
//!   `G = A^-1 sum w l c'`. Noise alone explains as much of the squares as the mean of F's distribution
//!   [@fisher1925methods] says; the share beyond that counts, as in Stein's rule
//!   [@efron1973stein].
//! - *Light from other surfaces.* It is all that a sample shows whose light is behind the surface, and is about as large
//!   where the lamp shines.
//! - *What is still alike under neighbouring lights* ([`Learned::correlation`](super::Learned)). It is mostly symmetric about the
//!   view, and so are the lights: it tilts a normal the more the further it leans.

use crate::geometry::{Rig, View};
use crate::math::real::Part;
use crate::math::{Real, Vec3};

use super::lights::Lights;
use super::problem::StereoProblem;
use super::rows::PlaneRows;
use super::solve::{Symmetric, SymmetricInverse};
use super::sums::residual;

/// Standard deviation per shift of the normal, and per indirect light and correlated residual relative to the
/// brightness; calibrated on objects and panels of known normals (docs/numerics.md).
const PER_SHIFT: f64 = 0.63;
const PER_INDIRECT: f64 = 3.0;
const PER_CORRELATED: f64 = 2.5;

/// The lobe is `(N.H)^16`, by so many squarings of the square.
const SQUARINGS: usize = 3;

/// Least square of `N.H` in the lobe: beyond, squares of the lobe would leave the range of numbers that are fast.
const LEAST_SQUARE: f64 = 0.01;

/// Shares of its own diagonal, and of the constant's, that are added to that of a column: columns may be nearly alike, and no light
/// may be near the mirror's direction.
const RIDGE: f64 = 1e-3;
const FAINT: f64 = 1e-6;

/// Share of the squares that rounding leaves for certain.
const LEAST_LEFT: f64 = 1e-6;

/// Unknowns of the normal, and with both columns.
const UNKNOWNS: f64 = 3.0;
const COLUMNS: f64 = 5.0;

/// Cosine of a normal with a light from which on it is turned away.
const BEHIND: f64 = 0.05;

/// Light in shadow, relative to the brightness, from which on it is no other surface's: a highlight, or an insect.
const BRIGHT: f64 = 0.1;

/// Scales of the noise below which light in shadow is none: samples of nothing are clipped at 0, and the mean
/// of what is left of normal noise is 0.4 of its scale.
const CLIPPED: f64 = 0.5;

/// Where the cameras are.
pub(super) struct Views<R> {
    /// One for all photographs, or one each.
    towards: Vec<Vec3<R>>,
    near: bool,
}

impl<R: Real<Scalar = f32>> Views<R> {
    pub(super) fn new(problem: &StereoProblem<'_>) -> Self {
        let views = problem.rig.views();
        let alike = views.iter().all(|view| *view == views[0]);
        let count = if alike { 1 } else { views.len() };
        let towards = views[..count].iter().map(|view| view.direction().splat()).collect();
        Self { towards, near: problem.near_views }
    }

    /// Seen from the points `(x, y)` in mm.
    #[inline(always)]
    pub(super) fn aim(&mut self, rig: &Rig, x: R, y: R) {
        if self.near {
            for (view, towards) in rig.views().iter().zip(&mut self.towards) {
                *towards = view.at(x, y);
            }
        }
    }

    #[inline(always)]
    fn at(&self, photograph: usize) -> Vec3<R> {
        self.towards[photograph.min(self.towards.len() - 1)]
    }
}

/// Whether any camera is so near that pixels see it in different directions.
pub(super) fn near_views(rig: &Rig) -> bool {
    !rig.views().iter().all(View::is_distant)
}

/// The weights of the robust lanes.
pub(super) struct RobustWeights<'a, R: Real> {
    pub(super) robust: R::Mask,
    pub(super) weights: &'a [R],
}

/// The weighted equations of the normals, and their solution.
pub(super) struct Equations<R> {
    /// Sum of `l l'`.
    pub(super) matrix: Symmetric<R>,
    pub(super) inverse: SymmetricInverse<R>,
    pub(super) b: Vec3<R>,
    /// Number of samples with weight.
    pub(super) count: R,
}

/// Predicts the errors of one register of normals.
pub(super) struct ModelErrors<'a, R: Real, L> {
    pub(super) lights: &'a L,
    pub(super) views: &'a Views<R>,
    /// Which samples are valid, and all of them.
    pub(super) samples: (&'a [R::Mask], PlaneRows<'a>),
    /// Nothing: every pixel keeps least squares.
    pub(super) robust: Option<RobustWeights<'a, R>>,
    pub(super) equations: Equations<R>,
    pub(super) correlation: f64,
}

/// Weighted sums over the samples, in units of the brightness.
struct Sums<R> {
    weights: R,
    residuals: R,
    pull: Vec3<R>,
    columns: [Vec3<R>; 2],
    gram: [R; 3],
    pulls: [R; 2],
    view: Vec3<R>,
    indirect: R,
    shadowed: R,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Part<R> for ModelErrors<'_, R, L> {
    /// The deviation of the normal along its worst axis, rad.
    type Output = R;

    #[inline(always)]
    fn compute(self) -> R {
        let (zero, one, two) = (R::zero(), R::one(), R::of(2.0));
        let Equations { matrix, inverse, b, count } = self.equations;
        let per_length = b.length().recip();
        let normal = b.scale(per_length);
        let Sums { weights, residuals, pull, columns, gram, pulls, view, indirect, shadowed } =
            self.sums(normal, per_length);

        // What the columns explain of the residuals.
        let moves = columns.map(|column| inverse.times(column));
        let squares = (residuals - pull.dot(inverse.times(pull))).max(zero);
        let ridge = R::of(1.0 + RIDGE);
        let faint = gram[0] * R::of(FAINT);
        let constant = gram[0].mul_add(ridge, -columns[0].dot(moves[0])) + faint;
        let mixed = gram[1] - columns[0].dot(moves[1]);
        let lobe = gram[2].mul_add(ridge, -columns[1].dot(moves[1])) + faint;
        let right = [pulls[0] - moves[0].dot(pull), pulls[1] - moves[1].dot(pull)];
        let determinant = constant.mul_add(lobe, -(mixed * mixed));
        let per_determinant = determinant.recip();
        let found = [
            lobe.mul_add(right[0], -(mixed * right[1])) * per_determinant,
            constant.mul_add(right[1], -(mixed * right[0])) * per_determinant,
        ];
        let explained = found[0].mul_add(right[0], found[1] * right[1]);
        let least = squares * R::of(LEAST_LEFT);
        let left = (squares - explained).max(least);
        // One minus the mean of F's distribution over what is found of it.
        let freedom = count - R::of(COLUMNS + 2.0);
        let noise = two * count * left / (freedom * weights * explained);
        let known = freedom.gt(zero) & determinant.gt(zero) & explained.gt(zero);
        let share = R::keep(known & noise.is_finite(), (one - noise).max(zero));

        let freedom = (-two).mul_add(share, count - R::of(UNKNOWNS));
        let squares = (-share).mul_add(explained, squares).max(least);
        let variance = squares * count / (weights * freedom);
        let student = R::of(0.521) / (freedom - R::of(0.377)) + one;
        let worst = matrix.worst_tangent_variance(&inverse, normal);
        let mut sum = variance * worst * student * student;

        let shift = moves[1].mul_add(found[1], moves[0].scale(found[0]));
        let along = normal.dot(shift);
        let across = (-along).mul_add(along, shift.length_squared()).max(zero);
        let shift = share * across * R::of(PER_SHIFT * PER_SHIFT);
        sum = sum + R::keep(shift.is_finite() & share.gt(zero), shift);

        let scale = variance.sqrt();
        let indirect = (-scale).mul_add(R::of(CLIPPED), indirect / shadowed);
        let indirect = R::keep(shadowed.gt(zero), indirect.max(zero) * R::of(PER_INDIRECT));
        sum = indirect.mul_add(indirect, sum);

        let factor = R::of(PER_CORRELATED * self.correlation);
        let lean = normal.cross(view).length_squared() / view.length_squared();
        (factor * factor * lean).mul_add(variance, sum).sqrt()
    }
}

impl<R: Real<Scalar = f32>, L: Lights<R>> ModelErrors<'_, R, L> {
    #[inline(always)]
    fn sums(&self, normal: Vec3<R>, per_length: R) -> Sums<R> {
        let Self { lights, views, samples: (kept, signal), ref robust, .. } = *self;
        let b = self.equations.b;
        let (zero, one, none) = (R::zero(), R::one(), Vec3::new(R::zero(), R::zero(), R::zero()));
        let (mut weights, mut residuals, mut pull) = (zero, zero, none);
        let (mut by_constant, mut by_lobe, mut view) = (none, none, none);
        let (mut gram, mut pulls) = ([zero; 3], [zero; 2]);
        let (mut indirect, mut shadowed) = (zero, zero);
        for (k, &kept) in kept.iter().enumerate() {
            let (light, per_irradiance) = (lights.at(k), lights.per_irradiance(k));
            let (direction, towards) = (light.scale(per_irradiance), views.at(k));
            let sample: R = signal.at(k);
            let residual = R::keep(kept, residual(sample, light, b) * per_length);
            let mut weight = R::keep(kept, one);
            if let Some(own) = robust {
                weight = R::keep(kept, R::select(own.robust, own.weights[k], one));
            }
            let cosine = normal.dot(direction);

            // (N.H)^2, with H between light and view.
            let between = (cosine + normal.dot(towards)).max(zero);
            let squared = (direction.dot(towards) + one) * R::of(2.0);
            let mut lobe = (between * between / squared).min(one);
            lobe = R::keep(lobe.ge(R::of(LEAST_SQUARE)), lobe);
            for _ in 0..SQUARINGS {
                lobe = lobe * lobe;
            }
            let mut constant = one;
            if !L::DISTANT {
                constant = per_irradiance.recip();
                lobe = lobe * constant;
            }

            let (light_by, lobe_by) = (light.scale(weight), lobe * weight);
            let constant_by = constant * weight;
            weights = weights + weight;
            residuals = (weight * residual).mul_add(residual, residuals);
            pull = light_by.mul_add(residual, pull);
            by_constant = light_by.mul_add(constant, by_constant);
            by_lobe = light_by.mul_add(lobe, by_lobe);
            gram[0] = constant_by.mul_add(constant, gram[0]);
            gram[1] = constant_by.mul_add(lobe, gram[1]);
            gram[2] = lobe_by.mul_add(lobe, gram[2]);
            pulls[0] = constant_by.mul_add(residual, pulls[0]);
            pulls[1] = lobe_by.mul_add(residual, pulls[1]);
            view = towards.mul_add(weight, view);

            let seen = sample * per_irradiance * per_length;
            let shadow = kept & cosine.lt(R::of(-BEHIND)) & seen.lt(R::of(BRIGHT));
            indirect = indirect + R::keep(shadow, seen);
            shadowed = shadowed + R::keep(shadow, one);
        }
        let columns = [by_constant, by_lobe];
        Sums { weights, residuals, pull, columns, gram, pulls, view, indirect, shadowed }
    }
}
