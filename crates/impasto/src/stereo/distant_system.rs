//! The linear system of distant lights, solved once for all pixels, in double precision.

use crate::geometry::Rig;
use crate::math::Vec3;

use super::solve::{Symmetric, SymmetricInverse};

pub(super) struct DistantSystem {
    pub(super) matrix: Symmetric<f64>,
    pub(super) inverse: SymmetricInverse<f64>,
    pub(super) squared: f64,
    /// One row per light: `(L'L)^-1 l`.
    pub(super) pseudoinverse: Vec<Vec3<f64>>,
}

impl DistantSystem {
    pub(super) fn new(rig: &Rig) -> Self {
        let mut matrix = Symmetric::zero();
        for light in rig.lights() {
            matrix.add(light.direction(), light.direction());
        }
        let inverse = matrix.inverse();
        let squared = matrix.squared_condition(&inverse);
        let pseudoinverse = rig.lights().iter().map(|l| inverse.times(l.direction())).collect();
        Self { matrix, inverse, squared, pseudoinverse }
    }
}
