//! A Levenberg-Marquardt search [@more1978levenberg] for shapes and normals, with the colours
//! eliminated in closed form ([`normal_equations`](super::normal_equations)).

use core::cell::RefCell;

use crate::lm::{
    Batch, Bounds, Column, Columns, Normal, Occupancy, Options, Outcome, Reason, Rows, fit,
};
use crate::math::lanes::Isa;
use crate::math::{Element, Kernel, Level, Real, Scalar, Vec3};

use super::model::{LobeEstimation, Visit};
use super::normal_equations::{
    PixelSamples, Place, Pull, Records, add_band, add_priors, look, record, tilted, worst,
};
use super::options::LobeOptions;
use super::photographs::Photographs;
use super::prior::ShapePrior;
use super::tile::{Estimate, STRIDE, TILE, TileSamples};

/// Searches in single precision end where the next step would be shorter, in standard deviations: what is
/// left out adds half a per cent to the errors that noise makes.
const OFFSET: f64 = 0.1;

/// Largest tilt of one search: 1.4 rad, beyond which a camera sees no surface.
const STEEPEST: f64 = 6.0;

/// What a search may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Normals, and lobes no wider than [`LobeEstimation::widest_with_normal`].
    Bounded,
    /// Lobes, about fixed normals.
    Shapes,
    /// Normals, and lobes of any width.
    All,
}

impl Freedom {
    pub(super) fn of_options(options: &LobeOptions) -> Self {
        match (options.normal, options.bounded) {
            (true, true) => Self::Bounded,
            (true, false) => Self::All,
            (false, _) => Self::Shapes,
        }
    }
}

/// One search for many pixels with the same number of lobes.
///
/// Starts and results are always in single precision: a result that is off by a rounding raises the
/// cost by the square of that rounding.
pub(super) struct Search<'a, M: LobeEstimation> {
    pub(super) photographs: &'a Photographs<M>,
    pub(super) samples: &'a TileSamples,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) ambient: bool,
    pub(super) freedom: Freedom,
    /// The prior of each pixel's shapes; `None` during forward selection.
    pub(super) typical: Option<&'a [ShapePrior]>,
    /// The start of each pixel.
    pub(super) starts: &'a [Estimate],
    /// The best estimate so far; replaced where the search ends at a smaller cost.
    pub(super) found: &'a mut [Estimate],
    pub(super) pixels: &'a [usize],
    pub(super) lobes: usize,
    /// Whether it steps and sums in double precision.
    pub(super) double: bool,
    pub(super) options: &'a Options,
    pub(super) level: Level,
}

impl<M: LobeEstimation> Search<'_, M> {
    /// Returns the passes that it took: of all lanes, and of those at work.
    pub(super) fn run(self) -> [u64; 2] {
        let Occupancy { lanes, useful } = M::dispatch(self.lobes, self);
        [lanes, useful]
    }

    fn seek<S: Element, const J: usize, const K: usize, const N: usize>(self) -> Occupancy {
        let tilt = S::from_f64(if self.freedom == Freedom::Shapes { 0.0 } else { STEEPEST });
        let mut bounds = Bounds { lower: [-tilt; N], upper: [tilt; N] };
        let [mut lower, upper] = self.photographs.model.bounds();
        if self.freedom == Freedom::Bounded {
            lower = self.photographs.model.widest_with_normal();
        }
        for (unknown, shape) in (2..N).zip((0..M::SHAPES).cycle()) {
            bounds.lower[unknown] = S::from_f64(lower[shape]);
            bounds.upper[unknown] = S::from_f64(upper[shape]);
        }
        let numbers = record(J, M::SHAPES) * self.photographs.len() * crate::math::lanes::MAX_LANES;
        let mut lanes = Lanes::<S, M, J, K, N> {
            photographs: self.photographs,
            samples: self.samples,
            counts: if self.double {
                Vec::new() // nobody asks
            } else {
                self.level.run(Count { samples: self.samples, pixels: self.pixels })
            },
            x: self.x,
            y: self.y,
            barred: core::array::from_fn(|column| column == K - 1 && !self.ambient),
            typical: self.typical,
            starts: self.starts,
            found: self.found,
            scratch: RefCell::new(vec![S::zero(); numbers]),
            bounded: RefCell::default(),
        };
        let offset = if self.double { 0.0 } else { OFFSET };
        let options = &Options { offset, ..*self.options };
        fit(self.level, &mut lanes, self.pixels.iter().copied(), &bounds, options)
    }
}

impl<M: LobeEstimation> Visit for Search<'_, M> {
    type Output = Occupancy;

    fn visit<const J: usize, const K: usize, const N: usize>(self) -> Occupancy {
        if self.double { self.seek::<f64, J, K, N>() } else { self.seek::<f32, J, K, N>() }
    }
}

/// How many samples of some pixels, in rising order, have a weight above 0; numbers of other pixels of
/// the tile mean nothing.
struct Count<'a> {
    samples: &'a TileSamples,
    pixels: &'a [usize],
}

impl Kernel for Count<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<f32> {
        let (zero, one, width) = (I::F32::zero(), I::F32::one(), I::F32::WIDTH);
        let mut counts = vec![0.0; STRIDE];
        for some in self.pixels.chunk_by(|a, b| a / width == b / width) {
            let at = some[0] / width * width;
            let mut count = zero;
            for plane in 0..self.samples.planes() {
                let (_, weight) = self.samples.at::<I::F32>(plane, at);
                count = count + I::F32::keep(weight.gt(zero), one);
            }
            count.store(&mut counts[at..]);
        }
        counts
    }
}

/// A number of a tile in the precision of the search.
#[inline(always)]
fn number<S: Scalar>(value: f32) -> S {
    S::from_f64(f64::from(value))
}

struct Lanes<'a, S, M: LobeEstimation, const J: usize, const K: usize, const N: usize> {
    photographs: &'a Photographs<M>,
    samples: &'a TileSamples,
    /// How many samples of a pixel count.
    counts: Vec<f32>,
    x: &'a [f32],
    y: &'a [f32],
    barred: [bool; K],
    typical: Option<&'a [ShapePrior]>,
    starts: &'a [Estimate],
    found: &'a mut [Estimate],
    /// Columns and their derivatives, photograph by photograph, all lanes.
    scratch: RefCell<Vec<S>>,
    /// Photographs in which a sample is a bound.
    bounded: RefCell<Vec<usize>>,
}

impl<S: Element, M: LobeEstimation, const J: usize, const K: usize, const N: usize>
    Lanes<'_, S, M, J, K, N>
{
    /// Prior mean of an unknown that belongs to a shape, and its weight.
    fn typical(&self, pixel: usize, unknown: usize) -> [f32; 2] {
        let (lobe, shape) = ((unknown - 2) / M::SHAPES, (unknown - 2) % M::SHAPES);
        self.typical.map_or([0.0; 2], |typical| typical[pixel].0[lobe][shape])
    }
}

/// The samples in the lanes of a search, then their weights.
#[derive(Clone, Copy)]
struct Block<'a, R: Real> {
    rows: Rows<'a, R>,
    planes: usize,
}

impl<R: Real> PixelSamples<R> for Block<'_, R> {
    #[inline(always)]
    fn plane(&self, plane: usize) -> (R, R) {
        (self.rows.get(plane), self.rows.get(self.planes + plane))
    }
}

impl<S: Element, M: LobeEstimation, const J: usize, const K: usize, const N: usize> Batch<S, N>
    for Lanes<'_, S, M, J, K, N>
{
    const COVARIANCE: bool = true;

    fn rows(&self) -> usize {
        2 * self.samples.planes() + 5 + 2 * (N - 2)
    }

    fn samples(&self, pixel: usize) -> usize {
        self.counts[pixel] as usize
    }

    fn load(&mut self, pixel: usize, column: &mut Column<'_, S>) -> [S; N] {
        let Estimate { normal: [nx, ny, nz], shapes, .. } = self.starts[pixel];
        let planes = self.samples.planes();
        let rest = [nx, ny, nz, self.x[pixel], self.y[pixel]];
        column.fill_from(2 * planes, rest.map(number));
        let typical = (2..N).flat_map(|unknown| self.typical(pixel, unknown));
        column.fill_from(2 * planes + rest.len(), typical.map(number));
        core::array::from_fn(|unknown| match unknown {
            0 | 1 => S::zero(),
            _ => number(shapes[(unknown - 2) / M::SHAPES][(unknown - 2) % M::SHAPES]),
        })
    }

    fn load_rows(&mut self, columns: &mut Columns<'_, S>) {
        let TileSamples { samples, weights, .. } = self.samples;
        for (row, values) in [(0, samples), (self.samples.planes(), weights)] {
            let planes = values.as_chunks::<STRIDE>().0;
            columns.fill_from(row, planes, |plane, pixel| number(plane[pixel % TILE]));
        }
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        let (planes, bands) = (self.samples.planes(), self.samples.bands);
        let rest = |number: usize| rows.get(2 * planes + number);
        let (normal, tilts) = tilted(Vec3::new(rest(0), rest(1), rest(2)), at[0], at[1]);
        let (mut numbers, mut bounded) = (self.scratch.borrow_mut(), self.bounded.borrow_mut());
        let (x, y, lobes) = (rest(3), rest(4), R::of(J as f64));
        let place = Place { x, y, normal, tilts, shapes: at, lobes };
        look::<R, M, J, N>(self.photographs, &mut numbers, &place);
        let mut total = Normal::zero();
        for band in 0..bands {
            let seen = Records {
                samples: Block { rows, planes },
                bands,
                band,
                numbers: &numbers,
                photographs: self.photographs.len(),
                lobes: J,
                shapes: M::SHAPES,
            };
            add_band::<R, M, _, J, K, N>(&mut total, &seen, &self.barred, &mut bounded);
        }
        if self.typical.is_some() {
            let mut priors: [Pull<R>; N] = [[R::zero(); 2]; N];
            for i in 2..N {
                priors[i] = [rest(2 * i + 1), rest(2 * i + 2)];
            }
            add_priors(&mut total, &at, &priors);
        }
        total
    }

    fn store(&mut self, pixel: usize, outcome: &Outcome<S, N>) {
        let single = |value: S| value.to_f64() as f32;
        let cost = single(outcome.normal.cost);
        let better = outcome.reason != Reason::NotFinite && cost < self.found[pixel].cost;
        if !better {
            return;
        }
        let [x, y, z] = self.starts[pixel].normal.map(number);
        let [p, q, shapes @ ..] = outcome.parameters.as_slice() else { return };
        let (normal, _) = tilted(Vec3::new(x, y, z), *p, *q);
        let normal = normal.array().map(single);
        let mut estimate = Estimate { normal, lobes: J, cost, ..self.starts[pixel] };
        for (number, &shape) in shapes.iter().enumerate() {
            estimate.shapes[number / M::SHAPES][number % M::SHAPES] = single(shape);
        }
        estimate.converged = outcome.reason.converged();
        let covariance = outcome.covariance(S::one()).map(|row| row.map(single));
        estimate.normal_deviation = worst(covariance[0][0], covariance[1][0], covariance[1][1]);
        for lobe in 0..J {
            let unknown = 2 + lobe * M::SHAPES;
            let variance = covariance[unknown][unknown];
            estimate.shape_deviation[lobe] = variance.sqrt();
            // This variance combines the photographs with the prior: take the prior out.
            let [_, pull] = self.typical(pixel, unknown);
            let own = (-pull).mul_add(pull, variance.recip());
            estimate.own_deviation[lobe] = own.clamp(0.0, f32::INFINITY).sqrt().recip();
        }
        self.found[pixel] = estimate;
    }
}
