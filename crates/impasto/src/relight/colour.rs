//! Geometry becomes colour: one matrix and one vector per illuminant.

use super::block::{BLOCK, Block, Plane, copied};
use super::scene::{Colour, Lamp};
use crate::math::{Isa, Real};
use crate::surface::scaled;

/// Adds `matrix @ coefficients * diffuse + interface * specular`, and clears both for the next
/// colour.
#[inline(always)]
pub(crate) fn colour<I: Isa>(block: &mut Block, coefficients: &[Plane], colour: &Colour) {
    for lane in (0..block.count).step_by(I::F32::WIDTH) {
        let diffuse = I::F32::load(&block.diffuse[lane..]);
        let specular = I::F32::load(&block.specular[lane..]);
        for channel in 0..3 {
            let mut reflected = I::F32::zero();
            for (plane, column) in coefficients.iter().zip(&colour.diffuse) {
                let weight = I::F32::of(column[channel]);
                reflected = I::F32::load(&plane[lane..]).mul_add(weight, reflected);
            }
            let sum = I::F32::load(&block.light[channel][lane..]);
            let sum = reflected.mul_add(diffuse, sum);
            let sum = specular.mul_add(I::F32::of(colour.interface[channel]), sum);
            sum.store(&mut block.light[channel][lane..]);
        }
    }
    block.diffuse.fill(0.0);
    block.specular.fill(0.0);
}

/// Adds `matrix @ coefficients * value`, coefficients `(k, y, x)`; where one is 0, whatever the
/// value.
#[inline(always)]
pub(crate) fn shine<I: Isa>(
    block: &mut Block,
    value: &Plane,
    coefficients: &[f32],
    colour: &Colour,
    (start, count): (usize, usize),
) {
    let pixels = coefficients.len() / colour.diffuse.len();
    let mut plane = [0.0; BLOCK];
    for (number, column) in colour.diffuse.iter().enumerate() {
        copied(coefficients, number * pixels + start, count, &mut plane);
        for lane in (0..block.count).step_by(I::F32::WIDTH) {
            let shown = scaled(I::F32::load(&plane[lane..]), I::F32::load(&value[lane..]));
            for (light, &weight) in block.light.iter_mut().zip(column) {
                let sum = I::F32::load(&light[lane..]);
                shown.mul_add(I::F32::of(weight), sum).store(&mut light[lane..]);
            }
        }
    }
}

/// Adds what the surface shows whatever the lamp's direction.
#[inline(always)]
pub(crate) fn ambient<I: Isa>(
    block: &mut Block,
    lamp: &Lamp,
    coefficients: &[f32],
    colour: &Colour,
    range: (usize, usize),
) {
    shine::<I>(block, &[lamp.intensity as f32; BLOCK], coefficients, colour, range);
}
