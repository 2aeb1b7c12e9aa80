//! Some lobes on a known normal, all at once: one search per number of lobes.
//!
//! The unknowns are `rho_d` and, for each lobe, its strength, its turn times n, and `ln n`. Seen
//! from the mirror to the normal a lobe's strength goes with `(1 + turn)^n`: what the samples tell
//! is `n turn`, and bounds on it hold for any n.

use crate::brdf::lafortune::{Lobe, Pair};
use crate::lm::{Batch, Bounds, Column, Columns, Normal, Occupancy, Options, Outcome, Rows, fit};
use crate::math::elementary::exp;
use crate::math::{Element, Level, Real, Scalar, Vec3};

use super::estimate::{MOST_LOBES, TURN};
use super::luminance::{Geometries, Luminance};

/// `ln n` of the widest and of the sharpest lobe: n = 1/2 is broader than a cosine, 22,000 sharper
/// than any that was measured.
pub(super) const LOG_EXPONENT: [f64; 2] = [-core::f64::consts::LN_2, 10.0];

/// Bounds of a search whose first unknowns are others.
pub(super) fn bounds<S: Element, const N: usize>(others: usize, turning: bool) -> Bounds<S, N> {
    let mut bounds = Bounds { lower: [S::zero(); N], upper: [S::MAX; N] };
    let turn = if turning { TURN } else { 0.0 };
    for unknown in (others + 1..N).step_by(3) {
        bounds.lower[unknown + 1] = S::from_f64(-turn);
        bounds.upper[unknown + 1] = S::from_f64(turn);
        [bounds.lower[unknown + 2], bounds.upper[unknown + 2]] = LOG_EXPONENT.map(S::from_f64);
    }
    bounds
}

/// A search for some pixels of [`Luminance`].
pub(super) struct LafortuneSearch<'a> {
    pub(super) data: &'a Luminance<'a>,
    /// Whether lobes may turn away from the mirror direction.
    pub(super) turning: bool,
    pub(super) level: Level,
    pub(super) options: &'a Options,
    /// How many photographs are looked at.
    pub(super) photographs: usize,
    /// Called before each pixel; true ends the search.
    pub(super) stopped: &'a (dyn Fn() -> bool + Sync),
}

impl LafortuneSearch<'_> {
    /// Fits the pixels from their starts and hands every end to `store`.
    pub(super) fn run<S: Element, const N: usize>(
        &self,
        pixels: &[usize],
        start: impl Fn(usize) -> [f64; N],
        store: impl FnMut(usize, &Outcome<S, N>),
    ) -> Occupancy {
        let bounds = bounds::<S, N>(0, self.turning);
        let geometries = Geometries::<S>::some(self.data.rig, self.photographs);
        let mut lanes = LafortuneBatch { data: self.data, geometries, pixels, start, store };
        let problems = (0..pixels.len()).take_while(|_| !(self.stopped)());
        fit(self.level, &mut lanes, problems, &bounds, self.options)
    }
}

struct LafortuneBatch<'a, S: Scalar, A, T> {
    data: &'a Luminance<'a>,
    geometries: Geometries<S>,
    pixels: &'a [usize],
    start: A,
    store: T,
}

impl<S, A, T, const N: usize> Batch<S, N> for LafortuneBatch<'_, S, A, T>
where
    S: Element,
    A: Fn(usize) -> [f64; N],
    T: FnMut(usize, &Outcome<S, N>),
{
    fn rows(&self) -> usize {
        self.geometries.rows()
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, S>) -> [S; N] {
        self.data.load(self.pixels[problem], &self.geometries, column);
        (self.start)(problem).map(S::from_f64)
    }
    fn load_rows(&mut self, columns: &mut Columns<'_, S>) {
        let pixels = self.pixels;
        self.data.load_rows(|problem| pixels[problem], &self.geometries, columns);
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        let count = self.geometries.len();
        let up = Vec3::new(rows.get(count), rows.get(count + 1), rows.get(count + 2));
        let shapes = Shapes::new(&at);
        self.geometries.equations(rows, |light, view, light_view, irradiance| {
            let mut pair = Pair::against(up, light, view, light_view);
            pair.cosine = pair.cosine * irradiance;
            let mut slope = [R::zero(); N];
            let [reflectance, _] = shapes.reflectance(&pair, &mut slope);
            (pair.cosine * reflectance, slope)
        })
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<S, N>) {
        (self.store)(problem, outcome);
    }
}

/// A diffuse part and lobes at some parameters.
pub(super) struct Shapes<R> {
    count: usize,
    diffuse: R,
    lobes: [Lobe<R>; MOST_LOBES],
    turns: [R; MOST_LOBES],
    widths: [R; MOST_LOBES],
}

impl<R: Real> Shapes<R> {
    /// From the diffuse strength, and strength, turn times n and `ln n` of each lobe.
    #[inline(always)]
    pub(super) fn new(at: &[R]) -> Self {
        let zero = R::zero();
        let mut all = Self {
            count: (at.len() - 1) / 3,
            diffuse: at[0],
            lobes: [Lobe::new(zero, zero, zero); MOST_LOBES],
            turns: [zero; MOST_LOBES],
            widths: [zero; MOST_LOBES],
        };
        for j in 0..all.count {
            all.widths[j] = exp(-at[3 + 3 * j]);
            all.turns[j] = at[2 + 3 * j] * all.widths[j];
            all.lobes[j] = Lobe::new(at[1 + 3 * j], all.turns[j], at[3 + 3 * j]);
        }
        all
    }

    /// Reflectance and how it changes with the normal, as [`Gradient`] has it; `slope` takes the
    /// derivatives of radiance in the order of the parameters.
    ///
    /// [`Gradient`]: crate::brdf::lafortune::Gradient
    #[inline(always)]
    pub(super) fn reflectance(&self, pair: &Pair<R>, slope: &mut [R]) -> [R; 2] {
        let (mut reflectance, mut bend) = (self.diffuse, R::zero());
        slope[0] = pair.cosine;
        for j in 0..self.count {
            let g = self.lobes[j].gradient(pair);
            reflectance = reflectance + g.value;
            bend = bend + g.normal;
            slope[1 + 3 * j] = pair.cosine * g.amplitude;
            slope[2 + 3 * j] = pair.cosine * g.turn * self.widths[j];
            slope[3 + 3 * j] = pair.cosine * (-self.turns[j]).mul_add(g.turn, g.log_exponent);
        }
        [reflectance, bend]
    }
}
