//! Work over many pixels: tiles, threads, cancelling and progress.
//!
//! The only file that names rayon. Tiles are closed computations that write to disjoint memory,
//! and whatever is summed over pixels is summed tile by tile in tile order: no result depends on
//! the number of threads or on which thread did what.

use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::math::Level;

/// Pixels of a tile: 16 photographs of 16 bits are 128 KiB, which stay in the second-level cache
/// while the outputs of one tile are written; and a megapixel makes enough tiles for any core.
pub const TILE: usize = 4096;

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
}

/// How far a call has come.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    total: AtomicUsize,
}

impl Progress {
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
    /// Set by the caller to stop the call at the next tile.
    pub cancel: &'a AtomicBool,
    /// Counted up as tiles finish.
    pub progress: &'a Progress,
}

impl Run<'_> {
    /// Whether the caller asked to stop.
    #[must_use]
    pub fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
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
    /// # Errors
    /// [`Error::Cancelled`] if the caller asked to stop before the last tile.
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
        let step = |scratch: &mut S, tile: T| {
            if self.cancelled() {
                return Err(Error::Cancelled);
            }
            let answer = body(scratch, tile);
            self.progress.done.fetch_add(1, Ordering::Relaxed);
            Ok(answer)
        };
        if let Some(Pool(pool)) = self.pool {
            return pool.install(|| tiles.into_par_iter().map_init(scratch, step).collect());
        }
        let mut scratch = scratch();
        tiles.into_iter().map(|tile| step(&mut scratch, tile)).collect()
    }
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
    fn tiles_cover_every_pixel_once() {
        let covered: usize = tiles(10_000).iter().map(|&(_, count)| count).sum();
        assert_eq!(covered, 10_000);
        assert_eq!(tiles(10_000).last(), Some(&(8192, 1808)));
    }
}
