//! Cast shadows: which pixels see a light over the relief.
//!
//! **Distant light**: [`distant`], prefix maximum along sheared [`lines`], as [`bits`], for the whole
//! picture or a tile of it. **Point light**: [`point`], a march. **Lamps with a size, the sky**:
//! [`horizon`].
//!
//! Beyond the border the relief goes on at the border's height for one pixel and throws no
//! shadow after that. A height that is NaN throws no shadow and receives none.

use crate::error::{Error, Result};
use crate::geometry::{Grid, Light};
use crate::pixels::{Run, TILE, zeros};

pub mod bits;
mod distant;
pub mod horizon;
mod hull;
pub(crate) mod lines;
mod point;
mod shares;

pub use bits::Bits;
pub use lines::Span;
pub use shares::Shares;

use distant::{Scratch, Sweep};

pub use super::statistics::SIDE;

/// Visibility of a light, 1 or 0 per pixel, `(y, x)`.
///
/// `relief` is the height in mm, `(y, x)`, on `grid`.
///
/// # Errors
/// If the sizes disagree, the light stands behind the painting, or the caller cancels.
pub fn cast_shadows(relief: &[f32], grid: Grid, light: &Light, run: &Run<'_>) -> Result<Vec<f32>> {
    checked(relief, grid, light)?;
    if let Light::Point { position, .. } = *light {
        return point::near(relief, grid, position, run);
    }
    let bits = visible(relief, grid, light, run)?;
    let mut map = zeros(relief.len())?;
    run.for_each(
        map.chunks_exact_mut(grid.width).enumerate().collect(),
        || (),
        |(), (row, map)| {
            for (map, &word) in map.chunks_mut(bits::WORD).zip(bits.row(row)) {
                for (place, seen) in map.iter_mut().enumerate() {
                    *seen = f32::from(u8::from(word >> place & 1 != 0));
                }
            }
        },
    )?;
    Ok(map)
}

/// Visibility of a light as bits.
///
/// # Errors
/// As [`cast_shadows`].
pub fn visible(relief: &[f32], grid: Grid, light: &Light, run: &Run<'_>) -> Result<Bits> {
    checked(relief, grid, light)?;
    match *light {
        Light::Distant(direction) => match Sweep::new(relief, grid, direction) {
            Some(sweep) => sweep.whole(run),
            None => Ok(Bits::filled(true, grid.width, grid.height)),
        },
        Light::Point { position, .. } => {
            let map = point::near(relief, grid, position, run)?;
            let mut bits = Bits::filled(false, grid.width, grid.height);
            let stride = bits.stride();
            let rows = bits.words_mut().chunks_exact_mut(stride).zip(map.chunks(grid.width));
            run.in_turn(rows, |(words, map)| {
                for (word, pixels) in words.iter_mut().zip(map.chunks(bits::WORD)) {
                    for (place, &seen) in pixels.iter().enumerate() {
                        *word |= u64::from(seen > 0.0) << place;
                    }
                }
            })?;
            Ok(bits)
        }
    }
}

/// Visibility of a distant light where tiles of [`SIDE`] pixels, by column and row of tiles, are
/// `wanted`; elsewhere a pixel is lit. The bits are those of [`visible`].
///
/// Swept tile by tile, each with as much of the relief towards the light as can throw a shadow on it,
/// or as a whole: whichever visits fewer samples.
///
/// # Errors
/// As [`cast_shadows`].
pub fn visible_where(
    relief: &[f32],
    grid: Grid,
    light: &Light,
    wanted: impl Fn(usize, usize) -> bool,
    run: &Run<'_>,
) -> Result<Bits> {
    checked(relief, grid, light)?;
    let Light::Distant(direction) = *light else {
        return visible(relief, grid, light, run);
    };
    let mut bits = Bits::filled(true, grid.width, grid.height);
    let Some(sweep) = Sweep::new(relief, grid, direction) else {
        return Ok(bits);
    };
    let tiles: Vec<_> = (0..grid.height.div_ceil(SIDE))
        .flat_map(|row| (0..grid.width.div_ceil(SIDE)).map(move |column| (column, row)))
        .filter(|&(column, row)| wanted(column, row))
        .map(|(column, row)| {
            let (left, top) = (column * SIDE, row * SIDE);
            (left..grid.width.min(left + SIDE), top..grid.height.min(top + SIDE))
        })
        .collect();
    let reach = sweep.reach(span(relief, run)?);
    let cost = |(columns, rows): &(_, _)| {
        sweep.cost_of_tile(Clone::clone(columns), Clone::clone(rows), reach)
    };
    if tiles.iter().map(cost).sum::<usize>() >= sweep.cost() {
        return sweep.whole(run);
    }
    let parts = run.map(tiles.clone(), Scratch::default, |scratch, (columns, rows)| {
        sweep.tile(columns, rows, reach, run.level, scratch)
    })?;
    for ((columns, rows), part) in tiles.into_iter().zip(parts) {
        bits.place(&part, columns.start, rows.start);
    }
    Ok(bits)
}

/// Visibility of a distant light in `width` x `height` pixels from `[column, row]` on: the bits that
/// [`visible`] has there. `span` is that of the whole relief.
///
/// # Errors
/// If the sizes disagree, the light is no distant one in front of the painting, or the tile reaches
/// beyond the picture.
pub fn tile(
    relief: &[f32],
    grid: Grid,
    light: &Light,
    [column, row]: [usize; 2],
    [width, height]: [usize; 2],
    (span, run): (Span, &Run<'_>),
) -> Result<Bits> {
    checked(relief, grid, light)?;
    let Light::Distant(direction) = *light else {
        return Err(Error::geometry("light", "tiles have the shadows of distant lights only"));
    };
    grid.tile([column, row], width, height)?;
    Ok(match Sweep::new(relief, grid, direction) {
        None => Bits::filled(true, width, height),
        Some(sweep) => {
            let (columns, rows) = (column..column + width, row..row + height);
            sweep.tile(columns, rows, sweep.reach(span), run.level, &mut Scratch::default())
        }
    })
}

/// Lowest and highest number of a relief.
///
/// # Errors
/// If the caller cancels.
pub fn span(relief: &[f32], run: &Run<'_>) -> Result<Span> {
    let parts = run.map(relief.chunks(TILE).collect(), || (), |(), part| Span::of(part))?;
    Ok(parts.into_iter().fold(Span::of(&[]), Span::joined))
}

fn checked(relief: &[f32], grid: Grid, light: &Light) -> Result<()> {
    if relief.len() != grid.width * grid.height || relief.is_empty() {
        return Err(Error::argument("height", "its size is not that of the painting"));
    }
    if light.direction().z <= 0.0 || !light.direction().length_squared().is_finite() {
        return Err(Error::geometry("light", "it stands behind the painting"));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
