//! Photometric stereo: normals and albedo from samples under known lights.
//!
//! A matte pixel under light `k` sends `I_k = b . l_k`, with `b` the normal times the albedo
//! (eq. 2 of the RGB-camera paper). Three things decide which samples carry `b`:
//!
//! 1. clipped and missing samples weigh nothing, whatever the method;
//! 2. a *rule* drops highlights and shadows by the size of a sample among its pixel's samples
//!    ([`Method::Threshold`], [`Method::Rank`]);
//! 3. a *loss* weighs the rest by their residuals and solves again ([`Method::L1`] and others).
//!
//! Rules look at the mean of the bands; `b` is solved from that mean or from one band. The albedo
//! of every band follows along the normal, by least squares with the same weights.

mod fit;
mod found;
mod lights;
mod loss;
mod pixels;
mod reweigh;
mod rows;
mod rule;
mod solve;
mod sort;
mod sums;
mod tile;
mod uniform;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::pixels::Run;
use crate::stack::Stack;

use loss::Loss;
use rule::Rule;
use solve::determined;
pub use solve::{CONDITION_LIMIT, RANK_LIMIT};
pub use tile::Maps;
use uniform::Uniform;

/// Samples from which a pixel has a residual: one more than unknowns.
pub const ENOUGH: usize = 4;

/// How highlights and shadows are kept out.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Not at all: every sample weighs the same.
    LeastSquares,
    /// The RGB-camera paper's rule (section 3.2): above `w1` times the pixel's mean over the
    /// lights is highlight, below `w2` times is shadow.
    Threshold {
        /// Highlights begin here; 1.2 in the paper.
        w1: f64,
        /// Shadows end here; 0.1 in the paper.
        w2: f64,
    },
    /// Of `n` samples, those of rank `int(low n) <= rank < round(high n)` count; ties go by the
    /// order of the lights.
    Rank {
        /// Share of the darkest samples that is dropped.
        low: f64,
        /// One minus the share of the brightest samples that is dropped.
        high: f64,
    },
    /// Least absolute residuals.
    L1,
    /// Huber's weights, `min(1, 1.345 s / |R|)`.
    Huber,
    /// Cauchy's weights, `1 / (1 + (R / 2.385 s)^2)`.
    Cauchy,
    /// Tukey's biweight, `(1 - (R / 4.685 s)^2)^2`, zero beyond.
    Tukey,
    /// [`Method::Rank`], then [`Method::L1`] among the samples that it kept.
    Robust {
        /// As for `Rank`.
        low: f64,
        /// As for `Rank`.
        high: f64,
    },
}

impl Method {
    fn rule(self) -> Rule {
        match self {
            Self::Threshold { w1, w2 } => Rule::Threshold { w1, w2 },
            Self::Rank { low, high } | Self::Robust { low, high } => Rule::Rank { low, high },
            _ => Rule::All,
        }
    }

    fn loss(self) -> Loss {
        match self {
            Self::L1 | Self::Robust { .. } => Loss::Absolute,
            Self::Huber => Loss::Huber,
            Self::Cauchy => Loss::Cauchy,
            Self::Tukey => Loss::Tukey,
            _ => Loss::Squares,
        }
    }

    /// Steps of reweighting after which results change by less than they are worth.
    #[must_use]
    pub fn usual_steps(self) -> usize {
        match self {
            Self::Robust { .. } => 5,
            Self::L1 => 30,
            Self::Huber | Self::Cauchy | Self::Tukey => 20,
            _ => 0,
        }
    }
}

/// What is estimated, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Which samples carry the normal.
    pub method: Method,
    /// Steps of reweighting.
    pub steps: usize,
    /// The band that normals are solved from; none means the mean of all bands.
    pub selection: Option<usize>,
}

/// What all tiles share.
struct Problem<'a> {
    stack: &'a Stack<'a>,
    rig: &'a Rig,
    rule: Rule,
    loss: Loss,
    options: Options,
    run: &'a Run<'a>,
    /// Where every valid sample counts and all lights are distant.
    uniform: Option<Uniform>,
}

/// Fits every pixel's normal and albedo.
///
/// # Errors
/// If there are fewer than three lights, all of them lie in one plane, an option makes no sense,
/// sizes disagree, or the run is cancelled.
pub fn fit_normals(
    stack: &Stack<'_>,
    rig: &Rig,
    options: &Options,
    maps: &mut Maps<'_>,
    run: &Run<'_>,
) -> Result<()> {
    check(stack, rig, options)?;
    let rule = options.method.rule();
    let problem = Problem {
        stack,
        rig,
        rule,
        loss: options.method.loss(),
        options: *options,
        run,
        uniform: (rule == Rule::All && rig.is_distant()).then(|| Uniform::new(rig)),
    };
    let shape = stack.shape();
    let level = run.level;
    run.for_each(
        maps.tiles(shape.pixels(), shape.bands)?,
        || fit::Scratch::new(&problem),
        |scratch, mut tile| level.run(fit::Fit { problem: &problem, scratch, tile: &mut tile }),
    )
}

fn check(stack: &Stack<'_>, rig: &Rig, options: &Options) -> Result<()> {
    let shape = stack.shape();
    let count = rig.observations();
    if count != shape.observations {
        let problem = format!("{count} lights for {} photographs", shape.observations);
        return Err(Error::geometry("lights", problem));
    }
    if count < 3 {
        let problem = format!(
            "a normal needs photographs under at least three lights, found {count}; take more \
             photographs under lights from other directions"
        );
        return Err(Error::geometry("lights", problem));
    }
    if rig.is_distant() && !determined(Uniform::new(rig).squared) {
        let problem = format!(
            "the {count} lights lie in one plane, which leaves the normal undetermined; add a \
             photograph under a light well outside it"
        );
        return Err(Error::geometry("lights", problem));
    }
    if options.selection.is_some_and(|band| band >= shape.bands) {
        let problem = format!("there are {} bands, counted from 0", shape.bands);
        return Err(Error::argument("selection", problem));
    }
    options.method.rule().check()
}
