//! What a model of lobes must answer to be estimated, besides its value.

use crate::math::{Real, Vec3};
use crate::surface::LobeModel;

/// Most numbers that a lobe's shape may have.
pub const MAX_SHAPES: usize = 2;

/// A lobe of unit strength under unit irradiance, and its derivatives; all 0 where the surface
/// turns away from light or view.
#[derive(Clone, Copy, Debug)]
pub struct Slope<R> {
    /// Radiance.
    pub value: R,
    /// With respect to the numbers of the shape.
    pub shape: [R; MAX_SHAPES],
    /// With respect to the normal (to be projected on the tangent plane by whoever steps there).
    pub normal: Vec3<R>,
}

/// A kind of lobe whose shape is searched for: its unknowns, their bounds, and where to start.
///
/// The unknowns of a shape are a search's own; [`LobeModel::NAMES`] names the parameters that maps
/// hold. The first unknown is the logarithm of a sharpness: the prior, the status `Pooled` and the
/// map of deviations use the standard deviation of this unknown alone.
///
/// Every generic method must be `#[inline(always)]`: it becomes part of a vector kernel.
pub trait LobeEstimation: LobeModel {
    /// How many unknowns a shape has, at most [`MAX_SHAPES`].
    const SHAPES: usize;

    /// The normal that would mirror the light into the view.
    fn facing<R: Real>(&self, pair: &Self::Pair<R>) -> Vec3<R>;
    /// A lobe from the unknowns of its shape.
    fn lobe_from_unknowns<R: Real>(&self, shape: [R; MAX_SHAPES]) -> Self::Lobe<R>;
    /// Writes the parameters of a shape, as many as there are [`LobeModel::NAMES`];
    /// [`LobeModel::lobe_from_parameters`] goes back.
    fn parameters_from_unknowns(&self, shape: [f32; MAX_SHAPES], parameters: &mut [f32]);
    /// [`LobeModel::value`] with its derivatives.
    fn slope<R: Real>(
        &self,
        lobe: &Self::Lobe<R>,
        pair: &Self::Pair<R>,
        normal: Vec3<R>,
    ) -> Slope<R>;
    /// Smallest and largest shape.
    fn bounds(&self) -> [[f64; MAX_SHAPES]; 2];
    /// Smallest shape while the normal is free: a wider lobe would stand for diffuse light under
    /// another normal.
    fn widest_with_normal(&self) -> [f64; MAX_SHAPES];
    /// Shapes to start from.
    fn starts(&self) -> &'static [[f64; MAX_SHAPES]];
    /// Usual standard deviations of the unknowns over a painting: a lobe whose unknowns are known
    /// no better is not known.
    fn deviations(&self) -> [f64; MAX_SHAPES];
    /// Standard deviation of the logarithm of a lobe's width, from that of the first unknown.
    fn width_deviation(&self, deviation: f32) -> f32;
    /// Lobes are numbered by this, largest first: the sharpest lobe is number 0.
    fn order(&self, shape: [f32; MAX_SHAPES]) -> f32;
    /// Calls `visit` with the constants of [`Visit::visit`] for 0 to
    /// [`MOST_LOBES`](super::MOST_LOBES) lobes.
    fn dispatch<V: Visit>(lobes: usize, visit: V) -> V::Output;
}

/// Something to do for a number of lobes that the compiler knows.
pub trait Visit {
    /// What it returns.
    type Output;
    /// `J` lobes, `K = J + 2` columns (diffuse, lobes, ambient), `N = 2 + J SHAPES` unknowns.
    fn visit<const J: usize, const K: usize, const N: usize>(self) -> Self::Output;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{MAX_PARAMETERS, TorranceSparrow};

    fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
        Vec3::new(x, y, z).normalised()
    }

    /// Directions of all kinds, some behind the surface.
    fn scenes() -> impl Iterator<Item = [Vec3<f64>; 3]> {
        (0..200).map(|i| {
            let t = f64::from(i);
            [
                unit(0.3 * (t * 0.7).sin(), 0.3 * (t * 1.3).cos(), 1.0),
                unit((t * 0.37).cos(), (t * 0.53).sin(), 0.9 * (t * 0.11).sin() + 0.5),
                unit(0.5 * (t * 0.21).sin(), 0.3, 0.4 + 0.6 * (t * 0.17).cos().abs()),
            ]
        })
    }

    fn slopes_are_differences<M: LobeEstimation>(model: M, shapes: &[[f64; MAX_SHAPES]]) {
        let mut lit = 0;
        for [normal, light, view] in scenes() {
            let pair = model.pair(light, view);
            for &shape in shapes {
                let value =
                    |shape, normal| model.value(&model.lobe_from_unknowns(shape), &pair, normal);
                let found = model.slope(&model.lobe_from_unknowns(shape), &pair, normal);
                assert!((found.value - value(shape, normal)).abs() < 1e-15);
                if found.value < 1e-6 {
                    continue;
                }
                lit += 1;
                // A difference carries 2e-16 / 1e-6 of the value, and h^2 / 6 of its third
                // derivative: sharpnesses of up to 150 cubed make that 6e-7.
                let (h, within) = (1e-6, 2e-6 * (1.0 + found.value));
                for number in 0..M::SHAPES {
                    let moved = |h: f64| {
                        let mut moved = shape;
                        moved[number] += h;
                        value(moved, normal)
                    };
                    let difference = (moved(h) - moved(-h)) / (2.0 * h);
                    assert!((difference - found.shape[number]).abs() < within, "{number}");
                }
                let tangent = normal.cross(unit(0.3, -0.5, 0.2)).normalised();
                let tilted = |h: f64| value(shape, (normal + tangent.scale(h)).normalised());
                let difference = (tilted(h) - tilted(-h)) / (2.0 * h);
                assert!((difference - found.normal.dot(tangent)).abs() < within, "normal");
            }
        }
        assert!(lit > 100, "{lit}");
    }

    /// The parameters of a shape make the same lobe again, up to single precision.
    fn parameters_make_the_lobe_again<M: LobeEstimation>(model: M, shapes: &[[f64; MAX_SHAPES]]) {
        for [normal, light, view] in scenes() {
            let pair = model.pair(light, view);
            for &shape in shapes {
                let mut parameters = [0.0; MAX_PARAMETERS];
                let shape_32 = shape.map(|number| number as f32);
                model.parameters_from_unknowns(shape_32, &mut parameters[..M::NAMES.len()]);
                let again = model.lobe_from_parameters(parameters.map(f64::from));
                let expected = model.slope(&model.lobe_from_unknowns(shape), &pair, normal);
                let found = model.slope(&again, &pair, normal);
                // Numbers of 6e-8 relative error in an exponent of up to 150.
                assert!((found.value - expected.value).abs() < 1e-4 * (1.0 + expected.value));
                for (a, b) in found.shape.into_iter().zip(expected.shape) {
                    assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn torrance_sparrow() {
        let shapes = [[4.7, 0.0], [2.9, 0.0], [1.2, 0.0]];
        slopes_are_differences(TorranceSparrow { index: 1.45 }, &shapes);
        parameters_make_the_lobe_again(TorranceSparrow { index: 1.45 }, &shapes);
    }
}
