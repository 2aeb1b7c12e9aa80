//! The second term of eq. 1 and 9: interface reflection, without its colour, and with one.

use super::block::{BLOCK, Block, Plane, copied};
use super::colour::shine;
use super::diffuse::normal;
use crate::math::{Isa, Real, Vec3};
use crate::sbrdf::{Lobe, LobeModel, MAX_NUMBERS, Parameter, Strength, scaled, unit};
use crate::scene::{Colour, Lamp};

/// Adds what one lobe reflects of the lamp: to the light that has the lamp's colour, or, coloured
/// as the lobe's strengths are, to the light of all colours.
#[inline(always)]
pub(crate) fn specular<I: Isa, M: LobeModel>(
    block: &mut Block,
    lamp: &Lamp,
    (model, lobe): (&M, &Lobe<'_>),
    colour: &Colour,
    view: Vec3<f64>,
    (start, count): (usize, usize),
) {
    let mut shape = [[0.0; BLOCK]; MAX_NUMBERS];
    for (plane, &number) in shape.iter_mut().zip(&lobe.shape) {
        parameter(number, start, count, plane);
    }
    let view = view.splat::<I::F32>();
    let mut value = [0.0; BLOCK];
    for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let (direction, _) = lamp.light.at(x, y);
        let numbers = shape.each_ref().map(|plane| I::F32::load(&plane[lane..]));
        let shown = unit(model, numbers, &model.pair(direction, view), normal::<I>(block, lane));
        (shown * I::F32::load(&block.reach[lane..])).store(&mut value[lane..]);
    }
    match lobe.strength {
        Strength::Tinted(strengths) => {
            shine::<I>(block, &value, strengths, colour, (start, count));
        }
        Strength::Neutral(strength) => {
            let mut strengths = [0.0; BLOCK];
            parameter(strength, start, count, &mut strengths);
            for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
                let at = |plane: &Plane| I::F32::load(&plane[lane..]);
                let sum = at(&block.specular) + scaled(at(&strengths), at(&value));
                sum.store(&mut block.specular[lane..]);
            }
        }
    }
}

#[inline(always)]
fn parameter(parameter: Parameter<'_>, start: usize, count: usize, out: &mut Plane) {
    match parameter {
        Parameter::Everywhere(value) => out.fill(value),
        Parameter::Map(map) => copied(map, start, count, out),
    }
}
