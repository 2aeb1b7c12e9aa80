//! The first term of eq. 1 and 9: `(N.L) S(lambda) E(lambda)`, without its colour.

use super::block::Block;
use super::scene::Lamp;
use crate::geometry::View;
use crate::math::{Isa, Real, Vec3};
use crate::surface::CoatedDiffuse;

/// Irradiance of a lamp at normal incidence, before anything stands in its light.
#[inline(always)]
pub(crate) fn reach<I: Isa>(block: &mut Block, lamp: &Lamp) {
    let intensity = I::F32::of(lamp.intensity);
    for lane in (0..block.count).step_by(I::F32::WIDTH) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let (_, irradiance) = lamp.light.at(x, y);
        (irradiance * intensity).store(&mut block.reach[lane..]);
    }
}

/// What diffuse light crosses on its way to an eye, if anything.
pub(crate) type Interface = Option<(CoatedDiffuse, View)>;

/// Adds the lamp's `(N.L) E`, 0 where the surface turns away, times what an interface transmits.
#[inline(always)]
pub(crate) fn diffuse<I: Isa>(block: &mut Block, lamp: &Lamp, interface: Interface) {
    for lane in (0..block.count).step_by(I::F32::WIDTH) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let normal = normal::<I>(block, lane);
        let (direction, _) = lamp.light.at(x, y);
        let cosine = normal.dot(direction);
        // A selection, not `max`: a missing normal must stay NaN until the pixel is filled.
        let cosine = match interface {
            None => I::F32::select(cosine.lt(I::F32::zero()), I::F32::zero(), cosine),
            Some((coated, view)) => {
                let value = coated.value(normal, direction, view.at(x, y));
                I::F32::select(cosine.le(cosine), value, cosine)
            }
        };
        let sum = I::F32::load(&block.diffuse[lane..]);
        cosine.mul_add(I::F32::load(&block.reach[lane..]), sum).store(&mut block.diffuse[lane..]);
    }
}

#[inline(always)]
pub(crate) fn normal<I: Isa>(block: &Block, lane: usize) -> Vec3<I::F32> {
    let [x, y, z] = &block.normal;
    Vec3::new(I::F32::load(&x[lane..]), I::F32::load(&y[lane..]), I::F32::load(&z[lane..]))
}
