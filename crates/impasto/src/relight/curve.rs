//! The display's tone curve as a table over the square root of light.

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
        Ok(Self { tables })
    }

    /// The table of a channel: the value at the left end of each cell, and what it rises by to the
    /// right end.
    #[must_use]
    #[inline(always)]
    pub fn channel(&self, channel: usize) -> &[[f32; 2]; CELLS] {
        &self.tables[channel.min(self.tables.len() - 1)]
    }
}

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
