//! Whether the painting's lobe describes its pixels.

use super::gross::{CLASSES, class_of};

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

/// Compares each pixel's own strength with the painting's.
///
/// The noise is that of the better pixels of the same brightness ([`noise_of_classes`]): a pixel
/// that the lobe does not describe has large residuals, which must not excuse it.
pub(super) fn agreement(
    beta: f32,
    brightness: &[f32],
    noise: &[f32],
    apart: &[f32],
    doubt: &[f32],
) -> Agreement {
    let classes = noise_of_classes(brightness, noise);
    let (mut known, mut agree) = (0_u64, 0_u64);
    let misfit = (0..noise.len())
        .map(|pixel| {
            if noise[pixel].is_nan() {
                return f32::NAN;
            }
            let error = classes[class_of(brightness[pixel])] * doubt[pixel];
            if beta <= 0.0 || !error.is_finite() {
                return 0.0;
            }
            let misfit = ((apart[pixel].abs() - DEVIATIONS * error) / beta).clamp(0.0, 1.0);
            if error <= KNOWN * beta {
                known += 1;
                agree += u64::from(misfit <= AGREES);
            }
            misfit
        })
        .collect();
    Agreement { misfit, describes: agree as f64 / known as f64 }
}

/// Lower quartile of the noise of the pixels of each brightness: shot noise grows with light.
fn noise_of_classes(brightness: &[f32], noise: &[f32]) -> Vec<f32> {
    let mut classes = vec![Vec::new(); CLASSES];
    for (&brightness, &noise) in brightness.iter().zip(noise) {
        if noise.is_finite() {
            classes[class_of(brightness)].push(noise);
        }
    }
    classes
        .into_iter()
        .map(|mut class| {
            let quarter = class.len() / 4;
            if class.is_empty() {
                return f32::INFINITY;
            }
            *class.select_nth_unstable_by(quarter, f32::total_cmp).1
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_of_another_strength_are_counted() {
        let n = 1000;
        let brightness: Vec<f32> = (0..n).map(|i| 0.1 + i as f32 * 1e-3).collect();
        let noise: Vec<f32> = brightness.iter().map(|b| 0.01 * b.sqrt()).collect();
        // A third has half the strength; a tenth knows nothing.
        let apart: Vec<f32> = (0..n).map(|i| if i % 3 == 0 { -5.0 } else { 0.01 }).collect();
        let doubt: Vec<f32> = (0..n).map(|i| if i % 10 == 0 { 1e6 } else { 10.0 }).collect();
        let found = agreement(10.0, &brightness, &noise, &apart, &doubt);
        assert!((found.describes - 2.0 / 3.0).abs() < 0.01, "{}", found.describes);
        assert_eq!(found.misfit[0], 0.0);
        assert!((0.4..=0.5).contains(&found.misfit[3]));
        assert_eq!(found.misfit[1], 0.0);
    }
}
