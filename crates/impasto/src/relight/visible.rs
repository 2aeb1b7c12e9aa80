//! Which pixels see a lamp: bits for a lamp without a size (the maps of all lamps are needed together,
//! and a bit is a thirty-second of a number), else shares.

use super::block::{BLOCK, Block};
use super::shadow::bits::WORD;
use super::shadow::{Bits, SIDE, Shares};

// Blocks begin with a word, and lie in one tile.
const _: () = assert!(BLOCK.is_multiple_of(WORD) && SIDE.is_multiple_of(BLOCK));

/// What the pixels see of a lamp.
#[derive(Debug)]
pub(crate) enum Visible {
    /// One bit per pixel, set where the lamp is seen.
    Bits(Bits),
    /// How much of it is seen.
    Shares(Shares),
}

impl Visible {
    /// Takes the lamp's light from the pixels of a block that do not see it; `column` and `row` are
    /// those of its first.
    #[inline(always)]
    pub(crate) fn shade(&self, block: &mut Block, column: usize, row: usize) {
        match self {
            Self::Bits(bits) => {
                let words = &bits.row(row)[column / WORD..];
                for (reach, &word) in block.reach.chunks_exact_mut(WORD).zip(words) {
                    for (place, reach) in reach.iter_mut().enumerate() {
                        *reach *= f32::from(u8::from(word >> place & 1 != 0));
                    }
                }
            }
            Self::Shares(shares) => {
                let codes = shares.row(column, row).unwrap_or_default();
                for (reach, &code) in block.reach.iter_mut().zip(codes) {
                    *reach *= Shares::share(code);
                }
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
        let visible = Visible::Bits(bits.clone());
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
