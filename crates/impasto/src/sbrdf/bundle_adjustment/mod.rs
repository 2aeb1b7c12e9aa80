//! Bundle adjustment [@triggs2000bundle] of a rig and of the surfaces of many pixels: the normal
//! equations of the rig, from which the unknowns of all pixels are eliminated.
//!
//! The numbers of a rig are inverse distances, which change every photograph, and the logarithms of
//! the lamps' strengths, each of which changes its own. The unknowns of a pixel (two tilts of its
//! normal, the width of its lobe, and in each band diffuse reflectance, ambient light and strength of
//! the lobe) appear in its own samples only: their Schur complement leaves the rig's numbers alone.
//! For photographs held out, the unknowns follow the photographs that are fitted.

mod elimination;
mod influence;
mod problem;
mod samples;
mod sums;
#[cfg(test)]
mod tests;

use core::ops::Range;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Mask, Real};
use crate::pixels::Run;
use crate::surface::{Model, Pairs, TorranceSparrow};

use elimination::Followed;
pub use problem::{Adjustment, LobeProfile};
use samples::{PixelSamples, Samples};
pub use sums::RigEquations;
use sums::{Lines, Sums};

/// Parts of the pixels whose sums are formed by themselves: as many as keep some threads busy, and so
/// few that the sums of hundreds of lamps need little memory. The result does not depend on threads.
const PARTS: usize = 8;

impl Adjustment<'_> {
    /// The normal equations of the rig's numbers.
    ///
    /// Where photographs are held out, no pixel counts more than a usual one.
    ///
    /// # Errors
    /// If sizes disagree, the surface has other lobes than one of Torrance and Sparrow, or the run is
    /// cancelled.
    pub fn equations(&self, run: &Run<'_>) -> Result<RigEquations> {
        let samples = self.samples()?;
        let pixels = self.rig.grid().width * self.rig.grid().height;
        let each = pixels.div_ceil(PARTS).max(1);
        let parts = || -> Vec<_> {
            (0..pixels).step_by(each).map(|start| start..pixels.min(start + each)).collect()
        };
        let weights = if self.held.iter().all(|&held| held) {
            None
        } else {
            let leverage =
                |(): &mut (), pixels| run.level.run(Leverage { samples: &samples, pixels });
            let found = run.map(parts(), || (), leverage)?;
            Some(influence::bounded(&run.joined(found)?))
        };
        let weights = weights.as_deref();
        let sums = run.map(
            parts(),
            || (),
            |(), pixels| run.level.run(Reduce { samples: &samples, weights, pixels }),
        )?;
        let mut total = Sums::new(samples.layout());
        for part in &sums {
            total.add(part);
        }
        Ok(total.equations())
    }

    /// The samples and their derivatives, after a check of the sizes.
    fn samples(&self) -> Result<Samples<'_>> {
        let Self { surface, rig, intensities, moved, held, .. } = *self;
        let grid = rig.grid();
        let (pixels, observations) = (grid.width * grid.height, rig.observations());
        let bands = surface.bands(pixels)?;
        let alike = |rig: &Rig| rig.observations() == observations && rig.grid() == grid;
        let samples = observations * bands * pixels;
        let rising = |profile: &LobeProfile<'_>| {
            !profile.knots.is_empty()
                && profile.knots.len() == profile.factors.len()
                && profile.knots.is_sorted()
        };
        let sizes = [
            ("intensities", intensities.len() == observations),
            ("moved", moved.iter().all(alike)),
            ("errors", self.errors.len() == samples),
            ("slopes", self.slopes.len() == samples),
            ("held", held.len() == observations),
            ("profile", self.profile.as_ref().is_none_or(rising)),
        ];
        if let Some((name, _)) = sizes.iter().find(|(_, fits)| !fits) {
            let problem = format!(
                "its size does not fit {} x {} pixels, {bands} bands and {observations} lights",
                grid.height, grid.width
            );
            return Err(Error::argument(name, problem));
        }
        let (Model::TorranceSparrow { index }, [lobe]) = (surface.model, &*surface.lobes) else {
            return Err(Error::argument("surface", "expected one Torrance-Sparrow lobe"));
        };
        let model = TorranceSparrow { index };
        let pairs = |rig| Pairs::of_rig(model, rig);
        Ok(Samples {
            adjustment: self,
            lobe,
            pairs: pairs(rig),
            moved: moved.iter().map(pairs).collect(),
            pixels,
            bands,
        })
    }
}

/// How much each of some pixels would change the rig.
struct Leverage<'a> {
    samples: &'a Samples<'a>,
    pixels: Range<usize>,
}

impl Kernel for Leverage<'_> {
    type Output = Vec<Option<Vec<f64>>>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let Self { samples, pixels } = self;
        let layout = samples.layout();
        let mut follower = Follower::<I::F64>::new(samples);
        let kinds = layout.places + 1;
        let mut left = vec![I::F64::zero(); kinds];
        let mut lanes = vec![[0.0; MAX_LANES]; kinds];
        let mut found = Vec::with_capacity(pixels.len());
        for first in pixels.clone().step_by(I::F64::WIDTH) {
            follower.follow(first);
            follower.followed.leverage(&mut left);
            for kind in 0..kinds {
                left[kind].store(&mut lanes[kind]);
            }
            for lane in 0..I::F64::WIDTH.min(pixels.end - first) {
                let any = follower.followed.any.lane(lane);
                found.push(any.then(|| lanes.iter().map(|kind| kind[lane]).collect()));
            }
        }
        found
    }
}

/// The sums of some pixels, each with its weight.
struct Reduce<'a> {
    samples: &'a Samples<'a>,
    weights: Option<&'a [f64]>,
    pixels: Range<usize>,
}

impl Kernel for Reduce<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<I: Isa>(self) -> Sums {
        let Self { samples, weights, pixels } = self;
        let layout = samples.layout();
        let mut sums = Sums::new(layout);
        let mut lines = Lines::new(layout, I::F64::WIDTH);
        let mut follower = Follower::<I::F64>::new(samples);
        for first in pixels.clone().step_by(I::F64::WIDTH) {
            follower.follow(first);
            let mut own = [0.0; MAX_LANES];
            let count = I::F64::WIDTH.min(pixels.end - first);
            for lane in 0..count {
                if follower.followed.any.lane(lane) {
                    own[lane] = weights.map_or(1.0, |weights| weights[first + lane]);
                }
            }
            sums.add_pixels(&follower.followed, &own[..count], &mut lines);
        }
        sums
    }
}

/// Some pixels after others, side by side in lanes.
struct Follower<'a, R: Real> {
    samples: &'a Samples<'a>,
    pixels: PixelSamples<R>,
    followed: Followed<R>,
}

impl<'a, R: Real<Scalar = f64>> Follower<'a, R> {
    fn new(samples: &'a Samples<'a>) -> Self {
        let layout = samples.layout();
        Self { samples, pixels: PixelSamples::new(layout), followed: Followed::new(layout) }
    }

    /// Reads the pixels from `first` on and follows them.
    #[inline(always)]
    fn follow(&mut self, first: usize) {
        self.samples.read(first, &mut self.pixels);
        self.followed.solve(&self.pixels, self.samples.adjustment.held);
    }
}
