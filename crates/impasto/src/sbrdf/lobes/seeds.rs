//! Seeds: pixels on a grid from which the pixels between them start.
//!
//! The seeds of a coarse grid are fitted by multistart, those of a fine grid start from these, all
//! other pixels from the fine grid. Both grids are those of the whole painting, so that no tile
//! changes which pixels are seeds. A pixel that fits much worse than the seeds around it (a fleck of
//! gold between them) is fitted by multistart, too.

use crate::geometry::Grid;

use super::tile::ByLobeCount;

/// Distance between seeds in rows and columns: a sixteenth of the pixels are seeds.
pub(super) const FINE: usize = 4;

/// The same between those that multistart fits. It takes eight times as long as a start from
/// neighbours; for one pixel in 256 that hardly counts. Multiple of [`FINE`].
pub(super) const COARSE: usize = 16;

/// Pixels around a tile whose samples its fit needs, as far as the painting reaches: with them the
/// seeds at the corners of every cell lie in the tile's stack.
pub const HALO: usize = COARSE - 1;

/// The fit of one pixel of the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    pub(super) by_count: ByLobeCount,
    /// Its normal by photometric stereo.
    pub(super) normal: [f32; 3],
    /// Its cost in units of the rounding of its samples, which goes with their weighted sum of
    /// squares.
    pub(super) misfit: f32,
}

impl Seed {
    /// A normal of photometric stereo, moved as the seed's first lobe moved the seed's own.
    pub(super) fn moved_normal(&self, normal: [f32; 3]) -> [f32; 3] {
        let found = self.by_count.estimates[1].normal;
        let long: [f32; 3] =
            core::array::from_fn(|axis| normal[axis] + (found[axis] - self.normal[axis]));
        let length = long.iter().map(|v| v * v).sum::<f32>().sqrt();
        // The sum is zero if a seed's normal was turned by half a circle.
        if length > 0.0 { long.map(|v| v / length) } else { normal }
    }
}

/// Which pixels are seeds: some rows and columns of a grid of the painting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SeedGrid {
    /// Pixels from one row or column to the next.
    step: usize,
    /// First column and row, in steps.
    first: [usize; 2],
    /// Columns and rows.
    size: [usize; 2],
}

impl SeedGrid {
    /// The seeds that lie in a tile.
    pub(super) fn inside(tile: Grid, step: usize) -> Self {
        let first = tile.origin.map(|start| start.div_ceil(step));
        let ends = [tile.origin[0] + tile.width, tile.origin[1] + tile.height];
        Self {
            step,
            first,
            size: [0, 1].map(|axis| ends[axis].div_ceil(step).saturating_sub(first[axis])),
        }
    }

    /// The seeds around all pixels of a tile: at the corners of the cells that these lie in, as far
    /// as the painting reaches.
    pub(super) fn around(tile: Grid, step: usize) -> Self {
        let first = tile.origin.map(|start| start / step);
        let lasts = [tile.origin[0] + tile.width - 1, tile.origin[1] + tile.height - 1];
        let size = [0, 1].map(|axis| {
            let last = lasts[axis].div_ceil(step).min((tile.extent[axis] - 1) / step);
            last + 1 - first[axis]
        });
        Self { step, first, size }
    }

    /// Columns and rows of the seeds in the whole painting, row by row.
    pub(super) fn places(self) -> impl Iterator<Item = [usize; 2]> {
        let Self { step, first: [column, row], size: [columns, rows] } = self;
        (row..row + rows)
            .flat_map(move |y| (column..column + columns).map(move |x| [x * step, y * step]))
    }
}

/// The seeds of a grid row by row; `None` where a pixel cannot be fitted.
#[derive(Debug)]
pub(super) struct Seeds {
    grid: SeedGrid,
    fits: Vec<Option<Seed>>,
}

impl Seeds {
    /// From the fits at the [places](SeedGrid::places) of a grid.
    pub(super) fn new(grid: SeedGrid, fits: Vec<Option<Seed>>) -> Self {
        Self { grid, fits }
    }

    /// Whether other seeds start from these, not all pixels.
    pub(super) fn are_coarse(&self) -> bool {
        self.grid.step == COARSE
    }

    /// The seeds at the corners of the cell that a column and row of the painting lies in, nearest
    /// first.
    pub(super) fn around(&self, [column, row]: [usize; 2]) -> Vec<&Seed> {
        let step = self.grid.step;
        let rows = row / step..=row.div_ceil(step);
        let corners =
            rows.flat_map(|y| (column / step..=column.div_ceil(step)).map(move |x| [x, y]));
        let mut near: Vec<(usize, &Seed)> = corners
            .filter_map(|corner| {
                let [x, y] = corner;
                let away = (x * step).abs_diff(column).pow(2) + (y * step).abs_diff(row).pow(2);
                Some((away, self.at(corner)?))
            })
            .collect();
        near.sort_by_key(|&(away, _)| away);
        near.into_iter().map(|(_, seed)| seed).collect()
    }

    /// The seed at a column and row of the grid.
    fn at(&self, [x, y]: [usize; 2]) -> Option<&Seed> {
        let SeedGrid { first, size, .. } = self.grid;
        let (x, y) = (x.checked_sub(first[0])?, y.checked_sub(first[1])?);
        if x < size[0] { self.fits.get(y * size[0] + x)?.as_ref() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::super::maps::MOST_LOBES;
    use super::super::tile::Estimate;
    use super::*;

    fn seed(mark: f32) -> Seed {
        let estimate = Estimate::new([0.0, 0.0, 1.0]);
        let by_count = ByLobeCount { estimates: [estimate; MOST_LOBES + 1], lobes: 0 };
        Seed { by_count, normal: estimate.normal, misfit: mark }
    }

    #[test]
    fn a_pixel_has_the_seeds_at_its_cells_corners() {
        // Seeds 0 1 2 in row 0, 3 4 5 in row 4; 4 cannot be fitted.
        let fits = (0..6).map(|i| (i != 4).then(|| seed(i as f32))).collect();
        let grid = SeedGrid::inside(Grid::whole(10, 6, 1.0), FINE);
        assert_eq!(
            grid.places().collect::<Vec<_>>(),
            [[0, 0], [4, 0], [8, 0], [0, 4], [4, 4], [8, 4]]
        );
        let seeds = Seeds::new(grid, fits);
        let around = |row: usize, column: usize| {
            seeds.around([column, row]).iter().map(|seed| seed.misfit).collect::<Vec<_>>()
        };
        assert_eq!(around(0, 4), [1.0]);
        assert_eq!(around(1, 3), [1.0, 0.0, 3.0]);
        assert_eq!(around(4, 4), [0.0; 0]);
        assert_eq!(around(5, 9), [5.0]);
        assert_eq!(around(3, 9), [5.0, 2.0]);
    }

    #[test]
    fn a_tile_has_the_seeds_that_its_pixels_have_in_the_whole() {
        let whole = Grid::whole(53, 38, 1.0);
        for step in [FINE, COARSE] {
            assert_eq!(SeedGrid::around(whole, step), SeedGrid::inside(whole, step));
        }
        let mark = |[column, row]: [usize; 2]| (100 * row + column) as f32;
        let marked = |grid: SeedGrid| {
            Seeds::new(grid, grid.places().map(|place| Some(seed(mark(place)))).collect())
        };
        let tiles =
            [([0, 0], 5, 5), ([3, 7], 9, 2), ([4, 8], 1, 1), ([51, 5], 2, 33), ([1, 37], 20, 1)];
        for (step, ([column, row], width, height)) in
            [FINE, COARSE].into_iter().flat_map(|step| tiles.map(|tile| (step, tile)))
        {
            let all = marked(SeedGrid::inside(whole, step));
            let tile = whole.tile([column, row], width, height).unwrap();
            let some = marked(SeedGrid::around(tile, step));
            // All of them lie in the tile and its halo.
            let from = [column, row].map(|start| start.saturating_sub(HALO));
            let reach = |axis: usize, end: usize| whole.extent[axis].min(end + HALO) - from[axis];
            let wide = whole.tile(from, reach(0, column + width), reach(1, row + height)).unwrap();
            assert!(SeedGrid::around(tile, step).places().all(|place| wide.pixel(place).is_some()));
            for pixel in 0..width * height {
                let marks = |seeds: &Seeds| -> Vec<f32> {
                    seeds.around(tile.place(pixel)).iter().map(|seed| seed.misfit).collect()
                };
                assert_eq!(marks(&some), marks(&all), "{pixel} of {tile:?}");
            }
            // Those of the fine grid lie in cells whose corners are all there.
            let fine = SeedGrid::around(tile, FINE).places();
            for place in fine {
                let marks = |seeds: &Seeds| -> Vec<f32> {
                    seeds.around(place).iter().map(|seed| seed.misfit).collect()
                };
                assert_eq!(marks(&some), marks(&all), "{place:?} of {tile:?}");
            }
        }
        assert_eq!(SeedGrid::inside(whole.tile([5, 1], 3, 9).unwrap(), FINE).places().count(), 0);
    }

    #[test]
    fn a_normal_moves_as_its_seed_did() {
        let mut seed = seed(0.0);
        seed.by_count.estimates[1].normal = [0.6, 0.0, 0.8];
        assert_eq!(seed.moved_normal(seed.normal), [0.6, 0.0, 0.8]);
        let [x, y, z] = seed.moved_normal([0.0, 0.6, 0.8]);
        assert!(x > 0.5 && y > 0.5 && (x * x + y * y + z * z - 1.0).abs() < 1e-6);
    }
}
