//! The three passes, tile by tile.

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm::Options;
use crate::maps::Status;
use crate::math::Level;
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::colours::{LafortuneColours, TileColours};
use super::consensus::Consensus;
use super::covariance::Covariance;
use super::estimate::{LafortuneEstimate, MOST_LOBES};
use super::forward_selection::LafortuneSelection;
use super::maps::{LafortuneMapsMut, LafortuneTile};
use super::normal::NormalEstimate;
use super::refine::Refine;
use super::scratch::{LafortuneScratch, TILE};

/// How the fit goes about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LafortuneOptions {
    /// Lobes per pixel at most, up to [`MOST_LOBES`].
    pub lobes: usize,
    /// Rounds in which outliers are left out and what they had bent is searched for anew.
    pub rounds: usize,
}

/// Lafortune lobes of every pixel, from the normals of photometric stereo.
///
/// Where views do not differ ([`Rig::views_differ`]) they cannot separate normals from lobe axes:
/// normals are then those of photometric stereo and lobes are Phong's (hard case 18).
///
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit_lafortune(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    options: LafortuneOptions,
    maps: LafortuneMapsMut<'_>,
    run: &Run<'_>,
) -> Result<()> {
    let shape = stack.shape();
    if rig.observations() != shape.observations {
        let problem =
            format!("{} lights for {} photographs", rig.observations(), shape.observations);
        return Err(Error::geometry("lights", problem));
    }
    if options.lobes > MOST_LOBES {
        let problem = format!("at most {MOST_LOBES}, found {}", options.lobes);
        return Err(Error::argument("lobes", problem));
    }
    start.check(shape.pixels(), shape.bands)?;
    let views_differ = rig.views_differ();
    let search = Options { damping: 1.0, max_iterations: 200, ..Options::single() };
    let sequence = LafortuneSelection {
        lobes: options.lobes,
        select: true,
        turning: views_differ,
        options: search,
    };
    let fit = LafortuneFit { stack, rig, start, sequence, rounds: options.rounds, run };
    let stopped = || run.cancelled();
    run.for_each(
        maps.tiles(shape.pixels(), shape.bands, options.lobes, TILE)?,
        || LafortuneScratch::new(stack),
        |scratch, tile| fit.tile(scratch, tile, &stopped),
    )
}

struct LafortuneFit<'a> {
    stack: &'a Stack<'a>,
    rig: &'a Rig,
    start: &'a Start<'a>,
    sequence: LafortuneSelection,
    rounds: usize,
    run: &'a Run<'a>,
}

impl LafortuneFit<'_> {
    fn tile(
        &self,
        scratch: &mut LafortuneScratch,
        mut tile: LafortuneTile<'_>,
        stopped: &(dyn Fn() -> bool + Sync),
    ) {
        let level = self.run.level;
        let all = self.stack.shape().pixels();
        tile.clear(&self.start.status[tile.start..tile.start + tile.status.len()]);
        scratch.read(level, self.stack, tile.start);
        self.rig.grid().coordinates(tile.start, &mut scratch.x, &mut scratch.y);
        for (place, (&x, &y)) in scratch.places.iter_mut().zip(scratch.x.iter().zip(&scratch.y)) {
            *place = [x, y];
        }
        let count = tile.status.len();
        for (pixel, normal) in scratch.normals[..count].iter_mut().enumerate() {
            *normal = [0, 1, 2].map(|axis| self.start.normal[axis * all + tile.start + pixel]);
        }
        let mut fine: Vec<usize> = (0..count)
            .filter(|&pixel| {
                let status = tile.status[pixel];
                status < Status::Dark.code() || self.turns(status)
            })
            .collect();
        if self.sequence.turning {
            self.set_normals(level, scratch, &mut fine, &mut tile, stopped);
        }
        if stopped() {
            return;
        }
        let data = scratch.luminance(self.rig);
        let (mut found, _) = self.sequence.fit(level, &data, &fine, stopped);
        let mut refine = Refine {
            rig: self.rig,
            sequence: &self.sequence,
            rounds: self.rounds,
            level,
            scratch,
            fine: &fine,
            sigma: tile.sigma,
            stopped,
        };
        refine.run(&mut found);
        // Nobody reads what a cancelled call has found.
        if stopped() {
            return;
        }
        let (data, turning) = (&scratch.luminance(self.rig), self.sequence.turning);
        Covariance { data, turning, pixels: &fine, found: &found, stopped }.write(level, &mut tile);
        scratch.leave_out(&fine);
        self.write(scratch, &fine, &found, tile);
    }

    /// Whether a normal that photometric stereo has not found may be found all the same: its lights
    /// lay in a plane, once those of highlights were left out; views tell what lights do not.
    fn turns(&self, status: u8) -> bool {
        self.sequence.turning && status == Status::RankDeficient.code()
    }

    /// Sets the normals of the pixels to those of their cosine lobes; pixels whose normals are still
    /// unknown keep their statuses.
    fn set_normals(
        &self,
        level: Level,
        scratch: &mut LafortuneScratch,
        fine: &mut Vec<usize>,
        tile: &mut LafortuneTile<'_>,
        stopped: &(dyn Fn() -> bool + Sync),
    ) {
        for &pixel in fine.iter().filter(|&&pixel| self.turns(tile.status[pixel])) {
            scratch.normals[pixel] = [0.0, 0.0, 1.0];
        }
        let options = &self.sequence.options;
        let facing = Consensus { rig: self.rig, options, level, scratch, fine, stopped }.run();
        for (&pixel, NormalEstimate { normal, sigma, .. }) in fine.iter().zip(facing) {
            scratch.normals[pixel] = normal;
            tile.sigma[pixel] = sigma;
            if self.turns(tile.status[pixel]) && sigma.is_finite() {
                tile.status[pixel] = Status::Fitted.code();
            }
        }
        fine.retain(|&pixel| tile.status[pixel] < Status::Dark.code());
    }

    fn write(
        &self,
        scratch: &LafortuneScratch,
        fine: &[usize],
        found: &[LafortuneEstimate],
        mut tile: LafortuneTile<'_>,
    ) {
        let bands = self.stack.shape().bands;
        // Of a pixel without light this much is known: it reflects none.
        for pixel in (0..tile.status.len()).filter(|&p| tile.status[p] == Status::Dark.code()) {
            let colours = [&mut tile.diffuse, &mut tile.specular];
            colours.into_iter().flatten().for_each(|plane| plane[pixel] = 0.0);
        }
        let mut tints = TileColours::new(bands, scratch.places.len());
        self.run.level.run(LafortuneColours {
            rig: self.rig,
            scratch,
            fine,
            found,
            tints: &mut tints,
        });
        for (&pixel, found) in fine.iter().zip(found) {
            let scale = scratch.scales[pixel];
            if !tints.finite(pixel, scale) {
                // Samples near the end of single precision have colours beyond it.
                tile.status[pixel] = Status::InvalidInput.code();
                tile.sigma[pixel] = f32::NAN;
                let sigmas =
                    [&mut tile.specular_sigma, &mut tile.direction_sigma, &mut tile.exponent_sigma];
                sigmas.into_iter().flatten().for_each(|plane| plane[pixel] = f32::NAN);
                continue;
            }
            for (plane, value) in tile.normal.iter_mut().zip(scratch.normals[pixel]) {
                plane[pixel] = value;
            }
            for band in 0..bands {
                tile.diffuse[band][pixel] = scale * tints.colour(band, 0, pixel);
                for lobe in 0..self.sequence.lobes {
                    let strength =
                        if lobe < found.lobes { tints.colour(band, 1 + lobe, pixel) } else { 0.0 };
                    tile.specular[lobe * bands + band][pixel] = scale * strength;
                }
            }
            for lobe in 0..found.lobes {
                let [cxy, cz, exponent] = found.shape(lobe);
                tile.cxy[lobe][pixel] = cxy as f32;
                tile.cz[lobe][pixel] = cz as f32;
                tile.exponent[lobe][pixel] = exponent as f32;
            }
            tile.lobes[pixel] = found.lobes as u8;
            tile.residual[pixel] = scale * tints.residual[pixel];
        }
    }
}
