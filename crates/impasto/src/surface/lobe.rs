//! One lobe of every pixel: its strength, its parameters, and what it reflects.
//!
//! The second term of eq. 1 of the six-band paper, of eq. 9 of the RGB-camera paper and of eq. 3 of
//! the third is evaluated here and nowhere else, for [`predict`](super::predict()) and for the
//! renderer.

use crate::math::tail::load;
use crate::math::{Mask, Real, Vec3};

use super::lobe_model::{LobeModel, MAX_PARAMETERS};

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
    /// The parameters that [`LobeModel::NAMES`] names; they do not matter where the strength is 0.
    pub shape: Vec<Parameter<'a>>,
}

impl Parameter<'_> {
    /// Whether it covers so many pixels.
    pub(super) fn fits(&self, pixels: usize) -> bool {
        match self {
            Self::Everywhere(_) => true,
            Self::Map(map) => map.len() == pixels,
        }
    }

    /// Its values from `pixel` on; lanes beyond the end of a map repeat its last value.
    #[inline(always)]
    pub(crate) fn at<R: Real<Scalar = f32>>(&self, pixel: usize) -> R {
        match self {
            Self::Everywhere(value) => R::splat(*value),
            Self::Map(map) => load(map, pixel),
        }
    }
}

impl Lobe<'_> {
    /// What the lobe would show at unit strength under unit irradiance in the pixels from `pixel`
    /// on; NaN where a parameter is.
    #[inline(always)]
    pub(crate) fn value<M: LobeModel, R: Real<Scalar = f32>>(
        &self,
        model: &M,
        pixel: usize,
        pair: &M::Pair<R>,
        normal: Vec3<R>,
    ) -> R {
        self.shown(model, pixel, &model.seen(pair, normal))
    }

    /// The same of what all lobes of these pixels see alike.
    #[inline(always)]
    pub(crate) fn shown<M: LobeModel, R: Real<Scalar = f32>>(
        &self,
        model: &M,
        pixel: usize,
        seen: &M::Seen<R>,
    ) -> R {
        let (lobe, known) = self.shaped(model, pixel);
        R::select(known, model.shown(&lobe, seen), R::of(f64::NAN))
    }

    /// The same where light scatters, as of [`LobeModel::spread_value`].
    #[inline(always)]
    pub(crate) fn spread_value<M: LobeModel, R: Real<Scalar = f32>>(
        &self,
        model: &M,
        pixel: usize,
        (pair, spread): (&M::Pair<R>, R),
        normal: Vec3<R>,
    ) -> R {
        let (lobe, known) = self.shaped(model, pixel);
        let value = model.spread_value(&lobe, pair, normal, spread);
        R::select(known, value, R::of(f64::NAN))
    }

    /// The lobe of the pixels from `pixel` on, and whether all of its parameters are numbers.
    #[inline(always)]
    fn shaped<M: LobeModel, R: Real<Scalar = f32>>(
        &self,
        model: &M,
        pixel: usize,
    ) -> (M::Lobe<R>, R::Mask) {
        let mut parameters = [R::zero(); MAX_PARAMETERS];
        let mut known = R::Mask::splat(true);
        for (value, parameter) in parameters.iter_mut().zip(&self.shape) {
            *value = parameter.at(pixel);
            known = known & value.le(*value);
        }
        (model.lobe_from_parameters(parameters), known)
    }
}

/// `strength * value`, but a lobe that is not there shows nothing, whatever its parameters.
///
/// Strengths of bands are never negative; coefficients of their spectra may be.
#[inline(always)]
pub(crate) fn scaled<R: Real>(strength: R, value: R) -> R {
    R::select(strength.abs().le(R::zero()), R::zero(), strength * value)
}
