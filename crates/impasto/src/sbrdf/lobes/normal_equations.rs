//! The normal equations of a pixel's normal and shapes with the colours of every band eliminated:
//! variable projection [@golub1973varpro] in Kaufman's approximation [@kaufman1975varpro].
//!
//! The unknowns are two tilts of the normal about its start, and the lobes' shapes. The colours of
//! each band are the non-negative least-squares solution, so that the cost is that of the best
//! colours; its gradient is that with the colours held, and its matrix is the Schur complement of the
//! colours that are not 0.

use crate::lm::Normal;
use crate::math::{Real, Vec3};
use crate::sbrdf::pooled::tangents;

use super::bounds::{self, BandSamples, weight_at};
use super::model::{LobeEstimation, MAX_SHAPES};
use super::photographs::Photographs;

/// Numbers per photograph: the diffuse column and its derivatives by two tilts, and for every lobe
/// the same and its derivatives by its shape.
pub(super) const fn record(lobes: usize, shapes: usize) -> usize {
    3 * (lobes + 1) + lobes * shapes
}

/// Where some pixels are looked at.
#[derive(Clone, Copy)]
pub(super) struct Place<R, const N: usize> {
    pub(super) x: R,
    pub(super) y: R,
    pub(super) normal: Vec3<R>,
    /// Derivatives of the normal by two tilts.
    pub(super) tilts: [Vec3<R>; 2],
    /// Two numbers that are not read, then the shapes.
    pub(super) shapes: [R; N],
    /// How many lobes each pixel has; the columns of others are 0.
    pub(super) lobes: R,
}

/// Writes the columns of all photographs and their derivatives to `numbers`: [`record`] numbers for
/// each, all lanes.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
pub(super) fn look<R: Real, M: LobeEstimation, const J: usize, const N: usize>(
    photographs: &Photographs<M>,
    numbers: &mut [R::Scalar],
    at: &Place<R, N>,
) {
    let zero = R::zero();
    // A loop: in `from_fn` the model is not inlined, nor are its intrinsics.
    let mut lobes = [photographs.model.lobe_from_unknowns([zero; MAX_SHAPES]); J];
    for j in 0..J {
        let mut shape = [zero; MAX_SHAPES];
        for s in 0..M::SHAPES {
            shape[s] = at.shapes[2 + j * M::SHAPES + s];
        }
        lobes[j] = photographs.model.lobe_from_unknowns(shape);
    }
    let records = numbers.chunks_exact_mut(record(J, M::SHAPES) * R::WIDTH);
    for (photograph, out) in records.take(photographs.len()).enumerate() {
        let (towards, irradiance, pair) = photographs.at(photograph, at.x, at.y);
        let faces = at.normal.dot(towards).gt(zero);
        let lit = R::keep(faces, irradiance);
        let diffuse = photographs.diffuse(at.normal, towards, &pair);
        // Not a negative value times 0: where weights divide by it, the sign of 0 counts.
        put(out, 0, R::keep(faces, diffuse.value * irradiance));
        put(out, 1, at.tilts[0].dot(diffuse.normal) * lit);
        put(out, 2, at.tilts[1].dot(diffuse.normal) * lit);
        for j in 0..J {
            let irradiance = R::keep(at.lobes.gt(R::of(j as f64)), irradiance);
            let slope = photographs.model.slope(&lobes[j], &pair, at.normal);
            let first = 3 + j * (3 + M::SHAPES);
            put(out, first, slope.value * irradiance);
            put(out, first + 1, at.tilts[0].dot(slope.normal) * irradiance);
            put(out, first + 2, at.tilts[1].dot(slope.normal) * irradiance);
            for s in 0..M::SHAPES {
                put(out, first + 3 + s, slope.shape[s] * irradiance);
            }
        }
    }
}

/// Stores one number of a photograph.
#[inline(always)]
fn put<R: Real>(out: &mut [R::Scalar], number: usize, value: R) {
    value.store(&mut out[number * R::WIDTH..]);
}

/// The samples of some pixels.
pub(super) trait PixelSamples<R> {
    /// Sample and weight in a plane; it must be `#[inline(always)]`.
    fn plane(&self, plane: usize) -> (R, R);
}

/// The samples of a band beside what [`look`] wrote.
#[derive(Clone, Copy)]
pub(super) struct Records<'a, R: Real, P> {
    pub(super) samples: P,
    pub(super) bands: usize,
    pub(super) band: usize,
    pub(super) numbers: &'a [R::Scalar],
    pub(super) photographs: usize,
    /// Lobes, and numbers of a shape.
    pub(super) lobes: usize,
    pub(super) shapes: usize,
}

impl<R: Real, P: PixelSamples<R>> Records<'_, R, P> {
    #[inline(always)]
    fn number(&self, photograph: usize, number: usize) -> R {
        let place = photograph * record(self.lobes, self.shapes) + number;
        R::load(&self.numbers[place * R::WIDTH..])
    }

    /// Place of a column among the numbers of a photograph; its derivatives come after it.
    #[inline(always)]
    fn place(&self, column: usize) -> usize {
        if column == 0 { 0 } else { 3 + (column - 1) * (3 + self.shapes) }
    }

    /// The diffuse column.
    #[inline(always)]
    pub(super) fn diffuse(&self, photograph: usize) -> R {
        self.number(photograph, 0)
    }
}

impl<R: Real, P: PixelSamples<R>, const K: usize> BandSamples<R, K> for Records<'_, R, P> {
    #[inline(always)]
    fn photographs(&self) -> usize {
        self.photographs
    }

    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn at(&self, photograph: usize) -> ([R; K], R, R) {
        let mut columns = [R::one(); K];
        for column in 0..K - 1 {
            columns[column] = self.number(photograph, self.place(column));
        }
        let (sample, weight) = self.samples.plane(photograph * self.bands + self.band);
        (columns, weight, sample)
    }
}

/// Adds the equations of one band with its best colours; the columns in `barred` stay 0, `bounded` is
/// scratch memory.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "triangles are written with their indices")]
pub(super) fn add_band<
    R: Real,
    M: LobeEstimation,
    P: PixelSamples<R>,
    const J: usize,
    const K: usize,
    const N: usize,
>(
    total: &mut Normal<R, N>,
    seen: &Records<'_, R, P>,
    barred: &[bool; K],
    bounded: &mut Vec<usize>,
) {
    let zero = R::zero();
    let (colours, _) = bounds::solve(seen, barred, bounded);
    let mut mixed = [[zero; K]; N];
    for photograph in 0..seen.photographs {
        let (columns, weight, sample): ([R; K], R, R) = seen.at(photograph);
        let mut slope = [zero; N];
        let mut residual = sample - colours.values[K - 1];
        for column in 0..=J {
            let colour = colours.values[column];
            let first = seen.place(column);
            residual = (-colour).mul_add(columns[column], residual);
            slope[0] = colour.mul_add(seen.number(photograph, first + 1), slope[0]);
            slope[1] = colour.mul_add(seen.number(photograph, first + 2), slope[1]);
            if column > 0 {
                for s in 0..M::SHAPES {
                    slope[2 + (column - 1) * M::SHAPES + s] =
                        colour * seen.number(photograph, first + 3 + s);
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

/// The prior of an unknown: its mean, and the standard deviation of a sample over the unknown's.
pub(super) type Pull<R> = [R; 2];

/// Adds the priors of the shapes.
#[inline(always)]
pub(super) fn add_priors<R: Real, const N: usize>(
    total: &mut Normal<R, N>,
    shapes: &[R; N],
    priors: &[Pull<R>; N],
) {
    for i in 2..N {
        let [typical, pull] = priors[i];
        let residual = pull * (typical - shapes[i]);
        total.cost = residual.mul_add(residual, total.cost);
        total.descent[i] = pull.mul_add(residual, total.descent[i]);
        total.matrix[i][i] = pull.mul_add(pull, total.matrix[i][i]);
    }
}

/// The normal after two tilts about `start`, and its derivatives.
#[inline(always)]
pub(super) fn tilted<R: Real>(start: Vec3<R>, p: R, q: R) -> (Vec3<R>, [Vec3<R>; 2]) {
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

/// Root of the larger eigenvalue of a symmetric 2 x 2 matrix.
#[inline(always)]
pub(super) fn worst<R: Real>(xx: R, xy: R, yy: R) -> R {
    let half = R::of(0.5);
    let (middle, apart) = (half * (xx + yy), half * (xx - yy));
    (middle + apart.mul_add(apart, xy * xy).sqrt()).sqrt()
}
