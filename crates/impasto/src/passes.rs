//! Where the time of a fit goes: passes over the photographs of pixels, counted by what they are for.
//!
//! Benchmarks read the counts; no result depends on them.

use core::sync::atomic::{AtomicU64, Ordering};

/// What a pass is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Fits without a prior: what is learned about the painting, from seeds or a sample.
    Learning,
    /// Normals without a lobe, on the mean of the bands.
    Matte,
    /// One evaluation of each start of a lobe.
    Starts,
    /// Searches for the first lobe.
    FirstLobe,
    /// Searches for one lobe more.
    MoreLobes,
    /// Weights and colours of all bands.
    Weights,
    /// Searches on all bands.
    AllBands,
    /// The errors of normals, from photographs left out in turn.
    Errors,
}

impl Purpose {
    /// All of them, in the order in which a fit comes to them.
    pub const ALL: [Self; 8] = [
        Self::Learning,
        Self::Matte,
        Self::Starts,
        Self::FirstLobe,
        Self::MoreLobes,
        Self::Weights,
        Self::AllBands,
        Self::Errors,
    ];

    /// The purpose in plain words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Learning => "learning",
            Self::Matte => "no lobe",
            Self::Starts => "starts",
            Self::FirstLobe => "first lobe",
            Self::MoreLobes => "more lobes",
            Self::Weights => "weights and colours",
            Self::AllBands => "all bands",
            Self::Errors => "errors of normals",
        }
    }
}

/// The passes of one purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassCount {
    /// Passes over all lanes, times the lanes.
    pub lanes: u64,
    /// Passes of lanes that had a pixel to work on.
    pub useful: u64,
    /// Time of all threads in seconds.
    pub seconds: f64,
}

#[derive(Debug, Default)]
struct Counter {
    lanes: AtomicU64,
    useful: AtomicU64,
    nanoseconds: AtomicU64,
}

/// The passes of a call.
#[derive(Debug)]
pub struct Passes {
    counters: [Counter; Purpose::ALL.len()],
    /// Nanoseconds since some moment, as the numerics have no clock of their own; operations where
    /// these are counted.
    clock: fn() -> u64,
}

impl Default for Passes {
    /// Without a clock: seconds are 0.
    fn default() -> Self {
        Self::timed(|| 0)
    }
}

impl Passes {
    /// With a clock, which returns the nanoseconds since some moment.
    #[must_use]
    pub fn timed(clock: fn() -> u64) -> Self {
        Self { counters: Default::default(), clock }
    }

    /// What has been counted for a purpose.
    #[must_use]
    pub fn of(&self, purpose: Purpose) -> PassCount {
        let Counter { lanes, useful, nanoseconds } = &self.counters[purpose as usize];
        PassCount {
            lanes: lanes.load(Ordering::Relaxed),
            useful: useful.load(Ordering::Relaxed),
            seconds: 1e-9 * nanoseconds.load(Ordering::Relaxed) as f64,
        }
    }

    /// Does some work, and counts its time and its `[lanes, useful]` passes.
    pub(crate) fn count(&self, purpose: Purpose, work: impl FnOnce() -> [u64; 2]) {
        let begin = (self.clock)();
        let passes = work();
        let spent = (self.clock)().saturating_sub(begin);
        let counter = &self.counters[purpose as usize];
        counter.lanes.fetch_add(passes[0], Ordering::Relaxed);
        counter.useful.fetch_add(passes[1], Ordering::Relaxed);
        counter.nanoseconds.fetch_add(spent, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn purposes_are_counted_apart() {
        let passes = Passes::default();
        for (number, purpose) in Purpose::ALL.into_iter().enumerate() {
            let useful = number as u64;
            passes.count(purpose, || [16, useful]);
            passes.count(purpose, || [16, useful]);
            let found = passes.of(purpose);
            assert_eq!([found.lanes, found.useful], [32, 2 * useful], "{}", purpose.name());
        }
    }
}
