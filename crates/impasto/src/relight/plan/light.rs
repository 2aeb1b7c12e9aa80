//! What the light of a tile can be: interval arithmetic on the statistics of its maps, the cosines to its
//! lamps and the bounds of its lobes.

use super::Work;
use super::decide::LampSeen;
use super::display::Weights;
use super::interval::{Interval, either, plus, times};
use crate::geometry::Light;
use crate::relight::bounds;
use crate::relight::scene::Lamp;
use crate::relight::statistics::{Range, TileStatistics};
use crate::relight::tolerance::{Between, Tolerance};
use crate::surface::{CoatedDiffuse, Strength};

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
