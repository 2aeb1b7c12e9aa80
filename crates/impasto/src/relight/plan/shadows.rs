//! Where cast shadows may fall.

use super::{BOUNCE, LIT, SHADED, SKY, Work};
use crate::geometry::Light;
use crate::math::Vec3;
use crate::relight::bounds;
use crate::relight::scene::Lamp;
use crate::relight::shadow::horizon::SKY_FLOOR;
use crate::relight::statistics::{ReliefRange, SIDE, TileStatistics};

impl Work<'_> {
    /// Marks the tiles that shadows may fall on; returns the reason, and whether shadows are wanted.
    pub(super) fn shadows(&self, parts: &mut [u32]) -> (String, bool) {
        let Self { statistics, grid, scene, options, .. } = self;
        let lamps = scene.lamps().len();
        if !options.over.shadows {
            return ("no shadows wanted".to_owned(), false);
        }
        if lamps == 0 {
            return ("no lamp".to_owned(), false);
        }
        let mut reason = String::new();
        let mut closest = f64::INFINITY;
        for (number, lamp) in scene.lamps().iter().enumerate() {
            let steep = self.steep(lamp);
            let light = lamp.light.direction();
            let tangent = light.z / light.x.hypot(light.y);
            let reliefs = || statistics.tiles.iter().filter_map(|tile| tile.relief.as_ref());
            let steepest = reliefs()
                .map(|relief| bounds::rise(relief, [light.x, light.y]) / grid.pitch)
                .fold(f64::NEG_INFINITY, f64::max);
            if tangent - steepest < closest {
                closest = tangent - steepest;
                reason = format!(
                    "steepest rise towards light {}: {steepest:.3}; the light: {tangent:.3}",
                    number + 1
                );
            }
            let fallen = self.darkened(&steep, Away::of(lamp));
            for (tile, fallen) in fallen.into_iter().enumerate() {
                let parts = &mut parts[tile * lamps + number];
                if fallen && *parts & LIT != 0 {
                    *parts |= SHADED;
                }
            }
        }
        (reason, true)
    }

    /// Marks the tiles that see less than all of an environment over the relief; returns them
    /// and the reason.
    pub(super) fn sky(&self) -> (Vec<u8>, String) {
        let Self { statistics, grid, scene, options, .. } = self;
        let Some(around) = scene.environment() else {
            return (Vec::new(), "no environment".to_owned());
        };
        let none = vec![0; statistics.tiles.len()];
        if !options.over.shadows {
            return (none, "no shadows wanted".to_owned());
        }
        let floor = SKY_FLOOR / (1.0 - SKY_FLOOR * SKY_FLOOR).sqrt();
        let steep = |tile: &TileStatistics| {
            let flat = |relief| bounds::is_flat_all_round(relief, floor, grid.pitch);
            !tile.relief.as_ref().is_some_and(flat)
        };
        let steep: Vec<bool> = statistics.tiles.iter().map(steep).collect();
        let hidden = self.darkened(&steep, Away::Round(floor));
        let needs = SKY | if around.albedo > 0.0 { BOUNCE } else { 0 };
        let mark = |&hidden: &bool| if hidden { needs } else { 0 };
        let count = steep.iter().filter(|&&steep| steep).count();
        let reason = format!("the relief rises by more than {floor:.3} in {count} tiles");
        (hidden.iter().map(mark).collect(), reason)
    }

    /// Tiles whose relief rises as steeply as the lamp.
    fn steep(&self, lamp: &Lamp) -> Vec<bool> {
        let pitch = self.grid.pitch;
        let steep = |tile: &TileStatistics| match (&tile.relief, lamp.light) {
            (None, _) => true,
            (Some(relief), Light::Distant(direction)) if lamp.has_size() => {
                !bounds::is_flat_below_disc(relief, direction, lamp.radius, pitch)
            }
            (Some(relief), Light::Distant(direction)) => {
                !bounds::is_flat_below(relief, direction, pitch)
            }
            (Some(relief), Light::Point { position, .. }) => {
                !bounds::is_flat_below_point(relief, position, lamp.radius, self.grid)
            }
        };
        self.statistics.tiles.iter().map(steep).collect()
    }

    /// Tiles that a shadow of the steep ones may reach: those that lie away from the light within
    /// `(highest - lowest) / tan(elevation)`.
    fn darkened(&self, steep: &[bool], away: Away) -> Vec<bool> {
        let Self { statistics, grid, .. } = self;
        if !steep.contains(&true) {
            return vec![false; steep.len()];
        }
        let reliefs = || statistics.tiles.iter().filter_map(|tile| tile.relief.as_ref());
        let fold = |start: f32, of: fn(f32, f32) -> f32, end: fn(&ReliefRange) -> f32| {
            reliefs().map(end).fold(start, of)
        };
        let highest = fold(f32::NEG_INFINITY, f32::max, |relief| relief.height.high);
        let lowest = fold(f32::INFINITY, f32::min, |relief| relief.height.low);
        let range = f64::from(highest - lowest) / grid.pitch;
        // In tiles; one pixel more on each side for interpolation and one for rounding.
        let tiles = |tangent: f64, share: f64| share * (range / tangent + 2.0) / SIDE as f64;
        let [x, y] = match away {
            Away::Everywhere => return vec![true; steep.len()],
            Away::Round(tangent) => {
                let reach = tiles(tangent, 1.0);
                [[-reach, reach]; 2]
            }
            Away::From(light) => {
                let across = light.x.hypot(light.y);
                let reach = |share: f64| tiles(light.z / across, share / across);
                [reach(-light.x), reach(light.y)].map(|to| [to.min(0.0), to.max(0.0)])
            }
        };
        if !x.iter().chain(&y).all(|reach| reach.is_finite()) {
            return vec![true; steep.len()];
        }
        let columns = statistics.columns;
        let lines = steep.len() / columns;
        let mut darkened = vec![false; steep.len()];
        for (tile, _) in steep.iter().enumerate().filter(|(_, steep)| **steep) {
            let span = |at: usize, [before, after]: [f64; 2], count: usize| {
                let (low, high) = (at as f64 + before, at as f64 + after);
                let first = (low.floor().max(1.0) as usize) - 1;
                first..(high.ceil() as usize).saturating_add(2).min(count)
            };
            for line in span(tile / columns, y, lines) {
                for column in span(tile % columns, x, columns) {
                    darkened[line * columns + column] = true;
                }
            }
        }
        darkened
    }
}

/// Where the shadow of a steep place may fall.
#[derive(Clone, Copy)]
enum Away {
    /// On the side that a distant light does not come from.
    From(Vec3<f64>),
    /// On any side, of light at least as high as the tangent of an elevation.
    Round(f64),
    Everywhere,
}

impl Away {
    fn of(lamp: &Lamp) -> Self {
        match lamp.light {
            Light::Distant(direction) if !lamp.has_size() => Self::From(direction),
            Light::Distant(direction) => {
                let across = direction.x.hypot(direction.y);
                let lowest = direction.z.atan2(across) - lamp.radius;
                if lowest > 0.0 { Self::Round(lowest.tan()) } else { Self::Everywhere }
            }
            Light::Point { .. } => Self::Everywhere,
        }
    }
}
