//! What a model of lobes must answer.

use crate::math::{Real, Vec3};

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

/// A kind of lobe: where its highlight is, how it falls off, and where a search may start.
///
/// Every method must be `#[inline(always)]`: it becomes part of a vector kernel.
pub trait LobeModel: Copy + Send + Sync {
    /// A light and a view as the model sees them.
    type Pair<R: Real>: Copy + Send + Sync;
    /// A shape, ready for many pairs.
    type Lobe<R: Real>: Copy;
    /// How many numbers a shape has, at most [`MAX_SHAPES`].
    const SHAPES: usize;
    /// What the user calls the numbers of [`Self::report`].
    const NAMES: &'static [&'static str];

    /// A pair of unit vectors that point away from the surface.
    fn pair<R: Real>(&self, light: Vec3<R>, view: Vec3<R>) -> Self::Pair<R>;
    /// The same pair in every lane.
    fn spread<R: Real>(&self, pair: &Self::Pair<f64>) -> Self::Pair<R>;
    /// The normal that would mirror the light into the view.
    fn facing(&self, pair: &Self::Pair<f64>) -> Vec3<f64>;
    /// A lobe from its shape.
    fn lobe<R: Real>(&self, shape: [R; MAX_SHAPES]) -> Self::Lobe<R>;
    /// Radiance of a lobe of unit strength.
    fn value<R: Real>(&self, lobe: &Self::Lobe<R>, pair: &Self::Pair<R>, normal: Vec3<R>) -> R;
    /// The same with its derivatives.
    fn slope<R: Real>(
        &self,
        lobe: &Self::Lobe<R>,
        pair: &Self::Pair<R>,
        normal: Vec3<R>,
    ) -> Slope<R>;
    /// Smallest and largest shape.
    fn bounds(&self) -> [[f64; MAX_SHAPES]; 2];
    /// Shapes to start from.
    fn starts(&self) -> &'static [[f64; MAX_SHAPES]];
    /// How far shapes usually lie from what is typical of a painting.
    fn spreads(&self) -> [f64; MAX_SHAPES];
    /// Lobes are numbered by this, largest first.
    fn order(&self, shape: [f32; MAX_SHAPES]) -> f32;
    /// The numbers that the user is told, as many as there are [`Self::NAMES`].
    fn report(&self, shape: [f32; MAX_SHAPES], numbers: &mut [f32]);
    /// Calls `visit` with so many lobes as constants.
    fn dispatch<V: Visit>(lobes: usize, visit: V) -> V::Output;
}

/// Something to do for a number of lobes that the compiler knows.
pub trait Visit {
    /// What it returns.
    type Output;
    /// `J` lobes, `K = J + 2` columns (diffuse, lobes, ambient), `N = 2 + J SHAPES` unknowns.
    fn visit<const J: usize, const K: usize, const N: usize>(self) -> Self::Output;
}
