//! The second term of eq. 1 and 9: interface reflection, without its colour, and with one.

use super::area::Source;
use super::block::{BLOCK, Block, Pixels, Plane, lanes};
use super::colour::shine;
use super::scene::Colour;
use crate::math::{Isa, Real};
use crate::surface::{Lobe, LobeModel, Pairs, Parameter, Strength, scaled};

/// Adds what lobes reflect of the lamp: to the light that has the lamp's colour, or, coloured as the
/// strengths of a lobe are, to the light of all colours.
#[inline(always)]
pub(crate) fn specular<'a, I: Isa, M: LobeModel>(
    block: &mut Block,
    pixels: &Pixels<'_>,
    pairs: &Pairs<M, f32>,
    source: &Source,
    lobes: impl Iterator<Item = &'a Lobe<'a>> + Clone,
    colour: &Colour,
) {
    let neutral = lobes.clone().filter_map(|lobe| match lobe.strength {
        Strength::Neutral(strength) => Some((lobe, strength)),
        Strength::Tinted(_) => None,
    });
    if neutral.clone().next().is_some() {
        block.shiny = true;
        if source.pairs.len() == 1 {
            of_point::<I, M>(block, pixels, pairs, source.pairs.start, &neutral);
        } else {
            for (lobe, strength) in neutral {
                let value = spread_out::<I, M>(block, pixels, pairs, source, lobe);
                for lane in lanes::<I>(pixels.count) {
                    let sum = I::F32::load(&block.specular[lane..]);
                    let value = I::F32::load(&value[lane..]);
                    let sum = sum + scaled(strength.at(pixels.start + lane), value);
                    sum.store(&mut block.specular[lane..]);
                }
            }
        }
    }
    for lobe in lobes {
        if let Strength::Tinted(strengths) = lobe.strength {
            let value = if source.pairs.len() == 1 {
                alone::<I, M>(block, pixels, pairs, source.pairs.start, lobe)
            } else {
                spread_out::<I, M>(block, pixels, pairs, source, lobe)
            };
            shine::<I>(block, &value, strengths, colour, (pixels.start, pixels.count));
        }
    }
}

/// Adds what lobes reflect of a lamp without a size: what they see alike is computed once.
#[inline(always)]
fn of_point<'a, I: Isa, M: LobeModel>(
    block: &mut Block,
    pixels: &Pixels<'_>,
    pairs: &Pairs<M, f32>,
    lamp: usize,
    lobes: &(impl Iterator<Item = (&'a Lobe<'a>, Parameter<'a>)> + Clone),
) {
    let Block { x, y, reach, specular, .. } = block;
    let zero = I::F32::zero();
    let (near, (_, _, distant)) = (!pairs.is_distant(lamp), pairs.at(lamp, zero, zero));
    for lane in lanes::<I>(pixels.count) {
        let pair = if near {
            pairs.at(lamp, I::F32::load(&x[lane..]), I::F32::load(&y[lane..])).2
        } else {
            distant
        };
        let seen = pairs.model.seen(&pair, pixels.normal::<I>(lane));
        let reach = I::F32::load(&reach[lane..]);
        let mut sum = I::F32::load(&specular[lane..]);
        for (lobe, strength) in lobes.clone() {
            let pixel = pixels.start + lane;
            let value = lobe.shown(&pairs.model, pixel, &seen) * reach;
            sum = sum + scaled(strength.at(pixel), value);
        }
        sum.store(&mut specular[lane..]);
    }
}

/// What one lobe reflects of a lamp without a size, at unit strength.
#[inline(always)]
fn alone<I: Isa, M: LobeModel>(
    block: &Block,
    pixels: &Pixels<'_>,
    pairs: &Pairs<M, f32>,
    lamp: usize,
    lobe: &Lobe<'_>,
) -> Plane {
    let mut value: Plane = [0.0; BLOCK];
    for lane in lanes::<I>(pixels.count) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let (_, _, pair) = pairs.at(lamp, x, y);
        let normal = pixels.normal::<I>(lane);
        let shown = lobe.value(&pairs.model, pixels.start + lane, &pair, normal);
        (shown * I::F32::load(&block.reach[lane..])).store(&mut value[lane..]);
    }
    value
}

/// What one lobe reflects of all points of a lamp with a size, at unit strength.
#[inline(always)]
fn spread_out<I: Isa, M: LobeModel>(
    block: &Block,
    pixels: &Pixels<'_>,
    pairs: &Pairs<M, f32>,
    source: &Source,
    lobe: &Lobe<'_>,
) -> Plane {
    let mut value: Plane = [0.0; BLOCK];
    let (share, spread) = (1.0 / source.pairs.len() as f64, I::F32::splat(source.spread));
    for lane in lanes::<I>(pixels.count) {
        let (x, y) = (I::F32::load(&block.x[lane..]), I::F32::load(&block.y[lane..]));
        let normal = pixels.normal::<I>(lane);
        let mut shown = I::F32::zero();
        for point in source.pairs.clone() {
            let (_, _, pair) = pairs.at(point, x, y);
            let seen = (&pair, spread);
            shown = shown + lobe.spread_value(&pairs.model, pixels.start + lane, seen, normal);
        }
        let reach = I::F32::load(&block.reach[lane..]) * I::F32::of(share);
        (shown * reach).store(&mut value[lane..]);
    }
    value
}
