//! Lights and views of the photographs, and the normals that would mirror one into the other.

use crate::brdf::coated_diffuse::{CoatedDiffuse, Slope};
use crate::geometry::Rig;
use crate::math::{Real, Vec3};
use crate::sbrdf::neighbouring_lights::NeighbouringLights;
use crate::surface::Pairs;

use super::model::LobeEstimation;

/// The table of lights and views, and what an estimation derives from it before any pixel is read.
pub(in crate::sbrdf) struct Photographs<M: LobeEstimation> {
    pub(super) model: M,
    pairs: Pairs<M>,
    /// Normals that would mirror the pairs.
    facing: Vec<Vec3<f64>>,
    pub(super) neighbours: NeighbouringLights,
    /// What diffuse light crosses.
    coated: Option<CoatedDiffuse>,
}

impl<M: LobeEstimation> Photographs<M> {
    pub(in crate::sbrdf) fn new(model: M, rig: &Rig, coated: Option<CoatedDiffuse>) -> Self {
        let pairs = Pairs::of_rig(model, rig);
        let facing = (0..pairs.len()).map(|index| model.facing(pairs.middle(index))).collect();
        Self { model, pairs, facing, neighbours: NeighbouringLights::new(rig), coated }
    }

    pub(super) fn len(&self) -> usize {
        self.pairs.len()
    }

    /// The normal that would mirror a photograph's light into its view, as the point `(x, y, 0)` has
    /// them.
    #[inline(always)]
    pub(super) fn facing_at<R: Real>(&self, photograph: usize, x: R, y: R) -> Vec3<R> {
        if self.pairs.is_distant(photograph) {
            self.facing[photograph].splat()
        } else {
            self.model.facing(&self.at(photograph, x, y).2)
        }
    }

    /// The irradiance of a photograph's light at normal incidence, at the points `(x, y, 0)`.
    #[inline(always)]
    pub(super) fn irradiance<R: Real>(&self, photograph: usize, x: R, y: R) -> R {
        self.pairs.light(photograph, x, y).1
    }

    /// Unit directions to the light and to the camera, from the points `(x, y, 0)`.
    #[inline(always)]
    pub(super) fn directions<R: Real>(&self, photograph: usize, x: R, y: R) -> [Vec3<R>; 2] {
        self.pairs.directions(photograph, x, y)
    }

    /// Direction to the light, irradiance and the pair, from the points `(x, y, 0)`.
    #[inline(always)]
    pub(in crate::sbrdf) fn at<R: Real>(
        &self,
        photograph: usize,
        x: R,
        y: R,
    ) -> (Vec3<R>, R, M::Pair<R>) {
        self.pairs.at(photograph, x, y)
    }

    /// The diffuse term of reflectance 1 under unit irradiance from `towards`, in front of the
    /// surface, and its derivative by the normal.
    #[inline(always)]
    pub(super) fn diffuse<R: Real>(
        &self,
        normal: Vec3<R>,
        towards: Vec3<R>,
        pair: &M::Pair<R>,
    ) -> Slope<R> {
        match &self.coated {
            None => Slope { value: normal.dot(towards), normal: towards },
            Some(coated) => coated.slope(normal, towards, self.model.view(pair)),
        }
    }
}
