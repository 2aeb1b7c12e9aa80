//! Geometry becomes colour: one matrix and one vector per illuminant.

use super::block::{BLOCK, Block, Pixels, Plane, copied, lanes};
use super::scene::{Colour, Lamp};
use crate::math::{Isa, Real};
use crate::surface::scaled;

/// Adds `matrix @ coefficients * diffuse + interface * specular`, and clears both for the next
/// colour.
#[inline(always)]
pub(crate) fn colour<I: Isa>(block: &mut Block, pixels: &Pixels<'_>, colour: &Colour) {
    // A matrix of a size that the compiler knows stays in registers.
    match (pixels.coefficients, &colour.diffuse[..]) {
        ([a, b, c], [one, two, three]) => {
            add::<I>(block, &[*a, *b, *c], &[*one, *two, *three], colour.interface, pixels.count);
        }
        (planes, columns) => add::<I>(block, planes, columns, colour.interface, pixels.count),
    }
}

#[inline(always)]
fn add<'a, I: Isa>(
    block: &mut Block,
    planes: &(impl AsRef<[&'a Plane]> + ?Sized),
    columns: &(impl AsRef<[[f64; 3]]> + ?Sized),
    interface: [f64; 3],
    count: usize,
) {
    let zero = I::F32::zero();
    let dark = block.was_dark();
    let Block { diffuse, specular, light, shiny, .. } = block;
    let shiny = core::mem::take(shiny);
    for lane in lanes::<I>(count) {
        let mut reflected = [zero; 3];
        for (plane, column) in planes.as_ref().iter().zip(columns.as_ref()) {
            let value = I::F32::load(&plane[lane..]);
            for (sum, &weight) in reflected.iter_mut().zip(column) {
                *sum = value.mul_add(I::F32::of(weight), *sum);
            }
        }
        let geometry = I::F32::load(&diffuse[lane..]);
        zero.store(&mut diffuse[lane..]);
        let gloss = if shiny {
            let gloss = I::F32::load(&specular[lane..]);
            zero.store(&mut specular[lane..]);
            gloss
        } else {
            zero
        };
        for ((reflected, light), weight) in
            reflected.into_iter().zip(light.iter_mut()).zip(interface)
        {
            let sum = if dark { zero } else { I::F32::load(&light[lane..]) };
            let sum = reflected.mul_add(geometry, sum);
            gloss.mul_add(I::F32::of(weight), sum).store(&mut light[lane..]);
        }
    }
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
    block.lighten();
    let pixels = coefficients.len() / colour.diffuse.len();
    let mut plane = [0.0; BLOCK];
    for (number, column) in colour.diffuse.iter().enumerate() {
        copied(coefficients, number * pixels + start, count, &mut plane);
        for lane in lanes::<I>(count) {
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
