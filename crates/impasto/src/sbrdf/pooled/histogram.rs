//! The separate fit by Levenberg-Marquardt [@levenberg1944; @marquardt1963]: the specular part of all
//! pixels against the angle phi, eq. 6 of the six-band paper [@tominaga-six-band-adaptation] and
//! eq. 10 of the RGB-camera paper [@tominaga-rgb-camera], in one pass over the pixels.
//!
//! Samples of one bin of `phi^2` share its lobe `D`, so that the sum of squares of
//! `y - beta w D(phi^2)`, `w = F G / (N.V)`, needs only the bin's sums of `w^2`, `w y` and `y^2`.
//! `phi^2` is taken at the bin's centroid (weighted by `w^2`): the error is of second order,
//! `(k width)^2 / 24` of the lobe; with [`BINS`] bins up to [`PHI_SQUARED_MAX`] that is 1e-5 at
//! gamma = 0.03 rad and less for wider lobes.

use crate::brdf::torrance_sparrow::{GAMMA_MAX, GAMMA_MIN, sharpness};
use crate::lm::{self, Bounds, Normal, Options, Outcome, Problem};

/// Bins of `phi^2`.
pub const BINS: usize = 4096;

/// Angles beyond 1 rad carry no highlight.
pub const PHI_SQUARED_MAX: f64 = 1.0;

/// Share of its peak below which a lobe is faint: beyond two and a half half-widths. Where all
/// samples are, a search goes as far as numbers reach: constant samples are the tail of a lobe of
/// any strength (hard case 27).
const FAINT: f64 = 0.01;

/// Steps of the search for the peak region, which changes by less and less.
const PEAK_STEPS: usize = 16;

/// Sums over the samples of each bin.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    bins: Vec<Bin>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Bin {
    count: f64,
    ww: f64,
    wy: f64,
    yy: f64,
    /// Sum of `w^2 phi^2`.
    ww_phi_squared: f64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { bins: vec![Bin::default(); BINS] }
    }
}

impl Histogram {
    /// Adds one sample: what is specular in it, the model's weight, its angle.
    #[inline]
    pub fn add(&mut self, specular: f32, weight: f32, phi_squared: f32) {
        let (y, w, p) = (f64::from(specular), f64::from(weight), f64::from(phi_squared));
        let place = p * (BINS as f64 / PHI_SQUARED_MAX);
        // False for NaN too (hard case 26).
        if w > 0.0 && place < BINS as f64 && y.is_finite() {
            let bin = &mut self.bins[place as usize];
            bin.count += 1.0;
            bin.ww = w.mul_add(w, bin.ww);
            bin.wy = w.mul_add(y, bin.wy);
            bin.yy = y.mul_add(y, bin.yy);
            bin.ww_phi_squared = (w * w).mul_add(p, bin.ww_phi_squared);
        }
    }

    /// Adds another's sums (tile by tile, in tile order).
    pub fn merge(&mut self, other: &Self) {
        for (bin, other) in self.bins.iter_mut().zip(&other.bins) {
            bin.count += other.count;
            bin.ww += other.ww;
            bin.wy += other.wy;
            bin.yy += other.yy;
            bin.ww_phi_squared += other.ww_phi_squared;
        }
    }

    /// The sums of samples so many times as large.
    pub(super) fn scale(&mut self, factor: f64) {
        for bin in &mut self.bins {
            bin.wy *= factor;
            bin.yy *= factor * factor;
        }
    }

    /// Samples in all bins.
    #[must_use]
    pub fn count(&self) -> f64 {
        self.bins.iter().map(|bin| bin.count).sum()
    }

    /// Whether any sample lies where such a lobe is not yet faint: strengths are else extrapolated.
    pub(super) fn shows(&self, log_sharpness: f64) -> bool {
        let near =
            |bin: &Bin| bin.ww > 0.0 && (-log_sharpness.exp() * bin.phi_squared()).exp() > FAINT;
        self.bins.iter().any(near)
    }

    /// The measured lobe, coarsened to `parts` points: phi (rad), mean of `y / w` weighted by
    /// `w^2`, samples.
    #[must_use]
    pub fn curve(&self, parts: usize) -> Vec<[f64; 3]> {
        let last = PHI_SQUARED_MAX.sqrt();
        let mut sums = vec![Bin::default(); parts];
        for (index, bin) in self.bins.iter().enumerate() {
            let phi = ((index as f64 + 0.5) / BINS as f64 * PHI_SQUARED_MAX).sqrt();
            let sum = &mut sums[((phi / last * parts as f64) as usize).min(parts - 1)];
            sum.count += bin.count;
            sum.ww += bin.ww;
            sum.wy += bin.wy;
            sum.ww_phi_squared += bin.ww_phi_squared;
        }
        sums.iter()
            .filter(|sum| sum.ww > 0.0)
            .map(|sum| [(sum.ww_phi_squared / sum.ww).sqrt(), sum.wy / sum.ww, sum.count])
            .collect()
    }

    /// The samples of the peak region: those at angles where the lobe that is fitted to them is above
    /// half its peak, `phi <= gamma`. Section 6 of the RGB-camera paper fits these; it does not say
    /// how far they reach. The search starts with all samples; where too few are left for a fit, it
    /// stops.
    #[must_use]
    pub fn peak(&self) -> Self {
        let mut region = self.clone();
        let mut bins = BINS;
        for _ in 0..PEAK_STEPS {
            let found = region.fit();
            let half = core::f64::consts::LN_2 / found.parameters[1].exp();
            let end = ((half * (BINS as f64 / PHI_SQUARED_MAX)).ceil() as usize).min(BINS);
            let filled = self.bins[..end].iter().filter(|bin| bin.ww > 0.0).count();
            if end == bins || filled < 3 || found.parameters[0] == 0.0 {
                break;
            }
            bins = end;
            region = self.clone();
            region.bins[end..].fill(Bin::default());
        }
        region
    }

    /// The best (beta, log k) by Levenberg-Marquardt, from several starting widths.
    #[must_use]
    pub fn fit(&self) -> Outcome<f64, 2> {
        // A lobe of each width, with the strength that fits it best: a linear problem.
        let linear = |gamma: f64| {
            let k = sharpness(gamma);
            let (mut top, mut bottom) = (0.0, 0.0);
            for bin in &self.bins {
                let lobe = (-k * bin.phi_squared()).exp();
                top = lobe.mul_add(bin.wy, top);
                bottom = (lobe * lobe).mul_add(bin.ww, bottom);
            }
            let beta = if top > 0.0 && bottom > 0.0 { top / bottom } else { 0.0 };
            (-top * beta, beta, k.ln())
        };
        let starts = [0.02, 0.05, 0.1, 0.2, 0.4].map(linear);
        let best = starts.into_iter().fold(starts[0], |a, b| if b.0 < a.0 { b } else { a });
        let bounds = Bounds {
            lower: [0.0, sharpness(GAMMA_MAX).ln()],
            upper: [f64::MAX, sharpness(GAMMA_MIN).ln()],
        };
        lm::minimise(self, [best.1, best.2], &bounds, &Options::default())
    }
}

impl Bin {
    fn phi_squared(&self) -> f64 {
        if self.ww > 0.0 { self.ww_phi_squared / self.ww } else { 0.0 }
    }
}

impl Problem<f64, 2> for Histogram {
    fn normal(&self, [beta, log_k]: [f64; 2]) -> Normal<f64, 2> {
        let k = log_k.exp();
        let mut normal = Normal::zero();
        for bin in self.bins.iter().filter(|bin| bin.ww > 0.0) {
            let exponent = k * bin.phi_squared();
            let lobe = (-exponent).exp();
            let slope = [lobe, -exponent * beta * lobe];
            let value = beta * lobe;
            let left = (-value).mul_add(bin.ww, bin.wy);
            normal.cost += value.mul_add(-(bin.wy + left), bin.yy);
            for i in 0..2 {
                normal.descent[i] = slope[i].mul_add(left, normal.descent[i]);
                for j in 0..=i {
                    normal.matrix[i][j] =
                        (slope[i] * slope[j]).mul_add(bin.ww, normal.matrix[i][j]);
                }
            }
        }
        normal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lobe_is_found_again() {
        let mut histogram = Histogram::default();
        for i in 0..200_000 {
            let phi = (f64::from(i) * 0.618_034).fract() * 0.8;
            let w = 0.03 + 0.01 * (f64::from(i) * 0.414_214).fract();
            let y = 12.0 * w * (-core::f64::consts::LN_2 * phi * phi / 0.0144).exp();
            histogram.add(y as f32, w as f32, (phi * phi) as f32);
        }
        let outcome = histogram.fit();
        assert!(outcome.reason.converged());
        let gamma = (core::f64::consts::LN_2 / outcome.parameters[1].exp()).sqrt();
        // Quantisation: (k width)^2 / 24 with k = 48, width 1/4096 is 6e-6.
        assert!((outcome.parameters[0] / 12.0 - 1.0).abs() < 1e-5);
        assert!((gamma / 0.12 - 1.0).abs() < 1e-5);
    }

    #[test]
    fn the_peak_region_ends_at_half_the_height() {
        // A haze four times as wide lies under the highlight: all samples are fitted by a lobe that
        // is too wide, those of the peak by a narrower one.
        let lobe =
            |phi: f64, gamma: f64| (-core::f64::consts::LN_2 * phi * phi / (gamma * gamma)).exp();
        let mut histogram = Histogram::default();
        for i in 0..200_000 {
            let phi = (f64::from(i) * 0.618_034).fract() * 0.8;
            let y = 10.0 * lobe(phi, 0.1) + lobe(phi, 0.4);
            histogram.add(y as f32, 1.0, (phi * phi) as f32);
        }
        let gamma = |fitted: &Histogram| {
            (core::f64::consts::LN_2 / fitted.fit().parameters[1].exp()).sqrt()
        };
        let region = histogram.peak();
        let last = region.bins.iter().rposition(|bin| bin.count > 0.0).unwrap();
        let reach = ((last + 1) as f64 / BINS as f64).sqrt();
        // The end is that of a bin: half of 1/4096 in phi^2 is 1.2e-3 rad at 0.1.
        assert!((reach - gamma(&region)).abs() < 1.3e-3, "{reach} {}", gamma(&region));
        assert!(gamma(&region) < gamma(&histogram) - 1e-3);
        // One lobe alone is found again from its peak.
        let mut alone = Histogram::default();
        for i in 0..200_000 {
            let phi = (f64::from(i) * 0.618_034).fract() * 0.8;
            alone.add(lobe(phi, 0.1) as f32, 1.0, (phi * phi) as f32);
        }
        assert!((gamma(&alone.peak()) / 0.1 - 1.0).abs() < 1e-5);
        // Nothing to fit leaves nothing.
        assert_eq!(Histogram::default().peak(), Histogram::default());
    }

    #[test]
    fn no_highlight_gives_no_strength() {
        let mut histogram = Histogram::default();
        for i in 0..1000 {
            histogram.add(-1e-3, 0.03, i as f32 * 1e-3);
        }
        assert_eq!(histogram.fit().parameters[0], 0.0);
        let empty = Histogram::default().fit();
        assert!(empty.parameters.iter().all(|p| p.is_finite()) && empty.parameters[0] == 0.0);
    }
}
