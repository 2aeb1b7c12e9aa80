//! Light that the cells of a relief send each other: form factors of radiosity
//! [@goral1984radiosity], found by horizon mapping [@max1988horizon], and one bounce through them.
//!
//! Along each of [`AZIMUTHS`] directions a cell sees those others that rise above all before them.
//! The part of a cell's sky that another fills lies between two elevations, and over these the cosine
//! law has an antiderivative: of light from the direction w at elevation e,
//! `(N.w) cos e = a cos^2 e + z sin e cos e`, where a is the normal's part along the azimuth,
//!
//! ```text
//! integral = (a (e + sin e cos e) + z sin^2 e) / 2
//! ```
//!
//! Slopes `t = tan e` are compared instead of elevations, with which `sin e cos e = t / (1 + t^2)`: an
//! arc function is needed only for the few cells that are seen.
//!
//! Sines and arc functions are those of the platform: a few thousand calls in double precision, whose
//! last bits another platform may round otherwise.

use core::ops::Range;

use crate::error::{Error, Result};
use crate::pixels::Run;

/// Directions in which each cell looks for others.
pub const AZIMUTHS: usize = 32;

/// Distributions of light that are gathered at a time: sixteen sums of 64 bits are kept in registers,
/// and what 48 x 48 cells send, 144 KiB, stays in the second-level cache.
const TOGETHER: usize = 16;

/// The share of its radiosity by which each cell lights another, as compressed sparse rows: from a
/// tenth to a fifth of all pairs see each other in a hollow, and almost none on a rough plane.
#[derive(Clone, Debug, PartialEq)]
pub struct FormFactors {
    /// `(n + 1,)`: where the entries of each lit cell begin, and where the last ones end.
    pub first: Vec<u64>,
    /// Per entry the cell that lights it, in rising order in each row.
    pub cell: Vec<u32>,
    /// Per entry the share.
    pub share: Vec<f64>,
}

/// Borrowed [`FormFactors`].
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    first: &'a [u64],
    cell: &'a [u32],
    share: &'a [f64],
}

impl FormFactors {
    /// Form factors between the cells of a relief.
    ///
    /// `height` is `(y, x)` in sides of a cell; where it is not finite there is no surface, which
    /// neither lights nor is lit. `normal` is `(3, y, x)`, of any length. `size` is the number of rows
    /// and columns.
    ///
    /// # Errors
    /// If the sizes disagree, or the caller cancels.
    pub fn new(height: &[f32], normal: &[f32], size: [usize; 2], run: &Run<'_>) -> Result<Self> {
        let [rows, columns] = size;
        let cells = rows * columns;
        if height.len() != cells || cells == 0 || u32::try_from(cells).is_err() {
            return Err(Error::argument("height", "expected shape (y, x) with at least one cell"));
        }
        if normal.len() != 3 * cells {
            return Err(Error::argument("normal", "expected the shape (3, y, x) of the heights"));
        }
        let known = |&height: &f32| if height.is_finite() { f64::from(height) } else { f64::NAN };
        let height = height.iter().map(known).collect();
        let relief = Relief { height, normal, size, azimuths: azimuths(size) };
        let parts = run.map(
            (0..rows).collect(),
            || vec![0.0; cells],
            |shares, row| relief.lit_row(row, shares),
        )?;
        let entries = parts.iter().map(|part| part.share.len()).sum();
        let mut whole = Self {
            first: Vec::with_capacity(cells + 1),
            cell: Vec::with_capacity(entries),
            share: Vec::with_capacity(entries),
        };
        run.in_turn(parts, |part| {
            let before = whole.share.len() as u64;
            whole.first.extend(part.first.iter().map(|first| before + first));
            whole.cell.extend(part.cell);
            whole.share.extend(part.share);
        })?;
        whole.first.push(entries as u64);
        Ok(whole)
    }

    /// All of them, to be multiplied with.
    #[must_use]
    pub fn rows(&self) -> Rows<'_> {
        Rows { first: &self.first, cell: &self.cell, share: &self.share }
    }
}

impl<'a> Rows<'a> {
    /// The fields of [`FormFactors`], checked.
    ///
    /// # Errors
    /// If they are not the rows of a square matrix.
    pub fn new(first: &'a [u64], cell: &'a [u32], share: &'a [f64]) -> Result<Self> {
        let cells = first.len().saturating_sub(1);
        let whole = first.first() == Some(&0)
            && first.last() == Some(&(share.len() as u64))
            && first.is_sorted()
            && cell.len() == share.len()
            && cell.iter().all(|&cell| (cell as usize) < cells);
        let problem = "they are not the compressed sparse rows of a square matrix";
        if whole { Ok(Self { first, cell, share }) } else { Err(Error::argument("rows", problem)) }
    }

    /// Number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.first.len() - 1
    }

    /// The light `(k, n)` that cells get from each other when they send `(k, n)`.
    ///
    /// Each sum is taken in the order of the cells, product by product: it depends neither on the
    /// number of threads nor on what else is gathered.
    ///
    /// # Errors
    /// If the sizes disagree, or the caller cancels.
    pub fn gather(&self, sent: &[f32], run: &Run<'_>) -> Result<Vec<f64>> {
        let cells = self.cells();
        if cells == 0 || !sent.len().is_multiple_of(cells) {
            return Err(Error::argument("sent", format!("expected shape (k, {cells})")));
        }
        let mut received = vec![0.0; sent.len()];
        let groups = sent.chunks(TOGETHER * cells).zip(received.chunks_mut(TOGETHER * cells));
        run.for_each(
            groups.collect(),
            // What each cell sends; in the last group the last lanes hold anything.
            || vec![[0.0; TOGETHER]; cells],
            |by_cell, (sent, received)| {
                for (lane, sent) in sent.chunks_exact(cells).enumerate() {
                    for (lanes, &light) in by_cell.iter_mut().zip(sent) {
                        lanes[lane] = light;
                    }
                }
                for (lit, ends) in self.first.windows(2).enumerate() {
                    let sums = self.sums(ends[0] as usize..ends[1] as usize, by_cell);
                    for (received, sum) in received[lit..].iter_mut().step_by(cells).zip(sums) {
                        *received = sum;
                    }
                }
            },
        )?;
        Ok(received)
    }

    /// What one cell gets.
    fn sums(&self, entries: Range<usize>, by_cell: &[[f32; TOGETHER]]) -> [f64; TOGETHER] {
        let mut sums = [0.0; TOGETHER];
        for (&cell, &share) in self.cell[entries.clone()].iter().zip(&self.share[entries]) {
            let sent = by_cell[cell as usize];
            for (sum, light) in sums.iter_mut().zip(sent) {
                *sum += share * f64::from(light);
            }
        }
        sums
    }
}

/// A direction in which cells look, and the cells on the way.
struct Azimuth {
    right: f64,
    down: f64,
    steps: Vec<Step>,
}

/// From a cell to another.
#[derive(Clone, Copy, PartialEq)]
struct Step {
    down: isize,
    right: isize,
    /// Distance between their middles: the other is not exactly on the azimuth.
    apart: f64,
}

/// The nearest cell at each distance along each azimuth, as far as the picture reaches.
///
/// No azimuth is that of an axis or diagonal, and no distance below 20,000 comes nearer than 4e-6 to
/// half of a cell: which cell is nearest does not depend on rounding.
fn azimuths([rows, columns]: [usize; 2]) -> Vec<Azimuth> {
    let azimuth = |index: usize| {
        let angle = (index as f64 + 0.5) * (core::f64::consts::TAU / AZIMUTHS as f64);
        let (right, down) = (angle.cos(), -angle.sin());
        let mut steps: Vec<_> = (1..rows + columns)
            .map(|distance| {
                let [down, right] = [down, right].map(|part| (distance as f64 * part).round());
                Step { down: down as isize, right: right as isize, apart: down.hypot(right) }
            })
            .take_while(|step| {
                step.down.unsigned_abs() < rows && step.right.unsigned_abs() < columns
            })
            .collect();
        // Between the axes some cell is nearest at two distances.
        steps.dedup();
        Azimuth { right, down, steps }
    };
    (0..AZIMUTHS).map(azimuth).collect()
}

struct Relief<'a> {
    /// `(y, x)` in sides of a cell; NaN where there is no surface: no comparison with it is true.
    height: Vec<f64>,
    normal: &'a [f32],
    size: [usize; 2],
    azimuths: Vec<Azimuth>,
}

impl Relief<'_> {
    /// The form factors of one row of lit cells. `shares` has a number for each cell, zero before and
    /// after.
    fn lit_row(&self, row: usize, shares: &mut [f64]) -> FormFactors {
        let mut found = FormFactors { first: Vec::new(), cell: Vec::new(), share: Vec::new() };
        for column in 0..self.size[1] {
            found.first.push(found.share.len() as u64);
            let normal = self.unit_normal(row * self.size[1] + column);
            for azimuth in &self.azimuths {
                self.look([row, column], normal, azimuth, shares);
            }
            for (cell, share) in shares.iter_mut().enumerate() {
                if *share != 0.0 {
                    found.cell.push(cell as u32);
                    found.share.push(*share * (2.0 / AZIMUTHS as f64));
                    *share = 0.0;
                }
            }
        }
        found
    }

    /// Of length 1 up to single precision, in which it is stored.
    fn unit_normal(&self, cell: usize) -> [f64; 3] {
        let [x, y, z] = [0, 1, 2].map(|axis| self.normal[axis * self.height.len() + cell]);
        let length = (x * x + y * y + z * z).sqrt();
        [x, y, z].map(|part| f64::from(part / length))
    }

    /// Adds what the cells along an azimuth fill of what a cell sees.
    fn look(
        &self,
        [row, column]: [usize; 2],
        [x, y, z]: [f64; 3],
        azimuth: &Azimuth,
        shares: &mut [f64],
    ) {
        let [rows, columns] = self.size;
        let along = x * azimuth.right - y * azimuth.down;
        // Below this slope a direction lies behind the surface. A surface that leans over sees
        // everything on the side to which it leans, and nothing on the other.
        let mut highest = match (z > 0.0, along > 0.0) {
            (true, _) => -along / z,
            (false, true) => f64::NEG_INFINITY,
            (false, false) => f64::INFINITY,
        };
        // There `a cos e + z sin e` is 0, and so is the antiderivative without its first term.
        let mut lower = 0.5 * along * (-along).atan2(z);
        let here = self.height[row * columns + column];
        for step in &azimuth.steps {
            let [row, column] =
                [row.wrapping_add_signed(step.down), column.wrapping_add_signed(step.right)];
            if row >= rows || column >= columns {
                break;
            }
            let other = row * columns + column;
            let rise = self.height[other] - here;
            if rise > highest * step.apart {
                highest = rise / step.apart;
                let upper = antiderivative(highest, along, z);
                shares[other] += upper - lower;
                lower = upper;
            }
        }
    }
}

/// Integral of `(N.w) cos e` over the elevations e of directions w up to this slope.
fn antiderivative(slope: f64, along: f64, z: f64) -> f64 {
    let cosine = 1.0 / (1.0 + slope * slope);
    0.5 * (along * (slope.atan() + slope * cosine) + z * (slope * slope * cosine))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::{Pool, Progress, looks, serially};
    use core::sync::atomic::AtomicBool;

    fn factors(height: &[f32], normal: &[f32], size: [usize; 2]) -> FormFactors {
        serially(|run| FormFactors::new(height, normal, size, run)).unwrap()
    }

    /// Cells and shares of a row.
    fn row(factors: &FormFactors, lit: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = factors.first[lit] as usize..factors.first[lit + 1] as usize;
        let cells = factors.cell[range.clone()].iter().map(|&cell| cell as usize);
        cells.zip(factors.share[range].iter().copied())
    }

    /// Bumps, and normals that fit them only roughly; there are holes.
    fn bumps([rows, columns]: [usize; 2]) -> (Vec<f32>, Vec<f32>) {
        let place = |cell: usize| ((cell / columns) as f32, (cell % columns) as f32);
        let height = |cell: usize| {
            let (y, x) = place(cell);
            if cell % 17 == 5 { f32::NAN } else { 3.0 * (0.7 * x).sin() + 2.0 * (0.5 * y).cos() }
        };
        let slopes = [
            |(_, x): (f32, f32)| -2.1 * (0.7 * x).cos(),
            |(y, _): (f32, f32)| -(0.5 * y).sin(),
            |_| 1.0,
        ];
        let normal =
            slopes.iter().flat_map(|slope| (0..rows * columns).map(move |c| slope(place(c))));
        ((0..rows * columns).map(height).collect(), normal.collect())
    }

    #[test]
    fn the_walls_of_a_groove_light_each_other_as_in_closed_form() {
        // Two walls at a right angle, each 16 cells of depth; a place i cells from the bottom sees of
        // the other wall `(1 - i / hypot(i, 16)) / 2` (Hottel's strings).
        const DEEP: usize = 16;
        let size = [201, 2 * DEEP + 1];
        let off = |cell: usize| (cell % size[1]) as f32 - DEEP as f32;
        let cells = 0..size[0] * size[1];
        let height: Vec<f32> = cells.clone().map(|cell| off(cell).abs()).collect();
        let across =
            cells.clone().map(|cell| if off(cell) == 0.0 { 0.0 } else { -off(cell).signum() });
        let upright = cells.clone().flat_map(|_| [0.0]).chain(cells.map(|_| 1.0));
        let normal: Vec<f32> = across.chain(upright).collect();
        let found = factors(&height, &normal, size);
        for i in 1..=DEEP {
            let lit = size[0] / 2 * size[1] + DEEP + i;
            let sum: f64 = row(&found, lit).map(|(_, share)| share).sum();
            let exact = 0.5 * (1.0 - i as f64 / (i as f64).hypot(DEEP as f64));
            // A step leads to the nearest cell, up to half of one beside the azimuth: some percent of
            // what an azimuth sees, of either sign, and 16 of them look at the other wall. It was up to
            // 0.8 %.
            assert!((sum / exact - 1.0).abs() < 0.02, "{i}: {sum} for {exact}");
        }
    }

    #[test]
    fn the_antiderivative_is_that_of_the_cosine_law() {
        const PIECES: usize = 2000;
        for (along, z) in [(0.6, 0.8), (-0.6, 0.8), (0.1, 0.02), (0.9, -0.3)] {
            let (low, high) = (-0.7_f64, 1.2_f64);
            let step = (high - low) / PIECES as f64;
            let sum: f64 = (0..PIECES)
                .map(|piece| low + (piece as f64 + 0.5) * step)
                .map(|e| (along * e.cos() + z * e.sin()) * e.cos() * step)
                .sum();
            let found = antiderivative(high.tan(), along, z) - antiderivative(low.tan(), along, z);
            // The midpoint rule: second derivatives of at most 4, times step^2 / 24.
            assert!((found - sum).abs() < 2.0 * step * step / 6.0, "{found} for {sum}");
        }
        assert!(
            (antiderivative(1e30, 0.6, 0.8) - 0.5 * (0.3 * core::f64::consts::PI + 0.8)).abs()
                < 1e-15
        );
    }

    #[test]
    fn a_hole_neither_lights_nor_is_lit() {
        let size = [12, 15];
        let (height, normal) = bumps(size);
        let found = factors(&height, &normal, size);
        assert!(found.cell.iter().all(|&cell| height[cell as usize].is_finite()));
        let mut seen = 0;
        for (lit, height) in height.iter().enumerate() {
            seen += row(&found, lit).count();
            assert!(height.is_finite() || row(&found, lit).count() == 0);
            assert!(row(&found, lit).is_sorted_by(|one, next| one.0 < next.0));
        }
        assert!(seen > height.len());
        assert_eq!(factors(&[f32::NAN], &[0.0, 0.0, 1.0], [1, 1]).first, [0, 0]);
    }

    #[test]
    fn what_is_gathered_is_the_sum_in_the_order_of_the_cells() {
        let size = [9, 11];
        let (height, normal) = bumps(size);
        let found = factors(&height, &normal, size);
        let cells = height.len();
        // More than one group, the last of them not full.
        let sent: Vec<f32> = (0..37 * cells).map(|i| (0.37 * i as f32).sin()).collect();
        let received = serially(|run| found.rows().gather(&sent, run)).unwrap();
        for (sent, received) in sent.chunks(cells).zip(received.chunks(cells)) {
            for (lit, &received) in received.iter().enumerate() {
                let expected = row(&found, lit)
                    .fold(0.0, |sum, (cell, share)| sum + share * f64::from(sent[cell]));
                assert_eq!(received, expected);
            }
        }
        assert!(serially(|run| found.rows().gather(&[], run)).unwrap().is_empty());
    }

    #[test]
    fn threads_change_no_bit() {
        let size = [23, 20];
        let (height, normal) = bumps(size);
        let sent = vec![0.3; 40 * height.len()];
        let alone = factors(&height, &normal, size);
        let pool = Pool::new(3).unwrap();
        let (cancel, progress) = (AtomicBool::new(false), Progress::default());
        let found = serially(|run| {
            let run = Run { pool: Some(&pool), cancel: &cancel, progress: &progress, ..*run };
            let found = FormFactors::new(&height, &normal, size, &run)?;
            let received = found.rows().gather(&sent, &run)?;
            Ok::<_, Error>((found, received))
        });
        let received = serially(|run| alone.rows().gather(&sent, run)).unwrap();
        assert_eq!(found.unwrap(), (alone, received));
    }

    #[test]
    fn both_stop_when_cancelled() {
        let size = [8, 6];
        let (height, normal) = bumps(size);
        let make = |run: &Run<'_>| FormFactors::new(&height, &normal, size, run);
        // Two looks at each row and one as it is joined.
        assert_eq!(looks::count(make), 3 * size[0]);
        let found = factors(&height, &normal, size);
        let sent = vec![1.0; 5 * TOGETHER * height.len()];
        assert_eq!(looks::count(|run| found.rows().gather(&sent, run)), 10);
        assert_eq!(looks::stopped_at(9, make), (Err(Error::Cancelled), 9));
    }

    #[test]
    fn sizes_that_disagree_are_refused() {
        let refused = |height: &[f32], normal: &[f32], size| {
            serially(|run| FormFactors::new(height, normal, size, run)).is_err()
        };
        assert!(refused(&[0.0; 5], &[0.0; 18], [2, 3]));
        assert!(refused(&[0.0; 6], &[0.0; 17], [2, 3]));
        assert!(refused(&[], &[], [0, 3]));
        let found = factors(&[0.0, 1.0], &[0.0, 0.0, 0.0, 0.0, 1.0, 1.0], [1, 2]);
        assert_eq!((&found.first[..], &found.cell[..]), (&[0, 1, 1][..], &[1][..]));
        assert!(serially(|run| found.rows().gather(&[1.0; 3], run)).is_err());
        for (first, cell) in
            [(&[0, 1, 1][..], &[2][..]), (&[0, 2, 1], &[1]), (&[0, 1], &[1]), (&[0, 0, 0], &[1])]
        {
            assert!(Rows::new(first, cell, &[0.5]).is_err(), "{first:?} {cell:?}");
        }
        assert!(Rows::new(&[], &[], &[]).is_err());
        assert!(Rows::new(&found.first, &found.cell, &found.share).is_ok());
    }
}
