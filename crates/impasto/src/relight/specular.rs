//! The second term of eq. 1 and 9: interface reflection, without its colour, and with one.

use super::block::{BLOCK, Block, Plane, copied};
use super::colour::shine;
use super::diffuse::normal;
use super::{Coat, Parameter, Tinted};
use crate::brdf::torrance_sparrow::{Facet, sharpness};
use crate::math::{Isa, Real, Vec3};
use crate::scene::{Colour, Lamp};

/// Adds the lamp's `beta D F G / (N.V) E` of one coat.
#[inline(always)]
pub(crate) fn specular<I: Isa>(
    block: &mut Block,
    lamp: &Lamp,
    coat: &Coat<'_>,
    view: Vec3<f64>,
    (start, count): (usize, usize),
) {
    let (mut beta, mut gamma) = ([0.0; BLOCK], [0.0; BLOCK]);
    parameter(coat.beta, start, count, &mut beta);
    parameter(coat.gamma, start, count, &mut gamma);
    let (view, index) = (view.splat::<I::F32>(), I::F32::of(coat.index));
    for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let (direction, _) = lamp.light.at(x, y);
        let glint = Facet::between(direction, view, index).on(normal::<I>(block, lane));
        let (beta, gamma) = (I::F32::load(&beta[lane..]), I::F32::load(&gamma[lane..]));
        let value = glint.value(beta, sharpness(gamma));
        // An unknown gamma of a coat that is there must stay unknown; `sharpness` bounds it.
        let known = gamma.le(gamma) | beta.le(I::F32::zero());
        let value = I::F32::select(known, value, gamma);
        let sum = I::F32::load(&block.specular[lane..]);
        value.mul_add(I::F32::load(&block.reach[lane..]), sum).store(&mut block.specular[lane..]);
    }
}

/// Adds the lamp's `D F G / (N.V) E` of one tinted lobe, coloured as its strengths are.
#[inline(always)]
pub(crate) fn tinted<I: Isa>(
    block: &mut Block,
    lamp: &Lamp,
    lobe: &Tinted<'_>,
    colour: &Colour,
    view: Vec3<f64>,
    (start, count): (usize, usize),
) {
    let (mut gamma, mut value) = ([0.0; BLOCK], [0.0; BLOCK]);
    parameter(lobe.gamma, start, count, &mut gamma);
    let (view, index) = (view.splat::<I::F32>(), I::F32::of(lobe.index));
    for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let (direction, _) = lamp.light.at(x, y);
        let glint = Facet::between(direction, view, index).on(normal::<I>(block, lane));
        // Where there is no lobe its gamma is NaN and `sharpness` gives some number: times 0.
        let shown = glint.value(I::F32::one(), sharpness(I::F32::load(&gamma[lane..])));
        (shown * I::F32::load(&block.reach[lane..])).store(&mut value[lane..]);
    }
    shine::<I>(block, &value, lobe.strength, colour, (start, count));
}

#[inline(always)]
fn parameter(parameter: Parameter<'_>, start: usize, count: usize, out: &mut Plane) {
    match parameter {
        Parameter::Everywhere(value) => out.fill(value),
        Parameter::Map(map) => copied(map, start, count, out),
    }
}
