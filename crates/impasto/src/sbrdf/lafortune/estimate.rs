//! The lobes of one pixel, and the criteria by which estimates are compared.

use crate::brdf::lafortune::coefficients;

/// Most lobes of a pixel.
pub const MOST_LOBES: usize = 3;

/// Largest `n |turn|`; measured lobes have up to 6.
pub(super) const TURN: f64 = 8.0;

/// Residuals beyond this many standard deviations are outliers, the deviation estimated by the median
/// of the absolute residuals; noise of 770 samples reaches 6 in one pixel of 600,000.
pub(super) const OUTLIER_DEVIATIONS: f64 = 6.0;

/// Outliers also differ by this share of the larger of sample and fit. Lobes describe the few bright
/// samples of a sharp highlight to some percent, which may be many deviations of the rest: those
/// samples are kept.
pub(super) const OUTLIER_SHARE: f32 = 0.5;

/// Fall of the criterion that no choice of photographs brings about: 151 of them tell the
/// logarithm of a variance to 0.12, which is 17 in the criterion; six times that.
pub(super) const CLEAR: f64 = 100.0;

/// Exponents of two lobes that are one, as a ratio, and the strength of one that is none, relative
/// to the others.
const ALIKE: f64 = 1.5;
const FAINT: f64 = 0.05;

/// `ln n` of lobes that are not searched again: n from 2.2 to 200.
const ORDINARY: [f64; 2] = [0.8, 5.3];

/// Diffuse part and lobes of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LafortuneEstimate {
    /// How many lobes.
    pub lobes: usize,
    /// Diffuse part, then (strength, n times turn, ln n) of every lobe, the sharpest first.
    pub at: [f64; 1 + 3 * MOST_LOBES],
    /// Sum of squared residuals.
    pub cost: f64,
    /// Samples that counted.
    pub samples: usize,
    /// Photographs that were used.
    pub(super) photographs: usize,
    /// Whether the first lobe starts towards the light, not its mirror image (hard case 16).
    pub(super) retro: bool,
    /// Cost of the rounding alone.
    pub(super) floor: f64,
}

impl LafortuneEstimate {
    /// The Bayesian information criterion [@schwarz1978bic], `m ln(C / m) + p ln m`.
    #[must_use]
    pub fn bic(&self) -> f64 {
        let m = self.samples as f64;
        let unknowns = (1 + 3 * self.lobes) as f64;
        m.mul_add(self.mean().ln(), unknowns * m.ln())
    }

    /// Mean squared residual, no less than what rounding leaves.
    pub(super) fn mean(&self) -> f64 {
        self.cost.max(self.floor) / self.samples as f64
    }

    /// Strength of the diffuse part (0) or of a lobe (from 1); 0 of one that is not there.
    pub(super) fn strength(&self, column: usize) -> f64 {
        match column {
            0 => self.at[0],
            _ if column <= self.lobes => self.lobe(column - 1)[0],
            _ => 0.0,
        }
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

    fn each(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        (0..self.lobes).map(|number| self.lobe(number))
    }

    /// Whether every lobe is one: lit, and sharper than what the diffuse part describes (hard
    /// cases 13 and 15).
    pub(super) fn whole(&self) -> bool {
        self.each().all(|[a, _, n]| a > 0.0 && n > 0.0)
    }

    /// Whether it is better than another fit of the pixel, to other photographs or fewer.
    pub(super) fn clearly_better(&self, other: &Self) -> bool {
        let m = self.samples.min(other.samples) as f64;
        m * (other.mean() / self.mean()).ln() > CLEAR
    }

    /// Whether the lobes look like a local minimum: two alike, one of almost no strength, one at a
    /// bound, one so sharp or so broad that it may describe noise or a remainder, or no lobe at all.
    pub(super) fn doubtful(&self) -> bool {
        let most = self.each().map(|lobe| lobe[0]).fold(0.0, f64::max);
        let odd = |[strength, turning, log_exponent]: [f64; 3]| {
            strength <= FAINT * most
                || turning.abs() >= TURN
                || !(ORDINARY[0]..ORDINARY[1]).contains(&log_exponent)
        };
        let alike = |a: usize, b: usize| (self.lobe(a)[2] - self.lobe(b)[2]).abs() < ALIKE.ln();
        self.lobes == 0
            || self.each().any(odd)
            || (1..self.lobes).any(|a| (0..a).any(|b| alike(a, b)))
    }

    /// All but one lobe, with a cost that any search undercuts.
    pub(super) fn without(&self, lobe: usize) -> Self {
        let mut fewer = *self;
        fewer.at.copy_within(4 + 3 * lobe..=3 * self.lobes, 1 + 3 * lobe);
        Self { lobes: self.lobes - 1, cost: f64::MAX, ..fewer }
    }

    /// The sharpest lobe first.
    pub(super) fn sort(&mut self) {
        let mut lobes: Vec<_> = self.each().collect();
        lobes.sort_by(|a, b| b[2].total_cmp(&a[2]));
        for (j, lobe) in lobes.into_iter().enumerate() {
            self.at[1 + 3 * j..4 + 3 * j].copy_from_slice(&lobe);
        }
    }
}
