//! Variable projection [@golub1973varpro]: a Levenberg-Marquardt search [@more1978levenberg] for
//! shapes and normal, with the colours eliminated in closed form.
//!
//! The unknowns are two tilts of the normal about its start, and the lobes' shapes. At every step
//! the colours of each band are the non-negative least-squares solution, so that the cost is that of
//! the best colours; its gradient is that with the colours held, and its matrix is the Schur
//! complement of the colours that are not 0 (Kaufman's approximation [@kaufman1975varpro]).

use core::cell::RefCell;

use crate::lm::{Batch, Bounds, Column, Normal, Options, Outcome, Reason, Rows, fit};
use crate::math::{Element, Level, Real, Scalar, Vec3};
use crate::sbrdf::pooled::tangents;

use super::bounds::{self, BandSamples, weight_at};
use super::model::{LobeEstimation, MAX_SHAPES, Visit};
use super::options::LobeOptions;
use super::photographs::Photographs;
use super::prior::ShapePrior;
use super::tile::{Estimate, TileSamples};

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
    pub(super) fn run(self) {
        M::dispatch(self.lobes, self);
    }

    fn seek<S: Element, const J: usize, const K: usize, const N: usize>(self) {
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
        let record = Lanes::<S, M, J, K, N>::RECORD;
        let numbers = record * self.photographs.len() * crate::math::lanes::MAX_LANES;
        let mut lanes = Lanes::<S, M, J, K, N> {
            photographs: self.photographs,
            samples: self.samples,
            x: self.x,
            y: self.y,
            barred: core::array::from_fn(|column| column == K - 1 && !self.ambient),
            typical: self.typical,
            starts: self.starts,
            found: self.found,
            scratch: RefCell::new(vec![S::zero(); numbers]),
            bounded: RefCell::default(),
        };
        fit(self.level, &mut lanes, self.pixels.iter().copied(), &bounds, self.options);
    }
}

impl<M: LobeEstimation> Visit for Search<'_, M> {
    type Output = ();

    fn visit<const J: usize, const K: usize, const N: usize>(self) {
        if self.double { self.seek::<f64, J, K, N>() } else { self.seek::<f32, J, K, N>() }
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
    /// Numbers per photograph: the diffuse column and its derivatives by two tilts, and for every
    /// lobe the same and its derivatives by its shape.
    const RECORD: usize = 3 * (J + 1) + J * M::SHAPES;

    /// Prior mean of an unknown that belongs to a shape, and its weight.
    fn typical(&self, pixel: usize, unknown: usize) -> [f32; 2] {
        let (lobe, shape) = ((unknown - 2) / M::SHAPES, (unknown - 2) % M::SHAPES);
        self.typical.map_or([0.0; 2], |typical| typical[pixel].0[lobe][shape])
    }

    /// Writes the columns of all photographs at given parameters to the scratch memory.
    #[inline(always)]
    fn look<R: Real<Scalar = S>>(
        &self,
        scratch: &mut [S],
        (x, y): (R, R),
        normal: Vec3<R>,
        tilts: [Vec3<R>; 2],
        at: &[R; N],
    ) {
        let zero = R::zero();
        // A loop: in `from_fn` the model is not inlined, nor are its intrinsics.
        let mut lobes = [self.photographs.model.lobe_from_unknowns([zero; MAX_SHAPES]); J];
        for (j, lobe) in lobes.iter_mut().enumerate() {
            let mut shape = [zero; MAX_SHAPES];
            shape[..M::SHAPES].copy_from_slice(&at[2 + j * M::SHAPES..][..M::SHAPES]);
            *lobe = self.photographs.model.lobe_from_unknowns(shape);
        }
        let records = scratch.chunks_exact_mut(Self::RECORD * R::WIDTH);
        for (photograph, out) in records.take(self.photographs.len()).enumerate() {
            let (towards, irradiance, pair) = self.photographs.at(photograph, x, y);
            let cosine = normal.dot(towards);
            let lit = R::keep(cosine.gt(zero), irradiance);
            let mut place = 0;
            let mut put = |value: R| {
                value.store(&mut out[place..]);
                place += R::WIDTH;
            };
            let diffuse = self.photographs.diffuse(normal, towards, &pair);
            put(diffuse.value * lit);
            put(tilts[0].dot(diffuse.normal) * lit);
            put(tilts[1].dot(diffuse.normal) * lit);
            for lobe in &lobes {
                let slope = self.photographs.model.slope(lobe, &pair, normal);
                put(slope.value * irradiance);
                put(tilts[0].dot(slope.normal) * irradiance);
                put(tilts[1].dot(slope.normal) * irradiance);
                for &by_shape in &slope.shape[..M::SHAPES] {
                    put(by_shape * irradiance);
                }
            }
        }
    }
}

/// The samples of a band beside what [`Lanes::look`] wrote.
#[derive(Clone, Copy)]
struct Records<'a, R: Real> {
    rows: Rows<'a, R>,
    bands: usize,
    band: usize,
    numbers: &'a [R::Scalar],
    photographs: usize,
    /// Numbers of a photograph, and of each lobe among them; a value comes before its derivatives.
    per_photograph: usize,
    per_lobe: usize,
}

impl<R: Real> Records<'_, R> {
    #[inline(always)]
    fn number(&self, photograph: usize, number: usize) -> R {
        R::load(&self.numbers[(photograph * self.per_photograph + number) * R::WIDTH..])
    }

    /// Place of a column among the numbers of a photograph.
    #[inline(always)]
    fn place(&self, column: usize) -> usize {
        if column == 0 { 0 } else { 3 + (column - 1) * self.per_lobe }
    }
}

impl<R: Real, const K: usize> BandSamples<R, K> for Records<'_, R> {
    #[inline(always)]
    fn photographs(&self) -> usize {
        self.photographs
    }

    #[inline(always)]
    fn at(&self, photograph: usize) -> ([R; K], R, R) {
        let mut columns = [R::one(); K];
        for (column, value) in columns[..K - 1].iter_mut().enumerate() {
            *value = self.number(photograph, self.place(column));
        }
        let plane = photograph * self.bands + self.band;
        let planes = self.photographs * self.bands;
        (columns, self.rows.get(planes + plane), self.rows.get(plane))
    }
}

/// The normal after two tilts about `start`, and its derivatives.
#[inline(always)]
fn tilted<R: Real>(start: Vec3<R>, p: R, q: R) -> (Vec3<R>, [Vec3<R>; 2]) {
    let [across, along] = tangents(start);
    let long = across.mul_add(p, along.mul_add(q, start));
    let shrink = long.length().recip();
    let normal = long.scale(shrink);
    let slopes = [
        normal.mul_add(-normal.dot(across), across).scale(shrink),
        normal.mul_add(-normal.dot(along), along).scale(shrink),
    ];
    (normal, slopes)
}

impl<S: Element, M: LobeEstimation, const J: usize, const K: usize, const N: usize> Batch<S, N>
    for Lanes<'_, S, M, J, K, N>
{
    const COVARIANCE: bool = true;

    fn rows(&self) -> usize {
        2 * self.samples.planes() + 5 + 2 * (N - 2)
    }

    fn load(&mut self, pixel: usize, column: &mut Column<'_, S>) -> [S; N] {
        let Estimate { normal: [nx, ny, nz], shapes, .. } = self.starts[pixel];
        let planes = self.samples.planes();
        let rest = [nx, ny, nz, self.x[pixel], self.y[pixel]];
        column.fill(self.samples.column(pixel).map(number));
        column.fill_from(planes, self.samples.weights_of(pixel).map(number));
        column.fill_from(2 * planes, rest.map(number));
        let typical = (2..N).flat_map(|unknown| self.typical(pixel, unknown));
        column.fill_from(2 * planes + rest.len(), typical.map(number));
        core::array::from_fn(|unknown| match unknown {
            0 | 1 => S::zero(),
            _ => number(shapes[(unknown - 2) / M::SHAPES][(unknown - 2) % M::SHAPES]),
        })
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        let zero = R::zero();
        let (planes, bands) = (self.samples.planes(), self.samples.bands);
        let rest = |number: usize| rows.get(2 * planes + number);
        let (normal, tilts) = tilted(Vec3::new(rest(0), rest(1), rest(2)), at[0], at[1]);
        let (mut scratch, mut bounded) = (self.scratch.borrow_mut(), self.bounded.borrow_mut());
        self.look(&mut scratch, (rest(3), rest(4)), normal, tilts, &at);
        let mut total = Normal::zero();
        for band in 0..bands {
            let seen = Records {
                rows,
                bands,
                band,
                numbers: &scratch,
                photographs: self.photographs.len(),
                per_photograph: Self::RECORD,
                per_lobe: 3 + M::SHAPES,
            };
            let (colours, _) = bounds::solve(&seen, &self.barred, &mut bounded);
            let mut mixed = [[zero; K]; N];
            for photograph in 0..seen.photographs {
                let (columns, weight, sample): ([R; K], R, R) = seen.at(photograph);
                let mut slope = [zero; N];
                let mut residual = sample - colours.values[K - 1];
                for column in 0..=J {
                    let colour = colours.values[column];
                    let get = |number| seen.number(photograph, seen.place(column) + number);
                    residual = (-colour).mul_add(columns[column], residual);
                    slope[0] = colour.mul_add(get(1), slope[0]);
                    slope[1] = colour.mul_add(get(2), slope[1]);
                    if column > 0 {
                        for s in 0..M::SHAPES {
                            slope[2 + (column - 1) * M::SHAPES + s] = colour * get(3 + s);
                        }
                    }
                }
                let weight = weight_at(weight, sample, sample - residual);
                let pull = weight * residual;
                total.cost = pull.mul_add(residual, total.cost);
                for i in 0..N {
                    total.descent[i] = pull.mul_add(slope[i], total.descent[i]);
                    let heavy = weight * slope[i];
                    for j in 0..=i {
                        total.matrix[i][j] = heavy.mul_add(slope[j], total.matrix[i][j]);
                    }
                    for column in 0..K {
                        mixed[i][column] = heavy.mul_add(columns[column], mixed[i][column]);
                    }
                }
            }
            for i in 0..N {
                let follow = colours.factor.solve(&mixed[i]);
                for j in 0..=i {
                    for column in 0..K {
                        total.matrix[i][j] =
                            (-mixed[j][column]).mul_add(follow[column], total.matrix[i][j]);
                    }
                }
            }
        }
        if self.typical.is_some() {
            for unknown in 2..N {
                let (typical, pull) = (rest(2 * unknown + 1), rest(2 * unknown + 2));
                let residual = pull * (typical - at[unknown]);
                total.cost = residual.mul_add(residual, total.cost);
                total.descent[unknown] = pull.mul_add(residual, total.descent[unknown]);
                total.matrix[unknown][unknown] = pull.mul_add(pull, total.matrix[unknown][unknown]);
            }
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

/// Root of the larger eigenvalue of a symmetric 2 x 2 matrix.
fn worst(xx: f32, xy: f32, yy: f32) -> f32 {
    let (middle, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    (middle + (half.mul_add(half, xy * xy)).sqrt()).sqrt()
}
