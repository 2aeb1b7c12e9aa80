//! One (beta, gamma) for the whole painting, and the normals and colours that go with it.

use crate::brdf::torrance_sparrow::{GAMMA_MAX, GAMMA_MIN, sharpness};
use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm;
use crate::pixels::{Run, TILE};
use crate::stack::Stack;

use super::extract::{Extract, Extraction};
use super::histogram::Histogram;
use super::refine::{Refine, Share};
use super::tile::{Maps, Reader, Scene};

/// How the pooled fit goes about it.
#[derive(Clone, Copy, Debug)]
pub struct PooledOptions {
    /// Which samples carry the first estimate.
    pub extraction: Extraction,
    /// Rounds of the joint fit; 0 stops at the papers' separate one.
    pub rounds: usize,
    /// Steps of each pixel's normal and colours per round.
    pub steps: usize,
    /// Index of refraction.
    pub index: f64,
}

/// What the samples say about the lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// A lobe stands out of the noise.
    Fitted,
    /// No sample shows a highlight: beta is 0, gamma where the search began (hard case 4).
    NoHighlight,
    /// A parameter ended at its bound, mirror-sharp or flat (hard cases 6 and 7).
    AtBound,
}

/// The painting's lobe.
#[derive(Clone, Debug)]
pub struct Pooled {
    /// Strength.
    pub beta: f64,
    /// Half-width of the facets, rad.
    pub gamma: f64,
    /// Covariance of (log beta, log gamma); infinite where there is no highlight.
    pub covariance: [[f64; 2]; 2],
    /// Why it is what it is.
    pub verdict: Verdict,
    /// What remains of the samples beside the final diffuse part, against phi.
    pub histogram: Histogram,
    /// (beta, gamma) after each round, the separate fit first.
    pub path: Vec<[f64; 2]>,
}

/// Fits the painting's (beta, gamma), refining normals and diffuse colours in place.
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit_pooled(
    stack: &Stack<'_>,
    rig: &Rig,
    maps: &mut Maps<'_>,
    options: &PooledOptions,
    run: &Run<'_>,
) -> Result<Pooled> {
    let shape = stack.shape();
    if rig.observations() != shape.observations {
        let problem =
            format!("{} lights for {} photographs", rig.observations(), shape.observations);
        return Err(Error::geometry("lights", problem));
    }
    let scene = Scene { stack, rig, index: options.index, bands: shape.bands };
    let first = extract(&scene, maps, options.extraction, run)?;
    let outcome = first.fit();
    let [mut beta, mut log_k] = outcome.parameters;
    let gamma_of = |log_k: f64| (core::f64::consts::LN_2 / log_k.exp()).sqrt();
    let mut path = vec![[beta, gamma_of(log_k)]];
    let freedom = (first.count() - 2.0).max(1.0);
    let mut normal = outcome.normal;
    let mut variance = normal.cost.max(0.0) / freedom;
    let bounds = (sharpness(GAMMA_MAX).ln(), sharpness(GAMMA_MIN).ln());
    for round in 0..=options.rounds {
        // The last pass only measures: normals and colours that go with the final lobe.
        // From the second round on, when the lobe is roughly known, lost normals are found again.
        let restart = options.rounds > 0 && round > 0;
        let share = refine(&scene, maps, (beta, log_k), restart, options, run)?;
        if options.rounds == 0 {
            break;
        }
        normal = share.normal;
        variance = normal.cost / share.freedom.max(1.0);
        if round == options.rounds {
            break;
        }
        let step = lm::factor(&normal.matrix, 1e-3, &[false; 2]).solve(&normal.descent);
        // A lobe is not linear in its width for more than this; beta may at most double or halve.
        log_k = (log_k + step[1].clamp(-0.7, 0.7)).clamp(bounds.0, bounds.1);
        beta = if beta > 0.0 { (beta + step[0]).clamp(0.3 * beta, 3.0 * beta) } else { 0.0 };
        path.push([beta, gamma_of(log_k)]);
    }
    let histogram = extract(&scene, maps, Extraction::Residual, run)?;
    Ok(judge(beta, log_k, &normal, variance, bounds, histogram, path))
}

fn judge(
    beta: f64,
    log_k: f64,
    normal: &lm::Normal<f64, 2>,
    variance: f64,
    bounds: (f64, f64),
    histogram: Histogram,
    path: Vec<[f64; 2]>,
) -> Pooled {
    let gamma = (core::f64::consts::LN_2 / log_k.exp()).sqrt();
    let factor = lm::factor(&normal.matrix, 0.0, &[false; 2]);
    let inverse = factor.inverse();
    // d log beta = d beta / beta, d log gamma = -1/2 d log k.
    let scale = [1.0 / beta, -0.5];
    let covariance: [[f64; 2]; 2] = core::array::from_fn(|i| {
        core::array::from_fn(|j| inverse[i][j] * variance * scale[i] * scale[j])
    });
    // Three standard deviations tell a highlight from noise.
    let seen = beta > 0.0 && !factor.deficient[0] && covariance[0][0].sqrt() < 1.0 / 3.0;
    if !seen {
        let unknown = [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]];
        let verdict = Verdict::NoHighlight;
        return Pooled { beta: 0.0, gamma, covariance: unknown, verdict, histogram, path };
    }
    let at_bound = log_k <= bounds.0 || log_k >= bounds.1 || factor.deficient[1];
    let verdict = if at_bound { Verdict::AtBound } else { Verdict::Fitted };
    Pooled { beta, gamma, covariance, verdict, histogram, path }
}

fn extract(
    scene: &Scene<'_>,
    maps: &mut Maps<'_>,
    extraction: Extraction,
    run: &Run<'_>,
) -> Result<Histogram> {
    let pixels = scene.stack.shape().pixels();
    let level = run.level;
    let parts = run.map(
        maps.tiles(pixels, scene.bands)?,
        || Reader::new(scene),
        |reader, tile| {
            reader.read(scene, tile.start);
            let Reader { samples, x, y } = reader;
            level.run(Extract { scene, tile: &tile, samples, stride: TILE, x, y, extraction })
        },
    )?;
    let mut sum = Histogram::default();
    for part in &parts {
        sum.merge(part);
    }
    Ok(sum)
}

fn refine(
    scene: &Scene<'_>,
    maps: &mut Maps<'_>,
    (beta, log_sharpness): (f64, f64),
    restart: bool,
    options: &PooledOptions,
    run: &Run<'_>,
) -> Result<Share> {
    let pixels = scene.stack.shape().pixels();
    let level = run.level;
    let steps = if options.rounds == 0 { 0 } else { options.steps };
    let parts = run.map(
        maps.tiles(pixels, scene.bands)?,
        || Reader::new(scene),
        |reader, mut tile| {
            reader.read(scene, tile.start);
            let Reader { samples, x, y } = reader;
            let tile = &mut tile;
            let stride = TILE;
            level.run(Refine {
                scene,
                tile,
                samples,
                stride,
                x,
                y,
                beta,
                log_sharpness,
                steps,
                restart,
            })
        },
    )?;
    let mut sum = Share::zero();
    for part in &parts {
        sum.merge(part);
    }
    Ok(sum)
}
