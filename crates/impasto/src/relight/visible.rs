//! Which pixels see a lamp, as bits: the maps of all lamps are needed together, and a bit is a
//! thirty-second of a number.

use super::block::{BLOCK, Block};
use crate::error::Result;
use crate::pixels::Run;

/// Pixels of a word.
const WORD: usize = 64;

// Blocks begin with a word.
const _: () = assert!(BLOCK.is_multiple_of(WORD));

/// One bit per pixel, set where the lamp is seen; every row begins with a word.
#[derive(Debug)]
pub(crate) struct Visible {
    words: Vec<u64>,
    /// Words of a row.
    stride: usize,
}

impl Visible {
    /// From 1 and 0 per pixel of rows of a width.
    pub(crate) fn new(map: &[f32], width: usize, run: &Run<'_>) -> Result<Self> {
        let stride = width.div_ceil(WORD);
        let mut words = vec![0; stride * (map.len() / width)];
        let rows = words.chunks_exact_mut(stride).zip(map.chunks_exact(width)).collect();
        run.for_each(
            rows,
            || (),
            |(), (words, map): (&mut [u64], &[f32])| {
                for (word, pixels) in words.iter_mut().zip(map.chunks(WORD)) {
                    for (place, &seen) in pixels.iter().enumerate() {
                        *word |= u64::from(seen > 0.0) << place;
                    }
                }
            },
        )?;
        Ok(Self { words, stride })
    }

    /// Takes the lamp's light from the pixels of a block that do not see it; `column` and `row` are
    /// those of its first.
    #[inline(always)]
    pub(crate) fn shade(&self, block: &mut Block, column: usize, row: usize) {
        let words = &self.words[row * self.stride..][..self.stride][column / WORD..];
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
        // More than a block, and a last word that is not full.
        let (width, rows) = (BLOCK + 44, 3);
        let map: Vec<f32> =
            (0..width * rows).map(|i| f32::from(u8::from(i * 7919 % 101 > 40))).collect();
        let visible = serially(|run| Visible::new(&map, width, run)).unwrap();
        for row in 0..rows {
            for column in (0..width).step_by(BLOCK) {
                let mut block = Block::new();
                block.reach.fill(0.5);
                visible.shade(&mut block, column, row);
                let seen = &map[row * width..][..width][column..];
                let seen = &seen[..seen.len().min(BLOCK)];
                let expected: Vec<f32> = seen.iter().map(|seen| 0.5 * seen).collect();
                assert_eq!(block.reach[..seen.len()], expected);
            }
        }
    }
}
