//! An environment as light from many directions: the texels of an equirectangular or a cube map.
//!
//! Two ideas meet here. The map is *clipped by the painting's plane before anything is filtered*:
//! light from behind the wall reaches no pixel, and without this step every filter would smear it to
//! the front. And texels stay together in small bundles with a bounding cone, so that a narrow lobe
//! passes over most of the sky in one comparison.

use crate::error::{Error, Result};
use crate::math::Vec3;

/// Side of the square of texels that a bundle takes from a map.
const SIDE: usize = 16;

/// Rows of a rotation matrix: what turns a direction of the room into one of the painting.
pub type Rotation = [[f64; 3]; 3];

/// Directions within an angle of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cone {
    axis: Vec3<f64>,
    /// Of the angle.
    cosine: f64,
    sine: f64,
}

impl Cone {
    /// The cone about the mean of unit vectors that holds them all.
    pub(crate) fn around(directions: impl Iterator<Item = Vec3<f64>> + Clone) -> Self {
        let sum = directions.clone().fold(Vec3::new(0.0, 0.0, 0.0), |sum, one| sum + one);
        let axis = if sum.length_squared() > 0.0 { sum.normalised() } else { sum };
        // Rounded directions are no unit vectors to the last digit.
        let cosine = directions.map(|one| one.dot(axis)).fold(1.0, f64::min) - 1e-6;
        let cosine = cosine.max(-1.0);
        Self { axis, cosine, sine: (1.0 - cosine * cosine).sqrt() }
    }

    /// Cosine of the smallest angle between a direction of one cone and one of the other.
    pub(crate) fn nearest_cosine(&self, other: &Self) -> f64 {
        let cosine = self.cosine * other.cosine - self.sine * other.sine;
        let sine = self.sine * other.cosine + self.cosine * other.sine;
        let between = self.axis.dot(other.axis);
        if sine <= 0.0 || between >= cosine {
            return 1.0;
        }
        between * cosine + (1.0 - between * between).max(0.0).sqrt() * sine
    }
}

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Texel {
    /// Unit vector to the light.
    pub(crate) direction: [f32; 3],
    /// Radiance times solid angle, per channel.
    pub(crate) light: [f32; 3],
}

impl Texel {
    /// The direction in double precision.
    pub(crate) fn towards(&self) -> Vec3<f64> {
        let [x, y, z] = self.direction.map(f64::from);
        Vec3::new(x, y, z)
    }
}

/// Neighbouring texels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Bundle {
    pub(crate) texels: Vec<Texel>,
    pub(crate) cone: Cone,
}

/// The light in front of the painting.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    pub(crate) bundles: Vec<Bundle>,
    /// Width of the widest texel, rad: what is finer is not known.
    pub(crate) spacing: f64,
}

impl Map {
    /// A map `(3, height, width)` of radiance over longitude and latitude.
    ///
    /// The middle of the map is the direction z of the room, in front of the painting; the upper edge
    /// is y, up; and columns run as somebody sees them who stands at the painting and looks into the
    /// room: to the right, towards -x. A texel's light comes from its middle, times its exact solid
    /// angle. `rotation` turns the room about the painting.
    ///
    /// # Errors
    /// If sizes disagree, a radiance is negative or not finite, or the matrix is no rotation.
    pub fn equirectangular(radiance: &[f32], width: usize, rotation: &Rotation) -> Result<Self> {
        let texels = radiance.len() / 3;
        let height = texels / width.max(1);
        let sized = width > 0 && height > 0 && 3 * width * height == radiance.len();
        check(radiance, sized, rotation)?;
        let (across, down) =
            (core::f64::consts::TAU / width as f64, core::f64::consts::PI / height as f64);
        let at = |column: usize, row: usize| {
            let longitude = (column as f64 + 0.5) * across - core::f64::consts::PI;
            let latitude = core::f64::consts::FRAC_PI_2 - (row as f64 + 0.5) * down;
            let (sin, cos) = latitude.sin_cos();
            let direction = Vec3::new(-longitude.sin() * cos, sin, longitude.cos() * cos);
            // The difference of the sines of the texel's two latitudes.
            (direction, across * 2.0 * cos * (0.5 * down).sin())
        };
        let bundles = bundles(radiance, [width, height], rotation, at);
        Ok(Self { bundles, spacing: across.max(down) })
    }

    /// Faces `(6, 3, size, size)` of a cube: +x, -x, +y, -y, +z, -z in the order and orientation of
    /// `OpenGL`, whose +z is in front of the painting here too, and whose +x is the painting's -x: a
    /// cube map is left-handed as seen from within.
    ///
    /// # Errors
    /// As [`Self::equirectangular`].
    pub fn cube(radiance: &[f32], size: usize, rotation: &Rotation) -> Result<Self> {
        check(radiance, size > 0 && radiance.len() == 18 * size * size, rotation)?;
        let step = 2.0 / size as f64;
        let mut all = Vec::new();
        for (face, radiance) in radiance.chunks_exact(3 * size * size).enumerate() {
            let at = |column: usize, row: usize| {
                let [s, t] = [column, row].map(|place| (place as f64 + 0.5) * step - 1.0);
                let [x, y, z] = match face {
                    0 => [1.0, -t, -s],
                    1 => [-1.0, -t, s],
                    2 => [s, 1.0, t],
                    3 => [s, -1.0, -t],
                    4 => [s, -t, 1.0],
                    _ => [-s, -t, -1.0],
                };
                let direction = Vec3::new(-x, y, z).normalised();
                (direction, solid_angle([s, t], step))
            };
            all.extend(bundles(radiance, [size, size], rotation, at));
        }
        Ok(Self { bundles: all, spacing: step })
    }

    /// All texels.
    pub(crate) fn texels(&self) -> impl Iterator<Item = &Texel> {
        self.bundles.iter().flat_map(|bundle| &bundle.texels)
    }
}

/// Solid angle of a square of a cube's face about `(s, t)`, from the areas between its corners and
/// the middle of the face.
fn solid_angle([s, t]: [f64; 2], step: f64) -> f64 {
    let corner = |s: f64, t: f64| (s * t).atan2((s * s + t * t + 1.0).sqrt());
    let [left, right] = [s - 0.5 * step, s + 0.5 * step];
    let [above, below] = [t - 0.5 * step, t + 0.5 * step];
    corner(left, above) - corner(left, below) - corner(right, above) + corner(right, below)
}

fn check(radiance: &[f32], sized: bool, rotation: &Rotation) -> Result<()> {
    if !sized {
        let problem = format!("{} values do not fill three channels of a map", radiance.len());
        return Err(Error::argument("environment", problem));
    }
    if let Some(place) = radiance.iter().position(|&value| !(0.0..=f32::MAX).contains(&value)) {
        let problem = format!(
            "radiance is neither negative nor infinite; value {place} of the map is {}",
            radiance[place]
        );
        return Err(Error::argument("environment", problem));
    }
    let [a, b, c] = rotation.map(|[x, y, z]| Vec3::new(x, y, z));
    let products = [a.dot(a), b.dot(b), c.dot(c), a.dot(b), b.dot(c), a.cross(b).dot(c)];
    let expected = [1.0, 1.0, 1.0, 0.0, 0.0, 1.0];
    // False for NaN.
    if !products.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6) {
        return Err(Error::argument("rotation", "expected a rotation matrix"));
    }
    Ok(())
}

/// The texels in front of the painting, square by square; `at` gives direction and solid angle.
fn bundles(
    radiance: &[f32],
    [width, height]: [usize; 2],
    rotation: &Rotation,
    at: impl Fn(usize, usize) -> (Vec3<f64>, f64),
) -> Vec<Bundle> {
    let rotated = rotation.map(|[x, y, z]| Vec3::new(x, y, z));
    let mut bundles = Vec::new();
    for top in (0..height).step_by(SIDE) {
        for left in (0..width).step_by(SIDE) {
            let mut texels = Vec::new();
            for row in top..height.min(top + SIDE) {
                for column in left..width.min(left + SIDE) {
                    let (direction, solid_angle) = at(column, row);
                    let direction = rotated.map(|axis| axis.dot(direction));
                    // What the height over the plane changes by from texel to texel.
                    let beside = |place: usize, size: usize| {
                        if place + 1 < size { place + 1 } else { place.saturating_sub(1) }
                    };
                    let steps = [(beside(column, width), row), (column, beside(row, height))];
                    let steps = steps.map(|(column, row)| {
                        (rotated[2].dot(at(column, row).0) - direction[2]).abs()
                    });
                    // At a pole the next row is farther away than the texel reaches.
                    let square = solid_angle.sqrt() * direction[0].hypot(direction[1]);
                    let many = width > 1 && height > 1;
                    let tall = if many { square.min(steps[0] + steps[1]) } else { square };
                    let Some((direction, share)) = in_front(direction, 0.5 * tall) else {
                        continue;
                    };
                    let solid_angle = solid_angle * share;
                    let place = row * width + column;
                    let value = |channel| f64::from(radiance[channel * width * height + place]);
                    let light = [0, 1, 2].map(|channel| (value(channel) * solid_angle) as f32);
                    let direction = direction.map(|value| value as f32);
                    if light.iter().any(|&light| light > 0.0) {
                        texels.push(Texel { direction, light });
                    }
                }
            }
            if !texels.is_empty() {
                let cone = Cone::around(texels.iter().map(Texel::towards));
                bundles.push(Bundle { texels, cone });
            }
        }
    }
    bundles
}

/// The middle of what lies in front of the painting's plane of a texel about a unit vector, and its
/// share, if the texel reaches by `half` over and below its middle as a square with two sides along the
/// plane does.
fn in_front([x, y, z]: [f64; 3], half: f64) -> Option<([f64; 3], f64)> {
    if z >= half {
        return Some(([x, y, z], 1.0));
    }
    let top = z + half;
    if top <= 0.0 {
        return None;
    }
    let middle = 0.5 * top;
    let flat = (1.0 - middle * middle).sqrt() / x.hypot(y);
    Some(([x * flat, y * flat, middle], (top / (2.0 * half)).min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const UPRIGHT: Rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    /// A map that is dark but for one texel.
    fn spot(width: usize, height: usize, column: usize, row: usize) -> Vec<f32> {
        let mut radiance = vec![0.0; 3 * width * height];
        for channel in 0..3 {
            radiance[(channel * height + row) * width + column] = 1.0;
        }
        radiance
    }

    fn only(map: &Map) -> Texel {
        assert_eq!(map.texels().count(), 1);
        *map.texels().next().unwrap()
    }

    #[test]
    fn light_in_front_reaches_and_light_behind_is_clipped() {
        let light = |fill: f32, map: fn(&[f32]) -> Map, count: usize| {
            map(&vec![fill; count]).texels().map(|texel| f64::from(texel.light[1])).sum::<f64>()
        };
        let sphere = |radiance: &[f32]| Map::equirectangular(radiance, 64, &UPRIGHT).unwrap();
        let cube = |radiance: &[f32]| Map::cube(radiance, 32, &UPRIGHT).unwrap();
        // Half a sphere; sums of 2048 and 3072 roundings of single precision.
        let half = core::f64::consts::TAU;
        assert!((light(1.0, sphere, 3 * 64 * 32) / half - 1.0).abs() < 1e-6);
        assert!((light(1.0, cube, 18 * 32 * 32) / half - 1.0).abs() < 1e-6);
    }

    #[test]
    fn columns_run_as_seen_from_the_painting() {
        // Right of the middle is the painting's left, x < 0; the upper half is up.
        let found = only(&Map::equirectangular(&spot(64, 32, 40, 8), 64, &UPRIGHT).unwrap());
        assert!(found.direction[0] < 0.0 && found.direction[1] > 0.0 && found.direction[2] > 0.0);
        let behind = Map::equirectangular(&spot(64, 32, 2, 8), 64, &UPRIGHT).unwrap();
        assert_eq!(behind.texels().count(), 0);
    }

    #[test]
    fn both_layouts_say_the_same() {
        // The +x face, left of its middle and above, is in front of the painting and at its left.
        let mut radiance = vec![0.0; 18 * 64];
        for channel in 0..3 {
            radiance[channel * 64 + 2 * 8 + 1] = 1.0;
        }
        let found = only(&Map::cube(&radiance, 8, &UPRIGHT).unwrap()).direction;
        assert!(found[0] < -0.7 && found[1] > 0.0 && found[2] > 0.0, "{found:?}");
        // The same by a turn of 90 degrees about y of the face in front.
        let mut front = vec![0.0; 18 * 64];
        for channel in 0..3 {
            front[4 * 192 + channel * 64 + 2 * 8 + 1] = 1.0;
        }
        let turn = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
        let rotated = only(&Map::cube(&front, 8, &turn).unwrap()).direction;
        for (one, other) in found.iter().zip(rotated) {
            assert!((one - other).abs() < 1e-6, "{found:?} {rotated:?}");
        }
    }

    #[test]
    fn a_rotation_moves_the_light() {
        let angle = 0.4_f64;
        let (sin, cos) = angle.sin_cos();
        let about_z = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
        let before = only(&Map::equirectangular(&spot(64, 32, 40, 8), 64, &UPRIGHT).unwrap());
        let after = only(&Map::equirectangular(&spot(64, 32, 40, 8), 64, &about_z).unwrap());
        let [x, y, z] = before.direction.map(f64::from);
        let expected = [cos * x - sin * y, sin * x + cos * y, z];
        for (found, expected) in after.direction.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn cones_hold_what_is_in_them() {
        let map = Map::equirectangular(&vec![1.0; 3 * 64 * 32], 64, &UPRIGHT).unwrap();
        for (one, other) in map.bundles.iter().zip(map.bundles.iter().skip(3)) {
            let bound = one.cone.nearest_cosine(&other.cone);
            let pairs = one.texels.iter().flat_map(|a| other.texels.iter().map(move |b| (a, b)));
            let most = pairs.map(|(a, b)| a.towards().dot(b.towards())).fold(-1.0, f64::max);
            assert!(most <= bound + 1e-9 && bound < most + 0.35, "{most} {bound}");
        }
    }

    #[test]
    fn what_is_no_map_is_refused() {
        let fine = vec![1.0; 3 * 64 * 32];
        let refused = |radiance: &[f32], width, rotation: &Rotation| {
            Map::equirectangular(radiance, width, rotation).is_err()
        };
        for bad in [f32::NAN, f32::INFINITY, -1e-3] {
            let mut radiance = fine.clone();
            radiance[77] = bad;
            assert!(refused(&radiance, 64, &UPRIGHT));
        }
        assert!(
            refused(&fine, 63, &UPRIGHT)
                && refused(&fine, 0, &UPRIGHT)
                && refused(&[], 4, &UPRIGHT)
        );
        assert!(
            refused(&fine, 64, &[[1.0, 0.0, 0.0]; 3]) && refused(&fine, 64, &[[f64::NAN; 3]; 3])
        );
        assert!(Map::cube(&fine, 8, &UPRIGHT).is_err());
    }
}
