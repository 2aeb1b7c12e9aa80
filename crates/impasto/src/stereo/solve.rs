//! Photometric stereo [@woodham1980photometric]: the symmetric 3 x 3 system of one pixel, its solution
//! by cofactors, its condition number by closed-form eigenvalues [@smith1961eigenvalues], and the
//! predicted error.

use crate::math::{Real, Vec3};

/// Condition number of the used lights beyond which a pixel is
/// [`IllConditioned`](crate::maps::Status::IllConditioned): half a percent of noise then moves
/// the normal by 3 degrees (about 0.1 degree times the condition number).
pub const CONDITION_LIMIT: f64 = 30.0;

/// Condition number beyond which a pixel is
/// [`RankDeficient`](crate::maps::Status::RankDeficient): half a percent of noise moves the
/// normal by 25 degrees, and single precision cannot distinguish such lights from coplanar ones
/// (their squared condition number is 2^16, of the 2^24 that it resolves).
pub const RANK_LIMIT: f64 = 256.0;

/// Samples from which a pixel has a residual: one more than unknowns.
pub const ENOUGH: usize = 4;

/// A symmetric matrix, by its upper triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Symmetric<R> {
    pub(super) xx: R,
    pub(super) xy: R,
    pub(super) xz: R,
    pub(super) yy: R,
    pub(super) yz: R,
    pub(super) zz: R,
}

impl<R: Real> Symmetric<R> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
        let zero = R::zero();
        Self { xx: zero, xy: zero, xz: zero, yy: zero, yz: zero, zz: zero }
    }

    /// Adds `w l'`, where `w` is `l` times its weight.
    #[inline(always)]
    pub(super) fn add(&mut self, l: Vec3<R>, w: Vec3<R>) {
        self.xx = w.x.mul_add(l.x, self.xx);
        self.xy = w.x.mul_add(l.y, self.xy);
        self.xz = w.x.mul_add(l.z, self.xz);
        self.yy = w.y.mul_add(l.y, self.yy);
        self.yz = w.y.mul_add(l.z, self.yz);
        self.zz = w.z.mul_add(l.z, self.zz);
    }

    #[inline(always)]
    pub(super) fn times(&self, v: Vec3<R>) -> Vec3<R> {
        Vec3::new(
            Vec3::new(self.xx, self.xy, self.xz).dot(v),
            Vec3::new(self.xy, self.yy, self.yz).dot(v),
            Vec3::new(self.xz, self.yz, self.zz).dot(v),
        )
    }

    #[inline(always)]
    fn trace(&self) -> R {
        self.xx + self.yy + self.zz
    }

    /// The matrix of cofactors, which is the inverse times the determinant.
    #[inline(always)]
    fn adjugate(&self) -> Self {
        Self {
            xx: self.yy.mul_add(self.zz, -(self.yz * self.yz)),
            xy: self.xz.mul_add(self.yz, -(self.xy * self.zz)),
            xz: self.xy.mul_add(self.yz, -(self.xz * self.yy)),
            yy: self.xx.mul_add(self.zz, -(self.xz * self.xz)),
            yz: self.xy.mul_add(self.xz, -(self.xx * self.yz)),
            zz: self.xx.mul_add(self.yy, -(self.xy * self.xy)),
        }
    }

    /// Largest eigenvalue of a matrix without negative ones.
    ///
    /// Cardano's formula: with `q` the mean of the diagonal, `6 p^2` the squared norm of
    /// `A - q I` and `r = det(A - q I) / 2 p^3`, it is `q + 2 p cos(acos(r) / 3)`.
    #[inline(always)]
    fn largest_eigenvalue(&self) -> R {
        let q = self.trace() * R::of(1.0 / 3.0);
        let rest = Self { xx: self.xx - q, yy: self.yy - q, zz: self.zz - q, ..*self };
        let off = rest.xy.mul_add(rest.xy, rest.xz.mul_add(rest.xz, rest.yz * rest.yz));
        let on = Vec3::new(rest.xx, rest.yy, rest.zz).length_squared();
        let p_squared = off.mul_add(R::of(2.0), on) * R::of(1.0 / 6.0);
        let p = p_squared.sqrt();
        let cofactors = rest.adjugate();
        let determinant = rest.first_row().dot(cofactors.first_row());
        let r = determinant * R::of(0.5) / (p_squared * p);
        // NaN where p = 0 (a multiple of the identity): `max` gives its second operand then.
        let r = r.max(R::of(-1.0)).min(R::one());
        (p * R::of(2.0)).mul_add(cosine_of_third(r), q)
    }

    /// The inverse, as cofactors over the determinant.
    #[inline(always)]
    pub(super) fn inverse(&self) -> SymmetricInverse<R> {
        let adjugate = self.adjugate();
        let determinant = self.first_row().dot(adjugate.first_row());
        SymmetricInverse { adjugate, per_determinant: determinant.recip() }
    }

    /// Whether single precision sees a determinant; it is far below what a rule's own lights have
    /// ([`RANK_LIMIT`]), but a loss's weights may leave almost nothing of some lights.
    #[inline(always)]
    pub(super) fn solvable(&self) -> R::Mask {
        let trace = self.trace();
        let determinant = self.first_row().dot(self.adjugate().first_row());
        determinant.gt(trace * trace * trace * R::of(1.0 / 16_777_216.0))
    }

    /// Squared condition number of the lights: largest by smallest eigenvalue. Infinite, negative
    /// or NaN where rounding leaves no determinant.
    ///
    /// The largest eigenvalue leaves a sum and a product to the other two; the smallest is what
    /// the determinant leaves to it.
    #[inline(always)]
    pub(super) fn squared_condition(&self, inverse: &SymmetricInverse<R>) -> R {
        let largest = self.largest_eigenvalue();
        let half_sum = (self.trace() - largest) * R::of(0.5);
        let product = (largest * inverse.per_determinant).recip();
        let middle = half_sum + half_sum.mul_add(half_sum, -product).max(R::zero()).sqrt();
        largest * largest * middle * inverse.per_determinant
    }

    /// Variance of `b` along the worst direction at right angles to the normal `n`, for noise of
    /// variance 1.
    ///
    /// The larger eigenvalue of the inverse `C` seen in the tangent plane, where its trace is
    /// `tr C - n'Cn` and its determinant `n' adj(C) n = n'An / det A`.
    #[inline(always)]
    pub(super) fn worst_tangent_variance(&self, inverse: &SymmetricInverse<R>, n: Vec3<R>) -> R {
        let along = n.dot(inverse.adjugate.times(n));
        let half = inverse.per_determinant * R::of(0.5);
        let half_trace = (inverse.adjugate.trace() - along) * half;
        let determinant = n.dot(self.times(n)) * inverse.per_determinant;
        half_trace + half_trace.mul_add(half_trace, -determinant).max(R::zero()).sqrt()
    }

    #[inline(always)]
    fn first_row(&self) -> Vec3<R> {
        Vec3::new(self.xx, self.xy, self.xz)
    }

    #[inline(always)]
    pub(super) fn select(mask: R::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            xx: R::select(mask, yes.xx, no.xx),
            xy: R::select(mask, yes.xy, no.xy),
            xz: R::select(mask, yes.xz, no.xz),
            yy: R::select(mask, yes.yy, no.yy),
            yz: R::select(mask, yes.yz, no.yz),
            zz: R::select(mask, yes.zz, no.zz),
        }
    }
}

impl Symmetric<f64> {
    /// The same matrix in every lane.
    #[inline(always)]
    pub(super) fn splat<R: Real>(&self) -> Symmetric<R> {
        Symmetric {
            xx: R::of(self.xx),
            xy: R::of(self.xy),
            xz: R::of(self.xz),
            yy: R::of(self.yy),
            yz: R::of(self.yz),
            zz: R::of(self.zz),
        }
    }
}

/// `cos(acos(r) / 3)` as a polynomial in `cos(acos(r) / 2) = sqrt((1 + r) / 2)`, in which it has no
/// singularity between 0 and 1; interpolated at Chebyshev's points, error below 2.7e-8.
#[inline(always)]
fn cosine_of_third<R: Real>(r: R) -> R {
    let t = r.mul_add(R::of(0.5), R::of(0.5)).sqrt();
    let mut sum = R::of(COSINE_OF_THIRD[7]);
    for &term in COSINE_OF_THIRD[..7].iter().rev() {
        sum = sum.mul_add(t, R::of(term));
    }
    sum
}

const COSINE_OF_THIRD: [f64; 8] = [
    0.500_000_03,
    0.577_346_92,
    -0.111_038_51,
    0.052_841_41,
    -0.030_235_4,
    0.016_047_28,
    -0.006_089_35,
    0.001_127_64,
];

/// Whether lights of this squared condition number determine a normal; no for NaN.
#[inline(always)]
pub(super) fn determined<R: Real>(squared: R) -> R::Mask {
    squared.le(R::of(RANK_LIMIT * RANK_LIMIT)) & squared.gt(R::zero())
}

/// Whether they determine it well.
#[inline(always)]
pub(super) fn well_determined<R: Real>(squared: R) -> R::Mask {
    squared.le(R::of(CONDITION_LIMIT * CONDITION_LIMIT))
}

/// The inverse of a symmetric matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct SymmetricInverse<R> {
    pub(super) adjugate: Symmetric<R>,
    pub(super) per_determinant: R,
}

impl<R: Real> SymmetricInverse<R> {
    #[inline(always)]
    pub(super) fn select(mask: R::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            adjugate: Symmetric::select(mask, &yes.adjugate, &no.adjugate),
            per_determinant: R::select(mask, yes.per_determinant, no.per_determinant),
        }
    }

    #[inline(always)]
    pub(super) fn times(&self, v: Vec3<R>) -> Vec3<R> {
        self.adjugate.times(v).scale(self.per_determinant)
    }
}

/// The least-squares solution over some samples, and its accuracy.
#[derive(Clone, Copy)]
pub(super) struct Solution<R> {
    /// Normal times albedo.
    pub(super) b: Vec3<R>,
    /// Sum of the samples.
    pub(super) total: R,
    pub(super) matrix: Symmetric<R>,
    pub(super) inverse: SymmetricInverse<R>,
    /// Squared condition number of the lights, and its root.
    pub(super) squared: R,
    pub(super) condition: R,
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, SymmetricEigen};
    use proptest::prelude::*;

    fn lights() -> impl Strategy<Value = Vec<Vec3<f64>>> {
        let one = (-1.0..1.0, -1.0..1.0, 0.05..1.0);
        prop::collection::vec(one.prop_map(|(x, y, z)| Vec3::new(x, y, z).normalised()), 4..20)
    }

    fn dense(s: &Symmetric<f64>) -> Matrix3<f64> {
        Matrix3::new(s.xx, s.xy, s.xz, s.xy, s.yy, s.yz, s.xz, s.yz, s.zz)
    }

    proptest! {
        #[test]
        fn condition_and_error_are_those_of_an_eigenvalue_solver(
            lights in lights(), x in -0.8..0.8_f64, y in -0.5..0.5_f64,
        ) {
            let mut sum = Symmetric::zero();
            for &l in &lights {
                sum.add(l, l);
            }
            let matrix = dense(&sum);
            let values = SymmetricEigen::new(matrix).eigenvalues;
            let (least, largest) = (values.min(), values.max());
            let middle = values.sum() - least - largest;
            let exact = (largest / least).sqrt();
            prop_assume!(exact < RANK_LIMIT);
            // The cosine is wrong by the polynomial's 2.7e-8 and by what rounding its argument
            // does near a root, 1.2e-8. Times 2 p, at most two thirds of the largest eigenvalue,
            // that is 2.6e-8 of it; `off` of the middle one. Half their sum takes half of `off`;
            // half their difference is a root that moves by what is under it (`off` times half
            // their sum) over itself, or by the root of that where they nearly agree. The largest
            // enters twice more, and a condition number is a root: half of everything.
            let off = 2.6e-8 * largest / middle;
            let gap = (middle - least) / middle;
            let bound = 0.5 * ((2.0 * off / gap).min(off.sqrt()) + 0.5 * off + 5.2e-8);
            let squared = sum.squared_condition(&sum.inverse());
            prop_assert!((squared.sqrt() / exact - 1.0).abs() < bound);

            let n = Vec3::new(x, y, 1.0).normalised();
            let v = nalgebra::Vector3::new(n.x, n.y, n.z);
            let tangent = Matrix3::identity() - v * v.transpose();
            let covariance = tangent * matrix.try_inverse().unwrap() * tangent;
            let worst = SymmetricEigen::new(covariance).eigenvalues.max();
            prop_assert!((sum.worst_tangent_variance(&sum.inverse(), n) / worst - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn equal_eigenvalues_have_condition_one() {
        let mut sum = Symmetric::<f32>::zero();
        for axis in [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)] {
            sum.add(axis.splat(), axis.splat());
        }
        assert!((sum.squared_condition(&sum.inverse()) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn coplanar_lights_are_found_in_single_precision() {
        for turn in 0..50 {
            let (a, b) = (f64::from(turn) * 0.13, f64::from(turn) * 0.29);
            let mut sum = Symmetric::<f32>::zero();
            for i in 0..9 {
                // A half circle of lights around z, tilted.
                let t = f64::from(i) * 0.3 - 1.2;
                let (x, y, z) = (t.sin() * a.cos(), t.sin() * a.sin(), t.cos());
                let l = Vec3::new(x, y * b.cos() - z * b.sin(), y * b.sin() + z * b.cos());
                sum.add(l.splat(), l.splat());
            }
            assert!(!determined(sum.squared_condition(&sum.inverse())));
        }
    }
}
