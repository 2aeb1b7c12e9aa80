//! What a scene calls for: each effect is absent, changes nothing, is proven to change less than the
//! tolerance, or is simulated; decided tile by tile, with a reason.
//!
//! Light that is left out adds up: the bounds of all that a tile does without are summed, and stay
//! below the tolerance. What saves most for its bound is left out first (the greedy rule of the
//! knapsack problem [@dantzig1957discrete]).

use crate::error::{Error, Result};
use crate::geometry::Grid;
use crate::pixels::Run;
use crate::surface::Surface;

use super::scene::Scene;
use super::statistics::{SIDE, Statistics};
use super::tolerance::Tolerance;
use super::view::Projection;

mod clipping;
mod decide;
mod display;
mod interval;
mod light;
mod report;
mod shadows;

pub use display::Shown;
use display::{Beyond, Bounded, Clipping};

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
    /// Projection to an eye that does not stand straight in front.
    SlantedView,
    /// Parts of the relief before other parts, and nearer to the eye.
    Parallax,
    /// Light from all directions.
    Environment,
    /// Parts of the relief before an environment.
    SkyOcclusion,
    /// Light of an environment that the relief gives back to itself.
    OneBounce,
    /// A display shows no more than its white.
    Clipping,
    /// A display shows no colour outside its gamut: one whose light is below 0 in a channel.
    GamutClipping,
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
    /// Per tile: bits of [`SKY`] and [`BOUNCE`]; empty without an environment.
    around: Vec<u8>,
    columns: usize,
    tiles: usize,
    projected: bool,
    /// Whether a relief moves what is seen.
    displaced: bool,
    /// What its display clips, if that is known.
    clipping: Option<Clipping>,
    /// The largest sum of bounds.
    error: f64,
}

/// The lamp shines on some pixel.
pub(super) const LIT: u32 = 1;
/// Some pixel may be in a cast shadow.
pub const SHADED: u32 = 2;
/// Direction and irradiance are those of each pixel.
pub(super) const NEAR: u32 = 4;

/// Part of the environment may be hidden.
pub(super) const SKY: u8 = 1;
/// What hides it gives light back.
pub(super) const BOUNCE: u8 = 2;

/// The bit of a lobe; lobes beyond the last bit share it.
#[must_use]
pub const fn lobe_bit(lobe: usize) -> u32 {
    1 << (3 + if lobe < 28 { lobe } else { 28 })
}

/// A tile's decisions.
struct Decided {
    parts: Vec<u32>,
    /// What was left out that is not nothing, and the sum of its bounds: lobes by their number, near
    /// lamps behind them. Often there is none.
    lost: Vec<(usize, f64)>,
    error: f64,
    /// What of its light lies beyond the display, where there is one.
    beyond: Beyond,
}

impl Plan {
    /// Everything that is there is simulated everywhere.
    ///
    /// # Errors
    /// If the eye of a perspective is too near.
    pub fn forced(
        surface: &Surface<'_>,
        grid: Grid,
        scene: &Scene,
        Over { shadows, parallax }: Over,
    ) -> Result<Self> {
        let lamps = scene.lamps().len();
        let columns = grid.width.div_ceil(SIDE);
        let tiles = columns * grid.height.div_ceil(SIDE);
        let lobes = (0..surface.lobes.len()).map(lobe_bit).fold(0, |all, bit| all | bit);
        let shaded = if shadows { SHADED } else { 0 };
        let slanted = slanted(scene, grid)?;
        let displaced = parallax && moves_heights(scene, slanted);
        let projected = slanted > 0.0 || displaced;
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
        row(Effect::CastShadows, shadows, tiles);
        row(Effect::NearLight, near, tiles);
        row(Effect::NearView, !scene.view().is_distant(), tiles);
        row(Effect::SlantedView, projected, tiles);
        row(Effect::Parallax, displaced, tiles);
        let environment = scene.environment();
        row(Effect::Environment, environment.is_some(), tiles);
        let hidden = environment.is_some() && shadows;
        row(Effect::SkyOcclusion, hidden, tiles);
        row(Effect::OneBounce, hidden && environment.is_some_and(|one| one.albedo > 0.0), tiles);
        row(Effect::Clipping, true, tiles);
        row(Effect::GamutClipping, true, tiles);
        let parts = vec![LIT | shaded | NEAR | lobes; tiles * lamps];
        let around = vec![if hidden { SKY | BOUNCE } else { 0 }; tiles];
        let (clipping, error) = (None, 0.0);
        Ok(Self {
            rows,
            parts,
            lamps,
            around,
            columns,
            tiles,
            projected,
            displaced,
            clipping,
            error,
        })
    }

    /// Decides from the statistics of a surface, which hold a relief where shadows are wanted. What the
    /// surface's maps hold is not read: any part of it says as much.
    ///
    /// # Errors
    /// If the statistics are those of another surface, or the caller cancels.
    pub fn new(
        surface: &Surface<'_>,
        statistics: &Statistics,
        grid: Grid,
        scene: &Scene,
        options: Options,
        run: &Run<'_>,
    ) -> Result<Self> {
        if !statistics.describe(surface, grid) {
            return Err(Error::argument("statistics", "they are those of another surface"));
        }
        let bounded = Bounded::of(surface, scene, options.display.as_ref());
        let work = Work { surface, statistics, grid, scene, options, bounded };
        let (columns, lamps) = (statistics.columns, scene.lamps().len());
        let slanted = slanted(scene, grid)?;
        // A piece of work is a row of tiles.
        let lines = statistics.tiles.chunks(columns).enumerate().collect();
        let decided: Vec<Decided> = run
            .map(
                lines,
                || (),
                |(), (line, tiles)| {
                    let place = |(column, tile)| work.tile(tile, [column, line]);
                    tiles.iter().enumerate().map(place).collect::<Vec<_>>()
                },
            )?
            .into_iter()
            .flatten()
            .collect();
        let mut parts: Vec<u32> = decided.iter().flat_map(|tile| &tile.parts).copied().collect();
        let shadows = work.shadows(&mut parts);
        let sky = work.sky();
        let moved = work.moved(slanted);
        let mut rows = work.rows(&parts, &decided, shadows, (slanted, &moved), &sky);
        let clipping = options.display.map(|display| {
            let shaded =
                |tile: usize| parts[tile * lamps..][..lamps].iter().any(|part| part & SHADED != 0);
            let tiles = decided.iter().enumerate();
            Clipping::new(&display, tiles.map(|(number, tile)| (&tile.beyond, shaded(number))))
        });
        rows.extend(work.rows_of_display(&decided, clipping.as_ref()));
        let error = decided.iter().map(|tile| tile.error).fold(0.0, f64::max);
        let (tiles, around) = (decided.len(), sky.0);
        let displaced = moved.decision == Decision::On;
        let projected = slanted > 0.0 || displaced;
        Ok(Self {
            rows,
            parts,
            lamps,
            around,
            columns,
            tiles,
            projected,
            displaced,
            clipping,
            error,
        })
    }

    /// How many tiles are clipped whole, so that their display codes need no light.
    #[must_use]
    pub fn clipped_whole(&self) -> usize {
        self.clipping.as_ref().map_or(0, Clipping::whole)
    }

    /// The plan with what another one for the same picture knows of clipping.
    #[must_use]
    pub fn clipped_as(self, other: &Self) -> Self {
        Self { clipping: other.clipping.clone(), ..self }
    }

    /// The plan without one effect, whatever that costs: what the effect takes is the difference.
    #[must_use]
    pub fn without(mut self, effect: Effect) -> Self {
        let bits = match effect {
            Effect::Diffuse
            | Effect::CoatedDiffuse
            | Effect::Ambient
            | Effect::NearView
            | Effect::Environment
            | Effect::Clipping
            | Effect::GamutClipping => 0,
            Effect::Lobe(lobe) => lobe_bit(lobe),
            Effect::CastShadows => SHADED,
            Effect::NearLight => NEAR,
            Effect::SlantedView => {
                (self.projected, self.displaced) = (false, false);
                0
            }
            Effect::Parallax => {
                self.displaced = false;
                0
            }
            Effect::SkyOcclusion | Effect::OneBounce => {
                let kept = if effect == Effect::OneBounce { SKY } else { 0 };
                self.around.iter_mut().for_each(|around| *around &= kept);
                0
            }
        };
        for parts in &mut self.parts {
            *parts &= !bits;
        }
        self
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
        self.tiles
    }

    /// Whether it was made for these pixels and as many lamps.
    ///
    /// # Errors
    /// If it was not.
    pub fn fits(&self, grid: Grid, scene: &Scene) -> Result<()> {
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

    /// Whether the relief moves what a projected picture shows.
    #[must_use]
    pub fn displaced(&self) -> bool {
        self.displaced
    }

    /// The parts that the pixels from a column and row on need, one entry per lamp.
    pub(super) fn parts(&self, column: usize, row: usize) -> &[u32] {
        let tile = row / SIDE * self.columns + column / SIDE;
        &self.parts[tile * self.lamps..][..self.lamps]
    }

    /// Where the pixels from a column and row on lie beyond a display, above its white or below 0, in
    /// all channels whatever the light is in detail: whether each is above.
    pub(super) fn all_beyond(
        &self,
        column: usize,
        row: usize,
        matrix: &[[f64; 3]],
    ) -> Option<[bool; 3]> {
        self.clipping.as_ref()?.all(row / SIDE * self.columns + column / SIDE, matrix)
    }

    /// Whether a part of an environment may be hidden from a tile, by its column and row.
    #[must_use]
    pub fn hides_sky(&self, column: usize, row: usize) -> bool {
        self.around.get(row * self.columns + column).is_some_and(|around| around & SKY != 0)
    }

    /// Whether it may be hidden anywhere.
    #[must_use]
    pub fn needs_sky(&self) -> bool {
        self.around.iter().any(|around| around & SKY != 0)
    }

    /// Whether what hides it gives light back anywhere.
    #[must_use]
    pub fn bounces(&self) -> bool {
        self.around.iter().any(|around| around & BOUNCE != 0)
    }

    /// Whether a part is needed anywhere.
    #[must_use]
    pub fn needs(&self, lamp: usize, bit: u32) -> bool {
        self.parts.iter().skip(lamp).step_by(self.lamps).any(|parts| parts & bit != 0)
    }
}

/// What a relief, if there is one, does to a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Over {
    /// It casts shadows, and hides a part of an environment.
    pub shadows: bool,
    /// Its parts are seen where their heights put them.
    pub parallax: bool,
}

/// How far a plan may go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// What may be left out.
    pub tolerance: Tolerance,
    /// What a relief does.
    pub over: Over,
    /// Whether light is added or taken afterwards, so that a tile may be darker than it seems.
    pub more_light: bool,
    /// What shows the picture, if that is known before it.
    pub display: Option<Shown>,
}

/// How far the slant of a view moves a pixel, in pixels: where it moves any, the picture may be of
/// another size, and a highlight moves into what is dark beside it.
fn slanted(scene: &Scene, grid: Grid) -> Result<f64> {
    if scene.is_projected() {
        Projection::new(scene.view(), grid).map(|projection| projection.displacement())
    } else {
        Ok(0.0)
    }
}

/// Whether a picture shows a place elsewhere for its height: from the side, and from a near eye
/// straight in front, which leaves the plane where it is.
fn moves_heights(scene: &Scene, slanted: f64) -> bool {
    slanted > 0.0 || (scene.is_projected() && !scene.view().is_distant())
}

struct Work<'a> {
    surface: &'a Surface<'a>,
    statistics: &'a Statistics,
    grid: Grid,
    scene: &'a Scene,
    options: Options,
    bounded: Bounded,
}
