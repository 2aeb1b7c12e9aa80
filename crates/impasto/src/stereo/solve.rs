//! The symmetric 3 x 3 system of one pixel: solution, condition, predicted error.

use crate::math::{Real, Vec3};

/// Condition number of the used lights beyond which a pixel is
/// [`IllConditioned`](crate::maps::Status::IllConditioned): half a percent of noise then moves
/// the normal by 3 degrees (about 0.1 degree times the condition number).
pub const CONDITION_LIMIT: f64 = 30.0;

/// Condition number beyond which a pixel is
/// [`RankDeficient`](crate::maps::Status::RankDeficient): half a percent of noise moves the
/// normal by 25 degrees, and single precision no longer tells such lights from coplanar ones
/// (their squared condition number is 2^16, of the 2^24 that it resolves).
pub const RANK_LIMIT: f64 = 256.0;

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

    /// Adds `weight l l'`.
    #[inline(always)]
    pub(super) fn add(&mut self, l: Vec3<R>, weight: R) {
        let scaled = l.scale(weight);
        self.xx = scaled.x.mul_add(l.x, self.xx);
        self.xy = scaled.x.mul_add(l.y, self.xy);
        self.xz = scaled.x.mul_add(l.z, self.xz);
        self.yy = scaled.y.mul_add(l.y, self.yy);
        self.yz = scaled.y.mul_add(l.z, self.yz);
        self.zz = scaled.z.mul_add(l.z, self.zz);
    }

    #[inline(always)]
    fn times(&self, v: Vec3<R>) -> Vec3<R> {
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
        let determinant = Vec3::new(rest.xx, rest.xy, rest.xz).dot(Vec3::new(
            cofactors.xx,
            cofactors.xy,
            cofactors.xz,
        ));
        let r = determinant * R::of(0.5) / (p_squared * p);
        // NaN where p = 0 (a multiple of the identity): `max` gives its second operand then.
        let r = r.max(R::of(-1.0)).min(R::one());
        (p * R::of(2.0)).mul_add(cosine_of_third(r), q)
    }

    /// Everything that follows from the matrix alone.
    #[inline(always)]
    pub(super) fn inverse(&self) -> Inverse<R> {
        let adjugate = self.adjugate();
        let determinant = Vec3::new(self.xx, self.xy, self.xz).dot(Vec3::new(
            adjugate.xx,
            adjugate.xy,
            adjugate.xz,
        ));
        // The smallest eigenvalue is the inverse's largest; that one is exact where the two
        // smallest of the matrix are close, which a difference would not be.
        let squared = self.largest_eigenvalue() * adjugate.largest_eigenvalue() / determinant;
        Inverse { matrix: *self, adjugate, per_determinant: determinant.recip(), squared }
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

/// A symmetric matrix and its inverse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inverse<R> {
    matrix: Symmetric<R>,
    adjugate: Symmetric<R>,
    per_determinant: R,
    /// Squared condition number of the lights: largest by smallest eigenvalue of `sum l l'`.
    squared: R,
}

impl<R: Real> Inverse<R> {
    /// Condition number of the matrix whose rows are the used lights.
    #[inline(always)]
    pub(super) fn condition(&self) -> R {
        self.squared.sqrt()
    }

    /// Whether the lights determine a normal; no for NaN.
    #[inline(always)]
    pub(super) fn determined(&self) -> R::Mask {
        self.squared.le(R::of(RANK_LIMIT * RANK_LIMIT)) & self.squared.gt(R::zero())
    }

    /// Whether they determine it well.
    #[inline(always)]
    pub(super) fn well(&self) -> R::Mask {
        self.squared.le(R::of(CONDITION_LIMIT * CONDITION_LIMIT))
    }

    #[inline(always)]
    pub(super) fn times(&self, v: Vec3<R>) -> Vec3<R> {
        self.adjugate.times(v).scale(self.per_determinant)
    }

    /// Variance of `b` along the worst direction at right angles to the normal `n`, for noise of
    /// variance 1.
    ///
    /// The larger eigenvalue of the inverse `C` seen in the tangent plane, where its trace is
    /// `tr C - n'Cn` and its determinant `n' adj(C) n = n'An / det A`.
    #[inline(always)]
    pub(super) fn worst_tangent_variance(&self, n: Vec3<R>) -> R {
        let along = n.dot(self.adjugate.times(n));
        let half_trace = (self.adjugate.trace() - along) * self.per_determinant * R::of(0.5);
        let determinant = n.dot(self.matrix.times(n)) * self.per_determinant;
        let root = half_trace.mul_add(half_trace, -determinant).max(R::zero()).sqrt();
        half_trace + root
    }
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
                sum.add(l, 1.0);
            }
            let matrix = dense(&sum);
            let values = SymmetricEigen::new(matrix).eigenvalues;
            let exact = (values.max() / values.min()).sqrt();
            prop_assume!(exact < RANK_LIMIT);
            // The polynomial's 2.7e-8, doubled by 2 p <= 2 q, against the larger part of a sum of
            // eigenvalues that is at least a third of its trace.
            let inverse = sum.inverse();
            prop_assert!((inverse.condition() / exact - 1.0).abs() < 2e-7);

            let n = Vec3::new(x, y, 1.0).normalised();
            let v = nalgebra::Vector3::new(n.x, n.y, n.z);
            let tangent = Matrix3::identity() - v * v.transpose();
            let covariance = tangent * matrix.try_inverse().unwrap() * tangent;
            let worst = SymmetricEigen::new(covariance).eigenvalues.max();
            prop_assert!((inverse.worst_tangent_variance(n) / worst - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn equal_eigenvalues_have_condition_one() {
        let mut sum = Symmetric::<f32>::zero();
        for axis in [Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)] {
            sum.add(axis, 1.0);
        }
        assert!((sum.inverse().condition() - 1.0).abs() < 1e-6);
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
                sum.add(l.splat(), 1.0);
            }
            assert!(!sum.inverse().determined());
        }
    }
}
