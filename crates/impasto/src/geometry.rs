//! Who lit, who looked, and where on the painting a pixel lies.
//!
//! World frame: origin in the middle of the painting, x right, y up, z towards the viewer,
//! millimetres. Directions are unit vectors that point away from the surface.

use crate::error::{Error, Result};
use crate::math::{Real, Vec3};

/// Where a photograph's light came from; its strength is already divided out of the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// So far away that every pixel sees it from the same unit direction.
    Distant(Vec3<f64>),
    /// Near: position in mm, and whether the samples still carry the 1/r^2 fall-off.
    Point {
        /// Millimetres from the middle of the painting.
        position: Vec3<f64>,
        /// Irradiance falls off as `(r0 / r)^2`, with `r0` the distance of the middle.
        falloff: bool,
    },
}

impl Light {
    /// Unit direction to the light and its irradiance at normal incidence, seen from the points
    /// `(x, y, 0)` in mm.
    #[must_use]
    #[inline(always)]
    pub fn at<R: Real>(&self, x: R, y: R) -> (Vec3<R>, R) {
        match *self {
            Self::Distant(direction) => (direction.splat(), R::one()),
            Self::Point { position, falloff } => {
                let to_light = position.splat() - Vec3::new(x, y, R::zero());
                let inverse = to_light.length().recip();
                let irradiance = if falloff {
                    let ratio = R::of(position.length()) * inverse;
                    ratio * ratio
                } else {
                    R::one()
                };
                (to_light.scale(inverse), irradiance)
            }
        }
    }

    /// Whether every pixel sees the light from the same direction.
    #[must_use]
    pub fn is_distant(&self) -> bool {
        matches!(self, Self::Distant(_))
    }

    /// Unit direction from the middle of the painting.
    #[must_use]
    pub fn direction(&self) -> Vec3<f64> {
        match *self {
            Self::Distant(direction) => direction,
            Self::Point { position, .. } => position.normalised(),
        }
    }
}

/// From pixels to millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Width of a pixel on the painting, mm.
    pub pitch: f64,
}

impl Grid {
    /// x in mm of a (fractional) column.
    #[must_use]
    #[inline(always)]
    pub fn x(&self, column: f64) -> f64 {
        (column - 0.5 * (self.width as f64 - 1.0)) * self.pitch
    }

    /// y in mm of a (fractional) row: rows run down, y runs up.
    #[must_use]
    #[inline(always)]
    pub fn y(&self, row: f64) -> f64 {
        (0.5 * (self.height as f64 - 1.0) - row) * self.pitch
    }

    /// Writes the coordinates in mm of the pixels from `start` on, counted row by row.
    #[inline]
    pub fn coordinates(&self, start: usize, x: &mut [f32], y: &mut [f32]) {
        let (mut row, mut column) = (start / self.width, start % self.width);
        for (x, y) in x.iter_mut().zip(y) {
            *x = self.x(column as f64) as f32;
            *y = self.y(row as f64) as f32;
            column += 1;
            if column == self.width {
                (row, column) = (row + 1, 0);
            }
        }
    }
}

/// Views that differ by less, in radians, are one view: what a pixel shows under them then differs
/// by less than a sharp lobe's own width.
const ONE_VIEW: f64 = 0.05;

/// One light and one view per observation.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    lights: Vec<Light>,
    views: Vec<Vec3<f64>>,
    grid: Grid,
}

impl Rig {
    /// A rig of as many lights as views.
    ///
    /// # Errors
    /// If the counts differ, or a vector is not finite or has no length.
    pub fn new(lights: Vec<Light>, views: Vec<Vec3<f64>>, grid: Grid) -> Result<Self> {
        if lights.is_empty() || lights.len() != views.len() {
            let problem = format!("{} lights and {} views", lights.len(), views.len());
            return Err(Error::geometry("lights", problem));
        }
        let usable = |v: &Vec3<f64>| v.length_squared().is_finite() && v.length_squared() > 0.0;
        if let Some(index) = lights.iter().position(|light| !usable(&light.direction())) {
            let problem = format!("light {index} has no finite direction");
            return Err(Error::geometry("lights", problem));
        }
        if let Some(index) = views.iter().position(|view| !usable(view)) {
            return Err(Error::geometry("views", format!("view {index} has no finite direction")));
        }
        Ok(Self { lights, views, grid })
    }

    /// Number of observations.
    #[must_use]
    pub fn observations(&self) -> usize {
        self.lights.len()
    }

    /// One light per observation.
    #[must_use]
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// One unit direction to the eye per observation.
    #[must_use]
    pub fn views(&self) -> &[Vec3<f64>] {
        &self.views
    }

    /// Where the pixels lie.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Whether no light's direction changes over the painting.
    #[must_use]
    pub fn is_distant(&self) -> bool {
        self.lights.iter().all(Light::is_distant)
    }

    /// Whether photographs were taken from more than one direction.
    #[must_use]
    pub fn views_differ(&self) -> bool {
        self.views.iter().any(|view| view.dot(self.views[0]) < ONE_VIEW.cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_light_overhead_falls_off_with_the_squared_distance() {
        let light = Light::Point { position: Vec3::new(0.0, 0.0, 100.0), falloff: true };
        let (direction, irradiance) = light.at(100.0_f64, 0.0);
        // r = 100 sqrt 2: irradiance one half, direction at 45 degrees.
        assert!((irradiance - 0.5).abs() < 1e-15);
        assert!((direction.x + 0.5_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn views_differ_from_three_degrees_on() {
        let grid = Grid { width: 1, height: 1, pitch: 1.0 };
        let rig = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let views = vec![Vec3::new(0.0, 0.0, 1.0), Vec3::new(sin, 0.0, cos)];
            Rig::new(vec![Light::Distant(views[0]); 2], views, grid).unwrap()
        };
        // 0.05 rad is 2.86 degrees.
        assert!(!rig(2.8).views_differ());
        assert!(rig(2.9).views_differ());
    }

    #[test]
    fn rows_run_down_and_y_runs_up() {
        let grid = Grid { width: 3, height: 2, pitch: 2.0 };
        let (mut x, mut y) = ([0.0; 6], [0.0; 6]);
        grid.coordinates(0, &mut x, &mut y);
        assert_eq!(x, [-2.0, 0.0, 2.0, -2.0, 0.0, 2.0]);
        assert_eq!(y, [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]);
    }
}
