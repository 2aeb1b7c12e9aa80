//! Codes of 8 bits by a table over the bits of light, without roots, products or roundings.

use super::block::{BLOCK, Plane, lanes};
use crate::math::lanes::put;
use crate::math::{Isa, Mask, Real};

/// Bits of a number that say where in its cell it lies: a cell is a 128th of an octave.
const WITHIN: u32 = 16;
const FIRST_OF_CELL: u32 = 1 << WITHIN;

/// Light below it is as dark as no light; 24 octaves below white.
const DARKEST: f32 = 5.960_464_5e-8;

/// Entries of a table, one for each upper half of a number. No more than 3073 are read, of which a
/// picture without much darkness needs some hundreds: they stay in the first-level cache.
const CELLS: usize = 1 << 16;

/// A tone curve in codes of 8 bits, which rises by one code at most within a cell.
///
/// The entry of a cell is `2^16 c + 2^16 - t` for a code c that becomes c + 1 at the t-th number of
/// the cell, `2^16 c` where it stays c: the code of light is the upper part of the sum of the entry and
/// the light's place in its cell. So each number has the code that the curve gives it, to the bit.
#[derive(Clone, Debug)]
pub(crate) struct Steps(Box<[u32; CELLS]>);

/// Memory of one worker.
#[derive(Debug)]
pub(crate) struct Entries {
    light: [Plane; 3],
    entry: [Plane; 3],
    word: [u32; BLOCK],
}

impl Default for Entries {
    fn default() -> Self {
        let zero = [[0.0; BLOCK]; 3];
        Self { light: zero, entry: zero, word: [0; BLOCK] }
    }
}

#[inline(always)]
fn cell(light: f32) -> usize {
    (light.to_bits() >> WITHIN) as usize
}

impl Steps {
    /// Of a curve from light in [0, 1] to codes, which never falls; none if it rises by two codes
    /// within a cell, or below all cells.
    pub(crate) fn new(code: impl Fn(f32) -> u32) -> Option<Self> {
        if code(DARKEST) != code(0.0) {
            return None;
        }
        let mut entries: Box<[u32; CELLS]> = vec![0; CELLS].try_into().ok()?;
        let [first, last] = [DARKEST, 1.0_f32].map(|light| light.to_bits() >> WITHIN);
        for number in first..=last {
            let at = |within: u32| code(f32::from_bits((number << WITHIN) + within).min(1.0));
            let (low, high) = (at(0), at(FIRST_OF_CELL - 1));
            let later = match high - low {
                0 => 0,
                1 => {
                    // The last place known to have the lower code, the first to have the higher one.
                    let (mut before, mut step) = (0, FIRST_OF_CELL - 1);
                    while step - before > 1 {
                        let middle = before.midpoint(step);
                        if at(middle) == low {
                            before = middle;
                        } else {
                            step = middle;
                        }
                    }
                    FIRST_OF_CELL - step
                }
                _ => return None,
            };
            entries[number as usize] = (low << WITHIN) + later;
        }
        Some(Self(entries))
    }

    /// Codes of a block of linear light, three per pixel; NaN shows as 0.
    #[inline(always)]
    pub(crate) fn codes<I: Isa>(
        steps: [&Self; 3],
        linear: &[Plane; 3],
        scratch: &mut Entries,
        codes: &mut [u8],
    ) {
        let Entries { light, entry, word } = scratch;
        let count = codes.len() / 3;
        let (darkest, white) = (I::F32::splat(DARKEST), I::F32::one());
        for ((light, linear), (entry, steps)) in
            light.iter_mut().zip(linear).zip(entry.iter_mut().zip(steps))
        {
            for lane in lanes::<I>(count) {
                // NaN becomes dark at `max`.
                let value = I::F32::load(&linear[lane..]).max(darkest).min(white);
                value.store(&mut light[lane..]);
            }
            let table: &[u32; CELLS] = &steps.0;
            let (entries, _) = entry.as_chunks_mut::<8>();
            let (lights, _) = light.as_chunks::<8>();
            for (entries, lights) in entries.iter_mut().zip(lights).take(count.div_ceil(8)) {
                for (entry, &light) in entries.iter_mut().zip(lights) {
                    put(entry, f32::from_bits(table[cell(light)]));
                }
            }
        }
        let code = |channel: usize, pixel: usize| {
            let within = light[channel][pixel].to_bits() & (FIRST_OF_CELL - 1);
            (entry[channel][pixel].to_bits() + within) >> WITHIN
        };
        for (pixel, word) in word.iter_mut().enumerate() {
            *word = code(0, pixel) | code(1, pixel) << 8 | code(2, pixel) << 16;
        }
        I::three_bytes(&word[..count], codes);
    }
}

/// How many of so many values lie below 0 and above 1; what fills their last register lies between.
#[inline(always)]
pub(crate) fn outside<I: Isa>(linear: &Plane, count: usize) -> [u64; 2] {
    let (zero, one) = (I::F32::zero(), I::F32::one());
    let (mut lowest, mut highest) = (zero, one);
    for lane in lanes::<I>(count) {
        let light = I::F32::load(&linear[lane..]);
        // NaN in the first changes nothing.
        (lowest, highest) = (light.min(lowest), light.max(highest));
    }
    let mut found = [0; 2];
    if lowest.lt(zero).any() {
        found[0] = linear[..count].iter().map(|&light| u32::from(light < 0.0)).sum::<u32>().into();
    }
    if highest.gt(one).any() {
        found[1] = linear[..count].iter().map(|&light| u32::from(light > 1.0)).sum::<u32>().into();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gamma(power: f32) -> impl Fn(f32) -> u32 {
        move |light| (255.0 * light.powf(1.0 / power)).round_ties_even() as u32
    }

    fn looked_up(steps: &Steps, light: f32) -> u32 {
        let within = light.to_bits() & (FIRST_OF_CELL - 1);
        (steps.0[cell(light)] + within) >> WITHIN
    }

    #[test]
    fn every_light_has_the_code_of_the_curve() {
        for power in [1.0, 1.8, 2.2, 2.4] {
            let code = gamma(power);
            let steps = Steps::new(&code).unwrap();
            for i in 0..1_000_000 {
                let light = (f64::from(i) / 999_999.0) as f32;
                assert_eq!(looked_up(&steps, light.max(DARKEST)), code(light), "{power} {light}");
            }
            // Around each step number by number.
            for number in 1..256 {
                let step = ((f64::from(number) - 0.5) / 255.0).powf(f64::from(power)) as f32;
                for bits in step.to_bits() - 40..step.to_bits() + 40 {
                    let light = f32::from_bits(bits);
                    assert_eq!(looked_up(&steps, light), code(light), "{power} {number} {light}");
                }
            }
            assert_eq!((looked_up(&steps, DARKEST), looked_up(&steps, 1.0)), (0, 255));
        }
    }

    #[test]
    fn what_is_too_steep_has_no_table() {
        assert!(Steps::new(gamma(5.0)).is_none()); // its first step lies below all cells
        assert!(Steps::new(gamma(0.25)).is_none()); // two codes within a cell at white
        assert!(Steps::new(|light| if light < 0.51 { 0 } else { 255 }).is_none());
    }
}
