//! What a model of lobes must answer to be lit.

use core::fmt::Debug;

use super::sight::Sight;
use crate::math::{Real, Scalar, Vec3};

/// Most parameters that a lobe may have.
pub const MAX_PARAMETERS: usize = 3;

/// Smallest and largest values of the parameters of lobes.
pub type Shape = [[f64; 2]; MAX_PARAMETERS];

/// A kind of lobe: what it reflects of a light towards a view.
///
/// Every method must be `#[inline(always)]`: it becomes part of a vector kernel.
pub trait LobeModel: Copy + Debug + Send + Sync {
    /// A light and a view as the model sees them.
    type Pair<R: Real>: Copy + Debug + Send + Sync;
    /// A lobe, ready for many pairs.
    type Lobe<R: Real>: Copy;
    /// What all lobes of a pixel see alike of a pair against the normal.
    type Seen<R: Real>: Copy;
    /// The names of a lobe's parameters, at most [`MAX_PARAMETERS`].
    const NAMES: &'static [&'static str];

    /// A pair of unit vectors that point away from the surface.
    fn pair<R: Real>(&self, light: Vec3<R>, view: Vec3<R>) -> Self::Pair<R>;
    /// The same pair in every lane.
    fn splat<S: Scalar, R: Real>(&self, pair: &Self::Pair<S>) -> Self::Pair<R>;
    /// The view of a pair.
    fn view<R: Real>(&self, pair: &Self::Pair<R>) -> Vec3<R>;
    /// A lobe from its parameters; those beyond [`Self::NAMES`] are ignored.
    fn lobe_from_parameters<R: Real>(&self, parameters: [R; MAX_PARAMETERS]) -> Self::Lobe<R>;
    /// A pair against a normal.
    fn seen<R: Real>(&self, pair: &Self::Pair<R>, normal: Vec3<R>) -> Self::Seen<R>;
    /// Radiance of a lobe of unit strength under unit irradiance, 0 where the surface turns away
    /// from light or view.
    fn shown<R: Real>(&self, lobe: &Self::Lobe<R>, seen: &Self::Seen<R>) -> R;
    /// The same of a pair and a normal.
    #[inline(always)]
    fn value<R: Real>(&self, lobe: &Self::Lobe<R>, pair: &Self::Pair<R>, normal: Vec3<R>) -> R {
        self.shown(lobe, &self.seen(pair, normal))
    }

    /// The same where light comes from directions that scatter about that of the pair by `spread`,
    /// their variance along each axis in radians squared: the lobe is convolved with a Gaussian of that
    /// variance, itself taken for a Gaussian, and keeps its total.
    fn spread_value<R: Real>(
        &self,
        lobe: &Self::Lobe<R>,
        pair: &Self::Pair<R>,
        normal: Vec3<R>,
        spread: R,
    ) -> R;

    /// What a lobe of unit strength reflects in all directions, up to a factor that all lobes share.
    fn total(&self, shape: [f64; MAX_PARAMETERS]) -> f64;
    /// Over which normals a lobe is seen: their variance along each axis, in radians squared.
    fn variance(&self, shape: [f64; MAX_PARAMETERS]) -> f64;
    /// A lobe of another such variance.
    fn widened(&self, shape: [f64; MAX_PARAMETERS], variance: f64) -> [f64; MAX_PARAMETERS];

    /// No pixel shows more than this of a lobe of unit strength under unit irradiance: an upper
    /// bound over all normals, lights, views and parameters of the intervals; it may be 0 only where
    /// the lobe is exactly 0 in single precision.
    fn most(&self, shape: &Shape, sight: &Sight) -> f64;
}
