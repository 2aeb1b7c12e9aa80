//! The diffuse term `(N.L) S` of eq. 1 (six-band paper) and eq. 9 (RGB-camera paper).

use crate::math::{Real, Vec3};

/// Cosine of incidence, 0 where the light stands behind the surface.
///
/// NaN in the normal gives 0 here: the writer of a map decides what a missing normal means.
#[must_use]
#[inline(always)]
pub fn cosine<R: Real>(normal: Vec3<R>, light: Vec3<R>) -> R {
    let cosine = normal.dot(light);
    R::keep(cosine.gt(R::zero()), cosine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_behind_and_unknown_normals_give_nothing() {
        let up = Vec3::new(0.0, 0.0, 1.0);
        assert_eq!(cosine(up, Vec3::new(0.6, 0.0, 0.8)), 0.8);
        assert_eq!(cosine(up, Vec3::new(0.6, 0.0, -0.8)), 0.0);
        assert_eq!(cosine(Vec3::new(f64::NAN, 0.0, 1.0), up), 0.0);
    }
}
