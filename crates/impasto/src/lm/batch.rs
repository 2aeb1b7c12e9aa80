//! Many problems by Levenberg-Marquardt, one per lane; a lane that has finished takes the next.

use core::array::from_fn;
use core::marker::PhantomData;

use super::search::{LmSearch, Outcomes};
use super::{Bounds, Normal, Options, Outcome};
use crate::math::lanes::{Element, Isa, MAX_LANES, put};
use crate::math::{Kernel, Level, Real, Scalar};

/// Many problems of one kind.
///
/// Each is a column of [`rows`](Self::rows) numbers (samples, weights, whatever differs from
/// problem to problem); what all of them share stays in the implementing type.
pub trait Batch<S: Scalar, const N: usize> {
    /// Whether matrices are inverted lane by lane as problems finish: [`Outcome::covariance`] and
    /// [`Outcome::deficient`] have the same bits without it, but take a fraction of the time with
    /// it where they are read for every problem.
    const COVARIANCE: bool = false;

    /// Whether two groups of lanes alternate where a block of rows is small (4 KB at most): while one
    /// group waits for divisions and roots of a step, the processor runs the pass of the other. Worth a tenth of the time where passes are as short as steps, as those over 16
    /// samples; compiled twice.
    const INTERLEAVE: bool = false;

    /// How many numbers a problem has.
    fn rows(&self) -> usize;

    /// Writes one problem's numbers to its column and returns the parameters to start from.
    fn load(&mut self, problem: usize, column: &mut Column<'_, S>) -> [S; N];

    /// Writes what [`load`](Self::load) has not written of the problems that begin together, row by
    /// row: where a number lies beside those of other problems, each line of memory is then fetched
    /// once for all of them. It comes after [`load`](Self::load) of each, and not where bounds are
    /// crossed and nothing is searched. The default writes nothing.
    fn load_rows(&mut self, _columns: &mut Columns<'_, S>) {}

    /// Number of samples of a problem, by whose root [`Options::offset`] is divided; not asked for where
    /// that is 0. The default, 1, leaves it a share of the residuals' length.
    fn samples(&self, _problem: usize) -> usize {
        1
    }

    /// Cost, gradient and matrix of all lanes at their parameters, in one pass over the rows.
    ///
    /// It must be `#[inline(always)]`, as all that it calls, and treat every lane by itself. Lanes
    /// that have nothing to do hold zeros or the numbers of a finished problem.
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, parameters: [R; N]) -> Normal<R, N>;

    /// [`normal`](Self::normal) for models that find a better place than the trial without
    /// another pass, as those with an amplitude can
    /// ([`Normal::project`]): the better place and the equations there. It must be
    /// `#[inline(always)]`, too.
    #[inline(always)]
    fn visit<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; N]) -> ([R; N], Normal<R, N>) {
        (at, self.normal(rows, at))
    }

    /// Takes one problem's result.
    fn store(&mut self, problem: usize, outcome: &Outcome<S, N>);
}

/// The memory of one problem: a lane of the block.
#[derive(Debug)]
pub struct Column<'a, S> {
    block: &'a mut [S],
    lane: usize,
    width: usize,
}

impl<S: Scalar> Column<'_, S> {
    /// Sets one number.
    ///
    /// # Panics
    /// If the problem has no such row.
    #[inline(always)]
    pub fn set(&mut self, row: usize, value: S) {
        self.block[row * self.width + self.lane] = value;
    }

    /// Sets the numbers from the first row on.
    #[inline(always)]
    pub fn fill(&mut self, values: impl IntoIterator<Item = S>) {
        self.fill_from(0, values);
    }

    /// Sets the numbers from a row on: several runs are quicker than a chain of iterators.
    ///
    /// # Panics
    /// If the row lies beyond the end.
    #[inline(always)]
    pub fn fill_from(&mut self, row: usize, values: impl IntoIterator<Item = S>) {
        let block = &mut self.block[row * self.width..];
        match self.width {
            16 => Self::fill_rows::<16>(block, self.lane, values),
            8 => Self::fill_rows::<8>(block, self.lane, values),
            4 => Self::fill_rows::<4>(block, self.lane, values),
            width => {
                for (row, value) in block.chunks_exact_mut(width).zip(values) {
                    row[self.lane] = value;
                }
            }
        }
    }

    /// [`fill_from`](Self::fill_from) where the compiler knows the width, and that the lane lies within.
    #[inline(always)]
    fn fill_rows<const WIDTH: usize>(
        block: &mut [S],
        lane: usize,
        values: impl IntoIterator<Item = S>,
    ) {
        for (row, value) in block.as_chunks_mut::<WIDTH>().0.iter_mut().zip(values) {
            put(&mut row[lane % WIDTH], value);
        }
    }
}

/// The memory of the problems that begin together: some lanes of the block.
#[derive(Debug)]
pub struct Columns<'a, S> {
    block: &'a mut [S],
    /// Lanes and their problems.
    lanes: &'a [(usize, usize)],
    width: usize,
}

impl<S> Columns<'_, S> {
    /// The same for a batch that has other numbers for these problems.
    pub(super) fn renumbered(
        &mut self,
        number: impl Fn(usize) -> usize,
        then: impl FnOnce(&mut Columns<'_, S>),
    ) {
        let mut lanes = [(0, 0); MAX_LANES];
        for (other, &(lane, problem)) in lanes.iter_mut().zip(self.lanes) {
            *other = (lane, number(problem));
        }
        let lanes = &lanes[..self.lanes.len()];
        then(&mut Columns { block: self.block, lanes, width: self.width });
    }
}

impl<S: Scalar> Columns<'_, S> {
    /// Sets the numbers of all these problems from a row on, by the items of an iterator: one for
    /// each row, of which `number` takes that of a problem.
    ///
    /// # Panics
    /// If the row lies beyond the end.
    #[inline(always)]
    pub fn fill_from<T>(
        &mut self,
        row: usize,
        items: impl IntoIterator<Item = T>,
        number: impl Fn(&T, usize) -> S,
    ) {
        let block = &mut self.block[row * self.width..];
        match self.width {
            16 => Self::fill_rows::<16, T>(block, self.lanes, items, number),
            8 => Self::fill_rows::<8, T>(block, self.lanes, items, number),
            4 => Self::fill_rows::<4, T>(block, self.lanes, items, number),
            width => {
                for (row, item) in block.chunks_exact_mut(width).zip(items) {
                    for &(lane, problem) in self.lanes {
                        row[lane] = number(&item, problem);
                    }
                }
            }
        }
    }

    /// [`fill_from`](Self::fill_from) where the compiler knows the width, and that lanes lie within.
    #[inline(always)]
    fn fill_rows<const WIDTH: usize, T>(
        block: &mut [S],
        lanes: &[(usize, usize)],
        items: impl IntoIterator<Item = T>,
        number: impl Fn(&T, usize) -> S,
    ) {
        for (row, item) in block.as_chunks_mut::<WIDTH>().0.iter_mut().zip(items) {
            for &(lane, problem) in lanes {
                put(&mut row[lane % WIDTH], number(&item, problem));
            }
        }
    }
}

/// The numbers of the problems that are in the lanes.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a, R: Real> {
    block: &'a [R::Scalar],
}

impl<R: Real> Rows<'_, R> {
    /// One row, all lanes.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    #[inline(always)]
    pub fn get(&self, row: usize) -> R {
        R::load(&self.block[row * R::WIDTH..])
    }
}

/// How busy the lanes were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Occupancy {
    /// Passes over all lanes, times the lanes.
    pub lanes: u64,
    /// Passes that a lane needed for its problem.
    pub useful: u64,
}

impl Occupancy {
    /// Share of the lanes that did something useful.
    #[must_use]
    pub fn efficiency(&self) -> f64 {
        if self.lanes == 0 { 1.0 } else { self.useful as f64 / self.lanes as f64 }
    }
}

/// Fits the named problems of a batch and hands each result to [`Batch::store`].
///
/// The only memory taken is a block of `rows * lanes` numbers per call, or two where they are small.
pub fn fit<S: Element, const N: usize>(
    level: Level,
    batch: &mut impl Batch<S, N>,
    problems: impl IntoIterator<Item = usize>,
    bounds: &Bounds<S, N>,
    options: &Options,
) -> Occupancy {
    let problems = problems.into_iter();
    if bounds.crossed() {
        let mut block = vec![S::default(); batch.rows()];
        for problem in problems {
            let start = batch.load(problem, &mut Column { block: &mut block, lane: 0, width: 1 });
            batch.store(problem, &Outcome::nowhere(start));
        }
        return Occupancy::default();
    }
    level.run(BatchFit { batch, problems, bounds, options, scalar: PhantomData::<S> })
}

struct BatchFit<'a, B, P, S, const N: usize> {
    batch: &'a mut B,
    problems: P,
    bounds: &'a Bounds<S, N>,
    options: &'a Options,
    scalar: PhantomData<S>,
}

impl<S: Element, B: Batch<S, N>, P: Iterator<Item = usize>, const N: usize> Kernel
    for BatchFit<'_, B, P, S, N>
{
    type Output = Occupancy;

    #[inline(always)]
    fn run<I: Isa>(self) -> Occupancy {
        let size = self.batch.rows() * S::Lanes::<I>::WIDTH;
        if B::INTERLEAVE && size * size_of::<S>() <= SMALL {
            self.search::<S::Lanes<I>, 2>(size)
        } else {
            self.search::<S::Lanes<I>, 1>(size)
        }
    }
}

impl<S: Scalar, B: Batch<S, N>, P: Iterator<Item = usize>, const N: usize>
    BatchFit<'_, B, P, S, N>
{
    /// All problems, in so many groups of lanes that alternate.
    #[inline(always)]
    fn search<R: Real<Scalar = S>, const GROUPS: usize>(self, size: usize) -> Occupancy {
        let Self { batch, mut problems, bounds, options, .. } = self;
        let mut groups: [Group<S, R, N>; GROUPS] = from_fn(|_| Group::idle(size, options));
        let mut outcomes = Outcomes::blank();
        let mut occupancy = Occupancy::default();
        loop {
            let mut running = false;
            for group in &mut groups {
                group.refill(batch, &mut problems, &mut outcomes, bounds, options);
                let Group { search, block, busy, .. } = group;
                if search.running() {
                    running = true;
                    let (place, next) = batch.visit(Rows { block }, search.trial);
                    search.accept(place, &next, options);
                    search.step(bounds, options);
                    occupancy.lanes += R::WIDTH as u64;
                    occupancy.useful += u64::from(busy.count_ones());
                }
            }
            if !running {
                return occupancy;
            }
        }
    }
}

/// Bytes of a block up to which two groups alternate. Larger blocks spend their time in passes:
/// problems of 100 samples lose some hundredths by alternating.
const SMALL: usize = 1 << 12;

/// Problems that are searched side by side.
struct Group<S, R: Real, const N: usize> {
    search: LmSearch<R, N>,
    block: Vec<S>,
    /// Which problem is in a lane, if the lane's bit says that one is.
    held: [usize; MAX_LANES],
    busy: u32,
}

impl<S: Scalar, R: Real<Scalar = S>, const N: usize> Group<S, R, N> {
    #[inline(always)]
    fn idle(size: usize, options: &Options) -> Self {
        let block = vec![S::default(); size];
        Self { search: LmSearch::idle(options), block, held: [0; MAX_LANES], busy: 0 }
    }

    /// Takes finished problems out of their lanes and puts the next ones in.
    #[inline(always)]
    fn refill<B: Batch<S, N>>(
        &mut self,
        batch: &mut B,
        problems: &mut impl Iterator<Item = usize>,
        outcomes: &mut Outcomes<S, N>,
        bounds: &Bounds<S, N>,
        options: &Options,
    ) {
        let Self { search, block, held, busy } = self;
        if !search.ended() {
            return;
        }
        search.write(outcomes, B::COVARIANCE);
        let mut starts = [[S::zero(); MAX_LANES]; N];
        let mut fresh = [S::zero(); MAX_LANES];
        let mut samples = [S::one(); MAX_LANES];
        let (mut begun, mut count) = ([(0, 0); MAX_LANES], 0);
        let mut ended = outcomes.ended(R::WIDTH);
        while ended != 0 {
            let lane = ended.trailing_zeros() as usize % MAX_LANES;
            ended &= ended - 1;
            if *busy >> lane & 1 == 1 {
                batch.store(held[lane], &outcomes.lane(lane, bounds, options));
                *busy ^= 1 << lane;
            }
            if let Some(problem) = problems.next() {
                held[lane] = problem;
                *busy |= 1 << lane;
                fresh[lane] = S::one();
                if options.offset > 0.0 {
                    samples[lane] = S::from_f64(batch.samples(problem).max(1) as f64);
                }
                let start = batch.load(problem, &mut Column { block, lane, width: R::WIDTH });
                for (starts, start) in starts.iter_mut().zip(start) {
                    starts[lane] = start;
                }
                begun[count] = (lane, problem);
                count += 1;
            }
        }
        if count > 0 {
            let lanes = &begun[..count];
            batch.load_rows(&mut Columns { block, lanes, width: R::WIDTH });
        }
        let mut start = [R::zero(); N];
        for (start, starts) in start.iter_mut().zip(&starts) {
            *start = R::load(starts);
        }
        let fresh = R::load(&fresh).gt(R::zero());
        search.begin(fresh, start, R::load(&samples), bounds, options);
    }
}
