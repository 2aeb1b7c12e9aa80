//! Snel's second pass: lobes added one at a time.

use crate::brdf::lafortune::coefficients;
use crate::lm::{Occupancy, Options, Outcome};
use crate::math::{Element, Level};

use super::lobes::{LOG_EXPONENT, Search};
use super::luminance::Luminance;

/// Most lobes of a pixel.
pub const MOST_LOBES: usize = 3;

/// Exponents that Snel starts lobes from, in the order in which they are added.
const STARTS: [f64; MOST_LOBES] = [50.0, 5.0, 20.0];

/// `n` and `n turn` from which a first lobe starts that stands towards the light: `Cxy = Cz`.
const RETRO: f64 = 5.0;

/// Strength that a lobe starts from, relative to the diffuse surface of least squares; the
/// diffuse part starts from the same.
const STRENGTH: f64 = 0.5;

/// Rounding of a predicted sample relative to the largest: costs below it are noiseless.
const ROUNDING: f64 = 1.0 / (1_u64 << 21) as f64;

/// How lobes are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    /// Most lobes, 0 to [`MOST_LOBES`].
    pub lobes: usize,
    /// Whether a lobe that does not lower the Bayesian information criterion is left out.
    pub select: bool,
    /// Whether lobes may turn away from the mirror direction (hard case 18: not under one view).
    pub turning: bool,
    /// When the last search of a pixel stops.
    pub options: Options,
}

/// What was found for a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// How many lobes.
    pub lobes: usize,
    /// Diffuse part, then (strength, n times turn, ln n) of every lobe, the sharpest first.
    pub at: [f64; 1 + 3 * MOST_LOBES],
    /// Sum of squared residuals.
    pub cost: f64,
    /// Samples that counted.
    pub samples: usize,
    /// Whether the samples tell all parameters apart.
    pub distinct: bool,
    /// Whether the first lobe starts towards the light, not its mirror image (hard case 16).
    retro: bool,
    floor: f64,
}

impl Found {
    /// Schwarz's criterion, `m ln(C / m) + p ln m`.
    #[must_use]
    pub fn bic(&self) -> f64 {
        let m = self.samples as f64;
        let unknowns = (1 + 3 * self.lobes) as f64;
        m.mul_add((self.cost.max(self.floor) / m).ln(), unknowns * m.ln())
    }

    /// `[strength, n times turn, ln n]` of a lobe.
    #[must_use]
    pub fn lobe(&self, number: usize) -> [f64; 3] {
        core::array::from_fn(|i| self.at[1 + 3 * number + i])
    }

    /// `[Cxy, Cz, n]` of a lobe.
    #[must_use]
    pub fn shape(&self, number: usize) -> [f64; 3] {
        let [_, turning, log_exponent] = self.lobe(number);
        let exponent = log_exponent.exp();
        let [cxy, cz] = coefficients(turning / exponent);
        [cxy, cz, exponent]
    }

    /// Whether every lobe is one: lit, and sharper than what the diffuse part describes (hard
    /// cases 13 and 15).
    fn whole(&self) -> bool {
        (0..self.lobes).map(|j| self.lobe(j)).all(|[a, _, n]| a > 0.0 && n > 0.0)
    }

    /// The sharpest lobe first.
    fn sort(&mut self) {
        let mut lobes: Vec<_> = (0..self.lobes).map(|j| self.lobe(j)).collect();
        lobes.sort_by(|a, b| b[2].total_cmp(&a[2]));
        for (j, lobe) in lobes.into_iter().enumerate() {
            self.at[1 + 3 * j..4 + 3 * j].copy_from_slice(&lobe);
        }
    }
}

impl Sequence {
    /// Fits some pixels; the answers stand in their order.
    ///
    /// `stopped` is asked before a pixel is taken up; once it says yes the answers are worthless.
    pub fn fit(
        &self,
        level: Level,
        data: &Luminance<'_>,
        pixels: &[usize],
        stopped: &(dyn Fn() -> bool + Sync),
    ) -> (Vec<Found>, Occupancy) {
        let mut found: Vec<_> = pixels.iter().map(|&pixel| self.plain(data, pixel)).collect();
        let mut occupancy = Occupancy::default();
        let mut open: Vec<_> = (0..pixels.len()).collect();
        let search = |options| Search { data, turning: self.turning, level, options, stopped };
        // A cost to a thousandth is one to 0.7 in the criterion of 700 samples; a lobe costs 20.
        let rough = Options { cost: 1e-3, step: 1e-3, gradient: 1e-3, ..self.options };
        for lobes in 1..=self.lobes.min(MOST_LOBES) {
            open.retain(|&i| room_for(lobes, found[i].samples) && found[i].at[0] > 0.0);
            let options = if lobes == self.lobes { &self.options } else { &rough };
            let mut trial = found.clone();
            for &i in &open {
                trial[i] = with_lobe(&found[i], STARTS[lobes - 1]);
            }
            add(&mut occupancy, refine::<f32>(&search(options), pixels, &open, &mut trial));
            open.retain(|&i| {
                let better = !self.select || (trial[i].whole() && trial[i].bic() < found[i].bic());
                if better {
                    found[i] = trial[i];
                }
                better
            });
        }
        let ended = (0..pixels.len())
            .filter(|&i| (1..self.lobes).contains(&found[i].lobes))
            .collect::<Vec<_>>();
        for lobes in 1..self.lobes {
            let these: Vec<_> =
                ended.iter().copied().filter(|&i| found[i].lobes == lobes).collect();
            add(&mut occupancy, refine::<f32>(&search(&self.options), pixels, &these, &mut found));
        }
        found.iter_mut().for_each(Found::sort);
        (found, occupancy)
    }

    fn plain(&self, data: &Luminance<'_>, pixel: usize) -> Found {
        let plain = data.plain(pixel);
        let mut at = [0.0; 1 + 3 * MOST_LOBES];
        at[0] = plain.diffuse;
        Found {
            lobes: 0,
            at,
            cost: plain.cost,
            samples: plain.count,
            distinct: true,
            retro: self.turning && plain.retro,
            floor: plain.square * ROUNDING * ROUNDING,
        }
    }
}

/// Whether so many samples determine so many lobes, with something left over (hard case 30).
fn room_for(lobes: usize, samples: usize) -> bool {
    samples > 2 + 3 * lobes
}

/// One lobe more, as strong as a diffuse part that shares the light with it.
fn with_lobe(found: &Found, exponent: f64) -> Found {
    let mut next = *found;
    if found.lobes == 0 {
        next.at[0] *= STRENGTH;
    }
    let strength = next.at[0].max(STRENGTH * 0.5 * found.at[0]);
    let [exponent, turning] =
        if found.lobes == 0 && found.retro { [RETRO; 2] } else { [exponent, 0.0] };
    let place = 1 + 3 * found.lobes;
    next.at[place..place + 3].copy_from_slice(&[
        strength,
        turning,
        exponent.ln().clamp(LOG_EXPONENT[0], LOG_EXPONENT[1]),
    ]);
    next.lobes += 1;
    next
}

/// Searches on from where some pixels, all with as many lobes, stand.
fn refine<S: Element>(
    search: &Search<'_>,
    pixels: &[usize],
    which: &[usize],
    found: &mut [Found],
) -> Occupancy {
    match which.first().map_or(0, |&i| found[i].lobes) {
        0 => Occupancy::default(),
        1 => refine_some::<S, 4>(search, pixels, which, found),
        2 => refine_some::<S, 7>(search, pixels, which, found),
        _ => refine_some::<S, 10>(search, pixels, which, found),
    }
}

fn refine_some<S: Element, const N: usize>(
    search: &Search<'_>,
    pixels: &[usize],
    which: &[usize],
    found: &mut [Found],
) -> Occupancy {
    let chosen: Vec<_> = which.iter().map(|&i| pixels[i]).collect();
    let starts: Vec<[f64; N]> =
        which.iter().map(|&i| core::array::from_fn(|p| found[i].at[p])).collect();
    search.run(
        &chosen,
        |problem| starts[problem],
        |problem, outcome: &Outcome<S, N>| {
            let found = &mut found[which[problem]];
            for (at, parameter) in found.at.iter_mut().zip(outcome.parameters) {
                *at = parameter.to_f64();
            }
            found.cost = outcome.normal.cost.to_f64();
            found.distinct = !outcome.deficient().contains(&true);
        },
    )
}

fn add(sum: &mut Occupancy, more: Occupancy) {
    sum.lanes += more.lanes;
    sum.useful += more.useful;
}
