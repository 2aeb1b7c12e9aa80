//! Sums over pixels, and the normal equations that they make.

#![allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]

use super::elimination::Followed;
use super::samples::Layout;
use crate::math::Real;
use crate::math::lanes::MAX_LANES;

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
    /// `D'D` and the products with errors, as [`Layout::direct`] numbers them.
    direct: Vec<f64>,
    /// `H`, `(number, number)`, with rows and columns of zeros up to whole registers.
    half: Vec<f64>,
}

/// `F` times a pixel's weight, and `U'D - U'U F / 2`, of some pixels: `(pixel, unknown, number)`, with
/// zeros up to whole registers.
pub(super) struct Lines {
    follow: Vec<f64>,
    half: Vec<f64>,
}

impl Lines {
    pub(super) fn new(layout: Layout, pixels: usize) -> Self {
        let size = pixels * layout.unknowns() * stride(layout);
        Self { follow: vec![0.0; size], half: vec![0.0; size] }
    }
}

/// Numbers of the rig, and the errors, up to whole pairs of registers.
fn stride(layout: Layout) -> usize {
    layout.columns().next_multiple_of(2 * MAX_LANES)
}

impl Sums {
    pub(super) fn new(layout: Layout) -> Self {
        let direct = vec![0.0; layout.direct_products()];
        Self { layout, direct, half: vec![0.0; stride(layout).pow(2)] }
    }

    /// Adds the pixels in the first lanes, as many as there are weights, which have followed the rig.
    ///
    /// Pixel by pixel, in their order: the sums do not depend on how many lanes there are.
    #[inline(always)]
    pub(super) fn add_pixels<R: Real<Scalar = f64>>(
        &mut self,
        followed: &Followed<R>,
        weights: &[f64],
        lines: &mut Lines,
    ) {
        let mut lanes = [0.0; MAX_LANES];
        for at in 0..self.direct.len() {
            followed.direct[at].store(&mut lanes);
            for lane in 0..weights.len() {
                self.direct[at] = weights[lane].mul_add(lanes[lane], self.direct[at]);
            }
        }
        let (unknowns, stride) = (self.layout.unknowns(), stride(self.layout));
        for number in 0..self.layout.columns() {
            for unknown in 0..unknowns {
                let from = number * unknowns + unknown;
                followed.follow[from].store(&mut lanes);
                for lane in 0..weights.len() {
                    let to = (lane * unknowns + unknown) * stride + number;
                    lines.follow[to] = weights[lane] * lanes[lane];
                }
                followed.half[from].store(&mut lanes);
                for lane in 0..weights.len() {
                    lines.half[(lane * unknowns + unknown) * stride + number] = lanes[lane];
                }
            }
        }
        let count = weights.len() * unknowns * stride;
        let lines = [&lines.follow[..count], &lines.half[..count]];
        add_products::<R>(&mut self.half, lines, [self.layout.columns(), stride]);
    }

    /// Adds the sums of other pixels.
    pub(super) fn add(&mut self, other: &Self) {
        for (total, other) in [(&mut self.direct, &other.direct), (&mut self.half, &other.half)] {
            total.iter_mut().zip(other).for_each(|(total, other)| *total += other);
        }
    }

    /// The normal equations.
    pub(super) fn equations(&self) -> RigEquations {
        let layout = self.layout;
        let (numbers, stride) = (layout.numbers(), stride(layout));
        let left = |i: usize, j: usize| {
            let (i, j) = (i.min(j), i.max(j));
            let direct =
                if layout.share_samples(i, j) { self.direct[layout.direct(i, j)] } else { 0.0 };
            direct - self.half[i * stride + j] - self.half[j * stride + i]
        };
        let matrix = (0..numbers).flat_map(|i| (0..numbers).map(move |j| left(i, j)));
        RigEquations {
            matrix: matrix.collect(),
            right: (0..numbers).map(|i| left(i, numbers)).collect(),
        }
    }
}

/// Rows of a block of the product.
const ROWS: usize = 4;

/// Adds `left' right` to a square matrix of some rows and columns. All lines are `stride` long. Four
/// rows and two registers of columns at a time stay in registers.
#[inline(always)]
fn add_products<R: Real<Scalar = f64>>(
    total: &mut [f64],
    [left, right]: [&[f64]; 2],
    [count, stride]: [usize; 2],
) {
    for column in (0..count).step_by(2 * R::WIDTH) {
        for row in (0..count).step_by(ROWS) {
            let mut sums = [[R::zero(); 2]; ROWS];
            for i in 0..ROWS {
                let own = &total[(row + i) * stride + column..];
                sums[i] = [R::load(own), R::load(&own[R::WIDTH..])];
            }
            for (left, right) in left.chunks_exact(stride).zip(right.chunks_exact(stride)) {
                let right = &right[column..column + 2 * R::WIDTH];
                let right = [R::load(right), R::load(&right[R::WIDTH..])];
                let left = &left[row..row + ROWS];
                for i in 0..ROWS {
                    let factor = R::splat(left[i]);
                    sums[i][0] = factor.mul_add(right[0], sums[i][0]);
                    sums[i][1] = factor.mul_add(right[1], sums[i][1]);
                }
            }
            for i in 0..ROWS {
                let own = &mut total[(row + i) * stride + column..];
                sums[i][0].store(own);
                sums[i][1].store(&mut own[R::WIDTH..]);
            }
        }
    }
}
