//! A painting's surface as maps: what [`predict`](super::predict()) and [`relight`](crate::relight)
//! light.

use crate::error::{Error, Result};
use crate::math::{Mask, Real, Vec3};

use super::lobes::{LobeModel, MAX_NUMBERS};

/// One number for the whole painting, or a map `(y, x)`.
#[derive(Clone, Copy, Debug)]
pub enum Parameter<'a> {
    /// The same everywhere.
    Everywhere(f32),
    /// One per pixel.
    Map(&'a [f32]),
}

/// How strong a lobe is: 0 where a pixel does not have it, never less.
#[derive(Clone, Copy, Debug)]
pub enum Strength<'a> {
    /// The same in all bands: varnish, or the paint's own surface (`beta` of eq. 1 and 9).
    Neutral(Parameter<'a>),
    /// `(band, y, x)`, with a colour of its own: gilding, metal leaf, bronzing.
    Tinted(&'a [f32]),
}

/// A lobe of every pixel.
#[derive(Clone, Debug)]
pub struct Lobe<'a> {
    /// How strong it is.
    pub strength: Strength<'a>,
    /// The numbers that [`LobeModel::NAMES`] names; of no account where the strength is 0.
    pub shape: Vec<Parameter<'a>>,
}

/// The maps of a painting whose lobes are of one model.
#[derive(Clone, Debug)]
pub struct Surface<'a, M> {
    /// Unit normals `(3, y, x)`, NaN where unknown.
    pub normal: &'a [f32],
    /// Diffuse reflectance relative to the white board `(band, y, x)`, or coefficients of spectra;
    /// NaN where unknown.
    pub diffuse: &'a [f32],
    /// What kind of lobes these are.
    pub model: M,
    /// The lobes, coat upon coat; none for a matte painting.
    pub lobes: Vec<Lobe<'a>>,
    /// `(band, y, x)`: what the surface shows whatever a lamp's direction.
    pub ambient: Option<&'a [f32]>,
}

impl Parameter<'_> {
    fn fits(&self, pixels: usize) -> bool {
        match self {
            Self::Everywhere(_) => true,
            Self::Map(map) => map.len() == pixels,
        }
    }
}

impl<M: LobeModel> Surface<'_, M> {
    /// Number of bands, if all maps have the same and as many pixels.
    pub(crate) fn bands(&self, pixels: usize) -> Result<usize> {
        let bands = self.diffuse.len() / pixels.max(1);
        let strong = |lobe: &Lobe<'_>| match lobe.strength {
            Strength::Neutral(number) => number.fits(pixels),
            Strength::Tinted(map) => map.len() == bands * pixels,
        };
        let shaped = |lobe: &Lobe<'_>| {
            lobe.shape.len() == M::NAMES.len() && lobe.shape.iter().all(|n| n.fits(pixels))
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

/// What a lobe of unit strength and of the shape that the user knows shows under unit irradiance;
/// NaN where the shape is.
#[inline(always)]
pub(crate) fn unit<M: LobeModel, R: Real>(
    model: &M,
    shape: [R; MAX_NUMBERS],
    pair: &M::Pair<R>,
    normal: Vec3<R>,
) -> R {
    let mut known = R::Mask::splat(true);
    for number in &shape[..M::NAMES.len()] {
        known = known & number.le(*number);
    }
    R::select(known, model.value(&model.told(shape), pair, normal), R::of(f64::NAN))
}

/// `strength * unit`, but a lobe that is not there shows nothing, whatever its shape.
#[inline(always)]
pub(crate) fn scaled<R: Real>(strength: R, unit: R) -> R {
    R::select(strength.le(R::zero()), R::zero(), strength * unit)
}
