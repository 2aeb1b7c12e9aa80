//! From where the pixels of a tile are lit and seen, as cones: what upper bounds of lobes rest on.

use crate::math::Vec3;

/// A cone of directions.
#[derive(Clone, Copy, Debug)]
pub struct Cone {
    /// Unit vector.
    pub axis: Vec3<f64>,
    /// The largest angle to it, in radians.
    pub angle: f64,
}

/// Normals of some pixels, and the directions in which they see a light and an eye.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Unit normals.
    pub normals: Cone,
    /// To the light, all of its points.
    pub light: Cone,
    /// How the light scatters about each point, as of [`LobeModel::spread_value`].
    ///
    /// [`LobeModel::spread_value`]: super::LobeModel::spread_value
    pub spread: f64,
    /// To the eye.
    pub view: Cone,
}

/// Angle between unit vectors, exact for small ones.
#[must_use]
pub fn angle(a: Vec3<f64>, b: Vec3<f64>) -> f64 {
    let [sum, difference] = [(a + b).length_squared().sqrt(), (a - b).length_squared().sqrt()];
    2.0 * difference.atan2(sum)
}

impl Cone {
    /// One direction.
    #[must_use]
    pub fn of(axis: Vec3<f64>) -> Self {
        Self { axis, angle: 0.0 }
    }

    /// Smallest and largest cosine of the angle between directions of two cones, not below 0.
    #[must_use]
    pub fn cosines(&self, other: &Self) -> [f64; 2] {
        let (middle, spread) = (angle(self.axis, other.axis), self.angle + other.angle);
        let cosine = |angle: f64| cosine(angle).max(0.0);
        [cosine(middle + spread), cosine(middle - spread)]
    }
}

/// Cosine of an angle that was made smaller or larger.
pub(super) fn cosine(angle: f64) -> f64 {
    angle.clamp(0.0, core::f64::consts::PI).cos()
}
