//! What [`Method::Robust`](super::Method) must know of a whole painting: two numbers, from a sample of its pixels.
//!
//! The typical scale of a pixel's residuals is the prior of empirical Bayes [@morris1983empirical]. The correlation
//! of the residuals between each light and its nearest ones shows errors of the model: zero or
//! less for noise.

use crate::geometry::Rig;
use crate::maps::Status;
use crate::math::real::{Mask, Part};
use crate::math::{Real, Vec3};

use super::lights::Lights;
use super::problem::Learned;
use super::rows::PlaneRows;
use super::sums::residual;

/// Neighbours of a light.
const NEAREST: f64 = 3.0;

/// All other lights of each light, the nearest first.
#[derive(Clone, Debug)]
pub(super) struct LightNeighbours(Vec<Vec<usize>>);

impl LightNeighbours {
    pub(super) fn new(rig: &Rig) -> Self {
        let directions: Vec<_> = rig.lights().iter().map(|l| l.direction().normalised()).collect();
        let nearest = |k: usize| {
            let mut others: Vec<_> = (0..directions.len()).filter(|&other| other != k).collect();
            others.sort_by(|&a, &b| {
                let [a, b] = [a, b].map(|other| directions[k].dot(directions[other]));
                b.total_cmp(&a)
            });
            others
        };
        Self((0..directions.len()).map(nearest).collect())
    }
}

/// Sums over pairs of neighbouring lights.
#[derive(Clone, Copy)]
pub(super) struct PairSums<R> {
    /// Products of both residuals, and what noise lacks of zero.
    products: R,
    /// Means of their squares.
    squares: R,
}

/// What a register of pixels says of the painting.
#[derive(Clone, Copy)]
pub(super) struct PixelStatistics<R> {
    /// 1 where it says anything.
    pub(super) known: R,
    pub(super) scale: R,
    pub(super) sums: PairSums<R>,
}

impl<R: Real<Scalar = f32>> PixelStatistics<R> {
    pub(super) fn none() -> Self {
        let zero = R::zero();
        Self { known: zero, scale: zero, sums: PairSums { products: zero, squares: zero } }
    }

    /// `known`, scale, products and squares.
    pub(super) fn planes(&self) -> [R; PLANES] {
        [self.known, self.scale, self.sums.products, self.sums.squares]
    }
}

/// Numbers per pixel.
pub(super) const PLANES: usize = 4;

/// The sums of [`PairSums`] over the used samples, in units of the brightness.
pub(super) struct Neighbours<'a, R: Real, L> {
    pub(super) pairs: &'a LightNeighbours,
    pub(super) lights: &'a L,
    pub(super) used: &'a [R::Mask],
    pub(super) valid: R,
    pub(super) signal: PlaneRows<'a>,
    pub(super) b: Vec3<R>,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> Part<R> for Neighbours<'_, R, L> {
    type Output = PairSums<R>;

    #[inline(always)]
    fn compute(self) -> PairSums<R> {
        let Self { pairs, lights, used, valid, signal, b } = self;
        let (zero, one) = (R::zero(), R::one());
        let per_length = b.length().recip();
        let part = UsedResiduals { lights, used, signal, b, per_length };
        let (mut products, mut squares) = (zero, zero);
        for (k, others) in pairs.0.iter().enumerate() {
            let own = part.at(k);
            let mut found = zero;
            for &other in others {
                let wanting = used[k] & found.lt(R::of(NEAREST));
                if !wanting.any() {
                    break;
                }
                let both = wanting & used[other];
                found = found + R::keep(both, one);
                let other = R::keep(both, part.at(other));
                let own = R::keep(both, own);
                products = own.mul_add(other, products);
                squares = own.mul_add(own, other.mul_add(other, squares));
            }
        }
        let squares = squares * R::of(0.5);
        // Residuals that satisfy three equations are correlated by -3 / n even if the noise is not.
        PairSums { products: (R::of(3.0) / valid).mul_add(squares, products), squares }
    }
}

/// Residuals in units of the brightness, 0 where a sample is not used. A method and not a closure,
/// which would become a call without the registers of a kernel.
struct UsedResiduals<'a, R: Real, L> {
    lights: &'a L,
    used: &'a [R::Mask],
    signal: PlaneRows<'a>,
    b: Vec3<R>,
    per_length: R,
}

impl<R: Real<Scalar = f32>, L: Lights<R>> UsedResiduals<'_, R, L> {
    #[inline(always)]
    fn at(&self, k: usize) -> R {
        let residual = residual(self.signal.at(k), self.lights.at(k), self.b);
        R::keep(self.used[k], residual * self.per_length)
    }
}

/// Both numbers, from the planes of a sample's pixels and whether each is estimated.
pub(super) fn learned(statistics: &[f32], status: &[u8]) -> Learned {
    let pixels = status.len();
    // Dark and undetermined pixels say nothing.
    let known: Vec<usize> = (0..pixels)
        .filter(|&pixel| status[pixel] < Status::Dark.code() && statistics[pixel] > 0.0)
        .collect();
    let plane = |plane: usize| known.iter().map(move |&pixel| statistics[pixel + plane * pixels]);
    let mut scales: Vec<f32> = plane(1).filter(|scale| scale.is_finite()).collect();
    let sum =
        |index: usize| -> f64 { plane(index).map(f64::from).filter(|one| one.is_finite()).sum() };
    let (products, squares) = (sum(2), sum(3));
    let correlation = if squares > 0.0 { (products / squares).clamp(0.0, 1.0) } else { 0.0 };
    Learned {
        scale: rounded(median(&mut scales)),
        correlation: (correlation * STEPS).round() / STEPS,
    }
}

/// Steps of the correlation. Both numbers are coarse: no pixel of a sample decides what others become.
const STEPS: f64 = 32.0;

/// The nearest number of four binary digits.
fn rounded(value: f64) -> f64 {
    const LOW: u64 = (1 << 49) - 1;
    f64::from_bits((value.to_bits() + LOW.midpoint(1)) & !LOW)
}

fn median(values: &mut [f32]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
