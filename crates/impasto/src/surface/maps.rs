//! The maps of a whole painting.

use crate::brdf::coated_diffuse::CoatedDiffuse;
use crate::error::{Error, Result};

use super::lobe::{Lobe, Strength};
use super::model::Model;

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
    /// The smooth interface that diffuse light crosses, where there is one.
    pub coated: Option<CoatedDiffuse>,
}

impl Surface<'_> {
    /// Number of bands, if all maps have the same and as many pixels.
    ///
    /// # Errors
    /// If a map's size does not fit.
    pub fn bands(&self, pixels: usize) -> Result<usize> {
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
