//! Single precision first, double precision for problems whose result is doubtful.

use super::{Batch, Bounds, Column, Columns, Normal, Occupancy, Options, Outcome, Rows, fit};
use crate::math::{Level, Real};

/// Fits in single precision, then goes on in double precision from there wherever `doubtful` is
/// true of a single-precision outcome.
///
/// The batch's double-precision [`load`](Batch::load) is used for the numbers only: the start is
/// where single precision ended. [`store`](Batch::store) is called once per problem and precision,
/// the double-precision call last. Returns the occupancy of either.
pub fn fit_polished<B, const N: usize>(
    level: Level,
    batch: &mut B,
    problems: impl IntoIterator<Item = usize>,
    bounds: &Bounds<f64, N>,
    (single, double): (&Options, &Options),
    doubtful: impl Fn(&Outcome<f32, N>) -> bool,
) -> [Occupancy; 2]
where
    B: Batch<f32, N> + Batch<f64, N>,
{
    let narrow = |values: [f64; N]| values.map(|v| v as f32);
    let limits = Bounds { lower: narrow(bounds.lower), upper: narrow(bounds.upper) };
    let mut first = First { batch, doubtful, flagged: Vec::new() };
    let coarse = fit(level, &mut first, problems, &limits, single);
    let First { batch, flagged, .. } = first;
    let count = flagged.len();
    let fine = fit(level, &mut Second { batch, flagged }, 0..count, bounds, double);
    [coarse, fine]
}

/// Remembers whose single-precision outcome is in doubt.
struct First<'a, B, D, const N: usize> {
    batch: &'a mut B,
    doubtful: D,
    flagged: Vec<(usize, [f32; N])>,
}

impl<B: Batch<f32, N>, D: Fn(&Outcome<f32, N>) -> bool, const N: usize> Batch<f32, N>
    for First<'_, B, D, N>
{
    const COVARIANCE: bool = <B as Batch<f32, N>>::COVARIANCE;
    const INTERLEAVE: bool = <B as Batch<f32, N>>::INTERLEAVE;

    fn rows(&self) -> usize {
        self.batch.rows()
    }
    fn samples(&self, problem: usize) -> usize {
        self.batch.samples(problem)
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; N] {
        self.batch.load(problem, column)
    }
    fn load_rows(&mut self, columns: &mut Columns<'_, f32>) {
        self.batch.load_rows(columns);
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        self.batch.normal(rows, at)
    }
    #[inline(always)]
    fn visit<R: Real<Scalar = f32>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; N],
    ) -> ([R; N], Normal<R, N>) {
        self.batch.visit(rows, at)
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, N>) {
        if (self.doubtful)(outcome) {
            self.flagged.push((problem, outcome.parameters));
        }
        self.batch.store(problem, outcome);
    }
}

/// The doubtful ones, from where they were left.
struct Second<'a, B, const N: usize> {
    batch: &'a mut B,
    flagged: Vec<(usize, [f32; N])>,
}

impl<B: Batch<f64, N>, const N: usize> Batch<f64, N> for Second<'_, B, N> {
    const COVARIANCE: bool = B::COVARIANCE;
    const INTERLEAVE: bool = B::INTERLEAVE;

    fn rows(&self) -> usize {
        self.batch.rows()
    }
    fn samples(&self, problem: usize) -> usize {
        self.batch.samples(self.flagged[problem].0)
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f64>) -> [f64; N] {
        let (number, place) = self.flagged[problem];
        self.batch.load(number, column);
        place.map(f64::from)
    }
    fn load_rows(&mut self, columns: &mut Columns<'_, f64>) {
        let Self { batch, flagged } = self;
        columns.renumbered(|problem| flagged[problem].0, |columns| batch.load_rows(columns));
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f64>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        self.batch.normal(rows, at)
    }
    #[inline(always)]
    fn visit<R: Real<Scalar = f64>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; N],
    ) -> ([R; N], Normal<R, N>) {
        self.batch.visit(rows, at)
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f64, N>) {
        self.batch.store(self.flagged[problem].0, outcome);
    }
}
