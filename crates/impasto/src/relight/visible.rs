//! Which pixels see a lamp, as bits: the maps of all lamps are needed together, and a bit is a
//! thirty-second of a number.

use super::block::{BLOCK, Block};
use super::shadow::Bits;
use super::shadow::bits::WORD;

// Blocks begin with a word.
const _: () = assert!(BLOCK.is_multiple_of(WORD));

/// One bit per pixel, set where the lamp is seen.
#[derive(Debug)]
pub(crate) struct Visible(Bits);

impl Visible {
    /// From the shadows of a lamp.
    pub(crate) fn new(bits: Bits) -> Self {
        Self(bits)
    }

    /// Takes the lamp's light from the pixels of a block that do not see it; `column` and `row` are
    /// those of its first.
    #[inline(always)]
    pub(crate) fn shade(&self, block: &mut Block, column: usize, row: usize) {
        let words = &self.0.row(row)[column / WORD..];
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

    #[test]
    fn bits_come_back_block_by_block() {
        // More than a block, and a last word that is not full.
        let (width, rows) = (BLOCK + 44, 3);
        let mut bits = Bits::filled(true, width, rows);
        for (index, word) in bits.words_mut().iter_mut().enumerate() {
            *word &= 0x5a5a_1234_9876_abcd_u64.rotate_left(index as u32);
        }
        let visible = Visible::new(bits.clone());
        for row in 0..rows {
            for column in (0..width).step_by(BLOCK) {
                let mut block = Block::new();
                block.reach.fill(0.5);
                visible.shade(&mut block, column, row);
                for (place, &reach) in block.reach[..BLOCK.min(width - column)].iter().enumerate() {
                    assert_eq!(reach > 0.0, bits.get(column + place, row));
                }
            }
        }
    }
}
