//! Which pixels see a lamp, as bits: the maps of all lamps are needed together, and a bit is a
//! thirty-second of a number.

use super::block::{BLOCK, Block};
use crate::error::Result;
use crate::pixels::{Run, TILE};

/// Pixels of a word.
const WORD: usize = 64;

// Blocks and tiles begin with a word.
const _: () = assert!(BLOCK.is_multiple_of(WORD) && TILE.is_multiple_of(WORD));

/// One bit per pixel, set where the lamp is seen.
#[derive(Debug)]
pub(crate) struct Visible(Vec<u64>);

impl Visible {
    /// From 1 and 0 per pixel.
    pub(crate) fn new(map: &[f32], run: &Run<'_>) -> Result<Self> {
        let mut words = vec![0; map.len().div_ceil(WORD)];
        let tiles = words.chunks_mut(TILE / WORD).zip(map.chunks(TILE)).collect();
        run.for_each(
            tiles,
            || (),
            |(), (words, map): (&mut [u64], &[f32])| {
                for (word, pixels) in words.iter_mut().zip(map.chunks(WORD)) {
                    for (place, &seen) in pixels.iter().enumerate() {
                        *word |= u64::from(seen > 0.0) << place;
                    }
                }
            },
        )?;
        Ok(Self(words))
    }

    /// Takes the lamp's light from the pixels of a block that do not see it; `start` is its first.
    #[inline(always)]
    pub(crate) fn shade(&self, block: &mut Block, start: usize) {
        let words = &self.0[start / WORD..];
        for (reach, &word) in block.reach.chunks_exact_mut(WORD).zip(words) {
            for (place, reach) in reach.iter_mut().enumerate() {
                *reach *= f32::from(u8::from(word >> place & 1 != 0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    #[test]
    fn a_map_comes_back_block_by_block() {
        // More than a tile, and a last word that is not full.
        let map: Vec<f32> =
            (0..TILE + 300).map(|i| f32::from(u8::from(i * 7919 % 101 > 40))).collect();
        let visible = serially(|run| Visible::new(&map, run)).unwrap();
        for (index, seen) in map.chunks(BLOCK).enumerate() {
            let mut block = Block::new();
            block.reach.fill(0.5);
            visible.shade(&mut block, index * BLOCK);
            let expected: Vec<f32> = seen.iter().map(|seen| 0.5 * seen).collect();
            assert_eq!(block.reach[..seen.len()], expected);
        }
    }
}
