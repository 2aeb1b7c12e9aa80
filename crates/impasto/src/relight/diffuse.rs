//! The first term of eq. 1 and 9: `(N.L) S(lambda) E(lambda)`, without its colour.

use super::block::{Block, Pixels, lanes};
use super::scene::Lamp;
use crate::geometry::View;
use crate::math::{Isa, Real};
use crate::surface::CoatedDiffuse;

/// Irradiance of a lamp at normal incidence, before anything stands in its light.
#[inline(always)]
pub(crate) fn reach<I: Isa>(block: &mut Block, count: usize, lamp: &Lamp) {
    let intensity = I::F32::of(lamp.intensity);
    if lamp.light.is_distant() {
        for lane in lanes::<I>(count) {
            intensity.store(&mut block.reach[lane..]);
        }
        return;
    }
    for lane in lanes::<I>(count) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let (_, irradiance) = lamp.light.at(x, y);
        (irradiance * intensity).store(&mut block.reach[lane..]);
    }
}

/// What diffuse light crosses on its way to an eye, if anything.
pub(crate) type Interface = Option<(CoatedDiffuse, View)>;

/// Adds the lamp's `(N.L) E`, 0 where the surface turns away, times what an interface transmits.
#[inline(always)]
pub(crate) fn diffuse<I: Isa>(
    block: &mut Block,
    pixels: &Pixels<'_>,
    lamp: &Lamp,
    interface: Interface,
) {
    let zero = I::F32::zero();
    let (distant, _) = lamp.light.at(zero, zero);
    let near = !lamp.light.is_distant();
    for lane in lanes::<I>(pixels.count) {
        let place = || (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let normal = pixels.normal::<I>(lane);
        let direction = if near {
            let (x, y) = place();
            lamp.light.at(x, y).0
        } else {
            distant
        };
        let cosine = normal.dot(direction);
        // A selection, not `max`: a missing normal must stay NaN until the pixel is filled.
        let cosine = match interface {
            None => I::F32::select(cosine.lt(zero), zero, cosine),
            Some((coated, view)) => {
                let (x, y) = place();
                let value = coated.value(normal, direction, view.at(x, y));
                I::F32::select(cosine.le(cosine), value, cosine)
            }
        };
        let sum = I::F32::load(&block.diffuse[lane..]);
        cosine.mul_add(I::F32::load(&block.reach[lane..]), sum).store(&mut block.diffuse[lane..]);
    }
}
