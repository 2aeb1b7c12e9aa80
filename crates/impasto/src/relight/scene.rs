//! What to light: lamps, the colour of their light as a matrix, and the eye.

use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

use super::environment::Environment;
use crate::error::{Error, Result};
use crate::geometry::{Light, View};

/// A light with its strength and colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Where it stands.
    pub light: Light,
    /// Irradiance at the middle of the painting at normal incidence; 1 shows a white board as
    /// white.
    pub intensity: f64,
    /// Of a distant lamp its angular radius in radians, of a near one its radius in mm: a disc that
    /// faces the middle of the painting; 0 for a lamp without a size.
    pub radius: f64,
    /// Which of the scene's [`Colour`]s its light has.
    pub colour: usize,
}

/// What one illuminant makes of the surface: everything between reflectance and three output
/// numbers is linear, so it is a matrix (diffuse) and a vector (interface).
#[derive(Clone, Debug, PartialEq)]
pub struct Colour {
    /// One column per reflectance coefficient: the output of one unit of it.
    pub diffuse: Vec<[f64; 3]>,
    /// The output of one unit of interface reflection: the colour of the light itself.
    pub interface: [f64; 3],
}

/// Lamps, their colours and the eye.
///
/// A distant eye sees the painting in parallel rays, foreshortened along its tilt. What a near eye
/// sees is shown on the painting's own grid, as rectified photographs are, or in perspective.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    lamps: Vec<Lamp>,
    colours: Vec<Colour>,
    view: View,
    perspective: bool,
    rectified: bool,
    environment: Option<Surroundings>,
}

/// An environment in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// Where light comes from.
    pub environment: Arc<Environment>,
    /// Which of the scene's [`Colour`]s its channels have.
    pub colours: [usize; 3],
    /// The mean reflectance of what surrounds a pixel, 0 to 1: over a relief a part of the light comes
    /// from there.
    pub albedo: f64,
}

/// Lamps that are smaller, in radians as the middle of the painting sees them, are points: single
/// precision knows no disc so small. The sun has 0.0047.
const SMALLEST: f64 = 1e-3;

impl Lamp {
    /// Its angular radius as the middle of the painting sees it, in radians; 0 for a point.
    #[must_use]
    pub fn angular_radius(&self) -> f64 {
        let radius = match self.light {
            Light::Distant(_) => self.radius,
            Light::Point { position, .. } => self.radius / position.length(),
        };
        if radius < SMALLEST { 0.0 } else { radius }
    }

    /// Whether it is no point.
    #[must_use]
    pub fn has_size(&self) -> bool {
        self.angular_radius() > 0.0
    }
}

impl Scene {
    /// A scene; the direction of a distant `view` is made a unit vector.
    ///
    /// # Errors
    /// If there is no lamp, one stands behind the painting or has no finite strength, the eye looks
    /// from behind, a lamp names a colour that is not there, or the colours disagree about the
    /// number of coefficients.
    pub fn new(lamps: Vec<Lamp>, colours: Vec<Colour>, view: impl Into<View>) -> Result<Self> {
        Self::surrounded(lamps, colours, view, None)
    }

    /// The same in an environment, where there may be no lamp.
    ///
    /// # Errors
    /// As [`Self::new`], or if the environment names a colour that is not there.
    pub fn surrounded(
        lamps: Vec<Lamp>,
        colours: Vec<Colour>,
        view: impl Into<View>,
        environment: Option<Surroundings>,
    ) -> Result<Self> {
        if lamps.is_empty() && environment.is_none() {
            return Err(Error::geometry("lights", "expected at least one light, found none"));
        }
        let named = environment.iter().flat_map(|one| one.colours).max();
        if let Some(most) = named.filter(|&most| most >= colours.len()) {
            let problem = format!("it names colour {most} of {}", colours.len());
            return Err(Error::argument("environment", problem));
        }
        if let Some(around) = environment.as_ref().filter(|one| !(0.0..=1.0).contains(&one.albedo))
        {
            let problem = format!("expected a mean reflectance of 0 to 1, found {}", around.albedo);
            return Err(Error::argument("albedo", problem));
        }
        for (index, lamp) in lamps.iter().enumerate() {
            let direction = lamp.light.direction();
            if !(direction.length_squared().is_finite() && direction.z > 0.0) {
                let problem = format!(
                    "light {index} does not stand in front of the painting (z is {})",
                    direction.z
                );
                return Err(Error::geometry("lights", problem));
            }
            if !(lamp.intensity.is_finite() && lamp.intensity >= 0.0) {
                let problem = format!("light {index} has intensity {}", lamp.intensity);
                return Err(Error::argument("lights", problem));
            }
            let largest = match lamp.light {
                Light::Distant(_) => FRAC_PI_4,
                // Give or take the rounding of whoever computed it.
                Light::Point { position, .. } => 0.5 * position.length() * (1.0 + 1e-9),
            };
            if !(0.0..=largest).contains(&lamp.radius) {
                let problem = format!(
                    "light {index}: expected a radius of 0 to {largest:.4}, found {}",
                    lamp.radius
                );
                return Err(Error::argument("lights", problem));
            }
            if lamp.colour >= colours.len() {
                let problem =
                    format!("light {index} names colour {} of {}", lamp.colour, colours.len());
                return Err(Error::argument("lights", problem));
            }
        }
        let coefficients = colours[0].diffuse.len();
        if colours.iter().any(|colour| colour.diffuse.len() != coefficients) {
            return Err(Error::argument("colours", "their matrices have different sizes"));
        }
        let view = match view.into() {
            View::Distant(direction) => View::Distant(direction.normalised()),
            point @ View::Point(_) => point,
        };
        let direction = view.direction();
        if !(direction.length_squared().is_finite() && direction.z > 0.0) {
            let problem =
                format!("the eye must be in front of the painting (z is {})", direction.z);
            return Err(Error::geometry("view", problem));
        }
        Ok(Self { lamps, colours, view, perspective: false, rectified: false, environment })
    }

    /// The same, but a near eye sees the painting in perspective.
    #[must_use]
    pub fn in_perspective(self, perspective: bool) -> Self {
        Self { perspective, ..self }
    }

    /// The same, but a rectified picture shows the painting on its own grid wherever the eye is.
    #[must_use]
    pub fn rectified(self, rectified: bool) -> Self {
        Self { rectified, ..self }
    }

    /// Whether the picture is the painting as its eye sees it: from anywhere but straight in front.
    #[must_use]
    pub fn is_projected(&self) -> bool {
        !self.rectified && (self.view.is_distant() || self.perspective)
    }

    /// All lamps.
    #[must_use]
    pub fn lamps(&self) -> &[Lamp] {
        &self.lamps
    }

    /// One colour per distinct illuminant.
    #[must_use]
    pub fn colours(&self) -> &[Colour] {
        &self.colours
    }

    /// Reflectance coefficients per pixel.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        self.colours[0].diffuse.len()
    }

    /// What surrounds the painting.
    #[must_use]
    pub fn environment(&self) -> Option<&Surroundings> {
        self.environment.as_ref()
    }

    /// Where the eye is.
    #[must_use]
    pub fn view(&self) -> View {
        self.view
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn scene(z: f64, colour: usize, view: Vec3<f64>) -> Result<Scene> {
        let light = Light::Distant(Vec3::new(0.6, 0.0, z));
        let lamp = Lamp { light, intensity: 1.0, radius: 0.0, colour };
        let colours = vec![Colour { diffuse: vec![[1.0; 3]], interface: [1.0; 3] }];
        Scene::new(vec![lamp], colours, view)
    }

    #[test]
    fn what_cannot_be_seen_is_refused() {
        let front = Vec3::new(0.0, 0.0, 2.0);
        assert_eq!(scene(0.8, 0, front).unwrap().view(), Vec3::new(0.0, 0.0, 1.0).into());
        assert!(scene(-0.8, 0, front).is_err());
        assert!(scene(0.8, 1, front).is_err());
        assert!(scene(0.8, 0, Vec3::new(0.0, 1.0, 0.0)).is_err());
        assert!(scene(0.8, 0, Vec3::new(0.0, f64::NAN, 1.0)).is_err());
    }
}
