//! Whether the painting's lobe describes its pixels.

use crate::error::Result;
use crate::pixels::{Run, TILE, tiles};

use super::outliers::{CLASSES, class_of};

/// A pixel knows its own strength if its error is below this share of the painting's.
const KNOWN: f32 = 0.2;

/// A pixel agrees if its own strength is the painting's to this share, beyond this many standard
/// deviations of doubt.
const AGREES: f32 = 0.25;
const DEVIATIONS: f32 = 3.0;

/// Share of the pixels from which a lobe describes a painting. One varnish, simulated with noise,
/// gives 0.96 and more; three varnishes of equal shares at most 0.55.
pub(super) const DESCRIBES: f64 = 0.8;

/// What the samples say about the lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// A lobe stands out of the noise, and describes the pixels.
    Fitted,
    /// A lobe stands out, but fewer than [`DESCRIBES`] of the pixels that know their own strength
    /// agree with it: several varnishes, or a surface of another kind.
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

/// How far pixels are from the painting's lobe.
pub(super) struct Agreement {
    /// `(y, x)`: by how much of the painting's strength the pixel's own differs beyond its error,
    /// at most 1; NaN where nothing was estimated.
    pub(super) misfit: Vec<f32>,
    /// Share of the pixels which know their own strength that agree; NaN if none does.
    pub(super) describes: f64,
}

/// What is known of every pixel's own strength, `(y, x)` each.
pub(super) struct Strengths {
    pub(super) brightness: Vec<f32>,
    /// Standard deviation of a sample; NaN where nothing was estimated.
    pub(super) noise: Vec<f32>,
    /// The pixel's own strength less the painting's.
    pub(super) apart: Vec<f32>,
    /// Its standard deviation per unit of noise.
    pub(super) doubt: Vec<f32>,
}

impl Strengths {
    /// Compares each pixel's own strength with the painting's.
    ///
    /// The noise is that of the better pixels of the same brightness ([`Self::noise_of_classes`]): a
    /// pixel that the lobe does not describe has large residuals, which must not excuse it.
    pub(super) fn agreement(&self, beta: f32, run: &Run<'_>) -> Result<Agreement> {
        let classes = self.noise_of_classes(run)?;
        let (mut known, mut agree) = (0_u64, 0_u64);
        let mut of = |pixel: usize| {
            if self.noise[pixel].is_nan() {
                return f32::NAN;
            }
            let error = classes[class_of(self.brightness[pixel])] * self.doubt[pixel];
            if beta <= 0.0 || !error.is_finite() {
                return 0.0;
            }
            let misfit = ((self.apart[pixel].abs() - DEVIATIONS * error) / beta).clamp(0.0, 1.0);
            if error <= KNOWN * beta {
                known += 1;
                agree += u64::from(misfit <= AGREES);
            }
            misfit
        };
        let mut misfit = Vec::with_capacity(self.noise.len());
        run.in_turn(tiles(self.noise.len()), |(start, count)| {
            misfit.extend((start..start + count).map(&mut of));
        })?;
        Ok(Agreement { misfit, describes: agree as f64 / known as f64 })
    }

    /// Lower quartile of the noise of the pixels of each brightness: shot noise grows with light.
    ///
    /// The number that sorting a class would find, eight bits at a time from the highest: the order
    /// of positive numbers is that of their bits. No class is ever held, let alone sorted, at once.
    fn noise_of_classes(&self, run: &Run<'_>) -> Result<Vec<f32>> {
        // The bits found so far, and the rank among the numbers that begin with them.
        let mut found = vec![(0_u32, 0_u64); CLASSES];
        for shift in [24, 16, 8, 0] {
            let mut counts = vec![[0_u64; 256]; CLASSES];
            let tiles = self.brightness.chunks(TILE).zip(self.noise.chunks(TILE));
            run.in_turn(tiles, |(brightness, noise)| {
                for (&brightness, &noise) in brightness.iter().zip(noise) {
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
    use crate::pixels::{looks, serially};

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
        let none = vec![0.0; pixels];
        let strengths = Strengths { brightness, noise, apart: none.clone(), doubt: none };
        assert_eq!(serially(|run| strengths.noise_of_classes(run)).unwrap(), expected);
        assert!(expected.iter().any(|noise| *noise > 0.0 && noise.is_finite()));
        // Four passes for the noise, one for the pixels.
        assert_eq!(looks::count(|run| strengths.agreement(1.0, run)), 5 * tiles(pixels).len());
    }

    #[test]
    fn pixels_of_another_strength_are_counted() {
        let n = 1000;
        let brightness: Vec<f32> = (0..n).map(|i| 0.1 + i as f32 * 1e-3).collect();
        let noise: Vec<f32> = brightness.iter().map(|b| 0.01 * b.sqrt()).collect();
        // A third has half the strength; a tenth knows nothing.
        let apart: Vec<f32> = (0..n).map(|i| if i % 3 == 0 { -5.0 } else { 0.01 }).collect();
        let doubt: Vec<f32> = (0..n).map(|i| if i % 10 == 0 { 1e6 } else { 10.0 }).collect();
        let strengths = Strengths { brightness, noise, apart, doubt };
        let found = serially(|run| strengths.agreement(10.0, run)).unwrap();
        assert!((found.describes - 2.0 / 3.0).abs() < 0.01, "{}", found.describes);
        assert_eq!(found.misfit[0], 0.0);
        assert!((0.4..=0.5).contains(&found.misfit[3]));
        assert_eq!(found.misfit[1], 0.0);
    }
}
