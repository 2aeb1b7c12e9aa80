//! Photometric stereo [@woodham1980photometric]: normals and albedo from samples under known lights.
//!
//! A matte pixel under light `k` sends `I_k = b . l_k`, with `b` the normal times the albedo
//! (eq. 2 of the RGB-camera paper [@tominaga-rgb-camera]). Three steps decide which samples determine `b`:
//!
//! 1. clipped and missing samples have weight 0, whatever the method;
//! 2. a `rejection` rule drops highlights and shadows by the size of a sample among its pixel's
//!    samples ([`Method::Threshold`], [`Method::Rank`]);
//! 3. an M-estimator (`m_estimators`) weights the rest by their residuals, in iteratively
//!    reweighted least squares (`irls`: [`Method::L1`] and others).
//!
//! Rejection rules use the mean of the bands; `b` is solved from that mean or from one band. The albedo
//! of every band follows along the normal, by least squares with the same weights.

mod distant_system;
mod fit;
mod irls;
mod lanes;
mod learning;
mod lights;
mod m_estimators;
mod m_scale;
mod mm_estimation;
mod model_errors;
mod plain_registers;
mod problem;
mod rejection;
mod results;
mod rows;
mod samples;
mod shrinkage;
mod solve;
mod sorting_network;
mod sums;
mod tile;

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::pixels::Run;
use crate::stack::Stack;

use distant_system::DistantSystem;
use model_errors::near_views;
use problem::StereoProblem;
pub use problem::{Learned, Method, StereoOptions};
use rejection::RejectionRule;
use solve::determined;
pub use solve::{CONDITION_LIMIT, ENOUGH, RANK_LIMIT};
pub use tile::NormalMaps;

/// Fits every pixel's normal and albedo.
///
/// # Errors
/// If there are fewer than three lights, all of them lie in one plane, an option makes no sense,
/// sizes disagree, or the run is cancelled.
pub fn fit_normals(
    stack: &Stack<'_>,
    rig: &Rig,
    options: &StereoOptions,
    maps: &mut NormalMaps<'_>,
    run: &Run<'_>,
) -> Result<()> {
    estimate(stack, rig, options, maps, None, run)
}

/// Learns what a fit of any part of a painting must know of the whole, from a sample of its pixels.
///
/// # Errors
/// As for [`fit_normals`], or if the method is another than [`Method::Robust`].
pub fn learn_normals(
    stack: &Stack<'_>,
    rig: &Rig,
    options: &StereoOptions,
    run: &Run<'_>,
) -> Result<Learned> {
    if options.method != Method::Robust {
        let problem = "only the robust method learns from a whole painting".to_owned();
        return Err(Error::argument("method", problem));
    }
    let pixels = stack.shape().pixels();
    let mut statistics = run.filled(0.0, learning::PLANES * pixels)?;
    let options = StereoOptions { learned: Learned::default(), ..*options };
    let mut maps = NormalMaps {
        normal: &mut [],
        albedo: &mut [],
        used: &mut [],
        rejected: &mut [],
        residual: &mut [],
        condition: &mut [],
        sigma: &mut [],
        status: &mut run.filled(0, pixels)?,
    };
    estimate(stack, rig, &options, &mut maps, Some(&mut statistics), run)?;
    Ok(learning::learned(&statistics, maps.status))
}

/// The fit, and for a sample to learn from what each of its pixels says.
fn estimate(
    stack: &Stack<'_>,
    rig: &Rig,
    options: &StereoOptions,
    maps: &mut NormalMaps<'_>,
    statistics: Option<&mut [f32]>,
    run: &Run<'_>,
) -> Result<()> {
    check(stack, rig, options)?;
    let rule = options.method.rule();
    // The default solves complete pixels as it does others: a photograph that counts nowhere changes no bit.
    let one_path = options.method != Method::Robust;
    let problem = StereoProblem {
        stack,
        rig,
        rule,
        loss: options.method.loss(),
        options: *options,
        learns: statistics.is_some(),
        albedo: !maps.albedo.is_empty(),
        near_views: options.method == Method::Robust && near_views(rig),
        run,
        uniform: (rule == RejectionRule::All && one_path && rig.is_distant())
            .then(|| DistantSystem::new(rig)),
    };
    let shape = stack.shape();
    let level = run.level;
    run.for_each(
        maps.tiles(shape.pixels(), shape.bands, statistics)?,
        || samples::StereoScratch::new(&problem),
        |scratch, mut tile| {
            level.run(fit::NormalFit { problem: &problem, scratch, tile: &mut tile });
        },
    )
}

fn check(stack: &Stack<'_>, rig: &Rig, options: &StereoOptions) -> Result<()> {
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
    if rig.is_distant() && !determined(DistantSystem::new(rig).squared) {
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
    options.check()
}
