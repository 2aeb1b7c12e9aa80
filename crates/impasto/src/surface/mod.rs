//! What a painting is before anyone fits or lights it.
//!
//! A [`Surface`] is a normal, a diffuse reflectance and a few [`Lobe`]s per pixel, all lobes of one
//! [`Model`]. [`predict()`] says which samples it would show to a rig; [`relight`](crate::relight)
//! makes pictures of it; [`sbrdf`](crate::sbrdf) estimates it. A model is a [`LobeModel`]: value
//! only, what an estimation needs besides is its own affair. [`Sights`] is the one table of lights
//! and views that kernels evaluate models with.

use crate::error::{Error, Result};

mod lafortune;
mod lobe;
mod lobe_model;
mod model;
mod predict;
mod sights;
mod torrance_sparrow;

pub use lafortune::{Lafortune, LightView, TurnedLobe};
pub(crate) use lobe::scaled;
pub use lobe::{Lobe, Parameter, Strength};
pub use lobe_model::{LobeModel, MAX_PARAMETERS};
pub use model::{Model, ModelVisitor};
pub use predict::predict;
pub use sights::Sights;
pub use torrance_sparrow::TorranceSparrow;

/// The maps of a painting whose lobes are of one model.
#[derive(Clone, Debug)]
pub struct Surface<'a> {
    /// Unit normals `(3, y, x)`, NaN where unknown.
    pub normal: &'a [f32],
    /// Diffuse reflectance relative to the white board `(band, y, x)`, or coefficients of spectra;
    /// NaN where unknown.
    pub diffuse: &'a [f32],
    /// What kind of lobes these are.
    pub model: Model,
    /// The lobes, coat upon coat; none for a matte painting.
    pub lobes: Vec<Lobe<'a>>,
    /// `(band, y, x)`: what the surface shows whatever a lamp's direction.
    pub ambient: Option<&'a [f32]>,
}

impl Surface<'_> {
    /// Number of bands, if all maps have the same and as many pixels.
    pub(crate) fn bands(&self, pixels: usize) -> Result<usize> {
        let bands = self.diffuse.len() / pixels.max(1);
        let parameters = self.model.names().len();
        let strong = |lobe: &Lobe<'_>| match lobe.strength {
            Strength::Neutral(number) => number.fits(pixels),
            Strength::Tinted(map) => map.len() == bands * pixels,
        };
        let shaped = |lobe: &Lobe<'_>| {
            lobe.shape.len() == parameters && lobe.shape.iter().all(|n| n.fits(pixels))
        };
        let sizes = [
            ("normal", self.normal.len() == 3 * pixels && pixels > 0),
            ("diffuse", self.diffuse.len() == bands * pixels && bands > 0),
            ("strength of a lobe", self.lobes.iter().all(strong)),
            ("shape of a lobe", self.lobes.iter().all(shaped)),
            ("ambient", self.ambient.is_none_or(|map| map.len() == bands * pixels)),
        ];
        match sizes.iter().find(|(_, fits)| !fits) {
            None => Ok(bands),
            Some((name, _)) => {
                let problem = format!("its size does not fit {pixels} pixels and {bands} bands");
                Err(Error::argument(name, problem))
            }
        }
    }
}
