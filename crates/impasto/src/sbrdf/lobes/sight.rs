//! Lights and views of the photographs, and the normals that would mirror one into the other.

use crate::geometry::Rig;
use crate::math::{Real, Vec3};
use crate::surface::Sights;

use super::model::LobeEstimation;

/// The table of lights and views, and what an estimation derives from it before any pixel is read.
pub(in crate::sbrdf) struct Sight<M: LobeEstimation> {
    pub(super) model: M,
    table: Sights<M>,
    /// Normals that would mirror the pairs.
    facing: Vec<Vec3<f64>>,
}

impl<M: LobeEstimation> Sight<M> {
    pub(in crate::sbrdf) fn new(model: M, rig: &Rig) -> Self {
        let table = Sights::of_rig(model, rig);
        let facing = (0..table.len()).map(|pair| model.facing(table.middle(pair))).collect();
        Self { model, table, facing }
    }

    pub(super) fn photographs(&self) -> usize {
        self.table.len()
    }

    /// The normal that would mirror a photograph's light into its view.
    pub(super) fn facing(&self, photograph: usize) -> Vec3<f64> {
        self.facing[photograph]
    }

    /// The same for light and view as the point `(x, y, 0)` has them.
    pub(super) fn facing_at(&self, photograph: usize, x: f64, y: f64) -> Vec3<f64> {
        if self.table.is_distant(photograph) {
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
        self.table.at(photograph, x, y)
    }
}
