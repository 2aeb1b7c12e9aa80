//! Light that pixels of a relief get from others: it is taken off the samples as they are read.
//!
//! It varies slowly and is known on a grid of cells, between which it is interpolated. So no corrected
//! copy of the photographs is made, and a part of a painting has the samples of the whole.

use crate::error::{Error, Result};

/// Where the pixels along one axis lie between the middles of cells.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    /// Per pixel the cell before it.
    pub first: &'a [u32],
    /// Per pixel the share of the cell after that, 0 to 1; 1 minus it is the share of the first.
    pub share: &'a [f32],
}

/// What is taken off linear samples, and how stored numbers become linear.
///
/// Light that the samples do not have is not taken off: none becomes negative, except for what was.
#[derive(Clone, Copy, Debug)]
pub struct Interreflections<'a> {
    /// `(obs, band, cell_y, cell_x)`: light from other places.
    pub irradiance: &'a [f32],
    /// Cells along y and x.
    pub cells: [usize; 2],
    /// `(band, y, x)`: the share of it that a pixel reflects.
    pub albedo: &'a [f32],
    /// Places of the rows of pixels.
    pub rows: Places<'a>,
    /// Places of the columns of pixels.
    pub columns: Places<'a>,
    /// `(band,)`: stored number that is no light.
    pub black: &'a [f32],
    /// `(band,)`: linear light per stored unit.
    pub scale: &'a [f32],
    /// `(band,)`: stored number from which a sample is clipped (`+inf` where nothing clips).
    pub saturation: &'a [f32],
}

impl Interreflections<'_> {
    /// Refuses arrays that do not fit photographs of so many observations and bands.
    pub(crate) fn check(&self, observations: usize, bands: usize, size: [usize; 2]) -> Result<()> {
        let [cell_rows, cell_columns] = self.cells;
        let fits = |places: &Places<'_>, pixels: usize, cells: usize| {
            places.first.len() == pixels
                && places.share.len() == pixels
                && places.first.iter().all(|&first| (first as usize) < cells)
        };
        let whole = self.irradiance.len() == observations * bands * cell_rows * cell_columns
            && self.albedo.len() == bands * size[0] * size[1]
            && [self.black, self.scale, self.saturation].iter().all(|one| one.len() == bands)
            && fits(&self.rows, size[0], cell_rows)
            && fits(&self.columns, size[1], cell_columns);
        let problem = "their sizes are not those of the photographs";
        if whole { Ok(()) } else { Err(Error::argument("interreflections", problem)) }
    }

    /// A stored number as linear light.
    pub(crate) fn linear(&self, band: usize, stored: f32) -> f32 {
        let clipped = stored >= self.saturation[band];
        if clipped { f32::INFINITY } else { (stored - self.black[band]) * self.scale[band] }
    }

    /// Takes the light from other places off linear samples: those of the pixels from `start` on,
    /// of one photograph and band.
    ///
    /// Products and sums are rounded one by one, as those are by which a model shows this light.
    pub(crate) fn take_off(&self, plane: usize, start: usize, samples: &mut [f32]) {
        let [cell_rows, cell_columns] = self.cells;
        let cells = cell_rows * cell_columns;
        let irradiance = &self.irradiance[plane * cells..][..cells];
        let width = self.columns.first.len();
        let pixels = width * self.rows.first.len();
        let albedo = &self.albedo[plane % self.black.len() * pixels + start..][..samples.len()];
        let mut at = 0;
        while at < samples.len() {
            let (row, column) = ((start + at) / width, (start + at) % width);
            let end = samples.len().min(at + width - column);
            let upper = self.rows.first[row] as usize;
            let lower = (upper + 1).min(cell_rows - 1);
            let down = self.rows.share[row];
            let [upper, lower] =
                [upper, lower].map(|row| &irradiance[row * cell_columns..][..cell_columns]);
            let blended = |cell: usize| (1.0 - down) * upper[cell] + down * lower[cell];
            let places = self.columns.first[column..].iter().zip(&self.columns.share[column..]);
            // Neighbours are mostly between the same two cells.
            let (mut known, mut left, mut right) = (u32::MAX, 0.0, 0.0);
            for ((sample, &albedo), (&first, &share)) in
                samples[at..end].iter_mut().zip(&albedo[at..end]).zip(places)
            {
                if first != known {
                    let second = (first as usize + 1).min(cell_columns - 1);
                    (known, left, right) = (first, blended(first as usize), blended(second));
                }
                let around = albedo * ((1.0 - share) * left + share * right);
                *sample = without(*sample, around);
            }
            at = end;
        }
    }
}

/// What is left of a sample; noise around black stays.
#[inline]
fn without(sample: f32, around: f32) -> f32 {
    let (left, least) = (sample - around, if sample < 0.0 { sample } else { 0.0 });
    if left < least { least } else { left }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{Decode, Samples, Shape, Stack};

    const SHAPE: Shape = Shape { observations: 2, bands: 1, height: 2, width: 3 };
    const ROWS: Places<'_> = Places { first: &[0, 0], share: &[0.25, 1.0] };
    const COLUMNS: Places<'_> = Places { first: &[0, 0, 1], share: &[0.0, 0.5, 0.75] };
    const LIGHT: Interreflections<'_> = Interreflections {
        irradiance: &[0.0, 4.0, 8.0, 16.0, 0.0, 0.0, 0.0, 0.0],
        cells: [2, 2],
        albedo: &[0.5, 0.5, 0.5, 1.0, 1.0, 0.0],
        rows: ROWS,
        columns: COLUMNS,
        black: &[2.0],
        scale: &[0.5],
        saturation: &[200.0],
    };
    /// Light of the first photograph as stored codes, of the second black and clipped ones.
    const CODES: [u8; 12] = [22, 22, 22, 22, 22, 22, 2, 0, 200, 2, 2, 2];

    #[test]
    fn light_between_cells_is_bilinear_and_leaves_noise_and_clipped_samples() {
        let decode = [Decode { gain: 2.0, offset: 0.0, saturation: f32::INFINITY }; 2];
        let stack = Stack::new(Samples::U8(&CODES), SHAPE, &decode, None).unwrap();
        let stack = stack.without(&LIGHT).unwrap();
        // Stored 22 is 10. Of the cells (0 4 / 8 16) the first row of pixels has a quarter of the way
        // to the second: 2 to 7, the other 8 to 16. The last column lies at the last cell.
        let expected = [10.0 - 1.0, 10.0 - 2.25, 10.0 - 3.5, 10.0 - 8.0, 0.0, 10.0];
        for start in 0..6 {
            let mut out = [0.0; 6];
            stack.read(0, 0, start, &mut out);
            for (found, expected) in out.iter().zip(&expected[start..]) {
                assert_eq!(*found, 2.0 * expected);
            }
        }
        let mut out = [0.0; 3];
        stack.read(1, 0, 0, &mut out);
        assert_eq!(out, [0.0, -2.0, f32::INFINITY]);
    }

    #[test]
    fn sizes_that_disagree_are_refused() {
        let few = Interreflections { albedo: &[1.0; 5], ..LIGHT };
        let beyond = Interreflections { rows: Places { first: &[0, 2], ..ROWS }, ..LIGHT };
        for wrong in [few, beyond] {
            assert!(wrong.check(2, 1, [2, 3]).is_err());
        }
        assert!(LIGHT.check(2, 1, [2, 3]).is_ok());
        assert!(LIGHT.check(1, 1, [2, 3]).is_err());
    }
}
