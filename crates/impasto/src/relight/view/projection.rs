//! Where an eye sees the places of the painting's plane.

use nalgebra::{Matrix3, Vector3};

use crate::error::{Error, Result};
use crate::geometry::{Grid, View};
use crate::math::Vec3;

/// A picture in perspective has at most so many times the painting's rows or columns.
const LARGEST: f64 = 4.0;

/// How an eye sees the painting's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    view: View,
    /// From the painting's (x, y, 1) to the picture's (right, up, 1), up to a factor.
    pub(super) forward: [[f64; 3]; 3],
    backward: [[f64; 3]; 3],
    /// The painting, or the part of it, whose middle is the origin here.
    pub(super) painting: Grid,
    /// The picture's size and pitch.
    pub picture: Grid,
}

impl Projection {
    /// The projection of a painting to an eye in front of it (`z > 0`), a distant one in a unit
    /// direction.
    ///
    /// # Errors
    /// An eye so near that it sees a part of the painting several times as large as the middle.
    pub fn new(view: View, painting: Grid) -> Result<Self> {
        // The picture of a part shows it about its own middle.
        let Grid { width, height, pitch, .. } = painting;
        let here = Grid::whole(width, height, pitch);
        match view {
            View::Distant(view) => Ok(Self::parallel(view, here)),
            View::Point(eye) => {
                let middle = [width, height].map(|size| 0.5 * (size as f64 - 1.0));
                let (x, y) = (painting.x(middle[0]), painting.y(middle[1]));
                Self::perspective(eye - Vec3::new(x, y, 0.0), here)
            }
        }
    }

    pub(super) fn parallel(view: Vec3<f64>, painting: Grid) -> Self {
        let [right, up] = axes(view);
        let forward = [[right.x, right.y], [up.x, up.y]];
        // The determinant is the foreshortening, V.Z.
        let determinant = forward[0][0] * forward[1][1] - forward[0][1] * forward[1][0];
        let backward = [
            [forward[1][1] / determinant, -forward[0][1] / determinant],
            [-forward[1][0] / determinant, forward[0][0] / determinant],
        ];
        let extent = |row: [f64; 2]| {
            let size = row[0].abs() * painting.width as f64 + row[1].abs() * painting.height as f64;
            // A hair less than the next whole pixel is that pixel: rounding must not add a row.
            (size - 1e-9).ceil().max(1.0) as usize
        };
        let (width, height) = (extent(forward[0]), extent(forward[1]));
        let affine = |[[a, b], [c, d]]: [[f64; 2]; 2]| [[a, b, 0.0], [c, d, 0.0], [0.0, 0.0, 1.0]];
        Self {
            view: View::Distant(view),
            forward: affine(forward),
            backward: affine(backward),
            painting,
            picture: Grid::whole(width, height, painting.pitch),
        }
    }

    fn perspective(eye: Vec3<f64>, painting: Grid) -> Result<Self> {
        let (view, distance) = (eye.normalised(), eye.length());
        let [right, up] = axes(view);
        let seen = Matrix3::new(
            right.x,
            right.y,
            0.0,
            up.x,
            up.y,
            0.0,
            -view.x / distance,
            -view.y / distance,
            1.0,
        );
        let half = [painting.width, painting.height].map(|size| 0.5 * size as f64 * painting.pitch);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let corner = seen * Vector3::new(x * half[0], y * half[1], 1.0);
            for axis in 0..2 {
                let place = if corner.z > 0.0 { corner[axis] / corner.z } else { f64::INFINITY };
                (low[axis], high[axis]) = (low[axis].min(place), high[axis].max(place));
            }
        }
        let size = [0, 1].map(|axis| (high[axis] - low[axis]) / painting.pitch);
        let largest = LARGEST * painting.width.max(painting.height) as f64;
        if size.iter().any(|size| size.is_nan() || *size > largest) {
            let problem = format!(
                "from ({:.4}, {:.4}, {:.4}) mm a corner of the painting is seen {LARGEST} times as large \
                 as its middle, or from behind; move the eye away",
                eye.x, eye.y, eye.z
            );
            return Err(Error::geometry("view", problem));
        }
        let middle = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]));
        let forward =
            Matrix3::new(1.0, 0.0, -middle[0], 0.0, 1.0, -middle[1], 0.0, 0.0, 1.0) * seen;
        let Some(backward) = forward.try_inverse() else {
            return Err(Error::geometry("view", "the eye sees the painting from its edge"));
        };
        let rows = |m: Matrix3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]));
        let [width, height] = size.map(|size| (size - 1e-9).ceil().max(1.0) as usize);
        Ok(Self {
            view: View::Point(eye),
            forward: rows(forward),
            backward: rows(backward),
            painting,
            picture: Grid::whole(width, height, painting.pitch),
        })
    }

    /// Where a point of the painting's plane (mm) appears in the picture (mm right, mm up).
    #[must_use]
    pub fn picture_from_painting(&self, x: f64, y: f64) -> (f64, f64) {
        let [right, up, depth] = self.forward.map(|row| row[0].mul_add(x, row[1] * y) + row[2]);
        (right / depth, up / depth)
    }

    /// How far the view moves the corner that it moves most, in pixels; 0 only where it moves nothing.
    #[must_use]
    pub fn displacement(&self) -> f64 {
        let (across, up) = (0.5 * self.painting.width as f64, 0.5 * self.painting.height as f64);
        let pitch = self.painting.pitch;
        // A homography that leaves four corners where they are is none.
        let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
        corners.into_iter().fold(0.0, |most: f64, (right, top)| {
            let (x, y) = (right * across, top * up);
            let (seen_x, seen_y) = self.picture_from_painting(x * pitch, y * pitch);
            most.max((seen_x / pitch - x).hypot(seen_y / pitch - y))
        })
    }

    /// Column, row and 1, up to a factor, of the painting at which the centre of a picture's pixel
    /// lies.
    #[inline(always)]
    pub(super) fn homogeneous(&self, column: f64, row: f64) -> [f64; 3] {
        let (right, up) = (self.picture.x(column), self.picture.y(row));
        let [x, y, one] = self.backward.map(|to| to[0].mul_add(right, to[1] * up) + to[2]);
        let Grid { width, height, pitch, .. } = self.painting;
        let middle = [width, height].map(|size| 0.5 * (size as f64 - 1.0) * one);
        [x / pitch + middle[0], middle[1] - y / pitch, one]
    }

    /// Column and row of the painting at which the centre of a picture's pixel lies.
    #[inline(always)]
    pub(super) fn painting_from_picture(&self, column: f64, row: f64) -> [f64; 2] {
        let [column, row, one] = self.homogeneous(column, row);
        [column / one, row / one]
    }

    /// From the first to behind the last sample of a picture's pixel, in painting pixels to the right
    /// and down.
    #[inline(always)]
    pub(super) fn spread(&self, column: f64, row: f64) -> [f64; 2] {
        if let View::Distant(view) = self.view {
            return [view.x / view.z, -view.y / view.z];
        }
        // The longest direction of what the pixel sees: the first left singular vector.
        let at = |right, down| self.painting_from_picture(column + right, row + down);
        let [[a, b], [c, d]] = [[0.5, 0.0], [0.0, 0.5]].map(|[right, down]: [f64; 2]| {
            let (to, from) = (at(right, down), at(-right, -down));
            [to[0] - from[0], to[1] - from[1]]
        });
        let (xx, xy, yy) = (a.mul_add(a, c * c), a.mul_add(b, c * d), b.mul_add(b, d * d));
        let apart = (0.5 * (xx - yy)).hypot(xy);
        let length = 0.5 * (xx + yy) + apart;
        let turn = 0.5 * (2.0 * xy).atan2(xx - yy);
        let box_ = (length - 1.0).max(0.0).sqrt();
        [box_ * turn.cos(), box_ * turn.sin()]
    }

    /// The rays that leave the painting about a column and row.
    #[inline(always)]
    pub(super) fn rays(&self, [column, row]: [f64; 2]) -> Rays<f64> {
        let pitch = self.painting.pitch;
        match self.view {
            View::Distant(view) => {
                Rays { per: [view.x / view.z / pitch, -view.y / view.z / pitch], grows: 0.0 }
            }
            View::Point(eye) => {
                let [x, y] = [self.painting.x(column), self.painting.y(row)];
                let per = [(eye.x - x) / eye.z / pitch, (y - eye.y) / eye.z / pitch];
                Rays { per, grows: -1.0 / eye.z }
            }
        }
    }
}

/// How far a place moves for each mm of height: in painting pixels to the right and down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rays<T> {
    /// At the origin.
    pub(super) per: [T; 2],
    /// Per pixel away from it: to a near eye, less.
    pub(super) grows: T,
}

/// Right and up of the picture of a unit view.
fn axes(view: Vec3<f64>) -> [Vec3<f64>; 2] {
    let up = Vec3::new(-view.y * view.x, 1.0 - view.y * view.y, -view.y * view.z).normalised();
    [up.cross(view), up]
}
