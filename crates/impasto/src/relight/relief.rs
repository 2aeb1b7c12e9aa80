//! Pixels and heights.

use crate::geometry::Grid;

/// Where a painting's pixels lie.
#[derive(Clone, Copy, Debug)]
pub struct Relief<'a> {
    /// Columns, rows and the width of a pixel.
    pub grid: Grid,
    /// Height in mm, `(y, x)`: given, shadows are cast.
    pub height: Option<&'a [f32]>,
}
