//! Whether the painting's lobe describes its pixels.

use core::slice::ChunksMut;

use crate::error::Result;
use crate::pixels::{Run, TILE};

use super::outliers::{CLASSES, class_of};

/// A pixel determines its own strength if its error is below this share of the painting's.
const KNOWN: f32 = 0.2;

/// A pixel agrees if its own strength is the painting's to this share, beyond this many standard
/// deviations of doubt.
const AGREES: f32 = 0.25;
const DEVIATIONS: f32 = 3.0;

/// Share of the pixels from which a lobe describes a painting. One varnish, simulated with noise,
/// gives 0.96 and more; three varnishes of equal shares at most 0.55.
pub(super) const DESCRIBES: f64 = 0.8;

/// Whether the samples show a highlight, and whether one lobe describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// A lobe stands out of the noise, and describes the pixels.
    Fitted,
    /// A lobe stands out, but fewer than [`DESCRIBES`] of the pixels that determine their own
    /// strength agree with it: several varnishes, or a surface of another kind.
    Mixed,
    /// No sample shows a highlight: beta is 0, gamma where the search began (hard case 4).
    NoHighlight,
    /// A parameter ended at its bound, mirror-sharp or flat (hard cases 6 and 7).
    AtBound,
}

impl Verdict {
    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fitted => "fitted",
            Self::Mixed => "mixed",
            Self::NoHighlight => "no-highlight",
            Self::AtBound => "at-bound",
        }
    }
}

/// A pixel's own strength, estimated from its samples alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strength {
    /// Sum of the diffuse colours.
    pub(super) brightness: f32,
    /// Standard deviation of a sample; NaN where nothing was estimated.
    pub(super) noise: f32,
    /// The pixel's own strength less the painting's.
    pub(super) apart: f32,
    /// Its standard deviation per unit of noise.
    pub(super) doubt: f32,
}

impl Strength {
    /// Of a pixel that was not estimated.
    pub(super) const UNKNOWN: Self =
        Self { brightness: f32::NAN, noise: f32::NAN, apart: f32::NAN, doubt: f32::NAN };

    /// By how much of the painting's strength the pixel's own differs beyond its error, at most 1, NaN
    /// where nothing was estimated; and whether the samples determine it.
    ///
    /// The noise is that of the better pixels of the same brightness ([`Strengths::noise_of_classes`]):
    /// a pixel that the lobe does not describe has large residuals, which must not excuse it.
    pub(super) fn misfit(&self, beta: f32, noise_of_classes: &[f32]) -> (f32, bool) {
        if self.noise.is_nan() {
            return (f32::NAN, false);
        }
        let error = noise_of_classes[class_of(self.brightness)] * self.doubt;
        if beta <= 0.0 || !error.is_finite() {
            return (0.0, false);
        }
        let misfit = ((self.apart.abs() - DEVIATIONS * error) / beta).clamp(0.0, 1.0);
        (misfit, error <= KNOWN * beta)
    }
}

/// The strengths of all pixels.
pub(super) struct Strengths(Vec<Strength>);

impl Strengths {
    pub(super) fn unknown(pixels: usize, run: &Run<'_>) -> Result<Self> {
        run.filled(Strength::UNKNOWN, pixels).map(Self)
    }

    pub(super) fn tiles(&mut self) -> ChunksMut<'_, Strength> {
        self.0.chunks_mut(TILE)
    }

    /// Compares each pixel's own strength with the painting's; returns the share of the pixels which
    /// determine their own that agree, NaN if none does.
    pub(super) fn agreement(
        &self,
        beta: f32,
        noise_of_classes: &[f32],
        misfit: &mut [f32],
        run: &Run<'_>,
    ) -> Result<f64> {
        let (mut known, mut agree) = (0_u64, 0_u64);
        run.in_turn(self.0.chunks(TILE).zip(misfit.chunks_mut(TILE)), |(strengths, misfit)| {
            for (strength, misfit) in strengths.iter().zip(misfit) {
                let determined;
                (*misfit, determined) = strength.misfit(beta, noise_of_classes);
                known += u64::from(determined);
                agree += u64::from(determined && *misfit <= AGREES);
            }
        })?;
        Ok(agree as f64 / known as f64)
    }

    /// Lower quartile of the noise of the pixels of each brightness: shot noise grows with light.
    ///
    /// The number that sorting a class would find, by radix selection, eight bits at a time from the
    /// highest: the order of positive numbers is that of their bits. No class is held in memory.
    pub(super) fn noise_of_classes(&self, run: &Run<'_>) -> Result<Vec<f32>> {
        // The bits found so far, and the rank among the numbers that begin with them.
        let mut found = vec![(0_u32, 0_u64); CLASSES];
        for shift in [24, 16, 8, 0] {
            let mut counts = vec![[0_u64; 256]; CLASSES];
            run.in_turn(self.0.chunks(TILE), |part| {
                for &Strength { brightness, noise, .. } in part {
                    let (class, bits) = (class_of(brightness), noise.to_bits() >> shift);
                    if noise.is_finite() && bits >> 8 == found[class].0 {
                        counts[class][bits as usize % 256] += 1;
                    }
                }
            })?;
            for ((bits, rank), counts) in found.iter_mut().zip(&counts) {
                if shift == 24 {
                    *rank = counts.iter().sum::<u64>() / 4;
                }
                let digit = counts.iter().position(|&count| {
                    let here = *rank < count;
                    *rank -= if here { 0 } else { count };
                    here
                });
                // Of an empty class, whose bits are then those of no number.
                *bits = *bits << 8 | digit.unwrap_or(255) as u32;
            }
        }
        let number = |(bits, _)| Some(f32::from_bits(bits)).filter(|noise| noise.is_finite());
        Ok(found.into_iter().map(|found| number(found).unwrap_or(f32::INFINITY)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::{looks, serially, tiles};

    #[test]
    fn the_noise_of_a_class_is_that_of_sorting_it() {
        // Numbers that share their first bits, and equal ones, in classes of 0 to 5000.
        let pixels = 20_000;
        let brightness: Vec<f32> = (0..pixels).map(|i| 0.1 * ((i * i) % 7) as f32).collect();
        let noise = |i: usize| match i % 11 {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 => 1e-40,
            3 => 0.0,
            _ => 0.01 + 1e-7 * ((i * 7919) % 1009) as f32,
        };
        let noise: Vec<f32> = (0..pixels).map(noise).collect();
        let mut classes = vec![Vec::new(); CLASSES];
        for (&brightness, &noise) in brightness.iter().zip(&noise).filter(|(_, n)| n.is_finite()) {
            classes[class_of(brightness)].push(noise);
        }
        let quartile = |class: &mut Vec<f32>| {
            class.sort_by(f32::total_cmp);
            class.get(class.len() / 4).copied().unwrap_or(f32::INFINITY)
        };
        let expected: Vec<f32> = classes.iter_mut().map(quartile).collect();
        let one = |(&brightness, &noise)| Strength { brightness, noise, apart: 0.0, doubt: 0.0 };
        let strengths = Strengths(brightness.iter().zip(&noise).map(one).collect());
        assert_eq!(serially(|run| strengths.noise_of_classes(run)).unwrap(), expected);
        assert!(expected.iter().any(|noise| *noise > 0.0 && noise.is_finite()));
        // Four passes for the noise, one for the pixels.
        let mut misfit = vec![0.0; pixels];
        let both = |run: &Run<'_>| {
            let noise = strengths.noise_of_classes(run)?;
            strengths.agreement(1.0, &noise, &mut misfit, run)
        };
        assert_eq!(looks::count(both), 5 * tiles(pixels).len());
    }

    #[test]
    fn pixels_of_another_strength_are_counted() {
        // A third has half the strength; a tenth determines nothing.
        let strength = |i: usize| {
            let brightness = 0.1 + i as f32 * 1e-3;
            Strength {
                brightness,
                noise: 0.01 * brightness.sqrt(),
                apart: if i.is_multiple_of(3) { -5.0 } else { 0.01 },
                doubt: if i.is_multiple_of(10) { 1e6 } else { 10.0 },
            }
        };
        let strengths = Strengths((0..1000).map(strength).collect());
        let mut misfit = vec![0.0; 1000];
        let describes = serially(|run| {
            let noise = strengths.noise_of_classes(run)?;
            strengths.agreement(10.0, &noise, &mut misfit, run)
        });
        let describes = describes.unwrap();
        // Of the 900 pixels that determine their strength, 300 have another one.
        assert_eq!(describes, 600.0 / 900.0);
        assert_eq!(misfit[0], 0.0);
        // Half, less three errors of at most 0.105: (5 - 0.315) / 10 = 0.47 or more.
        assert!((0.4..=0.5).contains(&misfit[3]));
        assert_eq!(misfit[1], 0.0);
    }
}
