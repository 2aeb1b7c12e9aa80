//! Seeds: pixels on a coarse grid that are fitted by multistart, and from which the pixels between
//! them start.
//!
//! The grid is that of the whole painting, so that no tile changes which pixels are seeds. A pixel
//! that fits much worse than the seeds around it (a fleck of gold between them) is fitted by
//! multistart, too.

use super::tile::ByLobeCount;

/// Distance between seeds in rows and columns: with a sixteenth of the pixels as seeds, their
/// multistart no longer dominates the time of the fit.
const STEP: usize = 4;

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

/// The seeds row by row; `None` where a pixel cannot be fitted.
#[derive(Debug)]
pub(super) struct Seeds {
    width: usize,
    columns: usize,
    fits: Vec<Option<Seed>>,
}

impl Seeds {
    /// The pixels that are seeds.
    pub(super) fn grid(width: usize, height: usize) -> Vec<usize> {
        let rows = (0..height).step_by(STEP);
        rows.flat_map(|row| (0..width).step_by(STEP).map(move |column| row * width + column))
            .collect()
    }

    /// From the fits of the pixels of [`Self::grid`].
    pub(super) fn new(width: usize, seeds: Vec<Option<Seed>>) -> Self {
        Self { width, columns: width.div_ceil(STEP), fits: seeds }
    }

    /// The seeds at the corners of the cell that a pixel lies in, nearest first.
    pub(super) fn around(&self, pixel: usize) -> Vec<&Seed> {
        let (row, column) = (pixel / self.width, pixel % self.width);
        let rows = row / STEP..=row.div_ceil(STEP);
        let corners =
            rows.flat_map(|y| (column / STEP..=column.div_ceil(STEP)).map(move |x| [x, y]));
        let mut near: Vec<(usize, &Seed)> = corners
            .filter(|&[x, _]| x < self.columns)
            .filter_map(|[x, y]| {
                let away = (x * STEP).abs_diff(column).pow(2) + (y * STEP).abs_diff(row).pow(2);
                Some((away, self.fits.get(y * self.columns + x)?.as_ref()?))
            })
            .collect();
        near.sort_by_key(|&(away, _)| away);
        near.into_iter().map(|(_, seed)| seed).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::maps::MOST_LOBES;
    use super::super::tile::Estimate;
    use super::*;

    fn seed(mark: f32) -> Seed {
        let place = Estimate::new([0.0, 0.0, 1.0]);
        let by_count = ByLobeCount { estimates: [place; MOST_LOBES + 1], lobes: 0 };
        Seed { by_count, normal: place.normal, misfit: mark }
    }

    #[test]
    fn a_pixel_has_the_nodes_at_its_cells_corners() {
        // Seeds 0 1 2 in row 0, 3 4 5 in row 4; 4 cannot be fitted.
        let seeds = (0..6).map(|i| (i != 4).then(|| seed(i as f32))).collect();
        assert_eq!(Seeds::grid(10, 6), [0, 4, 8, 40, 44, 48]);
        let seeds = Seeds::new(10, seeds);
        let about = |row: usize, column: usize| {
            seeds.around(row * 10 + column).iter().map(|seed| seed.misfit).collect::<Vec<_>>()
        };
        assert_eq!(about(0, 4), [1.0]);
        assert_eq!(about(1, 3), [1.0, 0.0, 3.0]);
        assert_eq!(about(4, 4), [0.0; 0]);
        assert_eq!(about(5, 9), [5.0]);
        assert_eq!(about(3, 9), [5.0, 2.0]);
    }

    #[test]
    fn a_normal_turns_as_its_node_did() {
        let mut seed = seed(0.0);
        seed.by_count.estimates[1].normal = [0.6, 0.0, 0.8];
        assert_eq!(seed.moved_normal(seed.normal), [0.6, 0.0, 0.8]);
        let [x, y, z] = seed.moved_normal([0.0, 0.6, 0.8]);
        assert!(x > 0.5 && y > 0.5 && (x * x + y * y + z * z - 1.0).abs() < 1e-6);
    }
}
