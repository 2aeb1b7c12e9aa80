//! Geometry becomes colour: one matrix and one vector per illuminant.

use super::block::{BLOCK, Block, Plane};
use crate::math::{Isa, Real};
use crate::scene::Colour;

/// Adds `matrix @ coefficients * diffuse + interface * specular`, and clears both for the next
/// colour.
#[inline(always)]
pub(crate) fn colour<I: Isa>(block: &mut Block, coefficients: &[Plane], colour: &Colour) {
    for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
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
