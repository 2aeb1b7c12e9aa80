//! What a scene calls for: an effect that is off has no stage, and costs nothing.

use super::scene::Scene;
use crate::geometry::View;

/// Which effects a rendering simulates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effects {
    /// Interface reflection (the second term of eq. 1 and 9).
    pub specular: bool,
    /// Parts of the relief standing in other parts' light.
    pub cast_shadows: bool,
    /// Projection along a view that is not the painting's normal.
    pub slanted_view: bool,
}

impl Effects {
    /// What is there to be simulated: interface reflection unless its strength is zero
    /// everywhere, shadows where a height is given, projection unless the view is frontal.
    #[must_use]
    pub fn of(scene: &Scene, has_specular: bool, has_height: bool) -> Self {
        Self {
            specular: has_specular,
            cast_shadows: has_height,
            slanted_view: matches!(scene.view(), View::Distant(view) if view.x != 0.0 || view.y != 0.0),
        }
    }
}
