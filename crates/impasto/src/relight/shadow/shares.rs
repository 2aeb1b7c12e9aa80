//! Which share of a light each pixel sees, in tiles, as 16-bit numbers: what is seen wholly takes no
//! memory.

use crate::error::Result;
use crate::geometry::Grid;
use crate::pixels::Run;
use crate::relight::statistics::SIDE;

/// All of the light.
const WHOLE: f32 = 65535.0;

/// Shares of a light from 0 to 1, within 1 / 131070, in tiles of [`SIDE`] pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Shares {
    /// Tiles side by side.
    columns: usize,
    width: usize,
    height: usize,
    /// Row by row; none where all is seen.
    tiles: Vec<Option<Vec<u16>>>,
}

impl Shares {
    /// Asks `seen` for `([column, row], [width, height])` of each tile that is `wanted`, by column and
    /// row of tiles: shares, row by row.
    ///
    /// # Errors
    /// If the caller cancels.
    pub(super) fn new<S: Default + Send>(
        grid: Grid,
        wanted: impl Fn(usize, usize) -> bool + Sync,
        run: &Run<'_>,
        seen: impl Fn(([usize; 2], [usize; 2]), &mut S) -> Vec<f32> + Sync,
    ) -> Result<Self> {
        let Grid { width, height, .. } = grid;
        let columns = width.div_ceil(SIDE);
        let places = (0..height.div_ceil(SIDE))
            .flat_map(|row| (0..columns).map(move |column| (column, row)))
            .collect();
        let tiles = run.map(places, S::default, |scratch, (column, row)| {
            let corner = [column * SIDE, row * SIDE];
            let size = [SIDE.min(width - corner[0]), SIDE.min(height - corner[1])];
            wanted(column, row).then(|| {
                let code = |share: &f32| (share * WHOLE).round() as u16;
                seen((corner, size), scratch).iter().map(code).collect()
            })
        })?;
        Ok(Self { columns, width, height, tiles })
    }

    /// From a map `(y, x)`, where tiles are `wanted`.
    ///
    /// # Errors
    /// If the caller cancels.
    pub(super) fn of(
        map: &[f32],
        grid: Grid,
        wanted: impl Fn(usize, usize) -> bool + Sync,
        run: &Run<'_>,
    ) -> Result<Self> {
        Self::new(grid, wanted, run, |([column, row], [width, height]), (): &mut ()| {
            let rows = (row..row + height).map(|row| &map[row * grid.width + column..][..width]);
            rows.flatten().copied().collect()
        })
    }

    /// The pixels of a row from `column` on to the end of the tile: numbers of [`Self::share`]; none
    /// where all is seen.
    #[inline(always)]
    pub(crate) fn row(&self, column: usize, row: usize) -> Option<&[u16]> {
        let tile = self.tiles[row / SIDE * self.columns + column / SIDE].as_ref()?;
        let (inside, left) = (column % SIDE, column - column % SIDE);
        let width = SIDE.min(self.width - left);
        Some(&tile[row % SIDE * width..][inside..width])
    }

    /// The whole picture `(y, x)` as 16-bit numbers, 65535 for all of the light.
    #[must_use]
    pub fn codes(&self) -> Vec<u16> {
        let mut codes = Vec::with_capacity(self.width * self.height);
        for row in 0..self.height {
            for column in (0..self.width).step_by(SIDE) {
                match self.row(column, row) {
                    None => codes.resize(codes.len() + SIDE.min(self.width - column), u16::MAX),
                    Some(part) => codes.extend_from_slice(part),
                }
            }
        }
        codes
    }

    /// The share that a number stands for.
    #[inline(always)]
    pub(crate) fn share(code: u16) -> f32 {
        f32::from(code) * (1.0 / WHOLE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;

    #[test]
    fn a_map_comes_back_where_it_is_wanted() {
        let grid = Grid::whole(SIDE + 44, SIDE + 3, 0.1);
        let map: Vec<f32> = (0..grid.width * grid.height).map(|i| (i % 97) as f32 / 96.0).collect();
        let right = |column: usize, _: usize| column == 1;
        let shares = serially(|run| Shares::of(&map, grid, right, run)).unwrap();
        let codes = shares.codes();
        for row in 0..grid.height {
            assert!(shares.row(0, row).is_none());
            let found = shares.row(SIDE, row).unwrap();
            assert_eq!(found.len(), 44);
            for (place, &code) in found.iter().enumerate() {
                let expected = map[row * grid.width + SIDE + place];
                assert!((Shares::share(code) - expected).abs() <= 0.5001 / WHOLE);
                assert_eq!(codes[row * grid.width + SIDE + place], code);
            }
            assert_eq!(codes[row * grid.width..][..SIDE], [u16::MAX; SIDE]);
        }
        assert_eq!(codes.len(), map.len());
        assert_eq!((Shares::share(0), Shares::share(u16::MAX)), (0.0, 1.0));
    }
}
