//! Who lit, who looked, and where on the painting a pixel lies.
//!
//! World frame: origin in the middle of the painting, x right, y up, z towards the viewer,
//! millimetres. Directions are unit vectors that point away from the surface.

use crate::error::{Error, Result};
use crate::math::{Real, Vec3};

/// Where a photograph's light came from; its strength is already divided out of the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// So far away that every pixel sees it from the same unit direction.
    Distant(Vec3<f64>),
    /// Near: position in mm, and whether the samples still carry the 1/r^2 fall-off.
    Point {
        /// Millimetres from the middle of the painting.
        position: Vec3<f64>,
        /// Irradiance falls off as `(r0 / r)^2`, with `r0` the distance of the middle.
        falloff: bool,
    },
}

impl Light {
    /// Unit direction to the light and its irradiance at normal incidence, seen from the points
    /// `(x, y, 0)` in mm.
    #[must_use]
    #[inline(always)]
    pub fn at<R: Real>(&self, x: R, y: R) -> (Vec3<R>, R) {
        match *self {
            Self::Distant(direction) => (direction.splat(), R::one()),
            Self::Point { position, falloff } => {
                let to_light = position.splat() - Vec3::new(x, y, R::zero());
                let inverse = to_light.length().recip();
                let irradiance = if falloff {
                    let ratio = R::of(position.length()) * inverse;
                    ratio * ratio
                } else {
                    R::one()
                };
                (to_light.scale(inverse), irradiance)
            }
        }
    }

    /// Whether every pixel sees the light from the same direction.
    #[must_use]
    pub fn is_distant(&self) -> bool {
        matches!(self, Self::Distant(_))
    }

    /// Unit direction from the middle of the painting.
    #[must_use]
    pub fn direction(&self) -> Vec3<f64> {
        match *self {
            Self::Distant(direction) => direction,
            Self::Point { position, .. } => position.normalised(),
        }
    }
}

/// Where a photograph was taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// So far away that every pixel sees the camera in the same unit direction.
    Distant(Vec3<f64>),
    /// Near: millimetres from the middle of the painting.
    Point(Vec3<f64>),
}

impl From<Vec3<f64>> for View {
    fn from(direction: Vec3<f64>) -> Self {
        Self::Distant(direction)
    }
}

impl View {
    /// Unit direction to the camera from the points `(x, y, 0)` in mm.
    #[must_use]
    #[inline(always)]
    pub fn at<R: Real>(&self, x: R, y: R) -> Vec3<R> {
        match *self {
            Self::Distant(direction) => direction.splat(),
            Self::Point(position) => {
                let to_camera = position.splat() - Vec3::new(x, y, R::zero());
                to_camera.scale(to_camera.length().recip())
            }
        }
    }

    /// Whether every pixel sees the camera in the same direction.
    #[must_use]
    pub fn is_distant(&self) -> bool {
        matches!(self, Self::Distant(_))
    }

    /// Unit direction from the middle of the painting.
    #[must_use]
    pub fn direction(&self) -> Vec3<f64> {
        match *self {
            Self::Distant(direction) => direction,
            Self::Point(position) => position.normalised(),
        }
    }
}

/// From pixels to millimetres: where the pixels of a painting, or of a tile of one, lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Width of a pixel on the painting, mm.
    pub pitch: f64,
    /// Column and row of the first pixel in the whole painting: `[0, 0]` unless this is a tile.
    pub origin: [usize; 2],
    /// Columns and rows of the whole painting, whose middle is the origin of the world.
    pub extent: [usize; 2],
    /// Pixels that the middle of `extent` lies right of and below the origin of the world: of a part
    /// that is fitted by itself, or of a smaller scale whose pixels do not fill the painting.
    /// `[0.0, 0.0]` otherwise.
    pub shift: [f64; 2],
}

/// The shift of a grid is a multiple of this, in pixels: coordinates are then exact sums, the same
/// from whatever part of a painting they are found.
const FINEST_SHIFT: f64 = 1.0 / (1 << 20) as f64;

fn shifted(offset: f64) -> f64 {
    (offset / FINEST_SHIFT).round() * FINEST_SHIFT
}

impl Grid {
    /// The pixels of a whole painting.
    #[must_use]
    pub const fn whole(width: usize, height: usize, pitch: f64) -> Self {
        Self { width, height, pitch, origin: [0, 0], extent: [width, height], shift: [0.0, 0.0] }
    }

    /// The `width` x `height` pixels from column and row `[column, row]` of these on. Their
    /// coordinates are, to the bit, those that the same pixels have here.
    ///
    /// # Errors
    /// If the tile reaches beyond the pixels.
    pub fn tile(&self, [column, row]: [usize; 2], width: usize, height: usize) -> Result<Self> {
        let inside = |start: usize, size: usize, all: usize| {
            start.checked_add(size).is_some_and(|end| end <= all)
        };
        if !(inside(column, width, self.width) && inside(row, height, self.height)) {
            let problem = format!(
                "{width} x {height} pixels from column {column}, row {row} on reach beyond {} x {}",
                self.width, self.height
            );
            return Err(Error::geometry("tile", problem));
        }
        let origin = [self.origin[0] + column, self.origin[1] + row];
        Ok(Self { width, height, origin, ..*self })
    }

    /// The pixels of a part whose middle lies `right` and `up` pixels from the middle of a painting,
    /// whose size need not be known: whatever it is, coordinates are, to the bit, those that the
    /// same pixels have in the whole. That is so for any fraction of a pixel: what is left of half
    /// pixels is rounded to 1 / 2^20 pixel.
    ///
    /// # Errors
    /// If an offset is not finite, or 10^9 pixels or more.
    pub fn part(width: usize, height: usize, pitch: f64, [right, up]: [f64; 2]) -> Result<Self> {
        if ![right, up].iter().all(|offset| offset.abs() < 1e9) {
            let problem = format!("a part at ({right}, {up}) pixels lies in no painting");
            return Err(Error::geometry("origin", problem));
        }
        let halves = [right, up].map(|offset| 0.5 * (2.0 * offset).round());
        let shift = [shifted(right - halves[0]), -shifted(up - halves[1])];
        let [right, up] = halves;
        let [first, more] = [
            [right.abs() + right, up.abs() - up].map(|offset| offset as usize),
            [2.0 * right.abs(), 2.0 * up.abs()].map(|margin| margin as usize),
        ];
        let whole = Self::whole(width + more[0], height + more[1], pitch);
        Ok(Self { shift, ..whole.tile(first, width, height)? })
    }

    /// The pixels of a part as in [`Self::part`], of a painting with `[columns, rows]` pixels whose
    /// own middle lies at `middle`: it may be a part of a larger one.
    ///
    /// # Errors
    /// If the part does not lie on the painting's pixels.
    pub fn part_of(
        [columns, rows]: [usize; 2],
        middle: [f64; 2],
        width: usize,
        height: usize,
        pitch: f64,
        [right, up]: [f64; 2],
    ) -> Result<Self> {
        let column = 0.5 * (columns as f64 - width as f64) + (right - middle[0]);
        let row = 0.5 * (rows as f64 - height as f64) - (up - middle[1]);
        let first = [column, row].map(f64::round);
        let apart = (column - first[0]).abs().max((row - first[1]).abs());
        // NaN is no place.
        if !(apart <= FINEST_SHIFT && first.iter().all(|&place| place >= 0.0)) {
            let problem = format!(
                "{width} x {height} pixels, their middle at ({right}, {up}), lie beside the pixels \
                 of a painting of {columns} x {rows}"
            );
            return Err(Error::geometry("origin", problem));
        }
        let shift = [shifted(middle[0]), -shifted(middle[1])];
        let whole = Self { shift, ..Self::whole(columns, rows, pitch) };
        whole.tile(first.map(|place| place as usize), width, height)
    }

    /// Column and row in the whole painting of a pixel, counted row by row.
    #[must_use]
    pub fn place(&self, pixel: usize) -> [usize; 2] {
        [self.origin[0] + pixel % self.width, self.origin[1] + pixel / self.width]
    }

    /// The pixel at a column and row of the whole painting, if it lies in this tile.
    #[must_use]
    pub fn pixel(&self, [column, row]: [usize; 2]) -> Option<usize> {
        let column = column.checked_sub(self.origin[0]).filter(|&column| column < self.width)?;
        let row = row.checked_sub(self.origin[1]).filter(|&row| row < self.height)?;
        Some(row * self.width + column)
    }

    /// x in mm of a (fractional) column.
    #[must_use]
    #[inline(always)]
    pub fn x(&self, column: f64) -> f64 {
        self.right(column) * self.pitch
    }

    /// y in mm of a (fractional) row: rows run down, y runs up.
    #[must_use]
    #[inline(always)]
    pub fn y(&self, row: f64) -> f64 {
        (0.0 - self.down(row)) * self.pitch
    }

    /// How many pixels a (fractional) column lies right of the middle of the painting.
    #[must_use]
    #[inline(always)]
    pub fn right(&self, column: f64) -> f64 {
        self.offset(0, column)
    }

    /// How many pixels a (fractional) row lies below the middle of the painting.
    #[must_use]
    #[inline(always)]
    pub fn down(&self, row: f64) -> f64 {
        self.offset(1, row)
    }

    #[inline(always)]
    fn offset(&self, axis: usize, place: f64) -> f64 {
        let first = self.origin[axis] as f64 - 0.5 * (self.extent[axis] as f64 - 1.0);
        place + (first + self.shift[axis])
    }

    /// Writes the coordinates in mm of the pixels from `start` on, counted row by row.
    #[inline]
    pub fn coordinates(&self, start: usize, x: &mut [f32], y: &mut [f32]) {
        let (mut row, mut column, mut at) = (start / self.width, start % self.width, 0);
        while at < x.len() {
            let end = x.len().min(at + self.width - column);
            y[at..end].fill(self.y(row as f64) as f32);
            for (x, column) in x[at..end].iter_mut().zip(column as u32..) {
                *x = self.x(f64::from(column)) as f32;
            }
            (row, column, at) = (row + 1, 0, end);
        }
    }
}

/// Views that differ by less, in radians, are one view: what a pixel shows under them then differs
/// by less than a sharp lobe's own width.
const ONE_VIEW: f64 = 0.05;

/// One light and one view per observation.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    lights: Vec<Light>,
    views: Vec<View>,
    grid: Grid,
}

impl Rig {
    /// A rig of as many lights as views.
    ///
    /// # Errors
    /// If the counts differ, or a vector is not finite or has no length.
    pub fn new(
        lights: Vec<Light>,
        views: impl IntoIterator<Item: Into<View>>,
        grid: Grid,
    ) -> Result<Self> {
        let views: Vec<View> = views.into_iter().map(Into::into).collect();
        if lights.is_empty() || lights.len() != views.len() {
            let problem = format!("{} lights and {} views", lights.len(), views.len());
            return Err(Error::geometry("lights", problem));
        }
        let usable = |v: &Vec3<f64>| v.length_squared().is_finite() && v.length_squared() > 0.0;
        if let Some(index) = lights.iter().position(|light| !usable(&light.direction())) {
            let problem = format!("light {index} has no finite direction");
            return Err(Error::geometry("lights", problem));
        }
        if let Some(index) = views.iter().position(|view| !usable(&view.direction())) {
            return Err(Error::geometry("views", format!("view {index} has no finite direction")));
        }
        Ok(Self { lights, views, grid })
    }

    /// Number of observations.
    #[must_use]
    pub fn observations(&self) -> usize {
        self.lights.len()
    }

    /// One light per observation.
    #[must_use]
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// One view per observation.
    #[must_use]
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Where the pixels lie.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Whether an observation's light and view have the same directions at every pixel.
    #[must_use]
    #[inline(always)]
    pub fn is_distant_at(&self, observation: usize) -> bool {
        self.lights[observation].is_distant() && self.views[observation].is_distant()
    }

    /// Whether no light's direction changes over the painting.
    #[must_use]
    pub fn is_distant(&self) -> bool {
        self.lights.iter().all(Light::is_distant)
    }

    /// Whether photographs were taken from more than one direction.
    #[must_use]
    pub fn views_differ(&self) -> bool {
        let first = self.views[0].direction();
        self.views.iter().any(|view| view.direction().dot(first) < ONE_VIEW.cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_light_overhead_falls_off_with_the_squared_distance() {
        let light = Light::Point { position: Vec3::new(0.0, 0.0, 100.0), falloff: true };
        let (direction, irradiance) = light.at(100.0_f64, 0.0);
        // r = 100 sqrt 2: irradiance one half, direction at 45 degrees.
        assert!((irradiance - 0.5).abs() < 1e-15);
        assert!((direction.x + 0.5_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn views_differ_from_three_degrees_on() {
        let grid = Grid::whole(1, 1, 1.0);
        let rig = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let views = vec![Vec3::new(0.0, 0.0, 1.0), Vec3::new(sin, 0.0, cos)];
            Rig::new(vec![Light::Distant(views[0]); 2], views, grid).unwrap()
        };
        // 0.05 rad is 2.86 degrees.
        assert!(!rig(2.8).views_differ());
        assert!(rig(2.9).views_differ());
    }

    #[test]
    fn rows_run_down_and_y_runs_up() {
        let grid = Grid::whole(3, 2, 2.0);
        let (mut x, mut y) = ([0.0; 6], [0.0; 6]);
        grid.coordinates(0, &mut x, &mut y);
        assert_eq!(x, [-2.0, 0.0, 2.0, -2.0, 0.0, 2.0]);
        assert_eq!(y, [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]);
    }

    #[test]
    fn a_pixel_of_a_tile_lies_where_it_lies_in_the_whole() {
        let whole = Grid::whole(37, 23, 0.3);
        let [mut x, mut y] = [(); 2].map(|()| vec![0.0; 37 * 23]);
        whole.coordinates(0, &mut x, &mut y);
        // A tile of a tile, too.
        let tile = whole.tile([4, 2], 30, 20).unwrap().tile([1, 5], 11, 7).unwrap();
        let [mut tile_x, mut tile_y] = [(); 2].map(|()| vec![0.0; 11 * 7]);
        tile.coordinates(0, &mut tile_x, &mut tile_y);
        for pixel in 0..11 * 7 {
            let there = (7 + pixel / 11) * 37 + 5 + pixel % 11;
            assert_eq!((tile_x[pixel], tile_y[pixel]), (x[there], y[there]));
            assert_eq!(whole.pixel(tile.place(pixel)), Some(there));
            assert_eq!(tile.pixel(tile.place(pixel)), Some(pixel));
        }
        // The same by its middle: columns 5 to 15 of 37, rows 7 to 13 of 23.
        let [mut part_x, mut part_y] = [(); 2].map(|()| vec![0.0; 11 * 7]);
        let part = Grid::part(11, 7, 0.3, [10.0 - 18.0, 11.0 - 10.0]).unwrap();
        part.coordinates(0, &mut part_x, &mut part_y);
        assert_eq!((&part_x, &part_y), (&tile_x, &tile_y));
        assert!(Grid::part(11, 7, 0.3, [f64::NAN, 0.0]).is_err());
        assert_eq!([[4, 7], [5, 6], [16, 7], [5, 14]].map(|place| tile.pixel(place)), [None; 4]);
        // Its middle lies 8 columns left of the painting's and a row above it.
        let middle = [5.0 + 5.0 - 18.0, 11.0 - 7.0 - 3.0];
        assert_eq!(Grid::part_of([37, 23], [0.0; 2], 11, 7, 0.3, middle), Ok(tile));
        assert!(Grid::part_of([37, 24], [0.0; 2], 11, 7, 0.3, middle).is_err());
        assert!(Grid::part_of([37, 23], [0.0; 2], 11, 7, 0.3, [-14.0, 1.0]).is_err());
        // The same in a painting that is itself a part, of 30 x 20 pixels from column 4, row 2 on.
        let around = [4.0 + 14.5 - 18.0, 11.0 - 2.0 - 9.5];
        let inner = Grid::part_of([30, 20], around, 11, 7, 0.3, middle).unwrap();
        assert_eq!((inner.origin, inner.extent), ([1, 5], [30, 20]));
        inner.coordinates(0, &mut x[..77], &mut y[..77]);
        assert_eq!((&x[..77], &y[..77]), (&tile_x[..], &tile_y[..]));
        assert!(whole.tile([4, 2], 34, 20).is_err());
        assert!(whole.tile([usize::MAX, 2], 4, 20).is_err());
    }

    /// A painting of 40 x 31 pixels at a scale of 1/3 has 13 x 10, whose middle lies half a pixel
    /// left of and above its own: 1/6 of the larger pixels.
    #[test]
    fn parts_of_a_smaller_scale_lie_where_they_lie_in_the_whole_of_it() {
        let [right, up] = [-0.5 / 3.0, 0.5 / 3.0];
        let whole = Grid::part(13, 10, 0.9, [right, up]).unwrap();
        for (left, top, width, height) in [(0, 0, 6, 5), (1, 3, 5, 2), (7, 2, 6, 8), (12, 9, 1, 1)]
        {
            // The middle of the part in pixels of the painting, then in larger ones.
            let middle = [
                (3.0 * (f64::from(left) + 0.5 * f64::from(width)) - 20.0) / 3.0,
                (15.5 - 3.0 * (f64::from(top) + 0.5 * f64::from(height))) / 3.0,
            ];
            let part = Grid::part(width as usize, height as usize, 0.9, middle).unwrap();
            assert_eq!(part.x(0.0).to_bits(), whole.x(f64::from(left)).to_bits());
            assert_eq!(part.y(0.0).to_bits(), whole.y(f64::from(top)).to_bits());
        }
        // Half of 2^-20 pixel of 0.9 mm, and roundings.
        let exact = (1.5 - 20.0) / 3.0 * 0.9;
        assert!((whole.x(0.0) - exact).abs() < 0.5e-6, "{}", whole.x(0.0) - exact);
    }
}
