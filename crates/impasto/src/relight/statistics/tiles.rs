//! Bounds of the maps of every tile.

use crate::error::{Error, Result};
use crate::geometry::Grid;
use crate::math::{Isa, Kernel, Level, Real, Vec3};
use crate::pixels::Run;
use crate::surface::{Parameter, Strength, Surface};

use crate::relight::block::{BLOCK, Plane};

/// Columns and rows of a tile: a row of it is a block.
pub const SIDE: usize = BLOCK;

/// Directions in which the steepest rise of a relief is known.
pub const AZIMUTHS: usize = 64;

/// The smallest and the largest value of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest.
    pub low: f32,
    /// Largest.
    pub high: f32,
    /// Whether a pixel that can be shown has no finite value.
    pub holes: bool,
}

impl Range {
    const NONE: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY, holes: false };

    fn of(value: f32) -> Self {
        Self { low: value, high: value, holes: !value.is_finite() }
    }

    /// The largest absolute value.
    #[must_use]
    pub fn largest(&self) -> f64 {
        f64::from(self.high).max(-f64::from(self.low)).max(0.0)
    }
}

/// A lobe within a tile.
#[derive(Clone, Debug, PartialEq)]
pub struct LobeRange {
    /// One range, or one per band of a lobe with a colour of its own.
    pub strength: Vec<Range>,
    /// One range per parameter.
    pub shape: Vec<Range>,
}

/// The relief of a tile, with the cells towards the next tile.
#[derive(Clone, Debug, PartialEq)]
pub struct ReliefRange {
    /// Heights in mm.
    pub height: Range,
    /// The steepest rise in each of [`AZIMUTHS`] directions, counted from x towards y, in mm per
    /// pixel: an upper bound of the directional derivative of the bilinear surface.
    pub rise: [f32; AZIMUTHS],
}

/// A tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileStatistics {
    /// Pixels that can be shown; of a tile that is joined from pieces, at most so many.
    pub pixels: usize,
    /// Whether a pixel cannot be shown.
    pub gaps: bool,
    /// The middle of the normals, a unit vector.
    pub axis: Vec3<f64>,
    /// The largest angle between a normal and the axis, in radians; infinite where a normal is not
    /// of unit length, so that nothing is proven about it.
    pub cone: f64,
    /// Per band, or per coefficient.
    pub diffuse: Vec<Range>,
    /// Per band, or per coefficient.
    pub ambient: Vec<Range>,
    /// Per lobe.
    pub lobes: Vec<LobeRange>,
    /// Where a height is given.
    pub relief: Option<ReliefRange>,
}

/// The tiles of a painting, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Tiles side by side.
    pub columns: usize,
    /// All of them.
    pub tiles: Vec<TileStatistics>,
}

/// Squared length that differs from 1 by more is not that of a unit vector in single precision.
const UNIT: f32 = 1e-6;

impl Statistics {
    /// The statistics of a surface of so many columns and, where given, its height in mm `(y, x)`.
    ///
    /// # Errors
    /// If sizes disagree, or the caller cancels.
    pub fn new(
        surface: &Surface<'_>,
        width: usize,
        height: Option<&[f32]>,
        run: &Run<'_>,
    ) -> Result<Self> {
        let pixels = surface.normal.len() / 3;
        let bands = surface.bands(pixels)?;
        if width == 0 || !pixels.is_multiple_of(width) || height.is_some_and(|h| h.len() != pixels)
        {
            return Err(Error::argument("height", "its size is not that of the painting"));
        }
        let rows = pixels / width;
        let (columns, lines) = (width.div_ceil(SIDE), rows.div_ceil(SIDE));
        let whole = Whole { surface, width, rows, bands, height };
        let corners = (0..lines).flat_map(|y| (0..columns).map(move |x| [x * SIDE, y * SIDE]));
        let tiles =
            run.map(corners.collect(), || (), |(), corner| whole.tile(corner, run.level))?;
        Ok(Self { columns, tiles })
    }

    /// Whether they have the tiles of a grid, and the bands and lobes of a surface: the whole
    /// painting's or any part of it.
    pub(crate) fn describe(&self, surface: &Surface<'_>, grid: Grid) -> bool {
        let (columns, rows) = (grid.width.div_ceil(SIDE), grid.height.div_ceil(SIDE));
        let bands = surface.diffuse.len() / (surface.normal.len() / 3).max(1);
        let fits = |tile: &TileStatistics| {
            tile.lobes.len() == surface.lobes.len() && tile.diffuse.len() == bands
        };
        (columns, columns * rows) == (self.columns, self.tiles.len()) && self.tiles.iter().all(fits)
    }
}

/// All maps.
struct Whole<'a> {
    surface: &'a Surface<'a>,
    width: usize,
    rows: usize,
    bands: usize,
    height: Option<&'a [f32]>,
}

/// Part of the rows of a plane.
#[derive(Clone, Copy)]
struct Window<'a> {
    plane: &'a [f32],
    width: usize,
    corner: [usize; 2],
    size: [usize; 2],
}

impl<'a> Window<'a> {
    fn rows(self) -> impl Iterator<Item = &'a [f32]> {
        let Self { plane, width, corner: [x, y], size: [columns, rows] } = self;
        (y..y + rows).map(move |row| &plane[row * width + x..][..columns])
    }
}

impl Whole<'_> {
    fn tile(&self, corner: [usize; 2], level: Level) -> TileStatistics {
        let Self { surface, width, rows, bands, .. } = *self;
        let size = [SIDE.min(width - corner[0]), SIDE.min(rows - corner[1])];
        let pixels = width * rows;
        let at = |plane| Window { plane, width, corner, size };
        let window = |map, plane| at(self::plane(map, plane, pixels));
        let normal = [0, 1, 2].map(|axis| window(surface.normal, axis));
        let diffuse: Vec<_> = (0..bands).map(|band| window(surface.diffuse, band)).collect();
        let gate = gate(&normal, &diffuse);
        let (shown, axis, cone) = cone(&normal, &gate, level);
        let range = |window: Window<'_>| level.run(Extremes { window, gate: &gate });
        let per_band = |map| (0..bands).map(|band| range(window(map, band))).collect::<Vec<_>>();
        let parameter = |parameter: &Parameter<'_>| match parameter {
            Parameter::Everywhere(value) => Range::of(*value),
            Parameter::Map(plane) => range(Window { plane, width, corner, size }),
        };
        let lobes = surface.lobes.iter().map(|lobe| LobeRange {
            strength: match lobe.strength {
                Strength::Neutral(strength) => vec![parameter(&strength)],
                Strength::Tinted(map) => per_band(map),
            },
            shape: lobe.shape.iter().map(parameter).collect(),
        });
        TileStatistics {
            pixels: shown,
            gaps: shown < size[0] * size[1],
            axis,
            cone,
            diffuse: diffuse.into_iter().map(range).collect(),
            ambient: surface.ambient.map(per_band).unwrap_or_default(),
            lobes: lobes.collect(),
            relief: self.height.map(|height| self.relief(height, corner, level)),
        }
    }

    /// The relief of a tile and of the cells that lead to the next one.
    fn relief(&self, height: &[f32], corner: [usize; 2], level: Level) -> ReliefRange {
        let size = [(SIDE + 1).min(self.width - corner[0]), (SIDE + 1).min(self.rows - corner[1])];
        let window = Window { plane: height, width: self.width, corner, size };
        let mut range = Range::NONE;
        for row in window.rows() {
            for &value in row {
                range.low = Real::min(value, range.low);
                range.high = Real::max(value, range.high);
                range.holes |= !value.is_finite();
            }
        }
        let mut rise = level.run(Rise { window });
        let [[across_low, across_high], [up_low, up_high]] = self.border(window);
        for (index, rise) in rise.iter_mut().enumerate() {
            let [x, y] = azimuth(index).map(|value| value as f32);
            let across = Real::max(x * across_low, x * across_high);
            let up = Real::max(y * up_low, y * up_high);
            *rise = Real::max(across, Real::max(up, *rise));
        }
        ReliefRange { height: range, rise }
    }

    /// Smallest and largest rise to the right and up along the border of the painting, beyond which
    /// the relief goes on at the same height; NaN away from the border.
    fn border(&self, window: Window<'_>) -> [[f32; 2]; 2] {
        let Window { plane, width, corner: [left, top], size: [columns, rows] } = window;
        let mut edges = [[f32::NAN; 2]; 2];
        let mut add = |axis: usize, rise: f32| {
            let [low, high] = edges[axis];
            edges[axis] = [f32::min(rise, low), f32::max(rise, high)];
        };
        let at = |column: usize, row: usize| plane[row * width + column];
        for row in [0, self.rows - 1].into_iter().filter(|row| (top..top + rows).contains(row)) {
            for column in left + 1..left + columns {
                add(0, at(column, row) - at(column - 1, row));
            }
        }
        for column in [0, width - 1].into_iter().filter(|c| (left..left + columns).contains(c)) {
            for row in top + 1..top + rows {
                add(1, at(column, row - 1) - at(column, row));
            }
        }
        edges
    }
}

fn plane(map: &[f32], index: usize, pixels: usize) -> &[f32] {
    &map[index * pixels..][..pixels]
}

/// 0 for a pixel that can be shown, else NaN, row by row.
fn gate(normal: &[Window<'_>; 3], diffuse: &[Window<'_>]) -> Vec<f32> {
    let [columns, rows] = normal[0].size;
    let mut gate = vec![0.0; columns * rows];
    for window in normal.iter().chain(diffuse) {
        for (gate, values) in gate.chunks_exact_mut(columns).zip(window.rows()) {
            for (gate, &value) in gate.iter_mut().zip(values) {
                *gate += 0.0 * value;
            }
        }
    }
    gate
}

/// How many pixels are shown, the middle of their normals and the largest angle to it.
fn cone(normal: &[Window<'_>; 3], gate: &[f32], level: Level) -> (usize, Vec3<f64>, f64) {
    let [columns, _] = normal[0].size;
    let (mut shown, mut sum) = (0, [0.0_f64; 3]);
    for (axis, window) in normal.iter().enumerate() {
        for (gate, values) in gate.chunks_exact(columns).zip(window.rows()) {
            let known = gate.iter().zip(values).filter(|(gate, _)| **gate == 0.0);
            let total: f64 = known.map(|(_, &value)| f64::from(value)).sum();
            sum[axis] += total;
        }
    }
    shown += gate.iter().filter(|gate| **gate == 0.0).count();
    let mean = Vec3::new(sum[0], sum[1], sum[2]);
    let length = mean.length_squared().sqrt();
    if !(length.is_finite() && length > 0.0) {
        return (shown, Vec3::new(0.0, 0.0, 1.0), if shown == 0 { 0.0 } else { f64::INFINITY });
    }
    let axis = mean.scale(1.0 / length);
    let rounded = Vec3::new(axis.x as f32, axis.y as f32, axis.z as f32);
    let (chord, odd) = level.run(Chord { normal, gate, axis: rounded });
    // Rounding: of the axis, of a component of the difference, of the squares.
    let chord = f64::from(chord).sqrt() + 1e-6;
    let cone = if odd > UNIT { f64::INFINITY } else { 2.0 * (0.5 * chord).min(1.0).asin() };
    (shown, axis, cone)
}

/// The largest squared distance of a normal from the axis, and of its squared length from 1.
struct Chord<'a> {
    normal: &'a [Window<'a>; 3],
    gate: &'a [f32],
    axis: Vec3<f32>,
}

impl Kernel for Chord<'_> {
    type Output = (f32, f32);

    #[inline(always)]
    fn run<I: Isa>(self) -> (f32, f32) {
        let [columns, _] = self.normal[0].size;
        let [x, y, z] = self.normal.map(Window::rows);
        let axis: Vec3<I::F32> = self.axis.fill();
        let (mut chord, mut odd) = (I::F32::zero(), I::F32::zero());
        let mut planes = [[f32::NAN; BLOCK]; 3];
        for (((x, y), z), gate) in x.zip(y).zip(z).zip(self.gate.chunks_exact(columns)) {
            for (plane, row) in planes.iter_mut().zip([x, y, z]) {
                plane[..columns].copy_from_slice(row);
            }
            gated(&mut planes[0], gate);
            for lane in (0..columns).step_by(I::F32::WIDTH) {
                let normal = Vec3::new(
                    I::F32::load(&planes[0][lane..]),
                    I::F32::load(&planes[1][lane..]),
                    I::F32::load(&planes[2][lane..]),
                );
                // NaN lanes keep what is there.
                chord = (normal - axis).length_squared().max(chord);
                odd = (normal.length_squared() - I::F32::one()).abs().max(odd);
            }
        }
        (largest(chord), largest(odd))
    }
}

/// Adds the gate to a plane, so that what is not shown is NaN.
#[inline(always)]
fn gated(plane: &mut Plane, gate: &[f32]) {
    for (value, gate) in plane.iter_mut().zip(gate) {
        *value += gate;
    }
}

#[inline(always)]
fn largest<R: Real<Scalar = f32>>(lanes: R) -> f32 {
    let mut values = [0.0; crate::math::lanes::MAX_LANES];
    lanes.store(&mut values);
    values[..R::WIDTH].iter().copied().fold(f32::NEG_INFINITY, f32::max)
}

/// The range of a map.
struct Extremes<'a> {
    window: Window<'a>,
    gate: &'a [f32],
}

impl Kernel for Extremes<'_> {
    type Output = Range;

    #[inline(always)]
    fn run<I: Isa>(self) -> Range {
        let [columns, _] = self.window.size;
        let none = Range::NONE;
        let (mut low, mut high) = (I::F32::splat(none.low), I::F32::splat(none.high));
        let mut holes = I::F32::zero();
        let (mut values, mut gates) = ([f32::NAN; BLOCK], [f32::NAN; BLOCK]);
        for (row, gate) in self.window.rows().zip(self.gate.chunks_exact(columns)) {
            values[..columns].copy_from_slice(row);
            gates[..columns].copy_from_slice(gate);
            for lane in (0..columns).step_by(I::F32::WIDTH) {
                let (value, gate) = (I::F32::load(&values[lane..]), I::F32::load(&gates[lane..]));
                let shown = value + gate;
                low = shown.min(low);
                high = shown.max(high);
                let hole = !value.is_finite() & gate.le(gate);
                holes = I::F32::select(hole, I::F32::one(), holes);
            }
        }
        Range { low: -largest(-low), high: largest(high), holes: largest(holes) > 0.0 }
    }
}

/// The steepest rise in each direction: per cell the larger of its two differences along x and of
/// those along y, whichever the direction makes larger.
struct Rise<'a> {
    window: Window<'a>,
}

/// Unit vectors of the directions.
#[must_use]
pub fn azimuth(index: usize) -> [f64; 2] {
    let (sin, cos) = (core::f64::consts::TAU * index as f64 / AZIMUTHS as f64).sin_cos();
    [cos, sin]
}

impl Kernel for Rise<'_> {
    type Output = [f32; AZIMUTHS];

    #[inline(always)]
    fn run<I: Isa>(self) -> [f32; AZIMUTHS] {
        let mut steepest = [I::F32::splat(f32::NEG_INFINITY); AZIMUTHS];
        let mut directions = [[0.0; 2]; AZIMUTHS];
        for (index, direction) in directions.iter_mut().enumerate() {
            *direction = azimuth(index);
        }
        let [columns, _] = self.window.size;
        // A picture of one column or row has no cells: it is level across.
        let cells = (columns - 1).max(1);
        let mut edges = [[f32::NAN; BLOCK]; 4];
        let mut previous: Option<&[f32]> = None;
        let single = self.window.size[1] == 1;
        for row in self.window.rows() {
            let above = if single { row } else { previous.unwrap_or(row) };
            let first = previous.replace(row).is_none();
            if first && !single {
                continue;
            }
            for cell in 0..cells {
                let next = (cell + 1).min(columns - 1);
                let (top, bottom) = (above[next] - above[cell], row[next] - row[cell]);
                // y runs up.
                let (left, right) = (above[cell] - row[cell], above[next] - row[next]);
                edges[0][cell] = Real::max(top, bottom);
                edges[1][cell] = Real::min(top, bottom);
                edges[2][cell] = Real::max(left, right);
                edges[3][cell] = Real::min(left, right);
            }
            for lane in (0..cells).step_by(I::F32::WIDTH) {
                let edge = [0, 1, 2, 3].map(|one: usize| I::F32::load(&edges[one][lane..]));
                for (steepest, [x, y]) in steepest.iter_mut().zip(directions) {
                    let across = if x >= 0.0 { edge[0] } else { edge[1] };
                    let up = if y >= 0.0 { edge[2] } else { edge[3] };
                    let rise = across.mul_add(I::F32::of(x), up * I::F32::of(y));
                    *steepest = rise.max(*steepest);
                }
            }
        }
        let mut rise = [0.0; AZIMUTHS];
        for (rise, lanes) in rise.iter_mut().zip(steepest) {
            *rise = largest(lanes);
        }
        rise
    }
}
