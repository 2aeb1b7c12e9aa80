//! A surface at a smaller scale: what a group of pixels shows together, seen from afar.
//!
//! Normals that scatter within a group widen its lobes: the shorter their mean, the more, as in Toksvig's
//! method [@toksvig2005mipmapping]; lobes and normals are Gaussians whose variances add, the isotropic part
//! of LEAN mapping [@olano2010lean]. A lobe keeps its total, so that light is neither gained nor lost.

use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::pixels::{Run, check_room};

use super::lobe::{Parameter, Strength};
use super::lobe_model::{LobeModel, MAX_PARAMETERS};
use super::maps::Surface;
use super::model::ModelVisitor;

/// The maps of a smaller surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Reduced {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `(3, y, x)`.
    pub normal: Vec<f32>,
    /// `(k, y, x)`.
    pub diffuse: Vec<f32>,
    /// `(k, y, x)`, where the surface has it.
    pub ambient: Option<Vec<f32>>,
    /// In the surface's order.
    pub lobes: Vec<ReducedLobe>,
    /// `(y, x)`, where it was given.
    pub relief: Option<Vec<f32>>,
}

/// A lobe of a smaller surface.
#[derive(Clone, Debug, PartialEq)]
pub struct ReducedLobe {
    /// `(y, x)`, or `(k, y, x)` where the lobe has a colour of its own.
    pub strength: Vec<f32>,
    /// `(y, x)` each.
    pub shape: Vec<Vec<f32>>,
}

/// Every `factor` x `factor` pixels of a surface of so many columns as one; rows and columns that fill no
/// group are left out. Pixels that a picture could not show are no part of their group; a group of
/// nothing else is NaN.
///
/// # Errors
/// If the sizes disagree, no group is full, or the caller cancels.
pub fn reduced(
    surface: &Surface<'_>,
    relief: Option<&[f32]>,
    columns: usize,
    factor: usize,
    run: &Run<'_>,
) -> Result<Reduced> {
    let pixels = surface.normal.len() / 3;
    let bands = surface.bands(pixels)?;
    if columns == 0 || !pixels.is_multiple_of(columns) || relief.is_some_and(|h| h.len() != pixels)
    {
        return Err(Error::argument("height", "its size is not that of the painting"));
    }
    let rows = pixels / columns;
    let [width, height] = [columns, rows].map(|size| size.checked_div(factor).unwrap_or(0));
    if width == 0 || height == 0 {
        let problem = format!("expected 1 to {} pixels, found {factor}", columns.min(rows));
        return Err(Error::argument("reduce", problem));
    }
    let group = Group { surface, relief, columns, pixels, bands, factor };
    let lines = surface.model.visit(Lines { group, width, height, run })?;
    // (row, x, plane) becomes (plane, y, x).
    let planes = lines.first().map_or(0, |line| line.len() / width);
    check_room::<f32>(2 * planes * width * height)?;
    let mut all = vec![vec![0.0; width * height]; planes];
    for (row, line) in lines.iter().enumerate() {
        for (column, numbers) in line.chunks_exact(planes).enumerate() {
            for (plane, &number) in all.iter_mut().zip(numbers) {
                plane[row * width + column] = number;
            }
        }
    }
    let mut all = all.into_iter();
    let mut next = |count: usize| all.by_ref().take(count).flatten().collect::<Vec<f32>>();
    let (normal, diffuse) = (next(3), next(bands));
    let ambient = surface.ambient.map(|_| next(bands));
    let lobes = surface.lobes.iter().map(|lobe| ReducedLobe {
        strength: next(strengths(lobe.strength, bands)),
        shape: lobe.shape.iter().map(|_| next(1)).collect(),
    });
    let lobes = lobes.collect();
    let relief = relief.map(|_| next(1));
    Ok(Reduced { width, height, normal, diffuse, ambient, lobes, relief })
}

fn strengths(strength: Strength<'_>, bands: usize) -> usize {
    match strength {
        Strength::Neutral(_) => 1,
        Strength::Tinted(_) => bands,
    }
}

fn at(parameter: &Parameter<'_>, pixel: usize) -> f64 {
    match parameter {
        Parameter::Everywhere(value) => f64::from(*value),
        Parameter::Map(map) => f64::from(map[pixel]),
    }
}

#[derive(Clone, Copy)]
struct Group<'a> {
    surface: &'a Surface<'a>,
    relief: Option<&'a [f32]>,
    columns: usize,
    pixels: usize,
    bands: usize,
    factor: usize,
}

struct Lines<'a, 'r> {
    group: Group<'a>,
    width: usize,
    height: usize,
    run: &'a Run<'r>,
}

impl ModelVisitor for Lines<'_, '_> {
    /// Rows of groups, each all of its numbers.
    type Output = Result<Vec<Vec<f32>>>;

    fn visit<M: LobeModel>(self, model: M) -> Self::Output {
        let Self { group, width, height, run } = self;
        run.map((0..height).collect(), Vec::new, |places: &mut Vec<usize>, row| {
            (0..width).flat_map(|column| group.of(&model, column, row, places)).collect()
        })
    }
}

impl Group<'_> {
    /// The numbers of a group, plane by plane.
    fn of<M: LobeModel>(
        &self,
        model: &M,
        column: usize,
        row: usize,
        places: &mut Vec<usize>,
    ) -> Vec<f32> {
        let Self { surface, relief, columns, pixels, bands, factor } = *self;
        places.clear();
        for line in row * factor..(row + 1) * factor {
            let first = line * columns + column * factor;
            places.extend((first..first + factor).filter(|&pixel| self.is_shown(pixel)));
        }
        let mean = |value: &dyn Fn(usize) -> f64| {
            places.iter().map(|&pixel| value(pixel)).sum::<f64>() / places.len() as f64
        };
        let of = |map: &[f32], plane: usize, pixel: usize| f64::from(map[plane * pixels + pixel]);
        let [x, y, z] = [0, 1, 2].map(|axis| mean(&|pixel| of(surface.normal, axis, pixel)));
        let sum = Vec3::new(x, y, z);
        let length = sum.length();
        let normal = sum.scale(1.0 / length);
        // Of unit vectors about their mean, along each of two axes.
        let scattered = 0.5 * (1.0 - length * length).max(0.0);
        let mut numbers: Vec<f64> = normal.array().to_vec();
        numbers.extend((0..bands).map(|band| {
            mean(&|pixel| {
                let axis = |axis: usize| of(surface.normal, axis, pixel);
                let cosine = normal.dot(Vec3::new(axis(0), axis(1), axis(2)));
                of(surface.diffuse, band, pixel) * cosine
            })
        }));
        if let Some(ambient) = surface.ambient {
            numbers.extend((0..bands).map(|band| mean(&|pixel| of(ambient, band, pixel))));
        }
        for lobe in &surface.lobes {
            let count = strengths(lobe.strength, bands);
            let strength = |band: usize, pixel: usize| match &lobe.strength {
                Strength::Neutral(number) => at(number, pixel),
                Strength::Tinted(map) => of(map, band, pixel),
            };
            // What each pixel reflects in all directions; its shape counts by that.
            let mut totals = vec![0.0; count];
            let (mut shapes, mut variance, mut weights) = ([0.0; MAX_PARAMETERS], 0.0, 0.0);
            for &pixel in places.iter() {
                let mut shape = [0.0; MAX_PARAMETERS];
                for (value, parameter) in shape.iter_mut().zip(&lobe.shape) {
                    *value = at(parameter, pixel);
                }
                let mut weight = 0.0;
                for (band, sum) in totals.iter_mut().enumerate() {
                    let strength = strength(band, pixel);
                    if strength != 0.0 {
                        let total = strength * model.total(shape);
                        *sum += total / places.len() as f64;
                        weight += total.abs();
                    }
                }
                if weight > 0.0 {
                    weights += weight;
                    variance += weight * model.variance(shape);
                    for (sum, value) in shapes.iter_mut().zip(shape) {
                        *sum += weight * value;
                    }
                }
            }
            if weights > 0.0 {
                let shape = shapes.map(|sum| sum / weights);
                let shape = model.widened(shape, variance / weights + scattered);
                numbers.extend(totals.iter().map(|total| total / model.total(shape)));
                numbers.extend(&shape[..lobe.shape.len()]);
            } else {
                let nothing = if places.is_empty() { f64::NAN } else { 0.0 };
                numbers.extend(vec![nothing; count]);
                // A lobe that is not there may have any shape.
                numbers.extend(vec![1.0; lobe.shape.len()]);
            }
        }
        if let Some(relief) = relief {
            numbers.push(mean(&|pixel| of(relief, 0, pixel)));
        }
        numbers.into_iter().map(|number| number as f32).collect()
    }

    /// Whether a picture can show a pixel.
    fn is_shown(&self, pixel: usize) -> bool {
        let Self { surface, pixels, bands, .. } = *self;
        let finite = |map: &[f32], planes: usize| {
            (0..planes).all(|plane| map[plane * pixels + pixel].is_finite())
        };
        finite(surface.normal, 3)
            && finite(surface.diffuse, bands)
            && surface.ambient.is_none_or(|map| finite(map, bands))
            && surface.lobes.iter().all(|lobe| {
                let shaped = lobe.shape.iter().all(|number| at(number, pixel).is_finite());
                let (known, there) = match &lobe.strength {
                    Strength::Neutral(number) => {
                        (at(number, pixel).is_finite(), at(number, pixel) != 0.0)
                    }
                    Strength::Tinted(map) => {
                        (finite(map, bands), (0..bands).any(|k| map[k * pixels + pixel] != 0.0))
                    }
                };
                known && (shaped || !there)
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;
    use crate::surface::{Lafortune, Lobe, Model, TorranceSparrow};

    /// The light of every pixel of a lobe, and of the group that they make, from a sweep of lights.
    fn compared<M: LobeModel>(model: Model, lobes: M, shape: &[f32], scatter: f64) -> f64 {
        const SIDE: usize = 80;
        let mut state = 5_u64;
        let mut noise = || {
            state = state.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut normal = vec![0.0_f32; 3 * SIDE * SIDE];
        for pixel in 0..SIDE * SIDE {
            // Gaussian slopes.
            let (r, turn) =
                ((-2.0 * noise().ln()).sqrt() * scatter, noise() * core::f64::consts::TAU);
            let n = Vec3::new(0.1 + r * turn.cos(), r * turn.sin(), 1.0).normalised();
            for (axis, value) in n.array().into_iter().enumerate() {
                normal[axis * SIDE * SIDE + pixel] = value as f32;
            }
        }
        let surface = Surface {
            normal: &normal,
            diffuse: &vec![0.0; SIDE * SIDE],
            model,
            lobes: vec![Lobe {
                strength: Strength::Neutral(Parameter::Everywhere(2.0)),
                shape: shape.iter().map(|&value| Parameter::Everywhere(value)).collect(),
            }],
            ambient: None,
            coated: None,
        };
        let small = serially(|run| reduced(&surface, None, SIDE, SIDE, run)).unwrap();
        assert_eq!((small.width, small.height), (1, 1));
        let value = |n: [f32; 3], shape: [f64; 3], strength: f64, light: Vec3<f64>| {
            let view = Vec3::new(0.0, 0.0, 1.0);
            let lobe = lobes.lobe_from_parameters::<f64>(shape);
            let n = Vec3::new(f64::from(n[0]), f64::from(n[1]), f64::from(n[2]));
            strength * lobes.value(&lobe, &lobes.pair(light, view), n)
        };
        let of = |values: &[f32]| {
            let mut shape = [0.0; 3];
            for (to, &value) in shape.iter_mut().zip(values) {
                *to = f64::from(value);
            }
            shape
        };
        let small_shape: Vec<f32> = small.lobes[0].shape.iter().map(|plane| plane[0]).collect();
        let (mut most, mut off) = (0.0_f64, 0.0_f64);
        for step in -40..40 {
            let angle = 0.2 + 0.02 * f64::from(step);
            let light = Vec3::new(angle.sin(), 0.0, angle.cos());
            let whole: f64 = (0..SIDE * SIDE)
                .map(|i| {
                    let n = [0, 1, 2].map(|axis| normal[axis * SIDE * SIDE + i]);
                    value(n, of(shape), 2.0, light)
                })
                .sum::<f64>()
                / (SIDE * SIDE) as f64;
            let strength = f64::from(small.lobes[0].strength[0]);
            let n = [small.normal[0], small.normal[1], small.normal[2]];
            let found = value(n, of(&small_shape), strength, light);
            (most, off) = (most.max(whole), off.max((found - whole).abs()));
        }
        off / most
    }

    #[test]
    fn a_group_shows_the_mean_of_its_pixels() {
        for scatter in [0.02, 0.06, 0.12] {
            let facets = Model::TorranceSparrow { index: 1.45 };
            let off = compared(facets, TorranceSparrow { index: 1.45 }, &[0.05], scatter);
            // A Gaussian of slopes is one of angles up to terms of the square of the scatter, and so
            // are the factors of masking and cosine; 6400 random normals add 0.002.
            let limit = 0.002 + 10.0 * scatter * scatter;
            assert!(off < limit, "facets, {scatter}: {off}");
            let off = compared(Model::Lafortune, Lafortune, &[-1.0, 1.0, 150.0], scatter);
            assert!(off < limit, "lobe, {scatter}: {off}");
        }
    }

    #[test]
    fn a_lobe_of_any_length_keeps_its_total() {
        // A power of 60 makes of lengths of 1.1 and 0.95 factors of 300 and 0.05.
        for shape in [[-0.9, 1.1, 60.0], [-1.05, 0.95, 60.0], [-1.1, 0.9, 60.0]] {
            let off = compared(Model::Lafortune, Lafortune, &shape, 0.06);
            // Off the front its length is another: by 0.2 of sin^2 of the view's angle, 1 % at 0.2
            // radians, of which a power of 60 makes up to a half.
            assert!(off < 0.5, "{shape:?}: {off}");
        }
    }

    #[test]
    fn gaps_are_no_part_of_a_group_and_factor_1_changes_nothing() {
        let normal: Vec<f32> = [0.0; 12].into_iter().chain([0.0; 12]).chain([1.0; 12]).collect();
        let mut diffuse: Vec<f32> = (0..12).map(|i| i as f32).collect();
        diffuse[1] = f32::NAN;
        diffuse[2] = f32::NAN;
        (diffuse[3], diffuse[6], diffuse[7]) = (f32::NAN, f32::NAN, f32::NAN);
        let surface = Surface {
            normal: &normal,
            diffuse: &diffuse,
            model: Model::Lafortune,
            lobes: vec![],
            ambient: None,
            coated: None,
        };
        let heights: Vec<f32> = (0..12).map(|i| 0.5 * i as f32).collect();
        serially(|run| {
            // 4 columns, 3 rows: the third row fills no group.
            let small = reduced(&surface, Some(&heights), 4, 2, run).unwrap();
            assert_eq!((small.width, small.height), (2, 1));
            assert_eq!((small.diffuse[0], small.relief.as_ref().unwrap()[0]), (3.0, 1.5));
            assert!(small.diffuse[1].is_nan() && small.normal[1].is_nan());
            let same = reduced(&surface, Some(&heights), 4, 1, run).unwrap();
            assert!(same.diffuse.iter().zip(&diffuse).all(|(a, b)| a == b || a.is_nan()));
            assert!(reduced(&surface, None, 4, 4, run).is_err());
            assert!(reduced(&surface, None, 4, 0, run).is_err());
        });
    }
}
