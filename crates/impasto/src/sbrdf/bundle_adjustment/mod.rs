//! Bundle adjustment [@triggs2000bundle] of a rig and of the surfaces of many pixels: the normal
//! equations of the rig, from which the unknowns of all pixels are eliminated.
//!
//! The numbers of a rig are inverse distances, which change every photograph, and the logarithms of
//! the lamps' strengths, each of which changes its own. The unknowns of a pixel (two tilts of its
//! normal, the width of its lobe, and in each band diffuse reflectance, ambient light and strength of
//! the lobe) appear in its own samples only: their Schur complement leaves the rig's numbers alone.
//! For photographs held out, the unknowns follow the photographs that are fitted.

mod elimination;
mod problem;
mod samples;
#[cfg(test)]
mod tests;

use core::marker::PhantomData;
use core::ops::Range;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::math::lanes::Isa;
use crate::math::{Kernel, Real};
use crate::pixels::Run;
use crate::surface::{Model, Pairs, TorranceSparrow};

pub use elimination::RigEquations;
use elimination::{Followed, Sums};
pub use problem::{Adjustment, LobeProfile};
use samples::{Block, PixelSamples, Samples};

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
            Some(elimination::bounded(&run.joined(found)?))
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
        let mut found = Vec::with_capacity(self.pixels.len());
        let mut follower = Follower::<I::F64>::new(self.samples);
        for number in self.pixels {
            follower.follow(number);
            found.push(follower.followed.leverage());
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
        let mut sums = Sums::new(self.samples.layout());
        let mut follower = Follower::<I::F64>::new(self.samples);
        for number in self.pixels {
            follower.follow(number);
            let weight = self.weights.map_or(1.0, |weights| weights[number]);
            let held = self.samples.adjustment.held;
            sums.add_pixel(&follower.pixel, &follower.followed, held, weight);
        }
        sums
    }
}

/// One pixel after another: they are read side by side, in lanes.
struct Follower<'a, R> {
    samples: &'a Samples<'a>,
    block: Block,
    /// The pixels of the block.
    inside: Range<usize>,
    pixel: PixelSamples,
    followed: Followed,
    lanes: PhantomData<R>,
}

impl<'a, R: Real<Scalar = f64>> Follower<'a, R> {
    fn new(samples: &'a Samples<'a>) -> Self {
        let layout = samples.layout();
        Self {
            samples,
            block: Block::new(layout, R::WIDTH),
            inside: 0..0,
            pixel: PixelSamples::new(layout),
            followed: Followed::new(layout),
            lanes: PhantomData,
        }
    }

    /// Reads a pixel and follows it.
    #[inline(always)]
    fn follow(&mut self, number: usize) {
        if !self.inside.contains(&number) {
            self.samples.read_block::<R>(number, &mut self.block);
            self.inside = number..number + R::WIDTH;
        }
        let lane = number - self.inside.start;
        self.samples.read(number, (&self.block, lane), &mut self.pixel);
        self.followed.solve(&self.pixel, self.samples.adjustment.held);
    }
}
