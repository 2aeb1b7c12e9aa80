//! Sheared lines over a relief: the samples that sweeps along a direction go through.
//!
//! The rows (or columns, whichever the direction is closer to crossing) are walked along lines: line
//! c runs through `column = c + m * step`, one row per step, m in [-1, 1]. On it the height is
//! interpolated linearly between the two neighbouring pixels of the row. Lines and steps are numbered
//! in the whole picture: a part of it has the samples that the whole has, to the bit.
//!
//! Beyond the border the relief goes on at the border's height for one pixel, and is the abyss after
//! that. Columns that are walked as rows are transposed some steps at a time: no second map is made.

use core::ops::Range;

use crate::geometry::Grid;

/// Far below any painting: what is hidden by nothing and hides nothing. Finite, so that interpolating
/// towards it gives no NaN.
pub(crate) const ABYSS: f32 = -1e30;

/// Steps that are transposed together: of a row of the picture two lines of the cache.
const BATCH: usize = 32;

/// The lines that a direction in the plane of the painting makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lines<'a> {
    relief: &'a [f32],
    /// Columns of the picture.
    columns: usize,
    /// Whether columns of the picture are walked as rows.
    pub(crate) transposed: bool,
    /// Whether the walk goes up, towards smaller rows.
    upwards: bool,
    /// Columns and rows as they are walked.
    pub(crate) width: usize,
    pub(crate) steps: usize,
    /// Columns per row walked, away from what the lines come from.
    shear: f64,
    /// Width of a step along the line, mm.
    pub(crate) step: f64,
}

/// Rows that are not rows of the picture, and pieces of rows at its border.
#[derive(Debug, Default)]
pub(crate) struct LineScratch {
    transposed: Vec<f32>,
    padded: Vec<f32>,
}

/// A part of the picture as it is walked.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    pub(crate) columns: Range<usize>,
    pub(crate) steps: Range<usize>,
}

impl<'a> Lines<'a> {
    /// Lines that come from the direction `(x, y)`, not both 0, of the world.
    pub(crate) fn new(relief: &'a [f32], grid: Grid, [x, y]: [f64; 2]) -> Self {
        // Rows run down, y runs up.
        let (across, down) = (x, -y);
        let transposed = across.abs() > down.abs();
        let (across, along) = if transposed { (down, across) } else { (across, down) };
        let [width, steps] =
            if transposed { [grid.height, grid.width] } else { [grid.width, grid.height] };
        let shear = -across / along.abs();
        let step = grid.pitch * shear.mul_add(shear, 1.0).sqrt();
        Self {
            relief,
            columns: grid.width,
            transposed,
            upwards: along > 0.0,
            width,
            steps,
            shear,
            step,
        }
    }

    /// The row (or column) of a step.
    pub(crate) fn row_at(&self, step: usize) -> usize {
        if self.upwards { self.steps - 1 - step } else { step }
    }

    /// Whole and fractional columns by which lines are displaced after so many rows.
    pub(crate) fn displacement(&self, step: usize) -> (isize, f32) {
        let shift = self.shear * step as f64;
        let whole = shift.floor();
        (whole as isize, (shift - whole) as f32)
    }

    /// The first line that meets the picture anywhere, and how many do, with neighbours for
    /// interpolation.
    pub(crate) fn all(&self) -> (isize, usize) {
        let (last, _) = self.displacement(self.steps - 1);
        let (first, end) = ((-last).min(0) - 2, self.width.cast_signed() - last.min(0) + 1);
        (first, (end - first) as usize)
    }

    /// The first and the number of lines right of the pixels of a part. (A pixel lies between the line
    /// `column - whole` and the one before it.)
    pub(crate) fn of(&self, part: &Part) -> (isize, usize) {
        let [one, other] =
            [part.steps.start, part.steps.end - 1].map(|step| self.displacement(step).0);
        let first = part.columns.start.cast_signed() - one.max(other);
        let end = part.columns.end.cast_signed() - one.min(other);
        (first, (end - first) as usize)
    }

    /// `columns` and `rows` of the picture as they are walked.
    pub(crate) fn part(&self, columns: Range<usize>, rows: Range<usize>) -> Part {
        let (columns, rows) = if self.transposed { (rows, columns) } else { (columns, rows) };
        let steps =
            if self.upwards { self.steps - rows.end..self.steps - rows.start } else { rows };
        Part { columns, steps }
    }

    /// Visits every step with its fraction and, for so many lines from `start` on, the pixels left of
    /// them, and one more.
    pub(crate) fn walk(
        &self,
        (start, count): (isize, usize),
        steps: Range<usize>,
        scratch: &mut LineScratch,
        mut visit: impl FnMut(usize, f32, &[f32]),
    ) {
        let LineScratch { transposed, padded } = scratch;
        padded.resize(count + 1, 0.0);
        for first in steps.clone().step_by(BATCH) {
            let batch = first..steps.end.min(first + BATCH);
            let shifts = [first, batch.end - 1].map(|step| start + self.displacement(step).0);
            let last = self.width.cast_signed() - 1;
            let low = shifts[0].min(shifts[1]).clamp(0, last) as usize;
            let high = (shifts[0].max(shifts[1]) + count.cast_signed()).clamp(0, last) as usize + 1;
            if self.transposed {
                self.transpose(&batch, low..high, transposed);
            }
            for step in batch {
                let (whole, fraction) = self.displacement(step);
                let row = if self.transposed {
                    &transposed[(step - first) * (high - low)..][..high - low]
                } else {
                    &self.relief[self.row_at(step) * self.width..][low..high]
                };
                let left = start + whole - low.cast_signed();
                let inside = left >= 0 && left as usize + count < row.len();
                if inside {
                    visit(step, fraction, &row[left as usize..=left as usize + count]);
                } else {
                    self.extend(row, low, start + whole, padded);
                    visit(step, fraction, padded);
                }
            }
        }
    }

    /// Some columns of the picture, from row `rows.start` to `rows.end`, as rows.
    fn transpose(&self, batch: &Range<usize>, rows: Range<usize>, out: &mut Vec<f32>) {
        let width = rows.len();
        out.resize(BATCH * width, 0.0);
        let places = [batch.start, batch.end - 1].map(|step| self.row_at(step));
        let (first, end) = (places[0].min(places[1]), places[0].max(places[1]) + 1);
        for (index, row) in rows.enumerate() {
            let values = &self.relief[row * self.columns..][first..end];
            let places = out[index..].iter_mut().step_by(width);
            if self.upwards {
                places.zip(values.iter().rev()).for_each(|(out, &value)| *out = value);
            } else {
                places.zip(values).for_each(|(out, &value)| *out = value);
            }
        }
    }

    /// A piece of a row from column `left` on; the border's height one pixel beyond it, the abyss
    /// after that. `row` begins at column `low`.
    fn extend(&self, row: &[f32], low: usize, left: isize, out: &mut [f32]) {
        let width = self.width.cast_signed();
        for (index, out) in out.iter_mut().enumerate() {
            let column = left + index.cast_signed();
            *out = if column < -1 || column > width {
                ABYSS
            } else {
                row[column.clamp(0, width - 1) as usize - low]
            };
        }
    }
}

/// The lowest and the highest number of a relief, and whether it has gaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// mm.
    pub lowest: f32,
    /// mm.
    pub highest: f32,
    /// Whether some height is no finite number.
    pub gaps: bool,
}

impl Span {
    /// Of a map, or a piece of one.
    #[must_use]
    pub fn of(relief: &[f32]) -> Self {
        let start = Self { lowest: f32::MAX, highest: f32::MIN, gaps: false };
        relief.iter().fold(start, |span, &height| {
            let gap = !height.is_finite();
            Self {
                lowest: if gap { span.lowest } else { span.lowest.min(height) },
                highest: if gap { span.highest } else { span.highest.max(height) },
                gaps: span.gaps | gap,
            }
        })
    }

    /// Of both.
    #[must_use]
    pub fn joined(self, other: Self) -> Self {
        Self {
            lowest: self.lowest.min(other.lowest),
            highest: self.highest.max(other.highest),
            gaps: self.gaps | other.gaps,
        }
    }

    /// How many rows a height can be carried, falling by `fall` per row, before any other height of
    /// the relief is above it, by single-precision arithmetic. None: no number of rows is proven.
    ///
    /// A subtraction rounds by at most half a unit of the last place of what is at most
    /// `size = max |h| + fall`; interpolation rounds twice. Across a gap nothing is carried on by the
    /// height next to it, so that a relief with gaps has no such number.
    pub(crate) fn reach(&self, fall: f64) -> Option<usize> {
        const UNIT: f64 = 0.5 * f32::EPSILON as f64;
        if self.gaps {
            return None;
        }
        let size = f64::from(self.lowest.abs().max(self.highest.abs()));
        let height = f64::from(self.highest) - f64::from(self.lowest) + 8.0 * UNIT * size;
        let fall = fall - 2.0 * UNIT * (size + fall);
        let rows = height / fall;
        (fall > 0.0 && rows < 1e9).then(|| rows.ceil() as usize + 2)
    }
}
