//! The joint search: Levenberg-Marquardt [@levenberg1944; @marquardt1963] for (beta, log k) while
//! normals and colours follow (variable projection [@golub1973varpro]), with the curvature of the
//! robust cost along the last step by the update of Broyden, Fletcher, Goldfarb and Shanno
//! [@broyden1970].

use core::cell::{Cell, RefCell};

use crate::brdf::torrance_sparrow::sharpness;
use crate::error::{Error, Result};
use crate::lm::{self, Normal, Options, Outcome, Problem};

use super::covariance::{relative, sandwich};
use super::descent::Stopping;
use super::lobe_equations::{LobeEquations, ScaleReference};
use super::passes::Passes;
use super::pixel::CommonLobe;
use super::samples::State;
use super::scale::Gaussian;

/// Steps of a pixel from the normals of photometric stereo, and between two places of the lobe.
pub(super) const FIRST_STEPS: usize = 16;
const STEPS: usize = 3;

/// The share by which a pixel's last step may change its squared scale: costs of two lobes are compared.
const TOLERANCE: f64 = 2e-5;

fn stopping(steps: usize) -> Stopping {
    Stopping { steps, tolerance: TOLERANCE }
}

/// Steps of the search before normals restart from elsewhere: the lobe is roughly known by then.
const ROUGH: usize = 3;

/// A cost that falls by a millionth has stopped falling. An error of one per cent of beta
/// costs some hundredths (the scene of `tests/oracles/pooled.py`: 174 times the error
/// squared): what is left to gain is a part in ten thousand of beta.
const SEARCH: Options = Options {
    max_iterations: 40,
    cost: 1e-6,
    step: 2e-5,
    gradient: 1e-8,
    offset: 0.0,
    damping: 1e-2,
    memory: 0.0,
};

/// A satin varnish, relative to the brightest colour: the second start, in case outliers have misled
/// the separate fit.
const SATIN: (f64, f64) = (12.0, 0.15);

/// Smallest share of the model's curvature that the cost is taken to have along a step.
const SOFTEST: f64 = 0.02;

/// The noise floor, as a share of the squared scale that pixels with this share of the painting's
/// light stay below.
const FLOOR_SHARE: f64 = 0.25;
const QUANTILE: f64 = 0.25;

/// A pixel counts for the light of so many bright ones at most: a lamp in the frame would else be
/// most of the painting's light.
const MOST_LIGHT: f64 = 4.0;

/// A noise floor known to a tenth moves the lobe by a small share of its error.
const SAME_FLOOR: f64 = 0.1;

/// Times that the noise floor is estimated anew.
const REFINEMENTS: usize = 8;

/// Three standard deviations separate a highlight from noise.
pub(super) fn shows_highlight(covariance: [[f64; 2]; 2]) -> bool {
    covariance[0][0].sqrt() < 1.0 / 3.0
}

/// The result of the search.
pub(super) struct JointLobe {
    pub(super) lobe: CommonLobe,
    /// Of the subset's pixels.
    pub(super) equations: LobeEquations,
    /// (beta, gamma) as they got better.
    pub(super) path: Vec<[f64; 2]>,
    pub(super) scale_reference: ScaleReference,
    pub(super) converged: bool,
}

impl JointLobe {
    /// Covariance of (log beta, log gamma), none where the samples determine no lobe; and whether
    /// they leave the width open.
    pub(super) fn covariance(&self, gaussian: Gaussian) -> (Option<[[f64; 2]; 2]>, bool) {
        let factor = lm::factor(&self.equations.information(), 0.0, &[false; 2]);
        let scatter = &self.equations.scatter;
        let covariance = (self.lobe.beta > 0.0 && !factor.deficient[0])
            .then(|| relative(self.lobe, sandwich(&factor, scatter, gaussian.curvature)));
        (covariance, factor.deficient[1])
    }

    /// Relative standard errors of beta and gamma; none where the samples determine no lobe.
    pub(super) fn standard_errors(&self, gaussian: Gaussian) -> Option<[f64; 2]> {
        let (covariance, open) = self.covariance(gaussian);
        covariance.filter(|_| !open).map(|covariance| [0, 1].map(|i| covariance[i][i].sqrt()))
    }

    /// Whether the samples show a highlight: three standard errors separate it from noise.
    pub(super) fn seen(&self, gaussian: Gaussian) -> bool {
        self.covariance(gaussian).0.is_some_and(shows_highlight)
    }
}

/// Costs of lobes, with the state of all pixels that goes with the best.
struct JointSearch<'a> {
    passes: Passes<'a>,
    best: RefCell<State>,
    trial: RefCell<State>,
    equations: Cell<LobeEquations>,
    least: Cell<f64>,
    /// The best place, and its equations.
    last: Cell<([f64; 2], Normal<f64, 2>)>,
    steps: Cell<usize>,
    path: RefCell<Vec<[f64; 2]>>,
    failure: RefCell<Option<Error>>,
}

impl<'a> JointSearch<'a> {
    /// A search that goes on along a `path`, from `lobe`.
    fn new(
        passes: Passes<'a>,
        [state, trial]: [State; 2],
        lobe: CommonLobe,
        mut path: Vec<[f64; 2]>,
    ) -> Self {
        let here = [lobe.beta, lobe.gamma()];
        if path.last() != Some(&here) {
            path.push(here);
        }
        Self {
            passes,
            best: RefCell::new(state),
            trial: RefCell::new(trial),
            equations: Cell::new(LobeEquations::default()),
            least: Cell::new(f64::INFINITY),
            last: Cell::new(([lobe.beta, lobe.log_sharpness], Normal::zero())),
            steps: Cell::new(FIRST_STEPS),
            path: RefCell::new(path),
            failure: RefCell::new(None),
        }
    }

    fn visit(&self, lobe: CommonLobe, restart: bool) -> Result<Normal<f64, 2>> {
        let (mut best, mut trial) = (self.best.borrow_mut(), self.trial.borrow_mut());
        let place = [lobe.beta, lobe.log_sharpness];
        let equations =
            self.passes.irls(&best, &mut trial, lobe, stopping(self.steps.get()), restart)?;
        self.steps.set(STEPS);
        let mut normal = equations.normal(self.passes.scale_reference.brightness);
        let matrix = self.softened(place, &normal);
        // The rule by which `minimise` accepts a place.
        if normal.cost < self.least.get() {
            core::mem::swap(&mut *best, &mut *trial);
            self.equations.set(equations);
            self.least.set(normal.cost);
            self.last.set((place, normal));
            let mut path = self.path.borrow_mut();
            let here = [lobe.beta, lobe.gamma()];
            // The same lobe with pixels that have come further is no step of its own.
            if path.last() != Some(&here) {
                path.push(here);
            }
        }
        normal.matrix = matrix;
        Ok(normal)
    }

    /// Estimates the noise floor under the best lobe; whether it changed.
    fn refine_noise_floor(&mut self) -> Result<bool> {
        let last = self.passes.scale_reference.noise_floor;
        let noise_floor = noise_floor(&self.passes, self.best.get_mut())?;
        let other = (noise_floor - last).abs() > SAME_FLOOR * last;
        if other {
            self.passes = self.passes.with_noise_floor(noise_floor);
            // Costs under another noise floor cannot be compared.
            self.least.set(f64::INFINITY);
        }
        Ok(other)
    }

    /// The equations' matrix, softened along the last step.
    ///
    /// `w J'J` bounds the curvature of a robust scale from above (that is what makes its steps
    /// safe); where many samples are outliers, or normals answer to the lobe, the cost is far
    /// softer in some direction, and steps would be as much too short. How the slopes changed on
    /// the last step give the curvature along it (the update of Broyden, Fletcher, Goldfarb and
    /// Shanno, of one step's memory).
    fn softened(&self, place: [f64; 2], normal: &Normal<f64, 2>) -> [[f64; 2]; 2] {
        let (from, before) = self.last.get();
        let matrix = normal.matrix;
        let step: [f64; 2] = core::array::from_fn(|i| place[i] - from[i]);
        let turn: [f64; 2] = core::array::from_fn(|i| before.descent[i] - normal.descent[i]);
        let pull: [f64; 2] =
            core::array::from_fn(|i| (0..2).map(|j| matrix[i.max(j)][i.min(j)] * step[j]).sum());
        let stiff = step[0].mul_add(pull[0], step[1] * pull[1]);
        let fall = step[0].mul_add(turn[0], step[1] * turn[1]);
        if !(stiff > 0.0 && fall < stiff) {
            return matrix;
        }
        // Powell's damping: no direction is taken for softer than this.
        let share =
            if fall < SOFTEST * stiff { (1.0 - SOFTEST) * stiff / (stiff - fall) } else { 1.0 };
        let turn: [f64; 2] = core::array::from_fn(|i| share.mul_add(turn[i] - pull[i], pull[i]));
        let fall = step[0].mul_add(turn[0], step[1] * turn[1]);
        core::array::from_fn(|i| {
            core::array::from_fn(|j| {
                matrix[i][j] - pull[i] * pull[j] / stiff + turn[i] * turn[j] / fall
            })
        })
    }

    /// The lobe of smallest cost near a `place`, after every pixel has tried other normals.
    fn finish(mut self, place: [f64; 2]) -> Result<JointLobe> {
        let at = |[beta, log_sharpness]: [f64; 2]| CommonLobe { beta, log_sharpness };
        self.steps.set(FIRST_STEPS);
        self.visit(at(place), true)?;
        let mut outcome = self.minimise(place, SEARCH)?;
        // Without noise every better lobe lowers the noise floor.
        for _ in 0..REFINEMENTS {
            if !self.refine_noise_floor()? {
                break;
            }
            self.visit(at(outcome.parameters), false)?;
            outcome = self.minimise(outcome.parameters, SEARCH)?;
        }
        Ok(JointLobe {
            lobe: at(outcome.parameters),
            equations: self.equations.get(),
            path: self.path.into_inner(),
            scale_reference: self.passes.scale_reference,
            converged: outcome.reason.converged(),
        })
    }

    fn minimise(&self, start: [f64; 2], options: Options) -> Result<Outcome<f64, 2>> {
        let outcome = lm::minimise(self, start, &CommonLobe::bounds(), &options);
        match self.failure.take() {
            Some(error) => Err(error),
            None => Ok(outcome),
        }
    }
}

impl Problem<f64, 2> for JointSearch<'_> {
    fn normal(&self, [beta, log_sharpness]: [f64; 2]) -> Normal<f64, 2> {
        let lost = Normal { cost: f64::INFINITY, ..Normal::zero() };
        if self.failure.borrow().is_some() {
            return lost;
        }
        self.visit(CommonLobe { beta, log_sharpness }, false).unwrap_or_else(|error| {
            self.failure.replace(Some(error));
            lost
        })
    }
}

/// Finds the lobe of smallest cost, normals and colours following.
///
/// Two searches; between them every pixel tries other normals
/// ([`Irls::restart`](super::irls::Irls)).
pub(super) fn find_lobe(passes: Passes<'_>, state: State, lobe: CommonLobe) -> Result<JointLobe> {
    let mut trial = state.copied(passes.run)?;
    let flat = CommonLobe { beta: 0.0, ..lobe };
    passes.irls(&state, &mut trial, flat, stopping(FIRST_STEPS), false)?;
    let passes = passes.with_noise_floor(noise_floor(&passes, &trial)?);
    let mut search = JointSearch::new(passes, [state, trial], lobe, Vec::new());
    // Outliers decide a sum of squares of all samples (hard case 31); the robust cost says which of
    // two lobes is nearer.
    let satin = CommonLobe {
        beta: SATIN.0 * passes.scale_reference.brightness,
        log_sharpness: sharpness(SATIN.1).ln(),
    };
    for lobe in [lobe, satin] {
        search.steps.set(FIRST_STEPS);
        search.visit(lobe, false)?;
    }
    let rough = Options { max_iterations: ROUGH, ..SEARCH };
    let place = search.minimise(search.last.get().0, rough)?.parameters;
    search.refine_noise_floor()?;
    search.finish(place)
}

/// Goes on from the lobe that fewer of the pixels determined, whose noise floor `passes` has.
pub(super) fn refine_lobe(passes: Passes<'_>, state: State, rough: JointLobe) -> Result<JointLobe> {
    let trial = state.copied(passes.run)?;
    let CommonLobe { beta, log_sharpness } = rough.lobe;
    JointSearch::new(passes, [state, trial], rough.lobe, rough.path).finish([beta, log_sharpness])
}

/// A quarter of the squared scale that pixels with a quarter of the painting's light stay below.
///
/// Pixels are counted by their light, of each no more than of four bright ones: dark pixels, however
/// many, are those whose few codes hide their noise. The lower quartile is taken because the model
/// may describe most of a painting badly.
fn noise_floor(passes: &Passes<'_>, state: &State) -> Result<f64> {
    let most = MOST_LIGHT * passes.photographs.bands as f64 * passes.scale_reference.brightness;
    let mut light = passes.brightness(state)?;
    for light in &mut light {
        *light = light.min(most as f32);
    }
    let known =
        state.scale.iter().zip(&light).filter(|(scale, light)| (**scale * **light).is_finite());
    let mut known: Vec<(f32, f32)> = known.map(|(&scale, &light)| (scale, light)).collect();
    known.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut left = QUANTILE * known.iter().map(|&(_, light)| f64::from(light)).sum::<f64>();
    let typical = known.iter().find(|(_, light)| {
        left -= f64::from(*light);
        left <= 0.0
    });
    Ok(typical.map_or(0.0, |&(scale, _)| FLOOR_SHARE * f64::from(scale)))
}
