//! Methods and options of photometric stereo, and what all tiles share.

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::pixels::Run;
use crate::stack::Stack;

use super::distant_system::DistantSystem;
use super::m_estimators::LossFunction;
use super::rejection::RejectionRule;

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
    Trimmed {
        /// As for `Rank`.
        low: f64,
        /// As for `Rank`.
        high: f64,
    },
    /// MM-estimation, shrunk to least squares where a Hausman test finds no evidence against it.
    Robust,
}

impl Method {
    pub(super) fn rule(self) -> RejectionRule {
        match self {
            Self::Threshold { w1, w2 } => RejectionRule::Threshold { w1, w2 },
            Self::Rank { low, high } | Self::Trimmed { low, high } => {
                RejectionRule::Rank { low, high }
            }
            _ => RejectionRule::All,
        }
    }

    pub(super) fn loss(self) -> LossFunction {
        match self {
            Self::L1 | Self::Trimmed { .. } => LossFunction::Absolute,
            Self::Huber => LossFunction::Huber,
            Self::Cauchy => LossFunction::Cauchy,
            Self::Tukey => LossFunction::Tukey,
            _ => LossFunction::Squares,
        }
    }

    /// Steps of reweighting after which results change by less than they are worth.
    #[must_use]
    pub fn usual_steps(self) -> usize {
        match self {
            Self::Trimmed { .. } | Self::Robust => 5,
            Self::L1 => 30,
            Self::Huber | Self::Cauchy | Self::Tukey => 20,
            _ => 0,
        }
    }
}

/// What is estimated, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoOptions {
    /// Which samples carry the normal.
    pub method: Method,
    /// Steps of reweighting.
    pub steps: usize,
    /// The band that normals are solved from; none means the mean of all bands.
    pub selection: Option<usize>,
    /// What is known of the whole painting; only [`Method::Robust`] asks.
    pub learned: Learned,
}

/// What [`Method::Robust`] knows of the whole painting, from [`learn_normals`](super::learn_normals).
/// Zeros: nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Learned {
    /// Typical scale of a pixel's residuals relative to its brightness.
    pub scale: f64,
    /// Correlation of the residuals under neighbouring lights, 0 to 1.
    pub correlation: f64,
}

impl Learned {
    fn check(self) -> Result<()> {
        if !(self.scale >= 0.0 && self.scale.is_finite()) {
            let problem = format!("expected a scale of at least 0, found {}", self.scale);
            return Err(Error::argument("learned", problem));
        }
        if !(0.0..=1.0).contains(&self.correlation) {
            let problem = format!("expected a correlation of 0 to 1, found {}", self.correlation);
            return Err(Error::argument("learned", problem));
        }
        Ok(())
    }
}

impl StereoOptions {
    pub(super) fn check(&self) -> Result<()> {
        self.method.rule().check()?;
        self.learned.check()
    }
}

/// What all tiles share.
pub(super) struct StereoProblem<'a> {
    pub(super) stack: &'a Stack<'a>,
    pub(super) rig: &'a Rig,
    pub(super) rule: RejectionRule,
    pub(super) loss: LossFunction,
    pub(super) options: StereoOptions,
    /// Whether the pixels are a sample to learn from.
    pub(super) learns: bool,
    /// Whether anybody asked for the albedo.
    pub(super) albedo: bool,
    /// Whether a camera is near and the method asks where it is.
    pub(super) near_views: bool,
    pub(super) run: &'a Run<'a>,
    /// Only where every valid sample counts and all lights are distant.
    pub(super) uniform: Option<DistantSystem>,
}
