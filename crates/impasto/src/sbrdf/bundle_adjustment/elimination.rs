//! The Schur complement of the unknowns of a pixel, and how these follow the numbers of the rig.
//!
//! With derivatives `U` by the unknowns of a pixel and `D` by the rig, the unknowns follow the rig by
//! `F = (U'U)^-1 U'D` of the photographs that are fitted. What is left of `D` in the photographs held
//! is `D - U F`, whose normal equations are `D'D - H - H'` with `H = F' (U'D - U'U F / 2)`. The
//! unknowns of different bands have no product, so `U'U` is an arrow: it is solved band by band.

#![allow(
    clippy::needless_range_loop,
    reason = "what adapters of iterators call does not have the kernel's instructions: twice the time"
)]

use nalgebra::{Matrix3, Vector3};

use super::samples::{Layout, OWN, PixelSamples, Row, SHARED};

/// Relative addition to the diagonal of the equations of a pixel, which what is not determined makes
/// singular.
const RIDGE: f64 = 1e-4;

type Square = [[f64; 3]; 3];

/// Sums of products over some photographs of a pixel.
struct Products {
    shared: Square,
    /// `(band, own, shared)`.
    cross: Vec<Square>,
    own: Vec<Square>,
    /// `(unknown, number)`: with the numbers of the rig, the errors as one more of them.
    by_rig: Vec<f64>,
}

impl Products {
    fn new(layout: Layout) -> Self {
        Self {
            shared: Square::default(),
            cross: vec![Square::default(); layout.bands],
            own: vec![Square::default(); layout.bands],
            by_rig: vec![0.0; layout.unknowns() * (layout.numbers() + 1)],
        }
    }

    /// The products of the photographs whose `held` is `which`.
    #[inline(always)]
    fn read(&mut self, pixel: &PixelSamples, held: &[bool], which: bool) {
        let layout @ Layout { bands, places, strengths, .. } = pixel.layout;
        let width = layout.numbers() + 1;
        self.shared = Square::default();
        self.cross.fill(Square::default());
        self.own.fill(Square::default());
        self.by_rig.fill(0.0);
        for observation in 0..held.len() {
            if held[observation] != which {
                continue;
            }
            for band in 0..bands {
                let number = observation * bands + band;
                let row = &pixel.rows[number];
                let by_place = pixel.places_of(number);
                let [cross, own] = [&mut self.cross[band], &mut self.own[band]];
                for i in 0..3 {
                    for j in 0..3 {
                        self.shared[i][j] += row.shared[i] * row.shared[j];
                        cross[i][j] += row.own[i] * row.shared[j];
                        own[i][j] += row.own[i] * row.own[j];
                    }
                }
                for k in 0..SHARED + OWN {
                    let (unknown, slope) = if k < SHARED {
                        (k, row.shared[k])
                    } else {
                        (k + OWN * band, row.own[k - SHARED])
                    };
                    let line = &mut self.by_rig[unknown * width..(unknown + 1) * width];
                    for place in 0..places {
                        line[place] += slope * by_place[place];
                    }
                    if strengths {
                        // A strength changes its own photograph alone.
                        line[places + observation] += slope * row.lamp;
                    }
                    line[width - 1] += slope * row.error;
                }
            }
        }
    }

    fn diagonal(&self, unknown: usize) -> f64 {
        match unknown.checked_sub(SHARED) {
            None => self.shared[unknown][unknown],
            Some(own) => self.own[own / OWN][own % OWN][own % OWN],
        }
    }
}

/// How the unknowns of a pixel follow the rig.
pub(super) struct Followed {
    layout: Layout,
    held: Products,
    fitted: Products,
    /// `(unknown, number)`: `F`, and `U'D - U'U F / 2`.
    follow: Vec<f64>,
    half: Vec<f64>,
    /// `(number)`: squares of the derivatives by the rig if nothing followed.
    alone: Vec<f64>,
    /// Whether any sample counts.
    any: bool,
}

impl Followed {
    pub(super) fn new(layout: Layout) -> Self {
        let size = layout.unknowns() * (layout.numbers() + 1);
        Self {
            layout,
            held: Products::new(layout),
            fitted: Products::new(layout),
            follow: vec![0.0; size],
            half: vec![0.0; size],
            alone: vec![0.0; layout.numbers()],
            any: false,
        }
    }

    /// Follows a pixel whose photographs `held` are to be explained.
    #[inline(always)]
    pub(super) fn solve(&mut self, pixel: &PixelSamples, held: &[bool]) {
        let all = held.iter().all(|&held| held);
        self.held.read(pixel, held, true);
        if !all {
            self.fitted.read(pixel, held, false);
        }
        self.any = pixel.rows.iter().any(|row| row.own[1] != 0.0 || row.lamp != 0.0);
        self.set_alone(pixel, held);
        let fitted = if all { &self.held } else { &self.fitted };
        let scale: Vec<f64> = (0..self.layout.unknowns())
            .map(|unknown| {
                // What shows in the photographs held alone, as a highlight may, does not follow.
                let more = if all { 0.0 } else { fitted.diagonal(unknown) };
                let size = (self.held.diagonal(unknown) + more).sqrt();
                if size > 0.0 { size } else { 1.0 }
            })
            .collect();
        follow(self.layout, fitted, &scale, all, &mut self.follow);
        self.set_half();
    }

    #[inline(always)]
    fn set_alone(&mut self, pixel: &PixelSamples, held: &[bool]) {
        let Layout { bands, places, strengths, .. } = self.layout;
        self.alone.fill(0.0);
        for observation in 0..held.len() {
            if !held[observation] {
                continue;
            }
            for number in observation * bands..(observation + 1) * bands {
                let by_place = pixel.places_of(number);
                for place in 0..places {
                    self.alone[place] += by_place[place] * by_place[place];
                }
                if strengths {
                    let lamp = pixel.rows[number].lamp;
                    self.alone[places + observation] += lamp * lamp;
                }
            }
        }
    }

    /// `U'D - U'U F / 2` of the photographs held.
    #[inline(always)]
    fn set_half(&mut self) {
        let Self { layout, held, follow, half, .. } = self;
        let width = layout.numbers() + 1;
        half.copy_from_slice(&held.by_rig);
        let mut take = |row: usize, column: usize, product: f64| {
            let line = &mut half[row * width..(row + 1) * width];
            add_line(line, -0.5 * product, &follow[column * width..]);
        };
        for s in 0..SHARED {
            for t in 0..SHARED {
                take(s, t, held.shared[s][t]);
            }
        }
        for (band, (cross, own)) in held.cross.iter().zip(&held.own).enumerate() {
            let first = SHARED + OWN * band;
            for k in 0..OWN {
                for s in 0..SHARED {
                    take(first + k, s, cross[k][s]);
                    take(s, first + k, cross[k][s]);
                }
                for l in 0..OWN {
                    take(first + k, first + l, own[k][l]);
                }
            }
        }
    }

    /// Sums of squares of what is left of the derivatives: by every inverse distance, and by all
    /// strengths together; `None` of a pixel without a sample that counts.
    #[inline(always)]
    pub(super) fn leverage(&self) -> Option<Vec<f64>> {
        let Self { layout, follow, half, alone, any, .. } = self;
        let width = layout.numbers() + 1;
        let mut left = alone.clone();
        for (follow, half) in follow.chunks_exact(width).zip(half.chunks_exact(width)) {
            for (left, (&follow, &half)) in left.iter_mut().zip(follow.iter().zip(half)) {
                *left -= 2.0 * follow * half;
            }
        }
        let lamps = left.split_off(layout.places).into_iter().sum();
        left.push(lamps);
        any.then_some(left)
    }
}

/// `F` of the scaled equations with a ridge, into `out`.
#[inline(always)]
fn follow(layout: Layout, fitted: &Products, scale: &[f64], errors: bool, out: &mut [f64]) {
    let width = layout.numbers() + 1;
    for ((out, line), scale) in
        out.chunks_exact_mut(width).zip(fitted.by_rig.chunks_exact(width)).zip(scale)
    {
        let shrink = scale.recip();
        for (out, &value) in out.iter_mut().zip(line) {
            *out = shrink * value;
        }
        if !errors {
            // Photographs that are fitted are at their least squares.
            out[width - 1] = 0.0;
        }
    }
    let (shared, own) = out.split_at_mut(SHARED * width);
    let scale_of = |first: usize| {
        Matrix3::from_diagonal(
            &Vector3::from_column_slice(&scale[first..first + OWN]).map(f64::recip),
        )
    };
    let ridge = Matrix3::identity() * RIDGE;
    let by_shared = scale_of(0);
    let mut complement = by_shared * matrix_of(&fitted.shared) * by_shared + ridge;
    let mut solved = Vec::with_capacity(layout.bands);
    for (band, lines) in own.chunks_exact_mut(OWN * width).enumerate() {
        let by_own = scale_of(SHARED + OWN * band);
        let inverse = inverted(&(by_own * matrix_of(&fitted.own[band]) * by_own + ridge));
        let cross = by_own * matrix_of(&fitted.cross[band]) * by_shared;
        multiply(&inverse, lines, width);
        subtract(shared, &cross.transpose(), lines, width);
        solved.push(inverse * cross);
        complement -= cross.transpose() * inverse * cross;
    }
    multiply(&inverted(&complement), shared, width);
    for (solved, lines) in solved.iter().zip(own.chunks_exact_mut(OWN * width)) {
        subtract(lines, solved, shared, width);
    }
    for (out, scale) in out.chunks_exact_mut(width).zip(scale) {
        let shrink = scale.recip();
        for value in out {
            *value *= shrink;
        }
    }
}

fn matrix_of(rows: &Square) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| rows[i][j])
}

/// The inverse of equations with a ridge; what has none, by an overflow, follows nothing.
#[inline(always)]
fn inverted(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    matrix.try_inverse().unwrap_or_else(Matrix3::zeros)
}

/// Replaces three lines by `matrix` times them.
#[inline(always)]
fn multiply(matrix: &Matrix3<f64>, lines: &mut [f64], width: usize) {
    let rows: Square = core::array::from_fn(|i| core::array::from_fn(|j| matrix[(i, j)]));
    let (first, rest) = lines.split_at_mut(width);
    let (second, third) = rest.split_at_mut(width);
    for i in 0..width {
        let [x, y, z] = [first[i], second[i], third[i]];
        first[i] = rows[0][0] * x + rows[0][1] * y + rows[0][2] * z;
        second[i] = rows[1][0] * x + rows[1][1] * y + rows[1][2] * z;
        third[i] = rows[2][0] * x + rows[2][1] * y + rows[2][2] * z;
    }
}

/// Subtracts `matrix` times three lines from three others.
#[inline(always)]
fn subtract(lines: &mut [f64], matrix: &Matrix3<f64>, others: &[f64], width: usize) {
    for i in 0..3 {
        for j in 0..3 {
            let line = &mut lines[i * width..(i + 1) * width];
            add_line(line, -matrix[(i, j)], &others[j * width..]);
        }
    }
}

/// Adds `factor` times a line to another.
#[inline(always)]
fn add_line(line: &mut [f64], factor: f64, other: &[f64]) {
    let other = &other[..line.len()];
    for i in 0..line.len() {
        line[i] += factor * other[i];
    }
}

/// Weights of pixels: bounded influence [@krasker1982bounded], as Mallows weighs.
///
/// A few pixels whose lobe the fitted photographs hardly determine would follow the rig without
/// bound, and the rig hardly move.
pub(super) fn bounded(leverage: &[Option<Vec<f64>>]) -> Vec<f64> {
    let known: Vec<&Vec<f64>> = leverage.iter().flatten().collect();
    let usual: Vec<f64> = (0..known.first().map_or(0, |first| first.len()))
        .map(|number| median(known.iter().map(|of| of[number]).collect()))
        .collect();
    let weight = |of: &Vec<f64>| {
        let times = of.iter().zip(&usual).filter(|(_, usual)| **usual > 0.0);
        times.map(|(of, usual)| of / usual).fold(1.0, f64::max).recip()
    };
    leverage.iter().map(|of| of.as_ref().map_or(1.0, weight)).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (low, high) = ((values.len() - 1) / 2, values.len() / 2);
    0.5 * (values[low] + values[high])
}

/// Normal equations of a rig: the inverse distances that are free, then the logarithms of strengths.
#[derive(Clone, Debug, PartialEq)]
pub struct RigEquations {
    /// Row by row; symmetric.
    pub matrix: Vec<f64>,
    /// As many numbers as it has rows.
    pub right: Vec<f64>,
}

/// Sums over pixels.
pub(super) struct Sums {
    layout: Layout,
    /// `D'D` above its diagonal, `(number, number)`.
    rig: Vec<f64>,
    /// `H`.
    half: Vec<f64>,
}

impl Sums {
    pub(super) fn new(layout: Layout) -> Self {
        let size = (layout.numbers() + 1).pow(2);
        Self { layout, rig: vec![0.0; size], half: vec![0.0; size] }
    }

    /// Adds a pixel that has followed the rig.
    #[inline(always)]
    pub(super) fn add_pixel(
        &mut self,
        pixel: &PixelSamples,
        followed: &Followed,
        held: &[bool],
        weight: f64,
    ) {
        if !followed.any {
            return;
        }
        let Layout { bands, places, strengths, .. } = self.layout;
        let width = self.layout.numbers() + 1;
        let last = width - 1;
        for observation in 0..held.len() {
            if !held[observation] {
                continue;
            }
            let lamp_at = places + observation;
            for number in observation * bands..(observation + 1) * bands {
                let Row { error, lamp, .. } = pixel.rows[number];
                let by_place = pixel.places_of(number);
                for i in 0..places {
                    let line = &mut self.rig[i * width..(i + 1) * width];
                    let heavy = weight * by_place[i];
                    for j in i..places {
                        line[j] += heavy * by_place[j];
                    }
                    line[last] += heavy * error;
                    if strengths {
                        line[lamp_at] += heavy * lamp;
                    }
                }
                if strengths {
                    let line = &mut self.rig[lamp_at * width..(lamp_at + 1) * width];
                    line[lamp_at] += weight * lamp * lamp;
                    line[last] += weight * lamp * error;
                }
            }
        }
        for unknown in 0..self.layout.unknowns() {
            let lines = unknown * width..(unknown + 1) * width;
            let (follow, half) = (&followed.follow[lines.clone()], &followed.half[lines]);
            for i in 0..width {
                let total = &mut self.half[i * width..(i + 1) * width];
                add_line(total, weight * follow[i], half);
            }
        }
    }

    /// Adds the sums of other pixels.
    pub(super) fn add(&mut self, other: &Self) {
        for (total, other) in [(&mut self.rig, &other.rig), (&mut self.half, &other.half)] {
            total.iter_mut().zip(other).for_each(|(total, other)| *total += other);
        }
    }

    /// The normal equations.
    pub(super) fn equations(&self) -> RigEquations {
        let numbers = self.layout.numbers();
        let width = numbers + 1;
        let left = |i: usize, j: usize| {
            let [above, below] = [i.min(j) * width + i.max(j), i.max(j) * width + i.min(j)];
            self.rig[above] - self.half[above] - self.half[below]
        };
        let matrix = (0..numbers).flat_map(|i| (0..numbers).map(move |j| left(i, j)));
        RigEquations {
            matrix: matrix.collect(),
            right: (0..numbers).map(|i| left(i, numbers)).collect(),
        }
    }
}
