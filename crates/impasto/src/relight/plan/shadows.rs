//! Where cast shadows may fall.

use super::{LIT, SHADED, Work};
use crate::geometry::Light;
use crate::relight::bounds;
use crate::relight::statistics::{ReliefRange, SIDE, TileStatistics};

impl Work<'_> {
    /// Marks the tiles that shadows may fall on; returns the reason, and whether shadows are wanted.
    pub(super) fn shadows(&self, parts: &mut [u32]) -> (String, bool) {
        let Self { statistics, grid, scene, options, .. } = self;
        let lamps = scene.lamps().len();
        if !options.shadows {
            return ("no shadows wanted".to_owned(), false);
        }
        let mut reason = String::new();
        let mut closest = f64::INFINITY;
        for (number, lamp) in scene.lamps().iter().enumerate() {
            let steep = self.steep(lamp.light);
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
            let fallen = self.darkened(lamp.light, &steep);
            for (tile, fallen) in fallen.into_iter().enumerate() {
                let parts = &mut parts[tile * lamps + number];
                if fallen && *parts & LIT != 0 {
                    *parts |= SHADED;
                }
            }
        }
        (reason, true)
    }

    /// Tiles whose relief rises as steeply as the light.
    fn steep(&self, light: Light) -> Vec<bool> {
        let pitch = self.grid.pitch;
        let steep = |tile: &TileStatistics| match (&tile.relief, light) {
            (None, _) => true,
            (Some(relief), Light::Distant(direction)) => {
                !bounds::is_flat_below(relief, direction, pitch)
            }
            (Some(relief), Light::Point { position, .. }) => {
                !bounds::is_flat_below_point(relief, position, self.grid)
            }
        };
        self.statistics.tiles.iter().map(steep).collect()
    }

    /// Tiles that a shadow of the steep ones may reach: those that lie away from the light within
    /// `(highest - lowest) / tan(elevation)`.
    fn darkened(&self, light: Light, steep: &[bool]) -> Vec<bool> {
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
        let Light::Distant(direction) = light else {
            return vec![true; steep.len()];
        };
        let across = direction.x.hypot(direction.y);
        let reach = f64::from(highest - lowest) / (direction.z / across) / grid.pitch;
        if !reach.is_finite() {
            return vec![true; steep.len()];
        }
        // In tiles, away from the light; one more on each side for interpolation and rounding.
        let away = [-direction.x, direction.y].map(|v| v / across * (reach + 2.0) / SIDE as f64);
        let columns = statistics.columns;
        let lines = steep.len() / columns;
        let mut darkened = vec![false; steep.len()];
        for (tile, _) in steep.iter().enumerate().filter(|(_, steep)| **steep) {
            let span = |at: usize, away: f64, count: usize| {
                let (low, high) = (at as f64 + away.min(0.0), at as f64 + away.max(0.0));
                let first = (low.floor().max(1.0) as usize) - 1;
                first..(high.ceil() as usize).saturating_add(2).min(count)
            };
            for line in span(tile / columns, away[1], lines) {
                for column in span(tile % columns, away[0], columns) {
                    darkened[line * columns + column] = true;
                }
            }
        }
        darkened
    }
}
