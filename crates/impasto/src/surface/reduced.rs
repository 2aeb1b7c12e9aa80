//! A surface at a smaller scale: what a group of pixels shows together, seen from afar.
//!
//! Normals that scatter within a group widen its lobes: the shorter their mean, the more, as in Toksvig's
//! method [@toksvig2005mipmapping]; lobes and normals are Gaussians whose variances add, the isotropic part
//! of LEAN mapping [@olano2010lean]. A lobe keeps its total, so that light is neither gained nor lost.

use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::pixels::{Run, check_room, with_room, zeros};

use super::lobe::{Lobe, Parameter, Strength};
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
    let maps = Maps { surface, relief, columns, pixels, bands, factor, width };
    let mut small = maps.room_for_groups(height)?;
    let planes = small.planes();
    let lines = small.rows(planes)?;
    surface.model.visit(Rows { maps, planes, lines, run })?;
    Ok(small)
}

/// A row of groups, each plane's part of it.
type Row<'a> = Vec<&'a mut [f32]>;

impl Reduced {
    /// In the order in which a row of groups is computed.
    fn maps(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        let lobes = self.lobes.iter_mut();
        [&mut self.normal, &mut self.diffuse]
            .into_iter()
            .chain(&mut self.ambient)
            .chain(lobes.flat_map(|lobe| [&mut lobe.strength].into_iter().chain(&mut lobe.shape)))
            .chain(&mut self.relief)
    }

    /// How many planes the maps have.
    fn planes(&mut self) -> usize {
        let pixels = self.width * self.height;
        self.maps().map(|map| map.len() / pixels).sum()
    }

    /// All planes, row by row: rows are computed at the same time, and each writes into the maps.
    fn rows(&mut self, planes: usize) -> Result<Vec<Row<'_>>> {
        let Self { width, height, .. } = *self;
        check_room::<&mut [f32]>(planes.saturating_mul(height))?;
        let mut rows: Vec<Row<'_>> = (0..height).map(|_| Vec::with_capacity(planes)).collect();
        for map in self.maps() {
            for (index, line) in map.chunks_exact_mut(width).enumerate() {
                rows[index % height].push(line);
            }
        }
        Ok(rows)
    }
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
struct Maps<'a> {
    surface: &'a Surface<'a>,
    relief: Option<&'a [f32]>,
    columns: usize,
    pixels: usize,
    bands: usize,
    factor: usize,
    /// Groups in a row.
    width: usize,
}

struct Rows<'a, 'o, 'r> {
    maps: Maps<'a>,
    planes: usize,
    lines: Vec<Row<'o>>,
    run: &'a Run<'r>,
}

impl ModelVisitor for Rows<'_, '_, '_> {
    type Output = Result<()>;

    fn visit<M: LobeModel>(self, model: M) -> Self::Output {
        let Self { maps, planes, lines, run } = self;
        let rows = lines.into_iter().enumerate().collect();
        let done = run.map(rows, Scratch::default, |scratch, (row, lines): (usize, Row<'_>)| {
            scratch.make_room(maps, planes)?;
            let Scratch { shown, cosines, numbers } = scratch;
            maps.find_shown(row, shown);
            numbers.clear();
            Groups::new(maps, shown).append(&model, cosines, numbers);
            for (line, values) in lines.into_iter().zip(numbers.chunks_exact(maps.width)) {
                line.copy_from_slice(values);
            }
            Ok(())
        })?;
        done.into_iter().collect()
    }
}

/// What a worker needs for a row of groups.
#[derive(Default)]
struct Scratch {
    shown: Vec<Shown>,
    /// Of `shown`, between the normal of a pixel and that of its group.
    cosines: Vec<f64>,
    /// Plane by plane.
    numbers: Vec<f32>,
}

impl Scratch {
    /// Room for any row: of large groups it has many pixels, and a list that grows by itself ends
    /// the program where there is no memory.
    fn make_room(&mut self, maps: Maps<'_>, planes: usize) -> Result<()> {
        let numbers = planes * maps.width;
        if self.numbers.capacity() >= numbers {
            return Ok(());
        }
        let most = maps.width * maps.factor * maps.factor;
        self.shown = with_room(most)?;
        self.cosines = with_room(most)?;
        self.numbers = with_room(numbers)?;
        Ok(())
    }
}

/// A pixel that a picture can show.
#[derive(Clone, Copy)]
struct Shown {
    group: usize,
    pixel: usize,
}

impl Maps<'_> {
    /// The maps of so many rows of groups, without their numbers.
    fn room_for_groups(&self, height: usize) -> Result<Reduced> {
        let Self { surface, relief, bands, width, .. } = *self;
        let planes = |count: usize| zeros(count * width * height);
        let lobes = surface.lobes.iter().map(|lobe| {
            Ok(ReducedLobe {
                strength: planes(strengths(lobe.strength, bands))?,
                shape: lobe.shape.iter().map(|_| planes(1)).collect::<Result<_>>()?,
            })
        });
        Ok(Reduced {
            width,
            height,
            normal: planes(3)?,
            diffuse: planes(bands)?,
            ambient: surface.ambient.map(|_| planes(bands)).transpose()?,
            lobes: lobes.collect::<Result<_>>()?,
            relief: relief.map(|_| planes(1)).transpose()?,
        })
    }

    /// What a picture can show of a row of groups, in the order of the pixels.
    fn find_shown(&self, row: usize, shown: &mut Vec<Shown>) {
        let Self { surface, columns, pixels, bands, factor, width, .. } = *self;
        shown.clear();
        let mut finite = vec![true; width * factor];
        for line in row * factor..(row + 1) * factor {
            let first = line * columns;
            finite.fill(true);
            let mut keep_finite = |map: &[f32], planes: usize| {
                for plane in 0..planes {
                    let values = &map[plane * pixels + first..][..width * factor];
                    for (finite, value) in finite.iter_mut().zip(values) {
                        *finite &= value.is_finite();
                    }
                }
            };
            keep_finite(surface.normal, 3);
            keep_finite(surface.diffuse, bands);
            if let Some(ambient) = surface.ambient {
                keep_finite(ambient, bands);
            }
            let of_line = (0..width * factor).filter(|&place| {
                finite[place] && surface.lobes.iter().all(|lobe| self.is_known(lobe, first + place))
            });
            shown.extend(of_line.map(|x| Shown { group: x / factor, pixel: first + x }));
        }
    }

    /// Whether a picture can show a lobe of a pixel, or need not.
    fn is_known(&self, lobe: &Lobe<'_>, pixel: usize) -> bool {
        let shaped = lobe.shape.iter().all(|number| at(number, pixel).is_finite());
        let mut strengths =
            (0..strengths(lobe.strength, self.bands)).map(|band| self.strength(lobe, band, pixel));
        strengths.all(|strength| strength.is_finite() && (shaped || strength == 0.0))
    }

    fn strength(&self, lobe: &Lobe<'_>, band: usize, pixel: usize) -> f64 {
        match &lobe.strength {
            Strength::Neutral(number) => at(number, pixel),
            Strength::Tinted(map) => f64::from(map[band * self.pixels + pixel]),
        }
    }
}

/// A row of groups.
struct Groups<'a, 's> {
    maps: Maps<'a>,
    shown: &'s [Shown],
    /// How many of a group are shown.
    count: Vec<f64>,
    /// Of unit length.
    normal: Vec<Vec3<f64>>,
    /// Variance of a group's normals along each of two axes.
    scattered: Vec<f64>,
}

/// Of a lobe, over the pixels of a group; each counts by what it reflects in all directions.
#[derive(Clone, Copy, Default)]
struct LobeSums {
    shape: [f64; MAX_PARAMETERS],
    variance: f64,
    weight: f64,
}

impl<'a, 's> Groups<'a, 's> {
    fn new(maps: Maps<'a>, shown: &'s [Shown]) -> Self {
        let mut count = vec![0.0; maps.width];
        for &Shown { group, .. } in shown {
            count[group] += 1.0;
        }
        let mut groups = Self { maps, shown, count, normal: Vec::new(), scattered: Vec::new() };
        let [x, y, z] = [0, 1, 2].map(|axis| groups.mean_of(maps.surface.normal, axis));
        for ((x, y), z) in x.into_iter().zip(y).zip(z) {
            let mean = Vec3::new(x, y, z);
            let length = mean.length();
            groups.normal.push(mean.scale(1.0 / length));
            // Of unit vectors about their mean.
            groups.scattered.push(0.5 * (1.0 - length * length).max(0.0));
        }
        groups
    }

    /// The mean over each group of what `value` says of the pixels that are shown, by their indices.
    fn mean(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut means = vec![0.0; self.maps.width];
        for (index, &Shown { group, .. }) in self.shown.iter().enumerate() {
            means[group] += value(index);
        }
        for (mean, count) in means.iter_mut().zip(&self.count) {
            *mean /= count;
        }
        means
    }

    fn mean_of(&self, map: &[f32], plane: usize) -> Vec<f64> {
        let values = &map[plane * self.maps.pixels..];
        self.mean(|index| f64::from(values[self.shown[index].pixel]))
    }

    /// Appends all numbers of the row, plane by plane.
    fn append<M: LobeModel>(&self, model: &M, cosines: &mut Vec<f64>, numbers: &mut Vec<f32>) {
        let Maps { surface, relief, bands, pixels, .. } = self.maps;
        for axis in 0..3 {
            numbers.extend(self.normal.iter().map(|normal| normal.array()[axis] as f32));
        }
        cosines.clear();
        cosines.extend(self.shown.iter().map(|place| self.cosine(place)));
        for band in 0..bands {
            let values = &surface.diffuse[band * pixels..];
            append(
                numbers,
                &self.mean(|index| f64::from(values[self.shown[index].pixel]) * cosines[index]),
            );
        }
        if let Some(ambient) = surface.ambient {
            for band in 0..bands {
                append(numbers, &self.mean_of(ambient, band));
            }
        }
        for lobe in &surface.lobes {
            self.append_lobe(model, lobe, numbers);
        }
        if let Some(relief) = relief {
            append(numbers, &self.mean_of(relief, 0));
        }
    }

    /// Between the normal of a pixel and that of its group.
    fn cosine(&self, place: &Shown) -> f64 {
        let Maps { surface, pixels, .. } = self.maps;
        let [x, y, z] =
            [0, 1, 2].map(|axis| f64::from(surface.normal[axis * pixels + place.pixel]));
        self.normal[place.group].dot(Vec3::new(x, y, z))
    }

    /// Appends the strengths of a lobe, then its parameters.
    fn append_lobe<M: LobeModel>(&self, model: &M, lobe: &Lobe<'_>, numbers: &mut Vec<f32>) {
        let Maps { width, bands, .. } = self.maps;
        let mut strengths = vec![vec![0.0; width]; strengths(lobe.strength, bands)];
        let mut all = vec![LobeSums::default(); width];
        for &Shown { group, pixel } in self.shown {
            let mut shape = [0.0; MAX_PARAMETERS];
            for (value, parameter) in shape.iter_mut().zip(&lobe.shape) {
                *value = at(parameter, pixel);
            }
            let mut weight = 0.0;
            for (band, totals) in strengths.iter_mut().enumerate() {
                let strength = self.maps.strength(lobe, band, pixel);
                if strength != 0.0 {
                    let total = strength * model.total(shape);
                    totals[group] += total / self.count[group];
                    weight += total.abs();
                }
            }
            if weight > 0.0 {
                let sums = &mut all[group];
                sums.weight += weight;
                sums.variance += weight * model.variance(shape);
                for (sum, value) in sums.shape.iter_mut().zip(shape) {
                    *sum += weight * value;
                }
            }
        }
        for (group, sums) in all.iter_mut().enumerate() {
            if sums.weight > 0.0 {
                let shape = sums.shape.map(|sum| sum / sums.weight);
                let variance = sums.variance / sums.weight + self.scattered[group];
                sums.shape = model.widened(shape, variance);
                for totals in &mut strengths {
                    totals[group] /= model.total(sums.shape);
                }
            } else {
                // A lobe that is not there may have any shape.
                sums.shape = [1.0; MAX_PARAMETERS];
                if self.count[group] == 0.0 {
                    for totals in &mut strengths {
                        totals[group] = f64::NAN;
                    }
                }
            }
        }
        for totals in &strengths {
            append(numbers, totals);
        }
        for parameter in 0..lobe.shape.len() {
            numbers.extend(all.iter().map(|sums| sums.shape[parameter] as f32));
        }
    }
}

fn append(numbers: &mut Vec<f32>, values: &[f64]) {
    numbers.extend(values.iter().map(|&value| value as f32));
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
