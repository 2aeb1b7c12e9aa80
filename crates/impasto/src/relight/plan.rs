//! What a scene calls for: each effect is absent, changes nothing, is proven to change less than the
//! tolerance, or is simulated; decided tile by tile, with a reason.
//!
//! Light that is left out adds up: the bounds of all that a tile does without are summed, and stay
//! below the tolerance. What saves most for its bound is left out first (the greedy rule of the
//! knapsack problem [@dantzig1957discrete]).

use crate::error::{Error, Result};
use crate::geometry::{Grid, Light, View};
use crate::math::Vec3;
use crate::pixels::Run;
use crate::surface::{Strength, Surface};

use super::bounds::{self, Cone, Seen};
use super::scene::{Colour, Scene};
use super::statistics::{SIDE, Statistics, TileStatistics};
use super::tolerance::{Between, Tolerance};
use super::view::Projection;

/// Something that a picture may need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The first term of eq. 1 and 9.
    Diffuse,
    /// The interface that diffuse light crosses.
    CoatedDiffuse,
    /// What the surface shows whatever the direction of a lamp.
    Ambient,
    /// One lobe of the interface, by its number.
    Lobe(usize),
    /// Parts of the relief in the light of other parts.
    CastShadows,
    /// Direction and irradiance of a lamp that differ from pixel to pixel.
    NearLight,
    /// A view that differs from pixel to pixel.
    NearView,
    /// Projection along a view that is not the painting's normal.
    SlantedView,
}

/// What is done about an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// There is nothing to simulate.
    Absent,
    /// Proven to change no bit of the picture.
    NoOp,
    /// Left out; proven to change less than the tolerance.
    Bounded,
    /// Simulated, in some tiles or in all.
    On,
}

/// What is decided about one effect, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The effect.
    pub effect: Effect,
    /// What is done.
    pub decision: Decision,
    /// Tiles in which it is simulated.
    pub tiles: usize,
    /// Most that leaving it out costs a pixel, in the unit of the tolerance.
    pub error: f64,
    /// Why.
    pub reason: String,
}

/// What is simulated where.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    rows: Vec<Row>,
    /// Per tile and lamp: bits of [`LIT`], [`SHADED`], [`NEAR`] and one per lobe.
    parts: Vec<u32>,
    lamps: usize,
    columns: usize,
    projected: bool,
    /// The largest sum of bounds.
    error: f64,
}

/// The lamp shines on some pixel.
pub(super) const LIT: u32 = 1;
/// Some pixel may be in a cast shadow.
pub(super) const SHADED: u32 = 2;
/// Direction and irradiance are those of each pixel.
pub(super) const NEAR: u32 = 4;

/// The bit of a lobe; lobes beyond the last bit share it.
pub(super) const fn lobe_bit(lobe: usize) -> u32 {
    1 << (3 + if lobe < 28 { lobe } else { 28 })
}

/// What a lobe, a near lamp's directions cost, relative to each other: pixels per unit of saving.
const COST_OF_LOBE: f64 = 4.0;
const COST_OF_NEAR: f64 = 2.0;

/// What is left out of a tile, and what it costs.
struct Candidate {
    lamp: usize,
    bit: u32,
    error: f64,
    cost: f64,
}

/// A tile's decisions.
struct Decided {
    parts: Vec<u32>,
    /// Per lobe, then for near lamps: the largest bound of what is left out.
    lost: Vec<f64>,
    /// The same: whether something that is not nothing was left out.
    dropped: Vec<bool>,
    error: f64,
}

impl Plan {
    /// Everything that is there is simulated everywhere.
    #[must_use]
    pub fn forced(surface: &Surface<'_>, grid: Grid, scene: &Scene, has_height: bool) -> Self {
        let lamps = scene.lamps().len();
        let columns = grid.width.div_ceil(SIDE);
        let tiles = columns * grid.height.div_ceil(SIDE);
        let lobes = (0..surface.lobes.len()).map(lobe_bit).fold(0, |all, bit| all | bit);
        let shaded = if has_height { SHADED } else { 0 };
        let projected = matches!(scene.view(), View::Distant(view) if slant(view, grid) > 0.0);
        let mut rows = Vec::new();
        let mut row = |effect, present: bool, tiles| {
            let decision = if present { Decision::On } else { Decision::Absent };
            let reason = if present { "forced" } else { "not there" }.to_owned();
            rows.push(Row { effect, decision, tiles, error: 0.0, reason });
        };
        let near = scene.lamps().iter().any(|lamp| !lamp.light.is_distant());
        row(Effect::Diffuse, true, tiles);
        row(Effect::CoatedDiffuse, surface.coated.is_some(), tiles);
        row(Effect::Ambient, surface.ambient.is_some(), tiles);
        for lobe in 0..surface.lobes.len() {
            row(Effect::Lobe(lobe), true, tiles);
        }
        row(Effect::CastShadows, has_height, tiles);
        row(Effect::NearLight, near, tiles);
        row(Effect::NearView, !scene.view().is_distant(), tiles);
        row(Effect::SlantedView, projected, tiles);
        let parts = vec![LIT | shaded | NEAR | lobes; tiles * lamps];
        Self { rows, parts, lamps, columns, projected, error: 0.0 }
    }

    /// Decides from the statistics of a surface, which hold a relief where shadows are wanted.
    ///
    /// # Errors
    /// If the caller cancels.
    pub fn new(
        surface: &Surface<'_>,
        statistics: &Statistics,
        grid: Grid,
        scene: &Scene,
        options: Options,
        run: &Run<'_>,
    ) -> Result<Self> {
        let work = Work { surface, statistics, grid, scene, options };
        let (columns, lamps) = (statistics.columns, scene.lamps().len());
        let (projected, slanted) = work.slanted();
        // A piece of work is a row of tiles.
        let lines = statistics.tiles.chunks(columns).enumerate().collect();
        let decided: Vec<Decided> = run
            .map(
                lines,
                || (),
                |(), (line, tiles)| {
                    let place = |(column, tile)| work.tile(tile, [column, line], slanted.error);
                    tiles.iter().enumerate().map(place).collect::<Vec<_>>()
                },
            )?
            .into_iter()
            .flatten()
            .collect();
        let mut parts: Vec<u32> = decided.iter().flat_map(|tile| tile.parts.clone()).collect();
        let shadows = work.shadows(&mut parts);
        let rows = work.rows(&parts, &decided, shadows, slanted);
        let error = decided.iter().map(|tile| tile.error).fold(0.0, f64::max);
        Ok(Self { rows, parts, lamps, columns, projected, error })
    }

    /// What was decided.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The largest sum of bounds of what a tile does without, in the unit of the tolerance.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.error
    }

    /// How many tiles there are.
    #[must_use]
    pub fn tiles(&self) -> usize {
        self.parts.len() / self.lamps
    }

    /// Whether it was made for these pixels and as many lamps.
    pub(super) fn fits(&self, grid: Grid, scene: &Scene) -> Result<()> {
        let columns = grid.width.div_ceil(SIDE);
        let tiles = columns * grid.height.div_ceil(SIDE);
        if (columns, tiles, scene.lamps().len()) == (self.columns, self.tiles(), self.lamps) {
            return Ok(());
        }
        Err(Error::argument("plan", "it was made for another painting or another scene"))
    }

    /// Whether the picture is projected along its view.
    #[must_use]
    pub fn projected(&self) -> bool {
        self.projected
    }

    /// The parts that the pixels from a column and row on need, one entry per lamp.
    pub(super) fn parts(&self, column: usize, row: usize) -> &[u32] {
        let tile = row / SIDE * self.columns + column / SIDE;
        &self.parts[tile * self.lamps..][..self.lamps]
    }

    /// Whether a part is needed anywhere.
    pub(super) fn needs(&self, lamp: usize, bit: u32) -> bool {
        self.parts.iter().skip(lamp).step_by(self.lamps).any(|parts| parts & bit != 0)
    }
}

/// How far a plan may go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// What may be left out.
    pub tolerance: Tolerance,
    /// Whether shadows are cast.
    pub shadows: bool,
    /// Whether light is added or taken afterwards, so that a tile may be darker than it seems.
    pub more_light: bool,
}

/// How far the slant of a view moves a pixel, in pixels.
fn slant(view: Vec3<f64>, grid: Grid) -> f64 {
    Projection::new(view, grid).displacement()
}

/// What is decided about a slanted view.
#[derive(Clone, Copy)]
struct Slanted {
    displacement: f64,
    error: f64,
}

struct Work<'a> {
    surface: &'a Surface<'a>,
    statistics: &'a Statistics,
    grid: Grid,
    scene: &'a Scene,
    options: Options,
}

impl Work<'_> {
    fn slanted(&self) -> (bool, Slanted) {
        let displacement = match self.scene.view() {
            View::Distant(view) => slant(view, self.grid),
            View::Point(_) => 0.0,
        };
        // A pixel changes by at most this share of the step from black to white.
        let Options { tolerance, .. } = self.options;
        let white = match tolerance {
            Tolerance::Exact => [0.0; 3],
            Tolerance::DeltaE { white, .. } => white,
            Tolerance::Codes { display, .. } => inverse_of_white(display),
        };
        let error = if displacement == 0.0 {
            0.0
        } else {
            displacement * tolerance.error(white, &Between::ANYTHING)
        };
        // Half of the tolerance is kept for what saves more.
        let left_out = error <= 0.5 * tolerance.limit();
        let error = if left_out { error } else { 0.0 };
        (!left_out, Slanted { displacement, error })
    }

    /// What the pixels of a tile need; `spent` is what is left out of every tile.
    fn tile(&self, tile: &TileStatistics, place: [usize; 2], spent: f64) -> Decided {
        let Self { surface, grid, scene, options, .. } = self;
        let lobes = surface.lobes.len();
        let view = bounds::view(scene.view(), *grid, place);
        let lamps: Vec<_> =
            scene.lamps().iter().map(|lamp| bounds::light(lamp.light, *grid, place)).collect();
        let between = self.between(tile, &lamps, &view);
        let mut parts = Vec::with_capacity(lamps.len());
        let mut candidates = Vec::new();
        for (number, (lamp, seen)) in scene.lamps().iter().zip(&lamps).enumerate() {
            if tile.pixels == 0 || bounds::cosines(tile, seen)[1] == 0.0 {
                parts.push(0);
                continue;
            }
            let colour = &scene.colours()[lamp.colour];
            let irradiance = lamp.intensity * seen.irradiance;
            let mut needs = LIT;
            for lobe in 0..lobes {
                let strongest = self.strongest(tile, lobe, colour, &between);
                let bound = bounds::lobe(surface.model, tile, &tile.lobes[lobe], seen, &view);
                if strongest.0 == 0.0 || bound == 0.0 {
                    continue;
                }
                needs |= lobe_bit(lobe);
                let error = strongest.1 * bound * irradiance;
                let bit = lobe_bit(lobe);
                candidates.push(Candidate { lamp: number, bit, error, cost: COST_OF_LOBE });
            }
            if !lamp.light.is_distant() {
                needs |= NEAR;
                if surface.coated.is_none() {
                    let error = self.reflected(tile, colour, &between) * lamp.intensity;
                    let error = error * seen.deviation;
                    let bit = NEAR;
                    candidates.push(Candidate { lamp: number, bit, error, cost: COST_OF_NEAR });
                }
            }
            parts.push(needs);
        }
        candidates.sort_by(|a, b| (a.error * b.cost).total_cmp(&(b.error * a.cost)));
        let mut decided = Decided {
            parts,
            lost: vec![0.0; lobes + 1],
            dropped: vec![false; lobes + 1],
            error: spent,
        };
        for Candidate { lamp, bit, error, .. } in candidates {
            let left = options.tolerance.limit() - decided.error;
            // Directions of a lamp that lobes see are those of each pixel.
            let seen_by_lobes = bit == NEAR && decided.parts[lamp] & !(LIT | SHADED | NEAR) != 0;
            if error > left || left <= 0.0 || seen_by_lobes {
                continue;
            }
            decided.error += error;
            decided.parts[lamp] &= !bit;
            let which = if bit == NEAR { lobes } else { bit.trailing_zeros() as usize - 3 };
            decided.lost[which] += error;
            decided.dropped[which] = true;
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
        let strongest = ranges.iter().map(super::statistics::Range::largest).fold(0.0, f64::max);
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

    /// What the light of a tile can be.
    fn between(&self, tile: &TileStatistics, lamps: &[Seen], view: &Cone) -> Between {
        let Self { surface, scene, options, .. } = self;
        if !matches!(options.tolerance, Tolerance::DeltaE { .. }) {
            return Between::ANYTHING;
        }
        let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
        for (lamp, seen) in scene.lamps().iter().zip(lamps) {
            let colour = &scene.colours()[lamp.colour];
            let [least, most] = bounds::cosines(tile, seen);
            let known = lamp.light.is_distant() && surface.coated.is_none();
            let least = if known { least * lamp.intensity } else { 0.0 };
            let most = most * seen.irradiance * lamp.intensity;
            for channel in 0..3 {
                let mut ends = [0.0; 2];
                for (range, column) in tile.diffuse.iter().zip(&colour.diffuse) {
                    let products =
                        [range.low, range.high].map(|value| f64::from(value) * column[channel]);
                    ends[0] += products[0].min(products[1]);
                    ends[1] += products[0].max(products[1]);
                }
                low[channel] += (ends[0] * least).min(ends[0] * most);
                high[channel] += (ends[1] * most).max(0.0);
                for (range, column) in tile.ambient.iter().zip(&colour.diffuse) {
                    let products =
                        [range.low, range.high].map(|value| f64::from(value) * column[channel]);
                    low[channel] += products[0].min(products[1]) * lamp.intensity;
                    high[channel] += products[0].max(products[1]) * lamp.intensity;
                }
            }
            for (number, lobe) in surface.lobes.iter().enumerate() {
                let ranges = &tile.lobes[number];
                let bound = bounds::lobe(surface.model, tile, ranges, seen, view);
                for channel in 0..3 {
                    let strength: f64 = match lobe.strength {
                        Strength::Neutral(_) => {
                            ranges.strength[0].largest() * colour.interface[channel].abs()
                        }
                        Strength::Tinted(_) => ranges
                            .strength
                            .iter()
                            .zip(&colour.diffuse)
                            .map(|(range, column)| range.largest() * column[channel].abs())
                            .sum(),
                    };
                    let most = strength * bound * lamp.intensity * seen.irradiance;
                    high[channel] += if strength == 0.0 { 0.0 } else { most };
                }
            }
        }
        let dark = options.shadows || options.more_light;
        let low = low.map(|value| if dark || value.is_nan() { 0.0 } else { value.max(0.0) });
        let unknown = |value: f64| options.more_light || value.is_nan();
        let high = high.map(|value| if unknown(value) { f64::INFINITY } else { value });
        Between { low, high }
    }

    /// Marks the tiles that shadows may fall on; returns the reason and how many tiles there are.
    fn shadows(&self, parts: &mut [u32]) -> (String, bool) {
        let Self { statistics, grid, scene, options, .. } = self;
        let lamps = scene.lamps().len();
        if !options.shadows {
            return ("no shadows wanted".to_owned(), false);
        }
        let mut reason = String::new();
        let mut closest = f64::INFINITY;
        for (number, lamp) in scene.lamps().iter().enumerate() {
            let unsafe_tiles = self.steep(lamp.light);
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
            let fallen = self.darkened(lamp.light, &unsafe_tiles);
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
        let fold = |start: f32,
                    of: fn(f32, f32) -> f32,
                    end: fn(&super::statistics::ReliefRange) -> f32| {
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

    fn rows(
        &self,
        parts: &[u32],
        decided: &[Decided],
        (shadows, wanted): (String, bool),
        slanted: Slanted,
    ) -> Vec<Row> {
        let Self { surface, scene, options, .. } = self;
        let (lamps, all) = (scene.lamps().len(), decided.len());
        let unit = options.tolerance.unit();
        let tiles_with = |bit: u32| {
            parts.chunks(lamps).filter(|parts| parts.iter().any(|part| part & bit != 0)).count()
        };
        let lost = |which: usize| {
            let errors = decided.iter().map(|tile| tile.lost[which]);
            let dropped = decided.iter().any(|tile| tile.dropped[which]);
            (errors.fold(0.0, f64::max), dropped)
        };
        let mut rows = Vec::new();
        let mut row = |effect, decision, tiles, error, reason: String| {
            rows.push(Row { effect, decision, tiles, error, reason });
        };
        let there = |present: bool, name: &str| {
            if present {
                (Decision::On, all, format!("the surface has {name}"))
            } else {
                (Decision::Absent, 0, format!("the surface has no {name}"))
            }
        };
        let lit = tiles_with(LIT);
        let decision = if lit > 0 { Decision::On } else { Decision::NoOp };
        let reason = format!("some normal faces a lamp in {lit} of {all} tiles");
        row(Effect::Diffuse, decision, lit, 0.0, reason);
        let (decision, tiles, reason) = there(surface.coated.is_some(), "coat over its paint");
        row(Effect::CoatedDiffuse, decision, tiles, 0.0, reason);
        let (decision, tiles, reason) = there(surface.ambient.is_some(), "ambient light");
        row(Effect::Ambient, decision, tiles, 0.0, reason);
        for lobe in 0..surface.lobes.len() {
            let tiles = tiles_with(lobe_bit(lobe));
            let (error, dropped) = lost(lobe.min(28));
            let (decision, reason) = match (tiles, dropped) {
                (0, false) => (Decision::NoOp, "0 in every tile".to_owned()),
                (0, true) => {
                    (Decision::Bounded, format!("at most {error:.3} {unit} in every tile"))
                }
                _ => (Decision::On, format!("can be seen in {tiles} of {all} tiles")),
            };
            row(Effect::Lobe(lobe), decision, tiles, error, reason);
        }
        let tiles = tiles_with(SHADED);
        let decision = match (wanted, tiles) {
            (false, _) => Decision::Absent,
            (true, 0) => Decision::NoOp,
            _ => Decision::On,
        };
        row(Effect::CastShadows, decision, tiles, 0.0, shadows);
        let near = scene.lamps().iter().any(|lamp| !lamp.light.is_distant());
        let tiles = tiles_with(NEAR);
        let (error, _) = lost(surface.lobes.len());
        let (decision, reason) = match (near, tiles) {
            (false, _) => (Decision::Absent, "every lamp is distant".to_owned()),
            (true, 0) => (Decision::Bounded, format!("at most {error:.3} {unit} in every tile")),
            _ => (Decision::On, format!("directions differ in {tiles} of {all} tiles")),
        };
        row(Effect::NearLight, decision, tiles, error, reason);
        let lobed = parts.iter().any(|part| part & !(LIT | SHADED | NEAR) != 0);
        let (decision, tiles, reason) = match (scene.view().is_distant(), lobed) {
            (true, _) => (Decision::Absent, 0, "the eye is distant"),
            (false, false) if surface.coated.is_none() => {
                (Decision::NoOp, 0, "no lobe and no coat sees where the eye is")
            }
            _ => (Decision::On, all, "lobes see the eye from each pixel"),
        };
        row(Effect::NearView, decision, tiles, 0.0, reason.to_owned());
        let Slanted { displacement, error } = slanted;
        let (decision, tiles) = match (displacement == 0.0, self.slanted().0) {
            (true, _) => (Decision::NoOp, 0),
            (false, true) => (Decision::On, all),
            (false, false) => (Decision::Bounded, 0),
        };
        let reason = format!("the view moves a pixel by {displacement:.4} pixels at most");
        row(Effect::SlantedView, decision, tiles, error, reason);
        rows
    }
}

/// The light that a display shows as white: the sum of the columns of the inverse matrix.
fn inverse_of_white(rows: [[f64; 3]; 3]) -> [f64; 3] {
    let matrix = nalgebra::Matrix3::from_fn(|row, column| rows[row][column]);
    let white = matrix.try_inverse().map(|inverse| inverse * nalgebra::Vector3::repeat(1.0));
    white.map_or([f64::INFINITY; 3], |white| [white[0], white[1], white[2]])
}
