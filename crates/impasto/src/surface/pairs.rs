//! Lights and views as a model of lobes evaluates them: one table for every kernel.

use crate::geometry::{Light, Rig, View};
use crate::math::{Real, Scalar, Vec3};

use super::lobe_model::LobeModel;

/// Pairs of a light and a view, each near or distant.
///
/// What a model derives from a pair that is the same for all pixels is computed once, in the
/// precision `S`; what differs from pixel to pixel is computed in the lanes.
#[derive(Debug)]
pub struct Pairs<M: LobeModel, S: Scalar = f64> {
    /// What evaluates the pairs.
    pub model: M,
    seen: Vec<Entry<M, S>>,
}

#[derive(Debug)]
struct Entry<M: LobeModel, S: Scalar> {
    light: Light,
    view: View,
    /// Seen from the middle of the painting.
    middle: M::Pair<S>,
}

impl<M: LobeModel, S: Scalar> Pairs<M, S> {
    /// The pairs of a rig's observations.
    pub fn of_rig(model: M, rig: &Rig) -> Self {
        Self::new(model, rig.lights().iter().copied().zip(rig.views().iter().copied()))
    }

    /// These pairs.
    pub fn new(model: M, pairs: impl IntoIterator<Item = (Light, View)>) -> Self {
        let zero = S::zero();
        let pair_of = |(light, view): (Light, View)| {
            let middle = model.pair(light.at(zero, zero).0, view.at(zero, zero));
            Entry { light, view, middle }
        };
        Self { model, seen: pairs.into_iter().map(pair_of).collect() }
    }

    /// These pairs, computed in double precision and rounded to `S`.
    pub fn rounded(model: M, pairs: impl IntoIterator<Item = (Light, View)>) -> Self {
        let Pairs { model, seen } = Pairs::<M>::new(model, pairs);
        let round = |Entry { light, view, middle }: Entry<M, f64>| Entry {
            light,
            view,
            middle: model.splat(&middle),
        };
        Self { model, seen: seen.into_iter().map(round).collect() }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.seen.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.seen.is_empty()
    }

    /// Whether a pair is the same from every pixel.
    #[must_use]
    #[inline(always)]
    pub fn is_distant(&self, index: usize) -> bool {
        let Entry { light, view, .. } = &self.seen[index];
        light.is_distant() && view.is_distant()
    }

    /// A pair seen from the middle of the painting.
    #[must_use]
    pub fn middle(&self, index: usize) -> &M::Pair<S> {
        &self.seen[index].middle
    }

    /// Unit direction to the light and its irradiance at normal incidence, from the points
    /// `(x, y, 0)` in mm.
    #[must_use]
    #[inline(always)]
    pub fn light<R: Real>(&self, index: usize, x: R, y: R) -> (Vec3<R>, R) {
        self.seen[index].light.at(x, y)
    }

    /// Unit directions to the light and to the camera, from the points `(x, y, 0)` in mm.
    #[must_use]
    #[inline(always)]
    pub fn directions<R: Real>(&self, index: usize, x: R, y: R) -> [Vec3<R>; 2] {
        let Entry { light, view, .. } = &self.seen[index];
        [light.at(x, y).0, view.at(x, y)]
    }

    /// Direction to the light, its irradiance, and the pair of light and view.
    #[must_use]
    #[inline(always)]
    pub fn at<R: Real>(&self, index: usize, x: R, y: R) -> (Vec3<R>, R, M::Pair<R>) {
        let Entry { light, view, middle } = &self.seen[index];
        let (towards, irradiance) = light.at(x, y);
        let pair = if light.is_distant() && view.is_distant() {
            self.model.splat(middle)
        } else {
            self.model.pair(towards, view.at(x, y))
        };
        (towards, irradiance, pair)
    }
}
