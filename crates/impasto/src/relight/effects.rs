//! What a scene calls for: an effect that is off has no stage, and costs nothing.

use super::scene::Scene;
use super::view::Projection;
use crate::geometry::{Grid, View};

/// Pixels by which a view must move some part of the painting for the picture to be projected.
/// A smaller displacement changes a pixel by less than this share of the difference to its
/// neighbour: between black and white, by a quarter of an 8-bit code.
const NOTICEABLE: f64 = 1.0 / 1024.0;

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
    /// What is there to be simulated: interface reflection where there are lobes, shadows where a
    /// height is given, projection where the view of a distant eye moves some pixel noticeably.
    #[must_use]
    pub fn of(scene: &Scene, grid: Grid, has_specular: bool, has_height: bool) -> Self {
        let slanted_view = match scene.view() {
            View::Distant(view) => Projection::new(view, grid).displacement() > NOTICEABLE,
            View::Point(_) => false,
        };
        Self { specular: has_specular, cast_shadows: has_height, slanted_view }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Light;
    use crate::math::Vec3;
    use crate::relight::scene::{Colour, Lamp};

    fn slanted(view: Vec3<f64>, width: usize) -> bool {
        let light = Light::Distant(Vec3::new(0.0, 0.0, 1.0));
        let colours = vec![Colour { diffuse: vec![[1.0; 3]], interface: [1.0; 3] }];
        let lamps = vec![Lamp { light, intensity: 1.0, colour: 0 }];
        let scene = Scene::new(lamps, colours, view).unwrap();
        Effects::of(&scene, Grid::whole(width, 20, 0.1), true, false).slanted_view
    }

    #[test]
    fn a_view_is_slanted_where_it_moves_a_pixel() {
        let tilted = |angle: f64| Vec3::new(angle.sin(), 0.0, angle.cos());
        assert!(!slanted(tilted(0.0), 1000) && !slanted(tilted(1e-9), 1000));
        // The edge moves by (1 - cos) 500 pixels: a thousandth of a pixel at 0.002 rad.
        assert!(!slanted(tilted(0.0019), 1000) && slanted(tilted(0.0021), 1000));
        // 0.0019 rad move the edge of a larger painting by more.
        assert!(slanted(tilted(0.0019), 2000) && slanted(tilted(0.0019).scale(3.0), 2000));
    }
}
