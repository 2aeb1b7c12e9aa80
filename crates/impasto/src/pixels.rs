//! Work over many pixels: tiles, threads, cancelling and progress.
//!
//! The only file that names rayon. Tiles are closed computations that write to disjoint memory,
//! and whatever is summed over pixels is summed tile by tile in tile order: no result depends on
//! the number of threads or on which thread did what.
//!
//! A call stops at the next check of its cancel flag: after a tile, or within it where a tile of
//! hundreds of photographs takes long ([`Run::cancelled`]). Work as large as the picture, such as a
//! copy or a sum, checks the flag as well ([`Run::in_turn`]).

use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::{Error, Result};
use crate::math::Level;
use crate::math::lanes::{LINE, MAX_LANES};
use crate::passes::Passes;

/// Pixels of a tile: 16 photographs of 16 bits are 128 KiB, which stay in the second-level cache
/// while the outputs of one tile are written; and a megapixel makes enough tiles for any core.
pub const TILE: usize = 4096;

/// Samples from one plane of a tile to the next: the tile's pixels and a line of the cache, for planes
/// a power of two apart would share the few lines of one of its sets.
pub(crate) const fn stride(tile: usize) -> usize {
    tile + LINE / size_of::<f32>()
}

/// Threads that belong to the caller; the process-wide pool is never used.
#[derive(Debug)]
pub struct Pool(rayon::ThreadPool);

impl Pool {
    /// A pool of so many threads.
    ///
    /// # Errors
    /// If the system refuses to start them.
    pub fn new(threads: usize) -> Result<Self> {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|index| format!("impasto-{index}"))
            .build()
            .map(Self)
            .map_err(|error| Error::argument("threads", format!("cannot start {threads}: {error}")))
    }

    fn threads(&self) -> usize {
        self.0.current_num_threads()
    }

    /// Not generic: what a call to rayon needs is compiled once, not for every kind of tile.
    fn on_every_thread(&self, work: &(dyn Fn() + Sync)) {
        self.0.broadcast(|_| work());
    }
}

/// How far a call has come.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    total: AtomicUsize,
    /// What the passes were for.
    pub passes: Passes,
    #[cfg(test)]
    looks: looks::Looks,
}

impl Progress {
    /// With a clock for its passes: the nanoseconds since some moment.
    #[must_use]
    pub fn timed(clock: fn() -> u64) -> Self {
        Self { passes: Passes::timed(clock), ..Self::default() }
    }

    /// Tiles done and tiles known so far.
    #[must_use]
    pub fn get(&self) -> (usize, usize) {
        (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed))
    }
}

/// Circumstances of a call: they change how fast it runs, never what it returns.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Threads; none means the caller's own.
    pub pool: Option<&'a Pool>,
    /// Instruction set.
    pub level: Level,
    /// Set by the caller to stop the call at the next look.
    pub cancel: &'a AtomicBool,
    /// Counted up as tiles finish.
    pub progress: &'a Progress,
}

impl Run<'_> {
    /// Whether the caller asked to stop.
    #[must_use]
    pub fn cancelled(&self) -> bool {
        #[cfg(test)]
        if self.progress.looks.add() {
            return true;
        }
        self.cancel.load(Ordering::Relaxed)
    }

    /// How many pixels a piece of work has where so many are cut into pieces of at most `most`, and
    /// every thread gets as many pieces as the others.
    ///
    /// Samples of some hundred pixels are less than one of the largest pieces for every thread. Only
    /// for work whose results do not depend on the pieces.
    pub(crate) fn piece(&self, pixels: usize, most: usize) -> usize {
        let threads = self.pool.map_or(1, Pool::threads);
        let pieces = pixels.div_ceil(most).max(1).next_multiple_of(threads);
        pixels.div_ceil(pieces).max(MAX_LANES.min(most))
    }

    fn look(&self) -> Result<()> {
        if self.cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Applies `body` to one piece of work after another on the caller's thread: what has an order,
    /// or is too little to be shared.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop before the last piece.
    pub fn in_turn<T>(
        &self,
        pieces: impl IntoIterator<Item = T>,
        mut body: impl FnMut(T),
    ) -> Result<()> {
        pieces.into_iter().try_for_each(|piece| self.look().map(|()| body(piece)))
    }

    /// A copy of a map.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop.
    pub fn copied<T: Copy>(&self, map: &[T]) -> Result<Vec<T>> {
        check_room::<T>(map.len())?;
        let mut copy = Vec::with_capacity(map.len());
        self.in_turn(map.chunks(TILE), |part| copy.extend_from_slice(part))?;
        Ok(copy)
    }

    /// A map that holds one value.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop.
    pub fn filled<T: Copy>(&self, value: T, pixels: usize) -> Result<Vec<T>> {
        check_room::<T>(pixels)?;
        let mut map = Vec::with_capacity(pixels);
        self.in_turn(tiles(pixels), |(start, count)| map.resize(start + count, value))?;
        Ok(map)
    }

    /// The results of tiles, one after another.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop.
    pub fn joined<T>(&self, parts: Vec<Vec<T>>) -> Result<Vec<T>> {
        let count = parts.iter().map(Vec::len).sum();
        check_room::<T>(count)?;
        let mut whole = Vec::with_capacity(count);
        self.in_turn(parts, |part| whole.extend(part))?;
        Ok(whole)
    }

    /// Applies `body` to every tile, with scratch memory that is made once per worker.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop before the last tile.
    pub fn for_each<T, S>(
        &self,
        tiles: Vec<T>,
        scratch: impl Fn() -> S + Send + Sync,
        body: impl Fn(&mut S, T) + Send + Sync,
    ) -> Result<()>
    where
        T: Send,
        S: Send,
    {
        self.map(tiles, scratch, |scratch, tile| body(scratch, tile)).map(drop)
    }

    /// Applies `body` to every tile and returns the answers in tile order.
    ///
    /// Before some of the tiles the room for what they may need is looked for, as answers and scratch
    /// are many small things that add up to something as large as the picture.
    ///
    /// A body that itself checks the flag may leave its tile when it is set: the results of a cancelled
    /// call are discarded.
    ///
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop before the last tile's end, [`Error::Memory`]
    /// if there is no room for a tile.
    pub fn map<T, S, A>(
        &self,
        tiles: Vec<T>,
        scratch: impl Fn() -> S + Send + Sync,
        body: impl Fn(&mut S, T) -> A + Send + Sync,
    ) -> Result<Vec<A>>
    where
        T: Send,
        S: Send,
        A: Send,
    {
        self.progress.total.fetch_add(tiles.len(), Ordering::Relaxed);
        let answers = Mutex::new(tiles.iter().map(|_| None).collect::<Vec<_>>());
        let queue = Mutex::new(tiles.into_iter().enumerate());
        let full = Mutex::new(None);
        let worker = || {
            let mut memory = None;
            while let Some((index, tile)) = next(&queue)
                && !self.cancelled()
                && locked(&full).is_none()
            {
                if index % PROBED == 0
                    && let Err(error) = check_room::<u8>(0)
                {
                    *locked(&full) = Some(error);
                    break;
                }
                let answer = body(memory.get_or_insert_with(&scratch), tile);
                self.progress.done.fetch_add(1, Ordering::Relaxed);
                if self.cancelled() {
                    break;
                }
                locked(&answers)[index] = Some(answer);
            }
        };
        match self.pool {
            Some(pool) => pool.on_every_thread(&worker),
            None => worker(),
        }
        if let Some(error) = full.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        // What no worker has answered was cancelled.
        let answers = answers.into_inner().unwrap_or_else(PoisonError::into_inner);
        answers.into_iter().collect::<Option<_>>().ok_or(Error::Cancelled)
    }
}

/// Bytes that are to be free beside what is as large as the picture: scratch of workers, lists, stacks.
///
/// More than the largest threshold (32 MiB) from which the C library maps memory of its own: asking
/// for it then touches none, and does not change that threshold.
const HEADROOM: usize = 40 << 20;

/// Of so many tiles room is looked for before one: it takes some microseconds, a fast tile thirty.
const PROBED: usize = 64;

/// Whether so many numbers, and small things beside them, can be had.
///
/// A Rust program that gets no memory ends at once, with all that its caller holds. So whatever is as
/// large as the picture is asked for here first, which is the one way that does not end it.
///
/// # Errors
/// [`Error::Memory`] if not.
pub fn check_room<T>(count: usize) -> Result<()> {
    let bytes = count.saturating_mul(size_of::<T>()).saturating_add(HEADROOM);
    let refused = |_| Error::Memory { bytes };
    // With the first small thing of a thread the C library takes 64 MiB of addresses for all others.
    let mut small = Vec::<u8>::new();
    small.try_reserve_exact(1).map_err(refused)?;
    let mut large = Vec::<u8>::new();
    large.try_reserve_exact(bytes).map_err(refused)?;
    // Else the compiler may leave out memory that nobody uses.
    std::hint::black_box((&small, &large));
    Ok(())
}

/// So many zeros, if there is room for them.
///
/// # Errors
/// [`Error::Memory`] if there is not.
pub fn zeros<T: Clone + Default>(count: usize) -> Result<Vec<T>> {
    check_room::<T>(count)?;
    Ok(vec![T::default(); count])
}

/// An empty list with room for so many, if there is any.
///
/// Workers ask for room at the same time, so that what one has found may be another's: nothing but the
/// list itself is certain.
///
/// # Errors
/// [`Error::Memory`] if there is not.
pub(crate) fn with_room<T>(count: usize) -> Result<Vec<T>> {
    check_room::<T>(count)?;
    let mut list = Vec::new();
    let bytes = count.saturating_mul(size_of::<T>());
    list.try_reserve_exact(count).map_err(|_| Error::Memory { bytes })?;
    Ok(list)
}

/// The next tile that nobody has taken.
fn next<T>(queue: &Mutex<impl Iterator<Item = T>>) -> Option<T> {
    locked(queue).next()
}

/// Held for a moment only, and never by a tile that panics.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A run on the caller's thread with the best instruction set, for tests and simple programs.
///
/// ```
/// let answer = impasto::pixels::serially(|run| run.map(vec![1, 2], || (), |(), n| n * n));
/// assert_eq!(answer.unwrap(), [1, 4]);
/// ```
pub fn serially<A>(work: impl FnOnce(&Run<'_>) -> A) -> A {
    let (cancel, progress) = (AtomicBool::new(false), Progress::default());
    work(&Run { pool: None, level: Level::detect(), cancel: &cancel, progress: &progress })
}

/// The first pixel of each tile of a plane, and how many pixels it has.
#[must_use]
pub fn tiles(pixels: usize) -> Vec<(usize, usize)> {
    (0..pixels).step_by(TILE).map(|start| (start, TILE.min(pixels - start))).collect()
}

/// Looks at the flag, counted, so that tests need no clock.
#[cfg(test)]
pub(crate) mod looks {
    use super::*;

    #[derive(Debug)]
    pub(super) struct Looks {
        count: AtomicUsize,
        /// The look that finds the flag set.
        last: usize,
    }

    impl Default for Looks {
        fn default() -> Self {
            Self { count: AtomicUsize::new(0), last: usize::MAX }
        }
    }

    impl Looks {
        /// Counts one; whether it finds the flag set.
        pub(super) fn add(&self) -> bool {
            self.count.fetch_add(1, Ordering::Relaxed) + 1 >= self.last
        }
    }

    /// What work on the caller's thread gives if its flag is set at some look, counted from 1, and
    /// how many looks it takes.
    pub(crate) fn stopped_at<A>(last: usize, work: impl FnOnce(&Run<'_>) -> A) -> (A, usize) {
        let cancel = AtomicBool::new(false);
        let looks = Looks { last, ..Looks::default() };
        let progress = Progress { looks, ..Progress::default() };
        let run = Run { pool: None, level: Level::detect(), cancel: &cancel, progress: &progress };
        let answer = work(&run);
        (answer, progress.looks.count.load(Ordering::Relaxed))
    }

    /// The looks of work that is not stopped.
    pub(crate) fn count<A>(work: impl FnOnce(&Run<'_>) -> Result<A>) -> usize {
        let (answer, looks) = stopped_at(usize::MAX, work);
        assert!(answer.is_ok());
        looks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_come_in_tile_order_whatever_the_pool() {
        let expected: Vec<usize> = (0..999).map(|n| n * n).collect();
        let pool = Pool::new(3).unwrap();
        let (cancel, progress) = (AtomicBool::new(false), Progress::default());
        let run =
            Run { pool: Some(&pool), level: Level::Baseline, cancel: &cancel, progress: &progress };
        assert_eq!(run.map((0..999).collect(), || (), |(), n: usize| n * n).unwrap(), expected);
        assert_eq!(progress.get(), (999, 999));
    }

    #[test]
    fn a_cancelled_run_says_so() {
        let (cancel, progress) = (AtomicBool::new(true), Progress::default());
        let run = Run { pool: None, level: Level::Baseline, cancel: &cancel, progress: &progress };
        assert_eq!(run.for_each(vec![1], || (), |(), _| ()), Err(Error::Cancelled));
    }

    #[test]
    fn a_tile_that_was_left_is_no_answer() {
        let cancel = AtomicBool::new(false);
        let progress = Progress::default();
        let run = Run { pool: None, level: Level::Baseline, cancel: &cancel, progress: &progress };
        let left = run.map(vec![1, 2], || (), |(), n| cancel.store(n == 2, Ordering::Relaxed));
        assert_eq!(left, Err(Error::Cancelled));
    }

    #[test]
    fn a_panic_in_a_tile_reaches_the_caller_and_leaves_the_pool_usable() {
        let pool = Pool::new(3).unwrap();
        let (cancel, progress) = (AtomicBool::new(false), Progress::default());
        let run =
            Run { pool: Some(&pool), level: Level::Baseline, cancel: &cancel, progress: &progress };
        let squares = |bad: Option<usize>| {
            let square = |(): &mut (), n: usize| {
                assert!(Some(n) != bad, "tile {n}");
                n * n
            };
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                run.map((0..999).collect(), || (), square)
            }))
        };
        let panic = squares(Some(500)).unwrap_err();
        assert_eq!(panic.downcast_ref::<String>().unwrap(), "tile 500");
        let expected: Vec<usize> = (0..999).map(|n| n * n).collect();
        assert_eq!(squares(None).unwrap(), Ok(expected));
    }

    #[test]
    fn what_is_as_large_as_the_picture_is_looked_at_tile_by_tile() {
        const TILES: usize = 5;
        let map: Vec<usize> = (0..TILES * TILE).collect();
        let parts: Vec<_> = map.chunks(TILE).map(<[usize]>::to_vec).collect();
        assert_eq!(serially(|run| run.copied(&map)).unwrap(), map);
        assert_eq!(serially(|run| run.joined(parts.clone())).unwrap(), map);
        assert_eq!(serially(|run| run.filled(7, 2 * TILE + 1)).unwrap(), vec![7; 2 * TILE + 1]);
        assert_eq!(looks::count(|run| run.copied(&map)), TILES);
        assert_eq!(looks::count(|run| run.joined(parts)), TILES);
        assert_eq!(looks::count(|run| run.filled(0, TILES * TILE)), TILES);
        assert_eq!(looks::stopped_at(3, |run| run.copied(&map)), (Err(Error::Cancelled), 3));
    }

    #[test]
    fn every_thread_gets_as_many_pieces() {
        let (cancel, progress) = (AtomicBool::new(false), Progress::default());
        for (threads, few) in [(1, 192), (2, 144), (3, 192), (8, 72), (64, MAX_LANES)] {
            let pool = Pool::new(threads).unwrap();
            let pool = Some(&pool);
            let run = Run { pool, level: Level::Baseline, cancel: &cancel, progress: &progress };
            for pixels in [0, 1, 15, 16, 17, 36, 576, 2304, 100_000, 1 << 20] {
                let piece = run.piece(pixels, 256);
                // Smaller ones than the widest registers would leave lanes empty.
                assert!((MAX_LANES..=256).contains(&piece));
                // While the last pieces are worked on, a sixteenth of the threads' time is lost.
                let pieces = pixels.div_ceil(piece);
                let idle = pieces.next_multiple_of(threads) - pieces;
                assert!(piece == MAX_LANES || 16 * idle <= pieces, "{pixels} on {threads}");
            }
            assert_eq!(run.piece(576, 256), few);
        }
        assert_eq!(serially(|run| run.piece(1 << 20, 256)), 256);
    }

    #[test]
    fn tiles_cover_every_pixel_once() {
        let covered: usize = tiles(10_000).iter().map(|&(_, count)| count).sum();
        assert_eq!(covered, 10_000);
        assert_eq!(tiles(10_000).last(), Some(&(8192, 1808)));
    }
}
