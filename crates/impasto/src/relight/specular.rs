//! The second term of eq. 1 and 9: interface reflection, without its colour, and with one.

use super::area::Source;
use super::block::{BLOCK, Block, Plane};
use super::colour::shine;
use super::diffuse::normal;
use super::scene::Colour;
use crate::math::{Isa, Real};
use crate::surface::{Lobe, LobeModel, Pairs, Strength, scaled};

/// Adds what one lobe reflects of the lamp: to the light that has the lamp's colour, or, coloured
/// as the lobe's strengths are, to the light of all colours.
#[inline(always)]
pub(crate) fn specular<I: Isa, M: LobeModel>(
    block: &mut Block,
    pairs: &Pairs<M, f32>,
    (source, lobe): (&Source, &Lobe<'_>),
    colour: &Colour,
    (start, count): (usize, usize),
) {
    let mut value: Plane = [0.0; BLOCK];
    if source.pairs.len() == 1 {
        let lamp = source.pairs.start;
        let near = !pairs.is_distant(lamp);
        let (_, _, mut pair) = pairs.at(lamp, I::F32::zero(), I::F32::zero());
        for lane in (0..count).step_by(I::F32::WIDTH) {
            if near {
                let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
                (_, _, pair) = pairs.at(lamp, x, y);
            }
            let shown = lobe.value(&pairs.model, start + lane, &pair, normal::<I>(block, lane));
            (shown * I::F32::load(&block.reach[lane..])).store(&mut value[lane..]);
        }
    } else {
        let (share, spread) = (1.0 / source.pairs.len() as f64, I::F32::splat(source.spread));
        for lane in (0..count).step_by(I::F32::WIDTH) {
            let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
            let normal = normal::<I>(block, lane);
            let mut shown = I::F32::zero();
            for point in source.pairs.clone() {
                let (_, _, pair) = pairs.at(point, x, y);
                let seen = (&pair, spread);
                shown = shown + lobe.spread_value(&pairs.model, start + lane, seen, normal);
            }
            let reach = I::F32::load(&block.reach[lane..]) * I::F32::of(share);
            (shown * reach).store(&mut value[lane..]);
        }
    }
    match lobe.strength {
        Strength::Tinted(strengths) => {
            shine::<I>(block, &value, strengths, colour, (start, count));
        }
        Strength::Neutral(strength) => {
            for lane in (0..count).step_by(I::F32::WIDTH) {
                let value = I::F32::load(&value[lane..]);
                let sum = I::F32::load(&block.specular[lane..]);
                let sum = sum + scaled(strength.at(start + lane), value);
                sum.store(&mut block.specular[lane..]);
            }
        }
    }
}
