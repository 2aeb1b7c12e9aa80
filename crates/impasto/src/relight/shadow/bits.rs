//! One bit per pixel: bit matrices, their alignment by funnel shifts and their transposition in
//! blocks of 64 x 64 by recursive exchange [@warren2012hackers].

/// Pixels of a word.
pub(crate) const WORD: usize = 64;

/// Yes or no per pixel `(y, x)`; every row begins with a word, bits behind the last column are 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bits {
    words: Vec<u64>,
    width: usize,
    stride: usize,
}

impl Bits {
    /// A matrix of one answer.
    #[must_use]
    pub fn filled(value: bool, width: usize, rows: usize) -> Self {
        let stride = width.div_ceil(WORD);
        let mut bits = Self { words: vec![0; stride * rows], width, stride };
        if value {
            for row in bits.words.chunks_exact_mut(stride) {
                row.fill(u64::MAX);
                trim(row, width);
            }
        }
        bits
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.words.len() / self.stride
    }

    /// Words of a row.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// The words of a row; the lowest bit of a word is its first pixel.
    #[must_use]
    pub fn row(&self, row: usize) -> &[u64] {
        &self.words[row * self.stride..][..self.stride]
    }

    /// All words, row by row.
    #[must_use]
    pub fn words_mut(&mut self) -> &mut [u64] {
        &mut self.words
    }

    /// Whether the bit of a pixel is set.
    #[must_use]
    pub fn get(&self, column: usize, row: usize) -> bool {
        self.row(row)[column / WORD] >> (column % WORD) & 1 == 1
    }

    /// Rows as columns.
    #[must_use]
    pub fn transposed(&self) -> Self {
        let mut out = Self::filled(false, self.rows(), self.width);
        let mut block = [0; WORD];
        for top in (0..self.rows()).step_by(WORD) {
            for word in 0..self.stride {
                for (row, line) in block.iter_mut().enumerate() {
                    let row = top + row;
                    *line = if row < self.rows() { self.row(row)[word] } else { 0 };
                }
                transpose(&mut block);
                let rows = WORD.min(self.width - word * WORD);
                for (row, &line) in block[..rows].iter().enumerate() {
                    out.words[(word * WORD + row) * out.stride + top / WORD] = line;
                }
            }
        }
        out
    }

    /// Copies a matrix to column `column`, a multiple of 64, and row `row`.
    pub(crate) fn place(&mut self, part: &Self, column: usize, row: usize) {
        for index in 0..part.rows() {
            let start = (row + index) * self.stride + column / WORD;
            self.words[start..][..part.stride].copy_from_slice(part.row(index));
        }
    }
}

/// Clears the bits from `width` on.
fn trim(row: &mut [u64], width: usize) {
    if let (Some(last), false) = (row.last_mut(), width.is_multiple_of(WORD)) {
        *last &= (1 << (width % WORD)) - 1;
    }
}

/// `width` bits from the bit `offset` of `words` on.
pub(super) fn shifted(words: &[u64], offset: usize, width: usize, out: &mut [u64]) {
    let (first, shift) = (offset / WORD, offset % WORD);
    for (index, out) in out.iter_mut().enumerate() {
        let here = words[first + index] >> shift;
        let next = words.get(first + index + 1).copied().unwrap_or(0);
        *out = if shift == 0 { here } else { here | next << (WORD - shift) };
    }
    trim(out, width);
}

/// Exchanges halves, quarters ... single bits across the diagonal.
fn transpose(block: &mut [u64; WORD]) {
    let (mut half, mut mask) = (32, u64::from(u32::MAX));
    while half > 0 {
        let mut row = 0;
        while row < WORD {
            let other = row | half;
            let change = (block[row] >> half ^ block[other]) & mask;
            block[row] ^= change << half;
            block[other] ^= change;
            row = (other + 1) & !half;
        }
        half >>= 1;
        mask ^= mask << half;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(width: usize, rows: usize) -> Bits {
        let mut bits = Bits::filled(false, width, rows);
        for row in 0..rows {
            for column in 0..width {
                let set = (row * 7919 + column * 104_729) % 101 > 50;
                bits.words[row * bits.stride + column / WORD] |= u64::from(set) << (column % WORD);
            }
        }
        bits
    }

    #[test]
    fn rows_become_columns() {
        for (width, rows) in [(1, 1), (64, 64), (65, 3), (130, 200)] {
            let bits = random(width, rows);
            let other = bits.transposed();
            for row in 0..rows {
                for column in 0..width {
                    assert_eq!(bits.get(column, row), other.get(row, column));
                }
            }
            assert_eq!(other.transposed(), bits);
        }
    }

    #[test]
    fn a_shift_takes_bits_from_an_offset_on() {
        let bits = random(300, 1);
        for offset in [0, 1, 63, 64, 100] {
            let mut out = vec![0; 3];
            shifted(bits.row(0), offset, 140, &mut out);
            for index in 0..192 {
                let set = out[index / WORD] >> (index % WORD) & 1 == 1;
                assert_eq!(set, index < 140 && bits.get(offset + index, 0));
            }
        }
        assert!(Bits::filled(true, 70, 2).get(69, 1));
        assert_eq!(Bits::filled(true, 70, 2).row(1)[1], 63);
    }
}
