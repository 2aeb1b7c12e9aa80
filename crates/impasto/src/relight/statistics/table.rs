//! Statistics as a table of numbers, to be kept beside the maps of a painting of any size, and those
//! of the whole from its pieces.

use core::ops::Range as Span;

use super::tiles::{LobeRange, Range, SIDE, Statistics, TileStatistics};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::surface::{Strength, Surface};

/// What a painting is cut into when its statistics are made tile by tile: every `tile` is cut, from
/// its own first pixel on, into pieces of [`SIDE`] columns and rows, the last ones smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pieces {
    /// Columns of the painting.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Columns and rows of a tile.
    pub tile: usize,
}

impl Pieces {
    /// First pixel and end of every piece along a side.
    fn along(self, size: usize) -> Vec<Span<usize>> {
        let tiles =
            (0..size).step_by(self.tile.max(1)).map(|start| (start, size.min(start + self.tile)));
        let cut = |(start, end): (usize, usize)| {
            (start..end).step_by(SIDE).map(move |from| from..end.min(from + SIDE))
        };
        tiles.flat_map(cut).collect()
    }
}

/// How many ranges the tiles of a surface have.
struct Kind {
    bands: usize,
    ambient: usize,
    /// Strengths and parameters.
    lobes: Vec<[usize; 2]>,
}

impl Kind {
    fn of(surface: &Surface<'_>) -> Result<Self> {
        let bands = surface.bands(surface.normal.len() / 3)?;
        let strengths = |strength| match strength {
            Strength::Neutral(_) => 1,
            Strength::Tinted(_) => bands,
        };
        let lobes = surface.lobes.iter().map(|lobe| [strengths(lobe.strength), lobe.shape.len()]);
        let ambient = if surface.ambient.is_some() { bands } else { 0 };
        Ok(Self { bands, ambient, lobes: lobes.collect() })
    }

    fn numbers(&self) -> usize {
        let of_lobes: usize = self.lobes.iter().flatten().sum();
        OF_NORMALS + OF_RANGE * (self.bands + self.ambient + of_lobes)
    }

    /// A tile from its numbers.
    fn tile(&self, mut numbers: impl Iterator<Item = f64>) -> TileStatistics {
        let mut next = || numbers.next().unwrap_or(f64::NAN);
        let (pixels, gaps) = (next() as usize, next() != 0.0);
        let axis = Vec3::new(next(), next(), next());
        let cone = next();
        let mut ranges = |count: usize| -> Vec<Range> {
            let mut range =
                || Range { low: next() as f32, high: next() as f32, holes: next() != 0.0 };
            (0..count).map(|_| range()).collect()
        };
        let (diffuse, ambient) = (ranges(self.bands), ranges(self.ambient));
        let lobes = self.lobes.iter();
        let lobes = lobes.map(|&[strengths, shape]| LobeRange {
            strength: ranges(strengths),
            shape: ranges(shape),
        });
        TileStatistics {
            pixels,
            gaps,
            axis,
            cone,
            diffuse,
            ambient,
            lobes: lobes.collect(),
            relief: None,
        }
    }
}

/// Numbers of a tile before its ranges: pixels, gaps, the axis and the angle of the cone.
const OF_NORMALS: usize = 6;
/// Numbers of a range: smallest, largest, 1 with holes.
const OF_RANGE: usize = 3;

impl TileStatistics {
    /// All but the relief, in the order in which [`Kind::tile`] takes them.
    fn numbers(&self) -> Vec<f64> {
        let Self { pixels, gaps, axis, cone, diffuse, ambient, lobes, relief: _ } = self;
        let of_lobes = lobes.iter().flat_map(|lobe| lobe.strength.iter().chain(&lobe.shape));
        let ranges = diffuse.iter().chain(ambient).chain(of_lobes);
        let ranges = ranges.flat_map(|range| {
            [f64::from(range.low), f64::from(range.high), f64::from(u8::from(range.holes))]
        });
        [*pixels as f64, f64::from(u8::from(*gaps)), axis.x, axis.y, axis.z, *cone]
            .into_iter()
            .chain(ranges)
            .collect()
    }
}

impl Range {
    fn or(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            holes: self.holes || other.holes,
        }
    }
}

impl Statistics {
    /// All but the relief as numbers `(number, tile)`, the tiles row by row.
    #[must_use]
    pub fn table(&self) -> Vec<f64> {
        let tiles: Vec<_> = self.tiles.iter().map(TileStatistics::numbers).collect();
        let count = tiles.first().map_or(0, Vec::len);
        (0..count).flat_map(|number| tiles.iter().map(move |tile| tile[number])).collect()
    }

    /// The statistics of a whole painting from those of its pieces: numbers `(number, piece)`, the
    /// pieces row by row. Exact where tiles are multiples of [`SIDE`]; else what a tile may show is
    /// bounded by all pieces that reach into it.
    ///
    /// `surface` is any part of the painting; its maps are not read.
    ///
    /// # Errors
    /// If there are other numbers than those of such a surface in these pieces.
    pub fn from_table(table: &[f64], surface: &Surface<'_>, pieces: Pieces) -> Result<Self> {
        let kind = Kind::of(surface)?;
        let (across, down) = (pieces.along(pieces.width), pieces.along(pieces.height));
        let count = across.len() * down.len();
        if count == 0 || table.len() != kind.numbers() * count {
            return Err(Error::argument("statistics", "they are those of another surface"));
        }
        let known: Vec<_> =
            (0..count).map(|one| kind.tile(table[one..].iter().step_by(count).copied())).collect();
        let starts =
            |size: usize| (0..size).step_by(SIDE).map(move |start| start..size.min(start + SIDE));
        let tiles = starts(pieces.height).flat_map(|rows| {
            let lines = within(&down, &rows);
            starts(pieces.width).map({
                let (known, across) = (&known, &across);
                move |columns| {
                    let places = within(across, &columns);
                    let at =
                        |line: usize| places.clone().map(move |place| line * across.len() + place);
                    joined(lines.clone().flat_map(at).map(|one| &known[one]))
                }
            })
        });
        Ok(Self { columns: pieces.width.div_ceil(SIDE), tiles: tiles.collect() })
    }
}

/// The pieces along a side that reach into a tile.
fn within(pieces: &[Span<usize>], tile: &Span<usize>) -> Span<usize> {
    let first = pieces.partition_point(|piece| piece.end <= tile.start);
    let end = pieces.partition_point(|piece| piece.start < tile.end);
    first..end
}

/// What is known of pixels that lie in these pieces.
fn joined<'a>(pieces: impl Iterator<Item = &'a TileStatistics>) -> TileStatistics {
    let pieces: Vec<_> = pieces.collect();
    let [first, rest @ ..] = pieces.as_slice() else { unreachable!("pieces cover every tile") };
    let mut all = (*first).clone();
    for piece in rest {
        let pairs = |mine: &mut [Range], theirs: &[Range]| {
            for (one, other) in mine.iter_mut().zip(theirs) {
                *one = one.or(*other);
            }
        };
        pairs(&mut all.diffuse, &piece.diffuse);
        pairs(&mut all.ambient, &piece.ambient);
        for (one, other) in all.lobes.iter_mut().zip(&piece.lobes) {
            pairs(&mut one.strength, &other.strength);
            pairs(&mut one.shape, &other.shape);
        }
        all.pixels += piece.pixels;
        all.gaps |= piece.gaps;
    }
    if !rest.is_empty() {
        (all.axis, all.cone) = around(&pieces);
    }
    all
}

/// A cone around the cones of all pieces that have a normal, about their mean.
fn around(pieces: &[&TileStatistics]) -> (Vec3<f64>, f64) {
    let shown = || pieces.iter().filter(|piece| piece.pixels > 0);
    let sum = shown().fold(Vec3::new(0.0, 0.0, 0.0), |sum: Vec3<f64>, piece| {
        sum + piece.axis.scale(piece.pixels as f64)
    });
    let length = sum.length_squared().sqrt();
    if !(length.is_finite() && length > 0.0) {
        let cone = if shown().next().is_none() { 0.0 } else { f64::INFINITY };
        return (Vec3::new(0.0, 0.0, 1.0), cone);
    }
    let axis = sum.scale(1.0 / length);
    let reach = |piece: &&TileStatistics| {
        let chord = (piece.axis - axis).length_squared().sqrt();
        2.0 * (0.5 * chord).min(1.0).asin() + piece.cone
    };
    (axis, shown().map(reach).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;
    use crate::surface::{Lobe, Model, Parameter};

    const SIZE: [usize; 2] = [300, 530];

    /// Two bands, ambient light, a coloured lobe with a map and one that is the same everywhere.
    struct Maps {
        normal: Vec<f32>,
        diffuse: Vec<f32>,
        gamma: Vec<f32>,
    }

    impl Maps {
        fn surface(&self) -> Surface<'_> {
            let everywhere = Parameter::Everywhere;
            Surface {
                normal: &self.normal,
                diffuse: &self.diffuse,
                model: Model::from_name("torrance-sparrow", 1.5).unwrap(),
                lobes: vec![
                    Lobe {
                        strength: Strength::Tinted(&self.diffuse),
                        shape: vec![Parameter::Map(&self.gamma)],
                    },
                    Lobe {
                        strength: Strength::Neutral(everywhere(0.5)),
                        shape: vec![everywhere(0.2)],
                    },
                ],
                coated: None,
                ambient: Some(&self.diffuse),
            }
        }

        /// Some rows and columns.
        fn part(&self, rows: &Span<usize>, columns: &Span<usize>) -> Self {
            let cut = |map: &[f32]| {
                map.chunks(SIZE[0] * SIZE[1])
                    .flat_map(|plane| rows.clone().map(move |row| &plane[row * SIZE[1]..]))
                    .flat_map(|row| row[columns.clone()].to_vec())
                    .collect()
            };
            Self { normal: cut(&self.normal), diffuse: cut(&self.diffuse), gamma: cut(&self.gamma) }
        }
    }

    /// Waves, with some pixels that have no normal, and one without a lobe.
    fn maps() -> Maps {
        let [rows, columns] = SIZE;
        let places = || (0..rows).flat_map(|y| (0..columns).map(move |x| [x as f32, y as f32]));
        let mut normal: Vec<[f32; 3]> = places()
            .map(|[x, y]| {
                let slope = [0.3 * (x / 40.0).sin(), 0.4 * (y / 25.0).cos()];
                let length = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
                [slope[0] / length, slope[1] / length, 1.0 / length]
            })
            .collect();
        for pixel in [5, 1007, 290 * columns + 260] {
            normal[pixel] = [f32::NAN; 3];
        }
        let mut gamma: Vec<f32> = places().map(|[x, y]| 0.1 + 0.05 * (x + y).sin()).collect();
        gamma[100 * columns + 300] = f32::NAN;
        let band = |phase: f32| {
            places().map(move |[x, y]| 0.5 + 0.4 * (x * 0.02 + phase - y * 0.03).sin())
        };
        Maps {
            normal: (0..3).flat_map(|axis| normal.iter().map(move |one| one[axis])).collect(),
            diffuse: band(0.0).chain(band(1.0)).collect(),
            gamma,
        }
    }

    fn of(maps: &Maps, width: usize) -> Statistics {
        serially(|run| Statistics::new(&maps.surface(), width, None, run)).unwrap()
    }

    /// The table of a painting from those of its tiles, as jobs lay them side by side.
    fn assembled(maps: &Maps, tile: usize) -> Vec<f64> {
        let pieces = Pieces { width: SIZE[1], height: SIZE[0], tile };
        let (across, down) = (pieces.along(SIZE[1]), pieces.along(SIZE[0]));
        let whole =
            |size: usize| (0..size).step_by(tile).map(move |start| start..size.min(start + tile));
        let mut table = Vec::new();
        for rows in whole(SIZE[0]) {
            for columns in whole(SIZE[1]) {
                let part = maps.part(&rows, &columns);
                let found = of(&part, columns.len());
                let numbers = found.table();
                table.resize(numbers.len() / found.tiles.len() * across.len() * down.len(), 0.0);
                let corner = [within(&down, &rows).start, within(&across, &columns).start];
                for (index, value) in numbers.into_iter().enumerate() {
                    let (number, place) = (index / found.tiles.len(), index % found.tiles.len());
                    let line = corner[0] + place / found.columns;
                    let column = corner[1] + place % found.columns;
                    table[(number * down.len() + line) * across.len() + column] = value;
                }
            }
        }
        table
    }

    fn from_tiles(maps: &Maps, tile: usize) -> Statistics {
        let pieces = Pieces { width: SIZE[1], height: SIZE[0], tile };
        let pixel = maps.part(&(0..1), &(0..1));
        Statistics::from_table(&assembled(maps, tile), &pixel.surface(), pieces).unwrap()
    }

    #[test]
    fn tiles_of_whole_pieces_give_the_statistics_of_the_whole() {
        let maps = maps();
        let whole = of(&maps, SIZE[1]);
        for tile in [256, 512, 768] {
            assert_eq!(from_tiles(&maps, tile), whole, "tiles of {tile}");
        }
    }

    #[test]
    fn other_tiles_give_bounds_that_hold_all_pixels() {
        let maps = maps();
        let whole = of(&maps, SIZE[1]);
        for tile in [100, 130, 300] {
            let joined = from_tiles(&maps, tile);
            for (bound, exact) in joined.tiles.iter().zip(&whole.tiles) {
                assert!(bound.pixels >= exact.pixels && (bound.gaps || !exact.gaps));
                let ranges = |tile: &TileStatistics| {
                    let lobes = tile.lobes.iter().flat_map(|l| l.strength.iter().chain(&l.shape));
                    let all = tile.diffuse.iter().chain(&tile.ambient).chain(lobes);
                    all.copied().collect::<Vec<_>>()
                };
                for (wide, narrow) in ranges(bound).iter().zip(ranges(exact)) {
                    assert!(wide.low <= narrow.low && wide.high >= narrow.high);
                    assert!(wide.holes || !narrow.holes);
                }
                assert!(bound.cone < 1.2, "the slopes reach 0.3 and 0.4");
            }
            let [rows, columns] = SIZE;
            for (pixel, _) in maps.gamma.iter().enumerate() {
                let [x, y, z] = [0, 1, 2].map(|axis| maps.normal[axis * rows * columns + pixel]);
                let normal = Vec3::new(f64::from(x), f64::from(y), f64::from(z));
                let block =
                    pixel / columns / SIDE * columns.div_ceil(SIDE) + pixel % columns / SIDE;
                let TileStatistics { axis, cone, .. } = &joined.tiles[block];
                let chord = (normal - *axis).length_squared().sqrt();
                assert!(chord.is_nan() || 2.0 * (0.5 * chord).asin() <= *cone);
            }
        }
    }

    #[test]
    fn a_table_of_another_surface_is_refused() {
        let maps = maps();
        let table = assembled(&maps, 256);
        let pieces = Pieces { width: SIZE[1], height: SIZE[0], tile: 256 };
        let mut other = maps.surface();
        other.ambient = None;
        assert!(Statistics::from_table(&table, &other, pieces).is_err());
        let less = Pieces { height: 200, ..pieces };
        assert!(Statistics::from_table(&table, &maps.surface(), less).is_err());
    }
}
