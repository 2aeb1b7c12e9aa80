//! Lights and views as a model of lobes sees them.

use crate::geometry::Rig;
use crate::math::{Real, Vec3};

use super::model::LobeModel;

/// A rig, and what a model knows of its pairs before any pixel is looked at.
pub(in crate::sbrdf) struct Sight<'a, M: LobeModel> {
    pub(super) model: M,
    rig: &'a Rig,
    pairs: Vec<M::Pair<f64>>,
    /// Normals that would mirror the pairs.
    facing: Vec<Vec3<f64>>,
}

impl<'a, M: LobeModel> Sight<'a, M> {
    pub(in crate::sbrdf) fn new(model: M, rig: &'a Rig) -> Self {
        let pairs: Vec<_> = rig
            .lights()
            .iter()
            .zip(rig.views())
            .map(|(light, &view)| model.pair(light.direction(), view))
            .collect();
        let facing = pairs.iter().map(|pair| model.facing(pair)).collect();
        Self { model, rig, pairs, facing }
    }

    pub(super) fn photographs(&self) -> usize {
        self.pairs.len()
    }

    /// The normal that would mirror a photograph's light into its view.
    pub(super) fn facing(&self, photograph: usize) -> Vec3<f64> {
        self.facing[photograph]
    }

    /// The same for the light as the point `(x, y, 0)` has it.
    pub(super) fn facing_at(&self, photograph: usize, x: f64, y: f64) -> Vec3<f64> {
        if self.rig.lights()[photograph].is_distant() {
            self.facing[photograph]
        } else {
            self.model.facing(&self.at(photograph, x, y).2)
        }
    }

    /// Direction to the light, irradiance and the pair, from the points `(x, y, 0)`.
    #[inline(always)]
    pub(in crate::sbrdf) fn at<R: Real>(
        &self,
        photograph: usize,
        x: R,
        y: R,
    ) -> (Vec3<R>, R, M::Pair<R>) {
        let light = self.rig.lights()[photograph];
        let (towards, irradiance) = light.at(x, y);
        let pair = if light.is_distant() {
            self.model.spread(&self.pairs[photograph])
        } else {
            self.model.pair(towards, self.rig.views()[photograph].splat())
        };
        (towards, irradiance, pair)
    }
}
