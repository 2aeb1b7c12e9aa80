//! Bounded influence [@huber1964] for sums over the whole painting: outliers are recognised by
//! quantiles and count for less.
//!
//! The largest sample decides a sum of squares: a lamp in the frame, or a pixel of the sensor that
//! is stuck, weighs as much as the painting (hard case 31). Magnitudes are therefore counted in
//! classes of half an octave, which takes no memory, and a sample far above a high quantile is
//! scaled down.

/// Half-octaves of magnitude.
pub(super) const CLASSES: usize = 512;

/// Two classes per power of two, by the bits of the number: scaling by a power of two moves every
/// number by the same number of classes.
pub(super) fn class_of(magnitude: f32) -> usize {
    (magnitude.max(0.0).to_bits() >> 22) as usize % CLASSES
}

/// The smallest number of a class.
fn least_of(class: usize) -> f32 {
    f32::from_bits((class as u32) << 22)
}

/// A tenth may be anything.
const QUANTILE: f64 = 0.9;

/// How many numbers there are of each class.
#[derive(Clone, Debug)]
pub(super) struct Counts([u64; CLASSES]);

impl Counts {
    pub(super) fn new() -> Self {
        Self([0; CLASSES])
    }

    /// Counts a magnitude, unless it is 0 or not a number.
    pub(super) fn add(&mut self, magnitude: f32) {
        self.0[class_of(magnitude)] += u64::from(magnitude > 0.0 && magnitude.is_finite());
    }

    fn merge(&mut self, other: &Self) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own += other;
        }
    }

    fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// The start of the class in which nine tenths are reached; none where nothing was counted.
    pub(super) fn high(&self) -> Option<f32> {
        let mut left = (QUANTILE * self.total() as f64).ceil() as u64;
        let class = self.0.iter().position(|&count| {
            left = left.saturating_sub(count);
            left == 0
        });
        class.filter(|_| self.total() > 0).map(least_of)
    }
}

/// Parts of the angle phi up to 1 rad: as fine as the first bin of
/// [`Histogram`](super::histogram::Histogram).
const PARTS: usize = 64;

/// Samples that a quantile needs at least; with fewer, those of neighbouring angles join in.
const ENOUGH: u64 = 40;

/// A sample this many times the high quantile of its angle is an outlier: three octaves. Within a
/// part the geometry's weight varies by less.
const OUTLIER: f32 = 8.0;

/// How large specular samples are, angle by angle: a highlight is large, but not for its angle.
#[derive(Clone, Debug)]
pub(super) struct Sizes(Vec<Counts>);

impl Sizes {
    pub(super) fn new() -> Self {
        Self(vec![Counts::new(); PARTS])
    }

    pub(super) fn add(&mut self, specular: f32, phi_squared: f32) {
        if let Some(part) = part_of(phi_squared) {
            self.0[part].add(specular.abs());
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            own.merge(other);
        }
    }

    /// The magnitude from which a sample is an outlier, angle by angle.
    pub(super) fn limits(&self) -> Limits {
        let limit = |part: usize| {
            let mut joined = self.0[part].clone();
            for reach in 1..PARTS {
                if joined.total() >= ENOUGH {
                    break;
                }
                let sides = [part.checked_sub(reach), Some(part + reach)];
                for side in sides.into_iter().flatten().filter_map(|side| self.0.get(side)) {
                    joined.merge(side);
                }
            }
            joined.high().map_or(f32::INFINITY, |high| high * OUTLIER)
        };
        Limits((0..PARTS).map(limit).collect())
    }
}

/// Magnitudes from which samples are outliers.
#[derive(Clone, Debug)]
pub(super) struct Limits(Vec<f32>);

impl Limits {
    /// What a sample and its model are multiplied by, so that an outlier counts no more than a sample
    /// at the limit; 1 for all others.
    pub(super) fn share(&self, specular: f32, phi_squared: f32) -> f32 {
        let limit = part_of(phi_squared).map_or(f32::INFINITY, |part| self.0[part]);
        if specular.abs() > limit { limit / specular.abs() } else { 1.0 }
    }
}

/// False for NaN too (hard case 26).
fn part_of(phi_squared: f32) -> Option<usize> {
    let place = phi_squared.sqrt() * PARTS as f32;
    (place < PARTS as f32).then_some(place as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_of_two_moves_every_number_alike() {
        for value in [0.013_f32, 0.5, 0.74, 1.0, 3.9] {
            assert_eq!(class_of(value * 8.0) - class_of(value), 6);
        }
        assert_eq!(class_of(f32::NAN), class_of(0.0));
    }

    #[test]
    fn hard_case_31_a_highlight_is_no_outlier_and_a_lamp_is() {
        for scale in [1.0_f32, 2.0_f32.powi(30), 2.0_f32.powi(-30)] {
            let mut sizes = Sizes::new();
            for i in 0..20_000 {
                let phi = (i as f32 * 0.618_034).fract();
                let highlight = 40.0 * (-(phi / 0.05).powi(2)).exp() + 0.01;
                sizes.add(scale * if i % 20 == 0 { 1e6 } else { highlight }, phi * phi);
            }
            let limits = sizes.limits();
            assert_eq!(limits.share(scale * 40.0, 1e-6), 1.0);
            let lamp = limits.share(scale * 1e6, 0.25) * 1e6;
            assert!((0.01..0.2).contains(&lamp), "{lamp}");
        }
        // Nothing, and NaN, limit nothing.
        assert_eq!(Sizes::new().limits().share(1e30, 0.1), 1.0);
        assert_eq!(Sizes::new().limits().share(1.0, f32::NAN), 1.0);
    }
}
