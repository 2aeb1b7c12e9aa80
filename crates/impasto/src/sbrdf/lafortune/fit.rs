//! The three passes, tile by tile.

use crate::error::{Error, Result};
use crate::geometry::Rig;
use crate::lm::Options;
use crate::maps::Status;
use crate::math::Level;
use crate::pixels::Run;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::aside::Aside;
use super::colours::{Colours, Tints};
use super::found::{Found, MOST_LOBES};
use super::maps::{LafortuneMaps, Sheet};
use super::normal::Facing;
use super::scratch::{Scratch, TILE};
use super::sequence::Sequence;
use super::settle::Settle;
use super::trust::Trust;

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
/// # Errors
/// If sizes disagree or the run is cancelled.
pub fn fit_lafortune(
    stack: &Stack<'_>,
    rig: &Rig,
    start: &Start<'_>,
    options: LafortuneOptions,
    run: &Run<'_>,
) -> Result<LafortuneMaps> {
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
    let sequence =
        Sequence { lobes: options.lobes, select: true, turning: views_differ, options: search };
    let fit = Fit { stack, rig, start, sequence, rounds: options.rounds, run };
    let mut maps = LafortuneMaps::new(shape.bands, options.lobes, start.status, run)?;
    maps.views_differ = views_differ;
    let stopped = || run.cancelled();
    run.for_each(
        maps.sheets(TILE),
        || Scratch::new(stack),
        |scratch, sheet| fit.tile(scratch, sheet, &stopped),
    )?;
    Ok(maps)
}

struct Fit<'a> {
    stack: &'a Stack<'a>,
    rig: &'a Rig,
    start: &'a Start<'a>,
    sequence: Sequence,
    rounds: usize,
    run: &'a Run<'a>,
}

impl Fit<'_> {
    fn tile(
        &self,
        scratch: &mut Scratch,
        mut sheet: Sheet<'_>,
        stopped: &(dyn Fn() -> bool + Sync),
    ) {
        let level = self.run.level;
        let all = self.stack.shape().pixels();
        scratch.read(level, self.stack, sheet.start);
        self.rig.grid().coordinates(sheet.start, &mut scratch.x, &mut scratch.y);
        for (place, (&x, &y)) in scratch.places.iter_mut().zip(scratch.x.iter().zip(&scratch.y)) {
            *place = [x, y];
        }
        let count = sheet.status.len();
        for (pixel, normal) in scratch.normals[..count].iter_mut().enumerate() {
            *normal = [0, 1, 2].map(|axis| self.start.normal[axis * all + sheet.start + pixel]);
        }
        let mut fine: Vec<usize> = (0..count)
            .filter(|&pixel| {
                let status = sheet.status[pixel];
                status < Status::Dark.code() || self.turns(status)
            })
            .collect();
        if self.sequence.turning {
            self.face(level, scratch, &mut fine, &mut sheet, stopped);
        }
        if stopped() {
            return;
        }
        let data = scratch.luminance(self.rig);
        let (mut found, _) = self.sequence.fit(level, &data, &fine, stopped);
        let mut settle = Settle {
            rig: self.rig,
            sequence: &self.sequence,
            rounds: self.rounds,
            level,
            scratch,
            fine: &fine,
            sigma: sheet.sigma,
            stopped,
        };
        settle.run(&mut found);
        // Nobody reads what a cancelled call has found.
        if stopped() {
            return;
        }
        let (data, turning) = (&scratch.luminance(self.rig), self.sequence.turning);
        Trust { data, turning, pixels: &fine, found: &found, stopped }.write(level, &mut sheet);
        scratch.leave_out(&fine);
        self.write(scratch, &fine, &found, sheet);
    }

    /// Whether a normal that photometric stereo has not found may be found all the same: its lights
    /// lay in a plane, once those of highlights were left out; views tell what lights do not.
    fn turns(&self, status: u8) -> bool {
        self.sequence.turning && status == Status::RankDeficient.code()
    }

    /// Turns the pixels to where a cosine lobe says that they face; whose normals are still unknown
    /// then are left to their statuses.
    fn face(
        &self,
        level: Level,
        scratch: &mut Scratch,
        fine: &mut Vec<usize>,
        sheet: &mut Sheet<'_>,
        stopped: &(dyn Fn() -> bool + Sync),
    ) {
        for &pixel in fine.iter().filter(|&&pixel| self.turns(sheet.status[pixel])) {
            scratch.normals[pixel] = [0.0, 0.0, 1.0];
        }
        let options = &self.sequence.options;
        let facing = Aside { rig: self.rig, options, level, scratch, fine, stopped }.run();
        for (&pixel, Facing { normal, sigma, .. }) in fine.iter().zip(facing) {
            scratch.normals[pixel] = normal;
            sheet.sigma[pixel] = sigma;
            if self.turns(sheet.status[pixel]) && sigma.is_finite() {
                sheet.status[pixel] = Status::Fitted.code();
            }
        }
        fine.retain(|&pixel| sheet.status[pixel] < Status::Dark.code());
    }

    fn write(&self, scratch: &Scratch, fine: &[usize], found: &[Found], mut sheet: Sheet<'_>) {
        let bands = self.stack.shape().bands;
        // Of a pixel without light this much is known: it reflects none.
        for pixel in (0..sheet.status.len()).filter(|&p| sheet.status[p] == Status::Dark.code()) {
            let colours = [&mut sheet.diffuse, &mut sheet.specular];
            colours.into_iter().flatten().for_each(|plane| plane[pixel] = 0.0);
        }
        let mut tints = Tints::new(bands, scratch.places.len());
        self.run.level.run(Colours { rig: self.rig, scratch, fine, found, tints: &mut tints });
        for (&pixel, found) in fine.iter().zip(found) {
            let scale = scratch.scales[pixel];
            if !tints.finite(pixel, scale) {
                // Samples near the end of single precision have colours beyond it.
                sheet.status[pixel] = Status::InvalidInput.code();
                sheet.sigma[pixel] = f32::NAN;
                let told = [
                    &mut sheet.specular_sigma,
                    &mut sheet.direction_sigma,
                    &mut sheet.exponent_sigma,
                ];
                told.into_iter().flatten().for_each(|plane| plane[pixel] = f32::NAN);
                continue;
            }
            for (plane, value) in sheet.normal.iter_mut().zip(scratch.normals[pixel]) {
                plane[pixel] = value;
            }
            for band in 0..bands {
                sheet.diffuse[band][pixel] = scale * tints.colour(band, 0, pixel);
                for lobe in 0..self.sequence.lobes {
                    let strength =
                        if lobe < found.lobes { tints.colour(band, 1 + lobe, pixel) } else { 0.0 };
                    sheet.specular[lobe * bands + band][pixel] = scale * strength;
                }
            }
            for lobe in 0..found.lobes {
                let [cxy, cz, exponent] = found.shape(lobe);
                sheet.cxy[lobe][pixel] = cxy as f32;
                sheet.cz[lobe][pixel] = cz as f32;
                sheet.exponent[lobe][pixel] = exponent as f32;
            }
            sheet.lobes[pixel] = found.lobes as u8;
            sheet.residual[pixel] = scale * tints.residual[pixel];
        }
    }
}
