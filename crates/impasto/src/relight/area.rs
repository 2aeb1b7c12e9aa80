//! Lamps with a size: discs, as points of equal area on Vogel's spiral [@vogel1979better].
//!
//! Diffuse light takes a lamp for the middle of its disc. Shadows see the share of the disc that is
//! not hidden. A lobe sees sixteen points, each for its part of the disc: the lobe is convolved with a
//! Gaussian ([`LobeModel::spread_value`](crate::surface::LobeModel)) of twice the variance of such a
//! part, so that a narrow lobe shows a disc and not the points. The points lie as much farther inside
//! as keeps the variance of the whole disc.

use core::f64::consts::PI;
use core::ops::Range;

use super::scene::Lamp;
use crate::geometry::Light;
use crate::math::Vec3;

/// Points that a lobe sees of a lamp.
const POINTS: usize = 16;

/// Radius of the spiral of these points, of the disc's: `r^2 / 4` is the variance of a disc along an
/// axis, and the Gaussians have `r^2 / (2 POINTS)` of it.
fn inside() -> f64 {
    (1.0 - 2.0 / POINTS as f64).sqrt()
}

/// Points of a disc of `radius` about `middle` that faces the origin.
pub(super) fn disc(
    middle: Vec3<f64>,
    radius: f64,
    count: usize,
) -> impl Iterator<Item = Vec3<f64>> {
    let axis = middle.normalised();
    let sideways = if axis.z > 0.9 { Vec3::new(1.0, 0.0, 0.0) } else { Vec3::new(0.0, 0.0, 1.0) };
    let across = sideways.cross(axis).normalised();
    let up = axis.cross(across);
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |index| {
        let r = radius * ((index as f64 + 0.5) / count as f64).sqrt();
        let (sine, cosine) = (index as f64 * golden).sin_cos();
        middle + across.scale(r * cosine) + up.scale(r * sine)
    })
}

/// What lobes see of a lamp.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Source {
    /// Which pairs of light and view are its points.
    pub(super) pairs: Range<usize>,
    /// Variance of directions about each of them along an axis, in radians squared.
    pub(super) spread: f32,
}

/// The points of all lamps, and which of them are whose.
pub(super) fn sources(lamps: &[Lamp]) -> (Vec<Light>, Vec<Source>) {
    let (mut lights, mut sources) = (Vec::new(), Vec::new());
    for lamp in lamps {
        let first = lights.len();
        lights.extend(points(lamp));
        sources.push(Source { pairs: first..lights.len(), spread: spread(lamp) as f32 });
    }
    (lights, sources)
}

/// The variance of the directions about a point of a lamp along each axis, in radians squared, as the
/// middle of the painting sees it.
pub(super) fn spread(lamp: &Lamp) -> f64 {
    let radius = match lamp.light {
        Light::Distant(_) => lamp.angular_radius().tan(),
        Light::Point { .. } => lamp.angular_radius(),
    };
    0.5 * radius * radius / POINTS as f64
}

impl Lamp {
    /// What lobes see of it, each point for an equal part of its light: of a lamp without a size the
    /// lamp itself.
    #[must_use]
    pub fn points(&self) -> Vec<Light> {
        points(self)
    }

    /// The variance of the directions about each of its [`Self::points`] along an axis, as the middle of
    /// the painting sees it, in radians squared; 0 for a lamp without a size.
    #[must_use]
    pub fn spread(&self) -> f64 {
        spread(self)
    }
}

fn points(lamp: &Lamp) -> Vec<Light> {
    if !lamp.has_size() {
        return vec![lamp.light];
    }
    match lamp.light {
        Light::Distant(direction) => {
            let points = disc(direction.normalised(), lamp.radius.tan() * inside(), POINTS);
            points.map(|point| Light::Distant(point.normalised())).collect()
        }
        Light::Point { position, falloff } => {
            let points = disc(position, lamp.radius * inside(), POINTS);
            points.map(|position| Light::Point { position, falloff }).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Lafortune, LobeModel, TorranceSparrow};

    const MANY: usize = 4000;

    fn lamp(light: Light, radius: f64) -> Lamp {
        Lamp { light, intensity: 1.0, radius, colour: 0 }
    }

    /// The light of a lobe from the points that it sees, and from many points without a part of the
    /// disc each, at normals about the one that mirrors the lamp; both over the largest of the latter.
    fn highlights<M: LobeModel>(model: M, shape: [f64; 3], lamp: &Lamp) -> Vec<[f64; 2]> {
        let lobe = model.lobe_from_parameters::<f64>(shape);
        let view = Vec3::new(-0.3, 0.1, 0.9).normalised();
        let middle = lamp.light.at(0.0, 0.0).0;
        let mirror = (middle + view).normalised();
        let across = mirror.cross(Vec3::new(0.0, 1.0, 0.0)).normalised();
        let spread = spread(lamp);
        let (few, many) = (points(lamp), disc(middle, lamp.radius.tan(), MANY));
        let many: Vec<_> = many.map(Vec3::normalised).collect();
        let mut seen: Vec<[f64; 2]> = (-30..=30)
            .map(|step| {
                let normal = mirror + across.scale(0.02 * f64::from(step) * lamp.radius);
                let normal = normal.normalised();
                let of = |light: Vec3<f64>| model.pair(light, view);
                let few = few
                    .iter()
                    .map(|light| model.spread_value(&lobe, &of(light.direction()), normal, spread));
                let many = many.iter().map(|&light| model.value(&lobe, &of(light), normal));
                [few.sum::<f64>() / POINTS as f64, many.sum::<f64>() / MANY as f64]
            })
            .collect();
        let most = seen.iter().map(|[_, exact]| *exact).fold(0.0, f64::max);
        seen.iter_mut().flatten().for_each(|value| *value /= most);
        seen
    }

    #[test]
    fn a_lobe_shows_the_disc_of_a_lamp() {
        let direction = Light::Distant(Vec3::new(0.5, 0.2, 0.8).normalised());
        for radius in [0.02, 0.1, 0.3] {
            let lamp = lamp(direction, radius);
            // From a lobe four times as wide as the lamp (in half vectors) to one an eighth of it.
            for wide in [4.0, 1.0, 0.25, 0.125] {
                let gamma = 0.5 * radius * wide;
                let exponent = core::f64::consts::LN_2 * 2.0 / (radius * wide).powi(2);
                let facets = highlights(TorranceSparrow { index: 1.45 }, [gamma, 0.0, 0.0], &lamp);
                let phong = highlights(Lafortune, [-1.0, 1.0, exponent], &lamp);
                for [found, exact] in facets.into_iter().chain(phong) {
                    // Sixteen Gaussians with deviations of 0.18 of the disc's radius in the plane of
                    // light, added in numpy and compared with 1000 points, are off by at most 0.01,
                    // 0.02, 0.22 and 0.48 (at the disc's edge, which they blur); real lobes on a
                    // sphere of directions add a few hundredths.
                    let limit = if wide < 0.2 { 0.5 } else { 0.25_f64.min(0.05 / wide) };
                    assert!((found - exact).abs() < limit, "{radius} {wide}: {found} {exact}");
                }
            }
        }
    }

    #[test]
    fn a_lamp_without_a_size_is_one_point_and_one_with_a_size_many() {
        let position = Vec3::new(0.0, 30.0, 40.0);
        let near = Light::Point { position, falloff: true };
        let (lights, sources) = sources(&[lamp(near, 0.0), lamp(near, 5.0)]);
        assert_eq!((lights[0], &sources[0].pairs, &sources[1].pairs), (near, &(0..1), &(1..17)));
        // The variance of a disc along an axis is a quarter of its squared radius: that of the points,
        // half the mean squared distance, and that about each.
        let far = |light: &Light| match light {
            Light::Point { position: point, .. } => (*point - position).length_squared(),
            Light::Distant(_) => f64::NAN,
        };
        let mean = lights[1..].iter().map(far).sum::<f64>() / 16.0;
        let about = f64::from(sources[1].spread) * position.length_squared();
        assert!((0.5 * mean + about - 0.25 * 25.0).abs() < 1e-5, "{mean} {about}");
        assert_eq!(sources[0].spread, 0.0);
    }
}
