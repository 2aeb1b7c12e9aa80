//! The first half of the pooled fit: what is learned of the whole painting, or of a sample of it.

use crate::error::Result;
use crate::geometry::Rig;
use crate::lm::Outcome;
use crate::pixels::{Run, TILE, zeros};
use crate::sbrdf::Start;
use crate::stack::Stack;
use crate::surface::{Pairs, TorranceSparrow};

use super::apply::{Application, begin, check, in_unit, photographs, unit_of};
use super::covariance::relative;
use super::extract::Extraction;
use super::histogram::Histogram;
use super::joint::{JointLobe, shows_highlight};
use super::learned::{LearnedLobe, PooledLobe};
use super::lobe_equations::{Cost, ScaleReference};
use super::maps::PooledMapsMut;
use super::outliers::Counts;
use super::passes::Passes;
use super::pixel::CommonLobe;
use super::progressive_sampling::learn_progressively;
use super::samples::Begin;
use super::scale::Gaussian;
use super::verdict::{DESCRIBES, Strengths, Verdict};

/// Settings of the pooled fit.
#[derive(Clone, Copy, Debug)]
pub struct PooledOptions {
    /// Which samples carry the first estimate.
    pub extraction: Extraction,
    /// Whether only those of the peak region do: see [`Histogram::peak`].
    pub peak: bool,
    /// Whether normals, colours and the lobe are fitted together; else the papers' separate fit.
    pub joint: bool,
    /// Whether diffuse light crosses a smooth interface; only with [`joint`](Self::joint).
    pub coated: bool,
    /// Index of refraction.
    pub index: f64,
    /// Pixels that the joint search visits, at most, about.
    pub pixels: usize,
}

/// Points of the measured lobe that are kept.
const CURVE_POINTS: usize = 200;

/// Learns the painting's lobe from the pixels whose normals are estimated in `start`.
///
/// The photographs may be the whole painting or a sample of it: a part, or the whole with the status
/// of a sample of its pixels only. The time it takes is that of the estimated pixels.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn learn(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    options: &PooledOptions,
    run: &Run<'_>,
) -> Result<LearnedLobe> {
    let (pixels, bands) = (stack.shape().pixels(), stack.shape().bands);
    let map = |planes: usize| zeros(planes * pixels);
    let mut out = PooledMapsMut {
        normal: &mut map(3)?,
        diffuse: &mut map(bands)?,
        residual: &mut map(1)?,
        sigma: &mut map(1)?,
        misfit: &mut map(1)?,
        status: &mut zeros(pixels)?,
    };
    fit(stack, rig, start, options, &mut out, run)
}

/// [`learn`] and [`apply`](super::apply()) in one: the lobe is learned from the same pixels that it is
/// applied to, and pixels are visited once for both.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    options: &PooledOptions,
    out: &mut PooledMapsMut<'_>,
    run: &Run<'_>,
) -> Result<LearnedLobe> {
    check(stack, rig, start, out)?;
    let brightness = bright(start, run)?;
    let unit = unit_of(brightness);
    let decode = in_unit(stack, unit);
    let stack = &stack.decoded(&decode)?;
    let pairs = &Pairs::of_rig(TorranceSparrow { index: options.index }, rig);
    let photographs = &photographs(stack, rig, start, pairs, options.coated && options.joint);
    let scale_reference =
        ScaleReference { brightness: brightness / f64::from(unit), noise_floor: 0.0 };
    let gaussian = Gaussian::of(photographs.bands);
    let passes = Passes { photographs, run, scale_reference, gaussian };
    let begin = begin(start, unit);
    let estimate = passes.estimate(begin, options)?;
    let passes = Passes { scale_reference: estimate.scale_reference, ..passes };
    let learned = passes.judge(begin, estimate, unit, out)?;
    Ok(learned.in_unit_one(brightness, f64::from(unit)))
}

/// A bright colour, whatever a tenth of the pixels show: a lamp in the frame is no colour. Scaling
/// the samples by a power of two scales it exactly.
fn bright(start: &Start<'_>, run: &Run<'_>) -> Result<f64> {
    let mut colours = Counts::new();
    run.in_turn(start.diffuse.chunks(TILE), |part| {
        for &colour in part {
            colours.add(colour);
        }
    })?;
    Ok(colours.high().map_or(1.0, f64::from))
}

/// The lobe as the search left it, before it is judged.
struct Estimate {
    lobe: CommonLobe,
    /// Of (log beta, log gamma); none where the samples do not determine it.
    covariance: Option<[[f64; 2]; 2]>,
    /// Whether the width is undetermined.
    open: bool,
    path: Vec<[f64; 2]>,
    converged: bool,
    /// Whether normals and colours are fitted with the lobe.
    joint: bool,
    scale_reference: ScaleReference,
    /// The samples that the lobe was fitted to, where normals and colours stay those of the start.
    histogram: Option<Histogram>,
}

impl Estimate {
    fn seen(&self) -> bool {
        self.covariance.is_some_and(shows_highlight)
    }

    /// The lobe, without strength where there is no highlight.
    fn shown(&self) -> CommonLobe {
        if self.seen() { self.lobe } else { CommonLobe { beta: 0.0, ..self.lobe } }
    }

    fn verdict(&self, describes: f64) -> Verdict {
        let k = self.lobe.log_sharpness;
        let (lowest, highest) = (CommonLobe::bounds().lower[1], CommonLobe::bounds().upper[1]);
        let at_bound = self.open || k <= lowest || k >= highest;
        match (self.seen(), at_bound) {
            (false, _) => Verdict::NoHighlight,
            (true, true) => Verdict::AtBound,
            (true, false) if describes < DESCRIBES => Verdict::Mixed,
            (true, false) => Verdict::Fitted,
        }
    }
}

impl Passes<'_> {
    fn estimate(&self, begin: Begin<'_>, options: &PooledOptions) -> Result<Estimate> {
        let samples = self.on(&self.photographs.bare()).extract(begin, options.extraction)?;
        let samples = if options.peak { samples.peak() } else { samples };
        let first = samples.fit();
        if !options.joint {
            return Ok(self.separate(&first, samples));
        }
        let lobe = CommonLobe { beta: first.parameters[0], log_sharpness: first.parameters[1] };
        match learn_progressively(*self, begin, options.pixels, lobe)? {
            Some(found) => Ok(self.joint(found)),
            None => Ok(self.separate(&first, samples)),
        }
    }

    /// The lobe that was fitted to `samples`.
    fn separate(&self, first: &Outcome<f64, 2>, samples: Histogram) -> Estimate {
        let lobe = CommonLobe { beta: first.parameters[0], log_sharpness: first.parameters[1] };
        let variance = first.normal.cost.max(0.0) / (samples.count() - 2.0).max(1.0);
        let shown = samples.shows(lobe.log_sharpness);
        let covariance = (lobe.beta > 0.0 && shown && !first.deficient()[0])
            .then(|| relative(lobe, first.covariance(variance)));
        Estimate {
            lobe,
            covariance,
            open: first.deficient()[1],
            path: vec![[lobe.beta, lobe.gamma()]],
            converged: first.reason.converged(),
            joint: false,
            scale_reference: self.scale_reference,
            histogram: Some(samples),
        }
    }

    /// The lobe that the joint search found.
    fn joint(&self, found: JointLobe) -> Estimate {
        let (covariance, open) = found.covariance(self.gaussian);
        let JointLobe { lobe, path, converged, scale_reference, .. } = found;
        let histogram = None;
        let joint = true;
        Estimate { lobe, covariance, open, path, converged, joint, scale_reference, histogram }
    }

    /// Fills the maps under the lobe that was found, or under none where it does not improve on the
    /// diffuse part alone, and compares it with the pixels' own strengths.
    fn judge(
        &self,
        begin: Begin<'_>,
        mut estimate: Estimate,
        unit: f32,
        out: &mut PooledMapsMut<'_>,
    ) -> Result<LearnedLobe> {
        let mut strengths = Strengths::unknown(out.status.len(), self.run)?;
        // Maps of photometric stereo know no interface.
        let bare = self.photographs.bare();
        let unrefined = self.on(&bare);
        let refined = estimate.joint && estimate.seen();
        let mut application = Application {
            passes: if refined { *self } else { unrefined },
            begin,
            lobe: estimate.shown(),
            refined,
            unit,
        };
        let [without, with] = application.whole(out, &mut strengths)?;
        let cost = |all: Cost| all.value(self.scale_reference.brightness);
        if application.refined && cost(with) >= cost(without) {
            estimate.covariance = None;
            application.lobe = estimate.shown();
            application.refined = false;
            application.passes = unrefined;
            application.whole(out, &mut strengths)?;
        }
        let lobe = application.lobe;
        let noise = strengths.noise_of_classes(self.run)?;
        let describes = strengths.agreement(lobe.beta as f32, &noise, out.misfit, self.run)?;
        let left = Begin { normal: out.normal, diffuse: out.diffuse, factor: unit.recip() };
        let mut histogram = match estimate.histogram.take() {
            Some(histogram) => histogram,
            None => application.passes.extract(left, Extraction::Residual)?,
        };
        histogram.scale(f64::from(unit));
        let unknown = [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]];
        Ok(LearnedLobe {
            covariance: estimate.covariance.filter(|_| estimate.seen()).unwrap_or(unknown),
            verdict: estimate.verdict(describes),
            describes,
            curve: histogram.curve(CURVE_POINTS),
            converged: estimate.converged,
            path: estimate.path,
            lobe: PooledLobe {
                beta: lobe.beta,
                log_sharpness: lobe.log_sharpness,
                index: self.photographs.pairs.model.index,
                refined: application.refined,
                coated: application.passes.photographs.coated.is_some(),
                brightness: self.scale_reference.brightness,
                noise,
                noise_floor: self.scale_reference.noise_floor,
            },
        })
    }
}

impl LearnedLobe {
    /// Strengths and brightness of samples that were counted in a unit.
    fn in_unit_one(mut self, brightness: f64, unit: f64) -> Self {
        self.lobe.brightness = brightness;
        self.lobe.beta *= unit;
        for [beta, _] in &mut self.path {
            *beta *= unit;
        }
        self
    }
}
