//! One call into the numerics: off the interpreter, on threads of our own, and interruptible unless it
//! is brief.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, OnceLock, TryLockError};
use std::time::Duration;
#[cfg(not(feature = "operations"))]
use std::time::Instant;

use pyo3::prelude::*;

use impasto::Error;
use impasto::math::Level;
use impasto::pixels::{Pool, Progress, Run, check_room};

use crate::errors;

/// Ctrl-C and the progress callback are looked at this often.
const HEARTBEAT: Duration = Duration::from_millis(50);

/// Bytes of the stack of a thread.
const STACK: usize = 2 << 20;

/// Bytes of addresses that a thread takes: its stack, and what the C library keeps for what it
/// allocates. A thread that does not get them may end the process.
const ADDRESSES: usize = STACK + (64 << 20);

/// The instruction set: the best there is, or a narrower one named by `IMPASTO_SIMD`.
pub(crate) fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        if cfg!(feature = "operations") {
            return Level::Baseline; // its numbers count
        }
        #[allow(clippy::disallowed_methods, reason = "the border is where the environment is read")]
        let requested = std::env::var("IMPASTO_SIMD").unwrap_or_default();
        Level::ALL
            .into_iter()
            .find(|level| level.name() == requested && level.available())
            .unwrap_or_else(Level::detect)
    })
}

/// Samples up to which a call is brief where there are vector instructions. Searches make thousands of
/// such calls, and to start a thread takes as long as to fit some pixels. Of the presets' fits the
/// slowest took 30 ms with AVX2, 0.6 s without vectors: there nothing is brief.
const BRIEF: usize = 1 << 16;

/// Runs `work` on a thread of its own with `threads` workers, and waits for it.
///
/// `progress` is called with (tiles done, tiles known) about twenty times a second; an exception
/// that it raises, and Ctrl-C, stop the work at the next tile.
pub(crate) fn call<A: Send>(
    py: Python<'_>,
    threads: usize,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Run<'_>) -> impasto::Result<A> + Send,
) -> PyResult<A> {
    call_on(py, usize::MAX, threads, progress, work)
}

/// The same; on the caller's thread where the work is as much as on few samples. Ctrl-C and an
/// exception of `progress`, which is called once, then wait for its end.
pub(crate) fn call_on<A: Send>(
    py: Python<'_>,
    samples: usize,
    threads: usize,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Run<'_>) -> impasto::Result<A> + Send,
) -> PyResult<A> {
    let brief = samples <= BRIEF && level() != Level::Baseline;
    let addresses = if brief { 0 } else { ADDRESSES };
    check_room::<u8>(addresses).map_err(|error| errors::to_python(py, &error))?;
    let pool = pool(threads);
    let cancel = AtomicBool::new(false);
    let tally = Progress::timed(spent);
    let mut interruption = None;
    let outcome = py.detach(|| {
        let run = Run { pool: pool.as_deref(), level: level(), cancel: &cancel, progress: &tally };
        let work = || catch_unwind(AssertUnwindSafe(|| work(&run)));
        if brief {
            return work();
        }
        std::thread::scope(|scope| {
            let (finished, wait) = channel();
            let worker = std::thread::Builder::new().spawn_scoped(scope, move || {
                let outcome = work();
                // Nobody listening only means that the caller no longer waits in steps.
                let _ = finished.send(());
                outcome
            });
            // The system has no memory for its stack.
            let worker = worker.map_err(|_| Error::Memory { bytes: STACK });
            let worker = match worker {
                Ok(worker) => worker,
                Err(error) => return Ok(Err(error)),
            };
            while wait.recv_timeout(HEARTBEAT) == Err(RecvTimeoutError::Timeout) {
                if interruption.is_none()
                    && let Err(error) = heartbeat(progress, &tally)
                {
                    cancel.store(true, Ordering::Relaxed);
                    interruption = Some(error);
                }
            }
            worker.join().unwrap_or_else(Err)
        })
    });
    if let Some(error) = interruption {
        return Err(error);
    }
    match outcome {
        Ok(Ok(answer)) => {
            report(py, progress, &tally)?;
            Ok(answer)
        }
        Ok(Err(error)) => Err(errors::to_python(py, &error)),
        Err(panic) => Err(errors::internal(py, panic.as_ref())),
    }
}

/// What a pass spends: operations.
#[cfg(feature = "operations")]
use impasto::math::lanes::operations as spent;

/// What a pass spends: nanoseconds, since the first call.
#[cfg(not(feature = "operations"))]
fn spent() -> u64 {
    static BEGIN: OnceLock<Instant> = OnceLock::new();
    #[allow(clippy::disallowed_methods, reason = "the border is where the clock is read")]
    let now = Instant::now();
    let begin = *BEGIN.get_or_init(|| now);
    u64::try_from(now.saturating_duration_since(begin).as_nanos()).unwrap_or(u64::MAX)
}

fn heartbeat(progress: Option<&Py<PyAny>>, tally: &Progress) -> PyResult<()> {
    Python::attach(|py| {
        py.check_signals()?;
        report(py, progress, tally)
    })
}

fn report(py: Python<'_>, progress: Option<&Py<PyAny>>, tally: &Progress) -> PyResult<()> {
    match progress {
        Some(callback) => callback.call1(py, tally.get()).map(drop),
        None => Ok(()),
    }
}

/// The pool of the last call if it has as many threads and belongs to this process, else a new one.
///
/// A forked child inherits the memory of its parent's pool but none of its threads: work given to
/// that pool would wait for ever. The pool is therefore kept with its process, and the child leaks
/// the parent's.
///
/// The child also inherits the lock, locked if another thread of the parent held it during the fork.
/// Nobody waits for it: who does not get it at once works on a pool of its own.
fn pool(threads: usize) -> Option<Arc<Pool>> {
    struct Kept {
        process: u32,
        threads: usize,
        pool: Arc<Pool>,
    }
    static LAST: Mutex<Option<Kept>> = Mutex::new(None);
    let last = || match LAST.try_lock() {
        Ok(last) => Some(last),
        Err(TryLockError::Poisoned(last)) => Some(last.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    };

    if threads <= 1 {
        return None;
    }
    let process = std::process::id();
    if let Some(last) = last()
        && let Some(kept) = last.as_ref()
        && kept.process == process
        && kept.threads == threads
    {
        return Some(Arc::clone(&kept.pool));
    }
    // Threads are started without the lock, which is held for a moment only.
    let room = check_room::<u8>((threads + 1).saturating_mul(ADDRESSES));
    let Ok(pool) = room.and_then(|()| Pool::new(threads)).map(Arc::new) else {
        return None; // there is no room for more threads: the results are the same on one
    };
    let kept = Kept { process, threads, pool: Arc::clone(&pool) };
    let previous = last().and_then(|mut last| last.replace(kept));
    if let Some(previous) = previous
        && previous.process != process
    {
        std::mem::forget(previous);
    }
    Some(pool)
}
