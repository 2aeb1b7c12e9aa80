//! The third paper's scheme [@snel]: the environment convolved with the lobe, one number per
//! direction, looked up in the direction of the lobe.
//!
//! For comparison. The cosine of incidence is taken in the middle of the lobe, `N.p^`, instead of in
//! the integral: wrong by tens of per cent for broad lobes (`docs/environment.md`), and equal to the
//! vectors of [`lafortune`](super::lafortune) in the limit of sharp ones.

use crate::math::{Real, Vec3};

/// How prefiltered maps become light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// `N . V_n(p^)`: the cosine inside the integral.
    #[default]
    Vector,
    /// `(N.p^) G_n(p^)`: the cosine in the middle of the lobe.
    Scalar,
}

impl Scheme {
    /// Light of the lobe in the direction `lobe` on a normal, from the numbers of the maps.
    #[inline(always)]
    pub(crate) fn light(self, maps: &[f32; 16], normal: Vec3<f32>, lobe: Vec3<f32>) -> [f32; 3] {
        [0, 1, 2].map(|channel| {
            let value = match self {
                Self::Vector => {
                    normal.dot(Vec3::new(maps[channel], maps[4 + channel], maps[8 + channel]))
                }
                Self::Scalar => Real::max(normal.dot(lobe), 0.0) * maps[12 + channel],
            };
            Real::max(value, 0.0)
        })
    }
}
