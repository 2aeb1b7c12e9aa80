//! The display's tone curve as a table over the square root of light.

use std::sync::OnceLock;

use super::steps::Steps;
use crate::error::{Error, Result};

/// Cells of the table.
pub const CELLS: usize = 2048;

/// A monotone curve from linear light in [0, 1] to codes in [0, 1], one per output channel.
///
/// `code = v[i] + (v[i + 1] - v[i]) * (s - i)` with `s = 2048 sqrt(light)` and `i = floor(s)`, in
/// single precision with one rounding per operation: the same code at every SIMD level. Over the
/// square root, tone curves are nearly straight lines: 2048 cells keep the interpolation of
/// the sRGB curve within 7e-4 of an 8-bit and 0.17 of a 16-bit code.
#[derive(Clone, Debug)]
pub struct Curve {
    /// One table, or one per channel where they differ.
    tables: Vec<Table>,
    /// The same curve in codes of 8 bits, made when it is first needed; none where it is too steep.
    steps: OnceLock<Option<Vec<Steps>>>,
}

/// The value at the left end of each cell, and what it rises by to the right end.
pub(crate) type Table = Box<[[f32; 2]; CELLS]>;

impl Curve {
    /// A curve through codes at `light = (i / 2048)^2`, i = 0 ..= 2048: one row of them, or three.
    ///
    /// # Errors
    /// If there are not 2049 or 3 x 2049 values in [0, 1], or a row falls.
    pub fn new(values: &[f32]) -> Result<Self> {
        let rows = values.chunks_exact(CELLS + 1);
        if !rows.remainder().is_empty() || !matches!(rows.len(), 1 | 3) {
            let problem =
                format!("expected 1 or 3 rows of {} values, found {}", CELLS + 1, values.len());
            return Err(Error::argument("curve", problem));
        }
        let valid =
            |row: &[f32]| row.iter().all(|value| (0.0..=1.0).contains(value)) && row.is_sorted();
        if !rows.clone().all(valid) {
            return Err(Error::argument("curve", "a tone curve stays in 0 .. 1 and never falls"));
        }
        let same = rows.clone().all(|row| row == &values[..=CELLS]);
        let tables = rows
            .take(if same { 1 } else { 3 })
            .map(|row| {
                let mut table = Box::new([[0.0; 2]; CELLS]);
                for (cell, ends) in table.iter_mut().zip(row.windows(2)) {
                    *cell = [ends[0], ends[1] - ends[0]];
                }
                table
            })
            .collect();
        Ok(Self { tables, steps: OnceLock::new() })
    }

    /// The table of a channel: the value at the left end of each cell, and what it rises by to the
    /// right end.
    #[must_use]
    #[inline(always)]
    pub fn channel(&self, channel: usize) -> &[[f32; 2]; CELLS] {
        &self.tables[channel.min(self.tables.len() - 1)]
    }

    /// The code of 8 bits of what lies beyond the display: above its white, or below 0.
    #[must_use]
    pub(crate) fn end(&self, channel: usize, above: bool) -> u8 {
        eight(self.channel(channel), if above { 1.0 } else { 0.0 }) as u8
    }

    /// The curves of red, green and blue in codes of 8 bits, if they are no steeper than [`Steps`]
    /// can be.
    #[must_use]
    pub(crate) fn steps(&self) -> Option<[&Steps; 3]> {
        let made = || self.tables.iter().map(|table| Steps::new(|light| eight(table, light)));
        let steps = self.steps.get_or_init(|| made().collect()).as_ref()?;
        Some([0, 1, 2].map(|channel: usize| &steps[channel.min(steps.len() - 1)]))
    }
}

/// The code of 8 bits of light in [0, 1], by the arithmetic of [`show`](super::show).
fn eight(table: &[[f32; 2]; CELLS], light: f32) -> u32 {
    let place = light.sqrt() * CELLS as f32;
    let cell = place.floor().min((CELLS - 1) as f32);
    let [value, rise] = table[cell as usize];
    let code = rise.mul_add(place - cell, value).min(1.0);
    code.mul_add(255.0, INTEGER_BITS).to_bits() & 0xff
}

/// Adding it puts the nearest integer (ties to even) into the low bits of a single-precision
/// number below 2^22.
pub(super) const INTEGER_BITS: f32 = 8_388_608.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_channels_share_a_table_and_wrong_curves_are_refused() {
        let ramp: Vec<f32> = (0..=CELLS).map(|i| i as f32 / CELLS as f32).collect();
        assert_eq!(Curve::new(&ramp.repeat(3)).unwrap().tables.len(), 1);
        let mut three = ramp.repeat(3);
        three[CELLS] = ramp[CELLS - 1];
        assert_eq!(Curve::new(&three).unwrap().tables.len(), 3);
        assert!(Curve::new(&ramp.repeat(2)).is_err());
        three[5] = f32::NAN;
        assert!(Curve::new(&three).is_err());
        assert!(Curve::new(&ramp.iter().map(|v| 1.0 - v).collect::<Vec<_>>()).is_err());
    }
}
