//! What the light of a tile can be: interval arithmetic on the statistics of its maps, the cosines to its
//! lamps and the bounds of its lobes.

use super::decide::LampSeen;
use super::{Shown, Work};
use crate::geometry::Light;
use crate::relight::bounds;
use crate::relight::scene::{Colour, Lamp, Scene};
use crate::relight::statistics::{Range, TileStatistics};
use crate::relight::tolerance::{Between, Tolerance};
use crate::surface::{CoatedDiffuse, Strength, Surface};

/// A smallest and a largest value.
pub(super) type Interval = [f64; 2];

pub(super) fn plus([a, b]: Interval, [c, d]: Interval) -> Interval {
    [a + c, b + d]
}

/// 0 times anything is 0: black reflects nothing of what has no bound. NaN says that nothing is known.
pub(super) fn times([a, b]: Interval, [c, d]: Interval) -> Interval {
    let product = |one: f64, other: f64| {
        if (one == 0.0 && !other.is_nan()) || (other == 0.0 && !one.is_nan()) {
            0.0
        } else {
            one * other
        }
    };
    let ends = [product(a, c), product(a, d), product(b, c), product(b, d)];
    // `min` and `max` would lose it.
    if ends.iter().any(|end| end.is_nan()) {
        return [f64::NAN; 2];
    }
    [
        ends.into_iter().fold(f64::INFINITY, f64::min),
        ends.into_iter().fold(-f64::INFINITY, f64::max),
    ]
}

/// Everything from the smaller to the larger end of both.
pub(super) fn either([a, b]: Interval, [c, d]: Interval) -> Interval {
    if [a, b, c, d].iter().any(|end| end.is_nan()) {
        return [f64::NAN; 2];
    }
    [a.min(c), b.max(d)]
}

/// A [`Colour`] whose weights are known within bounds.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    diffuse: Vec<[Interval; 3]>,
    interface: [Interval; 3],
}

impl Weights {
    fn exact(colour: &Colour) -> Self {
        Self::by(colour, |column| column.map(|value| [value; 2]))
    }

    /// Those of linear display light, with the roundings of everything from maps to codes: a share of
    /// the magnitudes that are summed up.
    fn shown(colour: &Colour, matrix: &[[f64; 3]; 3], rounding: f64) -> Self {
        Self::by(colour, |column| {
            [0, 1, 2].map(|channel: usize| {
                let terms = column.iter().zip(matrix).map(|(light, to)| light * to[channel]);
                let (sum, size) =
                    terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + f64::abs(term)));
                [sum - rounding * size, sum + rounding * size]
            })
        })
    }

    fn by(colour: &Colour, weigh: impl Fn(&[f64; 3]) -> [Interval; 3]) -> Self {
        Self {
            diffuse: colour.diffuse.iter().map(&weigh).collect(),
            interface: weigh(&colour.interface),
        }
    }
}

/// The colours of a scene with bounds: in its output unit, and as a display shows them.
#[derive(Clone, Debug)]
pub(super) struct Bounded {
    pub(super) light: Vec<Weights>,
    pub(super) shown: Option<Vec<Weights>>,
    /// What single precision adds to light that is shown, as a share of what it sums up.
    pub(super) rounding: f64,
}

impl Bounded {
    pub(super) fn of(surface: &Surface<'_>, scene: &Scene, display: Option<&Shown>) -> Self {
        let (lamps, lobes) = (scene.lamps().len() as f64, surface.lobes.len() as f64);
        let terms = scene.coefficients() as f64 + lamps * (2.0 + lobes);
        // Constants, weights and products are rounded, too, and the averages of a slanted view or of a
        // lens: less than sixty-four times besides the sums.
        let rounding = (64.0 + terms) * 2.0_f64.powi(-23);
        let shown = |display: &Shown| {
            let weights = |colour| Weights::shown(colour, &display.matrix, rounding);
            scene.colours().iter().map(weights).collect()
        };
        Self {
            light: scene.colours().iter().map(Weights::exact).collect(),
            shown: display.map(shown),
            rounding,
        }
    }
}

impl Work<'_> {
    /// What the light of a tile can be, in the scene's output unit.
    pub(super) fn between(&self, tile: &TileStatistics, lamps: &[LampSeen]) -> Between {
        let Self { scene, options, .. } = self;
        if !matches!(options.tolerance, Tolerance::DeltaE { .. }) {
            return Between::ANYTHING;
        }
        let light = self.light(tile, lamps, &self.bounded.light, options.over.shadows);
        let more_light = options.more_light || scene.environment().is_some();
        let dark = options.over.shadows || more_light;
        let low = light.map(|[low, _]| if dark || low.is_nan() { 0.0 } else { low.max(0.0) });
        let unknown = |value: f64| more_light || value.is_nan();
        let high = light.map(|[_, high]| if unknown(high) { f64::INFINITY } else { high });
        Between { low, high }
    }

    /// What lamps make of a tile in each channel; `shaded`: where any may be in a shadow.
    pub(super) fn light(
        &self,
        tile: &TileStatistics,
        lamps: &[LampSeen],
        colours: &[Weights],
        shaded: bool,
    ) -> [Interval; 3] {
        let Self { surface, scene, .. } = self;
        let mut light = [[0.0; 2]; 3];
        for (lamp, as_seen) in scene.lamps().iter().zip(lamps) {
            let weights = &colours[lamp.colour];
            let [least, most] = self.geometry(tile, lamp, as_seen);
            let unknown = shaded || surface.coated.is_some();
            let geometry = [if unknown { 0.0 } else { least }, most];
            let seen = &as_seen.seen;
            let brightest = seen.irradiance[1] * (1.0 + seen.rounding) * lamp.intensity;
            for (channel, light) in light.iter_mut().enumerate() {
                let sum = |map: &[Range]| {
                    let terms = map.iter().zip(&weights.diffuse);
                    terms.fold([0.0; 2], |sum, (range, weight)| {
                        plus(sum, times([range.low, range.high].map(f64::from), weight[channel]))
                    })
                };
                *light = plus(*light, times(sum(&tile.diffuse), geometry));
                *light = plus(*light, times(sum(&tile.ambient), [lamp.intensity; 2]));
                let lobes = surface.lobes.iter().zip(&tile.lobes).zip(&as_seen.lobes);
                for ((lobe, range), bound) in lobes {
                    let strength = match lobe.strength {
                        Strength::Neutral(_) => {
                            let strength = &range.strength[0];
                            let ends = [strength.low, strength.high].map(f64::from);
                            times(ends, weights.interface[channel])
                        }
                        // Coefficients of spectra may be negative: a lobe may take light away.
                        Strength::Tinted(_) => sum(&range.strength),
                    };
                    let value = times([0.0, *bound], [brightest; 2]);
                    // What a plan leaves out shows nothing.
                    *light = plus(*light, times(either(strength, [0.0; 2]), value));
                }
            }
        }
        light
    }

    /// The smallest and the largest `N.L` times irradiance of a lamp.
    fn geometry(
        &self,
        tile: &TileStatistics,
        lamp: &Lamp,
        LampSeen { seen, cosines, .. }: &LampSeen,
    ) -> Interval {
        let surface = self.surface;
        // Those of its middle.
        let [least, most] =
            if lamp.has_size() { bounds::cosines(tile, &seen.towards) } else { *cosines };
        let [darkest, brightest] = seen.irradiance;
        let widened = |[least, most]: Interval, rounding: f64| {
            [(least - rounding).max(0.0), if most == 0.0 { 0.0 } else { most + rounding }]
        };
        let [least, most] = widened([least, most], seen.rounding);
        let mut ends =
            [least * darkest * (1.0 - seen.rounding), most * brightest * (1.0 + seen.rounding)];
        // A near lamp may be taken for a distant one.
        if !lamp.light.is_distant() && self.options.tolerance != Tolerance::Exact {
            let middle = Light::Distant(lamp.light.direction());
            let middle = bounds::light(middle, self.grid, [0, 0]);
            let taken = widened(bounds::cosines(tile, &middle.towards), middle.rounding);
            ends = [ends[0].min(taken[0]), ends[1].max(taken[1])];
        }
        // An interface of an index above 2 + sqrt(3) transmits most at a slant, less than all.
        let all =
            |coated: CoatedDiffuse| if coated.index() > 3.7 { 0.5 * coated.scale() } else { 1.0 };
        let transmitted = surface.coated.map_or(1.0, all);
        times(ends, [lamp.intensity, lamp.intensity * transmitted * transmitted])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_holds_every_product_of_its_factors() {
        let intervals = [[-2.0, -1.0], [-1.0, 3.0], [0.0, 0.0], [0.0, 2.0], [0.5, 4.0]];
        for one in intervals {
            for other in intervals {
                let [low, high] = times(one, other);
                for i in 0..=10 {
                    for j in 0..=10 {
                        let at = |[low, high]: Interval, i: i32| {
                            low + (high - low) * f64::from(i) / 10.0
                        };
                        let product = at(one, i) * at(other, j);
                        assert!(low <= product && product <= high, "{one:?} {other:?}");
                    }
                }
                // It is no wider than two of them.
                let ends = one.map(|a| other.map(|b| a * b)).concat();
                assert!(ends.contains(&low) && ends.contains(&high));
            }
        }
        assert_eq!(times([0.0, 1.0], [1.0, f64::INFINITY]), [0.0, f64::INFINITY]);
        assert_eq!(times([0.0, 0.0], [0.0, f64::INFINITY]), [0.0, 0.0]);
        assert!(times([0.0, 1.0], [f64::NAN, 1.0])[1].is_nan());
        assert_eq!(either([1.0, 2.0], [0.0; 2]), [0.0, 2.0]);
        assert!(either([f64::NAN; 2], [0.0; 2])[0].is_nan());
    }
}
