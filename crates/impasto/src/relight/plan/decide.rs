//! What the pixels of a tile need.

use super::{Decided, LIT, NEAR, SHADED, Work, lobe_bit};
use crate::relight::bounds::{self, Seen};
use crate::relight::scene::Colour;
use crate::relight::statistics::{LobeRange, Range, TileStatistics};
use crate::relight::tolerance::Between;
use crate::surface::Strength;

/// What a lobe and the directions of a near lamp cost, relative to each other.
const COST_OF_LOBE: f64 = 4.0;
const COST_OF_NEAR: f64 = 2.0;

/// A lamp as the pixels of a tile see it.
pub(super) struct LampSeen {
    pub(super) seen: Seen,
    /// Smallest and largest `N.L` over all of its points.
    pub(super) cosines: [f64; 2],
    /// Most that each lobe of unit strength shows of it under unit irradiance.
    pub(super) lobes: Vec<f64>,
}

/// What is left out of a tile, and what it costs.
struct Candidate {
    lamp: usize,
    bit: u32,
    error: f64,
    cost: f64,
}

impl Work<'_> {
    /// What the pixels of a tile need.
    pub(super) fn tile(&self, tile: &TileStatistics, place: [usize; 2]) -> Decided {
        let Self { surface, grid, scene, options, .. } = self;
        let lobes = surface.lobes.len();
        let view = bounds::view(scene.view(), *grid, place);
        let lamps = scene.lamps().iter().map(|lamp| {
            let seen = bounds::lamp(lamp, *grid, place);
            let cosines = bounds::cosines(tile, &seen.points.0);
            let light = (&seen, cosines[1]);
            let most = |range| bounds::lobe(surface.model, tile, range, light, &view);
            LampSeen { seen, cosines, lobes: tile.lobes.iter().map(most).collect() }
        });
        let lamps: Vec<LampSeen> = lamps.collect();
        let between = self.between(tile, &lamps);
        let mut parts = Vec::with_capacity(lamps.len());
        let mut candidates = Vec::new();
        // A lobe that is not a number shows the background where it is simulated, lit or not.
        let hole = |lobe: usize| {
            let LobeRange { strength, shape } = &tile.lobes[lobe];
            strength.iter().chain(shape).any(|range| range.holes)
        };
        let holes = (0..lobes).any(hole);
        for (number, (lamp, as_seen)) in scene.lamps().iter().zip(&lamps).enumerate() {
            let LampSeen { seen, cosines, lobes: most } = as_seen;
            let dark = !holes && cosines[1] == 0.0;
            if tile.pixels == 0 || dark {
                parts.push(0);
                continue;
            }
            let colour = &scene.colours()[lamp.colour];
            let irradiance = lamp.intensity * seen.irradiance[1];
            let mut needs = LIT;
            for (lobe, &bound) in most.iter().enumerate() {
                let strongest = self.strongest(tile, lobe, colour, &between);
                if !hole(lobe) && (strongest.0 == 0.0 || bound == 0.0) {
                    continue;
                }
                let bit = lobe_bit(lobe);
                let error = strongest.1 * bound * irradiance;
                if needs & bit == 0 {
                    candidates.push(Candidate { lamp: number, bit, error, cost: COST_OF_LOBE });
                } else if let Some(shared) = candidates.last_mut() {
                    // Lobes beyond the last bit are left out together.
                    shared.error += error;
                }
                needs |= bit;
            }
            if !lamp.light.is_distant() {
                needs |= NEAR;
                if surface.coated.is_none() && tile.cone.is_finite() {
                    let error = self.reflected(tile, colour, &between) * lamp.intensity;
                    let error = error * seen.deviation;
                    let bit = NEAR;
                    candidates.push(Candidate { lamp: number, bit, error, cost: COST_OF_NEAR });
                }
            }
            parts.push(needs);
        }
        candidates.sort_by(|a, b| (a.error * b.cost).total_cmp(&(b.error * a.cost)));
        let beyond = self.beyond(tile, place, &lamps);
        let mut decided = Decided { parts, lost: Vec::new(), error: 0.0, beyond };
        for Candidate { lamp, bit, error, .. } in candidates {
            let left = options.tolerance.limit() - decided.error;
            // Directions of a lamp that lobes see are those of each pixel.
            let seen_by_lobes = bit == NEAR && decided.parts[lamp] & !(LIT | SHADED | NEAR) != 0;
            if !(error <= left && left > 0.0) || seen_by_lobes {
                continue;
            }
            decided.error += error;
            decided.parts[lamp] &= !bit;
            let which = if bit == NEAR { lobes } else { bit.trailing_zeros() as usize - 3 };
            match decided.lost.iter_mut().find(|(one, _)| *one == which) {
                Some((_, sum)) => *sum += error,
                None => decided.lost.push((which, error)),
            }
        }
        decided
    }

    /// The strength of a lobe, and the error of one unit of its value.
    fn strongest(
        &self,
        tile: &TileStatistics,
        lobe: usize,
        colour: &Colour,
        between: &Between,
    ) -> (f64, f64) {
        let ranges = &tile.lobes[lobe].strength;
        if ranges.iter().any(|range| range.holes) {
            return (f64::INFINITY, f64::INFINITY);
        }
        let tolerance = &self.options.tolerance;
        let strongest = ranges.iter().map(Range::largest).fold(0.0, f64::max);
        let error = match self.surface.lobes[lobe].strength {
            Strength::Neutral(_) => strongest * tolerance.error(colour.interface, between),
            Strength::Tinted(_) => {
                let bands = ranges.iter().zip(&colour.diffuse);
                bands.map(|(range, w)| range.largest() * tolerance.error(*w, between)).sum()
            }
        };
        (strongest, error)
    }

    /// The error of one unit of diffuse geometry.
    fn reflected(&self, tile: &TileStatistics, colour: &Colour, between: &Between) -> f64 {
        let bands = tile.diffuse.iter().zip(&colour.diffuse);
        bands.map(|(range, w)| range.largest() * self.options.tolerance.error(*w, between)).sum()
    }
}
