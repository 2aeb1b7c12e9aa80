//! How far a planned picture may be from the exact one, and what left-out light counts against it.
//!
//! CIELAB is a metric that light enters through `f(t) = t^(1/3)`, straight below `t = 0.008856`. Its
//! derivative falls, so that between the darkest and the brightest that a tile can be, left-out light
//! `t w` moves `f(X)` by at least `t w f'(brightest)` and at most `t w f'(darkest)`. CIEDE2000
//! [@sharma2005ciede2000] is at most `sqrt(dL^2 + 1.867 (2.25 da^2 + db^2))`: its `S_L`, `S_C` and
//! `S_H` are at least 1, `1 + G` at most 1.5, and `|R_T|` at most `2 sin 60 degrees`, half of which
//! the product of the chroma and the hue term takes at most.

/// What may be left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// Nothing that changes a bit.
    Exact,
    /// So many codes of the display.
    Codes {
        /// Largest difference of a code before rounding.
        limit: f64,
        /// Codes per unit of linear display light, at most, per channel.
        slope: [f64; 3],
        /// Rows: linear display light from the scene's output unit.
        display: [[f64; 3]; 3],
    },
    /// A colour difference, CIEDE2000.
    DeltaE {
        /// Largest difference.
        limit: f64,
        /// Tristimulus values of the display's white, in the scene's output unit.
        white: [f64; 3],
    },
}

/// What the light of a tile can be at least and at most, in the scene's output unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Between {
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
}

impl Between {
    /// Nothing is known.
    pub(super) const ANYTHING: Self = Self { low: [0.0; 3], high: [f64::INFINITY; 3] };
}

/// Where the cube root ends.
const KNEE: f64 = 216.0 / 24389.0;

/// Derivative of CIELAB's `f`, by light relative to white.
fn slope(relative: f64) -> f64 {
    if relative <= KNEE {
        return 24389.0 / (27.0 * 116.0);
    }
    let root = relative.max(KNEE).cbrt();
    1.0 / (3.0 * root * root)
}

impl Tolerance {
    /// The largest sum of errors of a pixel.
    pub(super) fn limit(&self) -> f64 {
        match *self {
            Self::Exact => 0.0,
            Self::Codes { limit, .. } | Self::DeltaE { limit, .. } => limit,
        }
    }

    /// The name of the unit of errors.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        match self {
            Self::Exact => "",
            Self::Codes { .. } => "codes",
            Self::DeltaE { .. } => "dE00",
        }
    }

    /// What is lost at most where up to one unit of light `w` is left out; it grows in proportion.
    pub(super) fn error(&self, w: [f64; 3], tile: &Between) -> f64 {
        match self {
            Self::Exact => f64::INFINITY,
            Self::Codes { slope, display, .. } => {
                let channels = display.iter().zip(slope).map(|(row, slope)| {
                    let light: f64 = row.iter().zip(w).map(|(m, w)| m * w).sum();
                    light.abs() * slope
                });
                channels.fold(0.0, f64::max)
            }
            Self::DeltaE { white, .. } => {
                let f: [[f64; 2]; 3] = [0, 1, 2].map(|axis: usize| {
                    let steep = w[axis] / white[axis] * slope(tile.low[axis] / white[axis]);
                    let shallow = w[axis] / white[axis] * slope(tile.high[axis] / white[axis]);
                    [steep.min(shallow), steep.max(shallow)]
                });
                let largest = |one: [f64; 2], other: [f64; 2]| {
                    (one[1] - other[0]).abs().max((one[0] - other[1]).abs())
                };
                let lightness = 116.0 * f[1][0].abs().max(f[1][1].abs());
                let (a, b) = (500.0 * largest(f[0], f[1]), 200.0 * largest(f[1], f[2]));
                let chroma = 1.867 * 2.25f64.mul_add(a * a, b * b);
                lightness.mul_add(lightness, chroma).sqrt()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_a_slope_times_light() {
        let display = [[2.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]];
        let codes = Tolerance::Codes { limit: 1.0, slope: [100.0, 200.0, 300.0], display };
        assert_eq!(codes.error([0.01, 0.0, 0.0], &Between::ANYTHING), 2.0);
        assert_eq!(codes.error([0.0, 0.01, 0.01], &Between::ANYTHING), 3.0);
    }

    #[test]
    fn light_of_the_colour_of_white_on_grey_has_no_chroma() {
        // In the dark: 903.3 units of lightness per unit of light.
        let white = [0.95, 1.0, 1.09];
        let grey = Between { low: [0.0; 3], high: [0.0; 3] };
        let all = Tolerance::DeltaE { limit: 0.5, white };
        assert!((all.error(white, &grey) - 24389.0 / 27.0).abs() < 1e-9);
        // A grey of 18 %: f' = 0.18^(-2/3) / 3, times 116.
        let grey = white.map(|w| 0.18 * w);
        let grey = Between { low: grey, high: grey };
        let expected = 116.0 / 3.0 * 0.18_f64.powf(-2.0 / 3.0);
        assert!((all.error(white, &grey) - expected).abs() < 1e-9);
        // Where the tile can be anything, the sum of both ends counts.
        assert!(all.error(white, &Between::ANYTHING) > 24389.0 / 27.0);
    }
}
