//! The horizon of each sample of a relief along sheared lines: the tangent to the upper hull of the
//! samples before it, kept as a stack [@timonen2010scalable].

use core::ops::Range;

use super::lines::{ABYSS, LineScratch, Lines, Span};
use crate::math::{Isa, Kernel, Level};

/// Memory of one worker.
#[derive(Debug, Default)]
pub(super) struct HullScratch {
    lines: LineScratch,
    seen: Seen,
}

/// Visits the pixels of a part, counted row by row, with the sine of their horizon, at least `floor`.
pub(super) fn sweep(
    lines: &Lines<'_>,
    (columns, rows): (Range<usize>, Range<usize>),
    floor: f32,
    span: Span,
    (scratch, level): (&mut HullScratch, Level),
    mut visit: impl FnMut(usize, f32),
) {
    let part = lines.part(columns.clone(), rows.clone());
    let (first, count) = lines.of(&part);
    let slope = f64::from(floor) / (1.0 - f64::from(floor).powi(2)).sqrt();
    let reach = if floor > 0.0 { span.reach(slope * lines.step) } else { None };
    let from = reach.map_or(0, |reach| part.steps.start.saturating_sub(reach));
    let HullScratch { lines: memory, seen } = scratch;
    // A line more on the left.
    let (start, count) = (first - 1, count + 1);
    seen.begin(count);
    let per = (1.0 / lines.step) as f32;
    let steps = from..part.steps.end;
    lines.walk((start, count), steps, memory, |step, fraction, row| {
        level.run(Onward { seen, row, fraction, place: step as f32 });
        if step < part.steps.start {
            return;
        }
        let (whole, _) = lines.displacement(step);
        let offset = (part.columns.start.cast_signed() - whole - start) as usize;
        let along = lines.row_at(step);
        let places = if lines.transposed {
            (along - columns.start, columns.len())
        } else {
            ((along - rows.start) * columns.len(), 1)
        };
        let lines = offset - 1..offset + part.columns.len();
        level.run(Horizon { seen, fraction, per, floor, lines, places, visit: &mut visit });
    });
}

/// What lines see behind them.
#[derive(Debug, Default)]
struct Seen {
    /// Of each line the upper hull of its samples: step and height, the nearest last.
    hulls: Vec<Vec<[f32; 2]>>,
    heights: Vec<f32>,
    /// How far what each sees at its horizon rises above it, NaN where there is nothing, and how many
    /// steps away that is.
    rises: Vec<f32>,
    away: Vec<f32>,
    sines: Vec<f32>,
}

impl Seen {
    /// So many lines that have seen nothing.
    fn begin(&mut self, count: usize) {
        self.hulls.resize(self.hulls.len().max(count), Vec::new());
        self.hulls.iter_mut().for_each(Vec::clear);
        for values in [&mut self.heights, &mut self.rises, &mut self.away, &mut self.sines] {
            values.resize(count, 0.0);
        }
    }
}

/// The next step of all lines.
struct Onward<'a> {
    seen: &'a mut Seen,
    /// The pixels left of the lines, and one more.
    row: &'a [f32],
    fraction: f32,
    /// The step.
    place: f32,
}

impl Kernel for Onward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { seen, row, fraction, place } = self;
        let Seen { hulls, heights, rises, away, .. } = seen;
        if fraction > 0.0 {
            for (height, pair) in heights.iter_mut().zip(row.windows(2)) {
                *height = pair[1].mul_add(fraction, pair[0] * (1.0 - fraction));
            }
        } else {
            let count = heights.len();
            heights.copy_from_slice(&row[..count]);
        }
        let horizons = rises.iter_mut().zip(away);
        for ((hull, &height), (rise, away)) in hulls.iter_mut().zip(&*heights).zip(horizons) {
            (*rise, *away) = (f32::NAN, 1.0);
            if height > 1e-10 * ABYSS {
                tangent(hull, place, height);
                if let Some(&[at, top]) = hull.last() {
                    (*rise, *away) = (top - height, place - at);
                }
                hull.push([place, height]);
            }
        }
    }
}

/// The horizons of the pixels between some lines at a step.
struct Horizon<'a, F> {
    seen: &'a mut Seen,
    fraction: f32,
    /// Steps per mm.
    per: f32,
    floor: f32,
    lines: Range<usize>,
    /// The number of the first pixel, and how far the next one lies.
    places: (usize, usize),
    visit: &'a mut F,
}

impl<F: FnMut(usize, f32)> Kernel for Horizon<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { seen, fraction, per, floor, lines, places: (first, apart), visit } = self;
        let Seen { rises, away, sines, .. } = seen;
        let (sines, rises) = (&mut sines[lines.clone()], &rises[lines.clone()]);
        for ((sine, &rise), &away) in sines.iter_mut().zip(rises).zip(&away[lines]) {
            let slope = rise / away * per;
            // The floor where there is no slope.
            *sine = (slope / slope.mul_add(slope, 1.0).sqrt()).max(floor);
        }
        for (index, pair) in sines.windows(2).enumerate() {
            // Between two equal horizons, such as the floor, exactly the same.
            let sine = fraction.mul_add(pair[0] - pair[1], pair[1]);
            visit(first + index * apart, sine);
        }
    }
}

/// Takes from a hull what lies below its tangent from a point after it.
#[inline(always)]
fn tangent(hull: &mut Vec<[f32; 2]>, place: f32, height: f32) {
    while let [.., [farther, high], [nearer, low]] = hull[..] {
        if (high - height) * (place - nearer) < (low - height) * (place - farther) {
            break;
        }
        hull.pop();
    }
}
