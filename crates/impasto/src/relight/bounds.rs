//! How much light an effect can add to the pixels of a tile: upper bounds, from the statistics of
//! the tile and the directions of light and view.
//!
//! As the upper bounds of a cluster's error decide what lightcuts [@walter2005lightcuts] leave out,
//! these decide what a [`plan`](super::plan) leaves out. Angles enter as intervals: the normals of a
//! tile lie in a cone, and near lamps and eyes are seen from it in a cone, too.

use core::f64::consts::{FRAC_PI_2, PI};

use crate::geometry::{Grid, Light, View};
use crate::math::Vec3;
use crate::surface::{Cone, MAX_PARAMETERS, Model, Sight, angle};

use super::area;
use super::scene::Lamp;
use super::statistics::{AZIMUTHS, LobeRange, ReliefRange, SIDE, TileStatistics};

/// What single precision may add to a value that is computed in some twenty operations.
const ROUNDING: f64 = 1.0 + 1e-5;

/// A lamp as a tile sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// The middle of the lamp.
    pub(super) towards: Cone,
    /// All points that lobes see of it, and how light scatters about each.
    pub(super) points: (Cone, f64),
    /// The smallest and the largest irradiance at normal incidence.
    pub(super) irradiance: [f64; 2],
    /// How far `irradiance * direction` can be from that of the middle of the painting.
    pub(super) deviation: f64,
    /// What single precision may add to a cosine, and to the irradiance as a share.
    pub(super) rounding: f64,
}

/// The corners of a tile and its middle, in mm.
fn places(grid: Grid, tile: [usize; 2]) -> [[f64; 2]; 5] {
    let [left, top] = tile.map(|index| index * SIDE);
    let right = (left + SIDE).min(grid.width) - 1;
    let bottom = (top + SIDE).min(grid.height) - 1;
    let place = |column: f64, row: f64| [grid.x(column), grid.y(row)];
    let [l, r, t, b] = [left, right, top, bottom].map(|index| index as f64);
    [place(l, t), place(r, t), place(l, b), place(r, b), place(0.5 * (l + r), 0.5 * (t + b))]
}

/// The directions from a tile to a point. Places that see it within an angle below 90 degrees from the
/// tile's middle lie in a section of a cone, which is convex: if the corners do, all do.
fn towards(position: Vec3<f64>, places: &[[f64; 2]; 5]) -> Cone {
    let direction = |[x, y]: [f64; 2]| (position - Vec3::new(x, y, 0.0)).normalised();
    let axis = direction(places[4]);
    let angle = places[..4].iter().map(|&place| angle(axis, direction(place))).fold(0.0, f64::max);
    Cone { axis, angle: if angle < FRAC_PI_2 { angle } else { PI } }
}

/// How a view is seen from a tile.
pub(super) fn view(view: View, grid: Grid, tile: [usize; 2]) -> Cone {
    match view {
        View::Distant(axis) => Cone::of(axis),
        View::Point(position) => towards(position, &places(grid, tile)),
    }
}

/// How a lamp is seen from a tile.
pub(super) fn lamp(lamp: &Lamp, grid: Grid, tile: [usize; 2]) -> Seen {
    let seen = light(lamp.light, grid, tile);
    if !lamp.has_size() {
        return seen;
    }
    let within = match lamp.light {
        Light::Distant(_) => lamp.radius,
        Light::Point { position, .. } => {
            // On the painting, nothing is nearer to the lamp than its height.
            let shortest = position.z.max(1e-300);
            (lamp.radius / shortest).min(1.0).asin()
                + FRAC_PI_2 * f64::from(lamp.radius >= shortest)
        }
    };
    let Cone { axis, angle } = seen.towards;
    Seen { points: (Cone { axis, angle: angle + within + 1e-9 }, area::spread(lamp)), ..seen }
}

/// The largest tangent of the angle between the normal and the view, over the painting.
pub(super) fn steepest_view(view: View, grid: Grid) -> f64 {
    match view {
        View::Distant(view) => view.x.hypot(view.y) / view.z,
        View::Point(eye) => {
            let x = [0.0, grid.width as f64 - 1.0].map(|column| (eye.x - grid.x(column)).abs());
            let y = [0.0, grid.height as f64 - 1.0].map(|row| (eye.y - grid.y(row)).abs());
            x[0].max(x[1]).hypot(y[0].max(y[1])) / eye.z
        }
    }
}

/// How a light is seen from a tile.
pub(super) fn light(light: Light, grid: Grid, tile: [usize; 2]) -> Seen {
    match light {
        Light::Distant(axis) => {
            let towards = Cone::of(axis);
            let (points, rounding) = ((towards, 0.0), 1e-6);
            Seen { towards, points, irradiance: [1.0; 2], deviation: 0.0, rounding }
        }
        Light::Point { position, falloff } => {
            let places = places(grid, tile);
            // The point of the tile that lies nearest to the foot of the lamp.
            let nearest = |axis: usize, foot: f64| {
                let values = places.map(|place| place[axis]);
                let low = values.iter().copied().fold(f64::INFINITY, f64::min);
                let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                foot.clamp(low, high)
            };
            let foot = Vec3::new(nearest(0, position.x), nearest(1, position.y), 0.0);
            let (middle, shortest) =
                (position.length_squared().sqrt(), (position - foot).length_squared().sqrt());
            let distance =
                |[x, y]: [f64; 2]| (position - Vec3::new(x, y, 0.0)).length_squared().sqrt();
            let longest = places.iter().copied().map(distance).fold(0.0, f64::max);
            let irradiance = [longest, shortest].map(|distance| {
                let ratio = middle / distance;
                if falloff { ratio * ratio } else { 1.0 }
            });
            // The field r0^2 r / r^3 has a derivative of at most 2 r0^2 / r^3, a direction of 1 / r;
            // on the painting, nothing is nearer to the lamp than its height.
            let away = places.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
            let deviation = if falloff {
                2.0 * middle * middle * away / position.z.powi(3)
            } else {
                away / position.z
            };
            let towards = towards(position, &places);
            // Coordinates have their roundings whatever is left of their differences.
            let rounding = 1e-6 * (1.0 + 2.0 * (middle + away) / shortest);
            Seen { towards, points: (towards, 0.0), irradiance, deviation, rounding }
        }
    }
}

fn normals(tile: &TileStatistics) -> Cone {
    Cone { axis: tile.axis, angle: tile.cone }
}

/// Smallest and largest `N.L` of a tile over directions to a light, not below 0.
pub(super) fn cosines(tile: &TileStatistics, light: &Cone) -> [f64; 2] {
    if tile.cone.is_finite() {
        normals(tile).cosines(light)
    } else {
        // Normals that are not of unit length.
        [0.0, f64::INFINITY]
    }
}

/// Most that a lobe of unit strength shows under unit irradiance of a light and at most a cosine to all
/// of its points ([`cosines`]); infinite where nothing is known.
pub(super) fn lobe(
    model: Model,
    tile: &TileStatistics,
    lobe: &LobeRange,
    (light, largest): (&Seen, f64),
    view: &Cone,
) -> f64 {
    if !tile.cone.is_finite() || lobe.shape.iter().any(|range| range.holes) {
        return f64::INFINITY;
    }
    if largest == 0.0 {
        return 0.0;
    }
    let (light, spread) = light.points;
    let mut shape = [[0.0; 2]; MAX_PARAMETERS];
    for (ends, range) in shape.iter_mut().zip(&lobe.shape) {
        *ends = [range.low, range.high].map(f64::from);
    }
    let sight = Sight { normals: normals(tile), light, spread, view: *view };
    model.most(&shape, &sight) * ROUNDING
}

/// The steepest rise towards a light of any direction `[x, y]` (not of unit length, nor zero), in mm
/// per pixel: between two directions a support function is at most their sublinear combination.
pub(super) fn rise(relief: &ReliefRange, [x, y]: [f64; 2]) -> f64 {
    let step = core::f64::consts::TAU / AZIMUTHS as f64;
    let turn = y.atan2(x).rem_euclid(core::f64::consts::TAU);
    // A tiny negative angle becomes a whole turn: sector 64, which is the first one again.
    let sector = (turn / step).floor();
    let past = (turn - sector * step).clamp(0.0, step);
    let first = sector as usize % AZIMUTHS;
    let [one, other] = [first, (first + 1) % AZIMUTHS].map(|index| f64::from(relief.rise[index]));
    (one * (step - past).sin() + other * past.sin()) / step.sin()
}

/// Whether no pixel's relief rises as steeply as the light does: nothing then stands in its way.
pub(super) fn is_flat_below(relief: &ReliefRange, light: Vec3<f64>, pitch: f64) -> bool {
    let across = light.x.hypot(light.y);
    // In mm per pixel.
    is_below(relief, rise(relief, [light.x, light.y]), light.z / across * pitch)
}

/// Whether no pixel's relief rises, in any direction, as steeply as the tangent of an elevation.
pub(super) fn is_flat_all_round(relief: &ReliefRange, tangent: f64, pitch: f64) -> bool {
    is_below(relief, steepest(relief), tangent * pitch)
}

/// The steepest rise in any direction, not below 0: between two of the directions a rise is at most
/// 1.0013 times the larger one.
fn steepest(relief: &ReliefRange) -> f64 {
    let steepest = relief.rise.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    1.0013 * f64::from(steepest).max(0.0)
}

/// Whether a rise is below a limit, in mm per pixel, and known.
fn is_below(relief: &ReliefRange, rise: f64, limit: f64) -> bool {
    let heights = relief.height.largest();
    // What rounding of heights and of the ray's fall may take.
    let limit = heights.mul_add(-1e-6, limit * (1.0 - 1e-5));
    !relief.height.holes && rise < limit
}

/// Whether no pixel's relief rises towards any point of a distant lamp of an angular radius as
/// steeply as its lowest point does.
pub(super) fn is_flat_below_disc(
    relief: &ReliefRange,
    light: Vec3<f64>,
    radius: f64,
    pitch: f64,
) -> bool {
    let across = light.x.hypot(light.y);
    let lowest = (light.z.atan2(across) - radius).tan();
    let sideways = radius.sin() / across;
    if sideways >= 1.0 {
        return is_flat_all_round(relief, lowest, pitch);
    }
    // Every direction between two of the table's that enclose the lamp.
    let step = core::f64::consts::TAU / AZIMUTHS as f64;
    let [middle, half] = [light.y.atan2(light.x), sideways.asin()].map(|turn| turn / step);
    let first = (middle - half).floor().rem_euclid(AZIMUTHS as f64) as usize;
    let count = (2.0 * half).ceil() as usize + 2;
    let rises = relief.rise.iter().cycle().skip(first).take(count);
    let steepest = rises.copied().fold(f32::NEG_INFINITY, f32::max);
    is_below(relief, 1.0013 * f64::from(steepest).max(0.0), lowest * pitch)
}

/// Whether no pixel's relief rises, in any direction, as steeply as a lamp at `position` does from
/// the farthest pixel, or the lowest point of a lamp of a radius in mm.
pub(super) fn is_flat_below_point(
    relief: &ReliefRange,
    position: Vec3<f64>,
    radius: f64,
    grid: Grid,
) -> bool {
    let half = [grid.x(0.0), grid.x(grid.width as f64 - 1.0)].map(|x| (position.x - x).abs());
    let half_y = [grid.y(0.0), grid.y(grid.height as f64 - 1.0)].map(|y| (position.y - y).abs());
    let across = half[0].max(half[1]).hypot(half_y[0].max(half_y[1]));
    let height = f64::from(relief.height.high).max(0.0);
    let limit = (position.z - radius - height) / (across + radius) * grid.pitch;
    is_below(relief, steepest(relief), limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::serially;
    use crate::relight::shadow::cast_shadows;
    use crate::relight::shadow::horizon::soft_shadows;
    use crate::relight::statistics::Statistics;
    use crate::surface::{
        Lafortune, Lobe, LobeModel, Parameter, Strength, Surface, TorranceSparrow,
    };

    /// Columns and rows of a patch.
    const PATCH: usize = 12;

    /// A generator of numbers in 0 .. 1 (linear congruential).
    struct Numbers(u64);

    impl Numbers {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }
        fn between(&mut self, low: f64, high: f64) -> f64 {
            low + (high - low) * self.next()
        }
        /// A direction within an angle of an axis; every third on the rim.
        fn direction(&mut self, axis: Vec3<f64>, within: f64) -> Vec3<f64> {
            let rim = self.next() < 0.33;
            let polar = if rim { within } else { within * self.next().sqrt() };
            let turn = self.between(0.0, core::f64::consts::TAU);
            let sideways = if axis.z.abs() < 0.9 {
                axis.cross(Vec3::new(0.0, 0.0, 1.0)).normalised()
            } else {
                axis.cross(Vec3::new(1.0, 0.0, 0.0)).normalised()
            };
            let other = axis.cross(sideways);
            let across = sideways.scale(turn.cos()) + other.scale(turn.sin());
            (axis.scale(polar.cos()) + across.scale(polar.sin())).normalised()
        }
    }

    const UP: Vec3<f64> = Vec3::new(0.0, 0.0, 1.0);

    /// A patch of normals within a cone; one of them is `special`.
    fn patch(numbers: &mut Numbers, within: f64, special: Vec3<f64>) -> Vec<f32> {
        let axis = numbers.direction(UP, 0.7);
        let toward = {
            let away = angle(axis, special);
            if away <= within {
                special
            } else {
                // The direction of the cone that lies nearest.
                let side = (special - axis.scale(axis.dot(special))).normalised();
                axis.scale(within.cos()) + side.scale(within.sin())
            }
        };
        let mut planes = vec![0.0; 3 * PATCH * PATCH];
        for pixel in 0..PATCH * PATCH {
            let n = if pixel == 5 { toward } else { numbers.direction(axis, within) };
            // As long as statistics take for a unit vector.
            let n = n.scale(numbers.between(-0.45e-6, 0.45e-6) + 1.0);
            for (axis, value) in n.array().into_iter().enumerate() {
                planes[axis * PATCH * PATCH + pixel] = value as f32;
            }
        }
        planes
    }

    /// How many tiles a bound is tried on: `IMPASTO_TILES`, for the record of a long run
    /// (`benches/python/bounds.py`), or as many as take no time.
    #[allow(clippy::disallowed_methods, reason = "a test that a script calls")]
    fn tiles(few: usize) -> usize {
        std::env::var("IMPASTO_TILES").map_or(few, |tiles| tiles.parse().unwrap())
    }

    /// Bound over largest value, of many random patches, lights and views; no value above its bound.
    fn looseness<M: LobeModel>(
        model: Model,
        lobe_model: M,
        shape: impl Fn(&mut Numbers) -> Vec<[f64; 2]>,
        best: impl Fn(Vec3<f64>, Vec3<f64>) -> Vec3<f64>,
    ) -> Vec<f64> {
        let mut numbers = Numbers(7);
        let mut looseness = Vec::new();
        for _ in 0..tiles(4000) {
            let (light, view) = (numbers.direction(UP, 1.4), numbers.direction(UP, 1.2));
            let within = numbers.between(0.0, 0.4);
            let normal = patch(&mut numbers, within, best(light, view));
            let ranges = shape(&mut numbers);
            let maps: Vec<Vec<f32>> = ranges
                .iter()
                .map(|&[low, high]| {
                    (0..PATCH * PATCH).map(|_| numbers.between(low, high) as f32).collect()
                })
                .collect();
            let lobe = Lobe {
                strength: Strength::Neutral(Parameter::Everywhere(1.0)),
                shape: maps.iter().map(|map| Parameter::Map(map)).collect(),
            };
            let surface = Surface {
                normal: &normal,
                diffuse: &[0.5; PATCH * PATCH],
                model,
                lobes: vec![lobe],
                ambient: None,
                coated: None,
            };
            let statistics = serially(|run| Statistics::new(&surface, PATCH, None, run)).unwrap();
            let tile = &statistics.tiles[0];
            // Every other lamp has a size.
            let radius = if numbers.next() < 0.5 { 0.0 } else { numbers.between(0.001, 0.6) };
            let lit = Lamp { light: Light::Distant(light), intensity: 1.0, radius, colour: 0 };
            let seen = super::lamp(&lit, Grid::whole(PATCH, PATCH, 0.1), [0, 0]);
            let (points, sources) = area::sources(&[lit]);
            let view_cone = Cone::of(view);
            let largest = cosines(tile, &seen.points.0)[1];
            let bound = super::lobe(model, tile, &tile.lobes[0], (&seen, largest), &view_cone);
            let spread = sources[0].spread;
            let mut largest = 0.0_f64;
            for pixel in 0..PATCH * PATCH {
                let at = |axis: usize| normal[axis * PATCH * PATCH + pixel];
                let n = Vec3::new(at(0), at(1), at(2));
                let value = |point: &Light| {
                    let pair = lobe_model.pair::<f32>(single(point.direction()), single(view));
                    let lobe = &surface.lobes[0];
                    f64::from(lobe.spread_value(&lobe_model, pixel, (&pair, spread), n))
                };
                let mean = points.iter().map(value).sum::<f64>() / points.len() as f64;
                largest = largest.max(mean);
            }
            assert!(largest <= bound, "{largest} > {bound}");
            if radius == 0.0 && largest > 1e-9 && bound.is_finite() {
                looseness.push(bound / largest);
            }
        }
        looseness.sort_by(f64::total_cmp);
        looseness
    }

    fn single(v: Vec3<f64>) -> Vec3<f32> {
        Vec3::new(v.x as f32, v.y as f32, v.z as f32)
    }

    /// For the script, which reads what is printed.
    #[allow(clippy::disallowed_macros, reason = "a test that a script calls")]
    fn print_median(lobe: &str, looseness: &[f64]) {
        println!("{lobe}: {:.4} of {} tiles", median(looseness), looseness.len());
    }

    fn median(sorted: &[f64]) -> f64 {
        sorted[sorted.len() / 2]
    }

    #[test]
    fn no_torrance_sparrow_lobe_exceeds_its_bound_and_half_of_them_come_within_a_factor_of_three() {
        let narrow = |numbers: &mut Numbers| {
            let gamma = numbers.between(0.02, 0.5);
            vec![[gamma, gamma]]
        };
        let index = 1.45;
        let best = |l: Vec3<f64>, v: Vec3<f64>| (l + v).normalised();
        let loose =
            looseness(Model::TorranceSparrow { index }, TorranceSparrow { index }, narrow, best);
        print_median("Torrance-Sparrow", &loose);
        assert!(loose.len() > 500 && median(&loose) < 3.0, "{} {}", loose.len(), median(&loose));
        // A range of widths: the widest is taken, whatever pixel has it.
        let range = |numbers: &mut Numbers| vec![[0.02, numbers.between(0.03, 0.6)]];
        looseness(Model::TorranceSparrow { index }, TorranceSparrow { index }, range, best);
    }

    #[test]
    fn no_lafortune_lobe_exceeds_its_bound_and_half_of_them_come_within_a_factor_of_three() {
        let one = |numbers: &mut Numbers| {
            let turn = numbers.between(-0.5, 0.5);
            let (sin, cos) = (2.0 * turn).sin_cos();
            let exponent = numbers.between(0.0, 6.0).exp();
            vec![[sin - cos; 2], [sin + cos; 2], [exponent; 2]]
        };
        let best = |l: Vec3<f64>, v: Vec3<f64>| (l + v).normalised();
        let loose = looseness(Model::Lafortune, Lafortune, one, best);
        print_median("Lafortune", &loose);
        assert!(loose.len() > 500 && median(&loose) < 3.0, "{} {}", loose.len(), median(&loose));
        let range = |numbers: &mut Numbers| {
            vec![[-1.3, -0.7], [0.6, 1.3], [numbers.between(1.0, 5.0), 400.0]]
        };
        looseness(Model::Lafortune, Lafortune, range, best);
    }

    /// A relief of a few waves and steps, in mm.
    fn relief(numbers: &mut Numbers, width: usize, height: usize) -> Vec<f32> {
        let waves: Vec<[f64; 4]> = (0..4)
            .map(|_| {
                let [x, y] = [0, 1].map(|_| numbers.between(-1.5, 1.5));
                [x, y, numbers.between(0.0, 6.3), numbers.between(0.0, 0.05)]
            })
            .collect();
        (0..width * height)
            .map(|pixel| {
                let (x, y) = ((pixel % width) as f64, (pixel / width) as f64);
                let sum: f64 =
                    waves.iter().map(|[a, b, c, d]| d * a.mul_add(x, b.mul_add(y, *c)).sin()).sum();
                sum as f32
            })
            .collect()
    }

    fn flat_surface(normal: &[f32]) -> Surface<'_> {
        Surface {
            normal,
            diffuse: &normal[..normal.len() / 3],
            model: Model::Lafortune,
            lobes: vec![],
            ambient: None,
            coated: None,
        }
    }

    #[test]
    fn below_the_steepest_rise_a_light_throws_shadows_and_above_it_none() {
        let mut numbers = Numbers(11);
        let (width, height, pitch) = (40, 31, 0.1);
        let grid = Grid::whole(width, height, pitch);
        let normal: Vec<f32> =
            (0..3 * width * height).map(|i| f32::from(u8::from(i >= 2 * width * height))).collect();
        let mut shaded = 0;
        for _ in 0..tiles(300) {
            let map = relief(&mut numbers, width, height);
            let statistics = serially(|run| {
                Statistics::new(&flat_surface(&normal), width, Some(&map), run).unwrap()
            });
            let range = statistics.tiles[0].relief.as_ref().unwrap();
            let turn = numbers.between(0.0, core::f64::consts::TAU);
            let across = [turn.cos(), turn.sin()];
            let tangent = rise(range, across) / pitch;
            for factor in [1.0001, 1.01, 0.75] {
                let light = Vec3::new(across[0], across[1], factor * tangent).normalised();
                let flat = is_flat_below(range, light, pitch);
                let light = Light::Distant(light);
                let visible = serially(|run| cast_shadows(&map, grid, &light, run)).unwrap();
                if factor > 1.0 {
                    assert!(flat && visible.iter().all(|&seen| seen == 1.0));
                } else {
                    assert!(!flat);
                    shaded += usize::from(visible.contains(&0.0));
                }
            }
        }
        let mut flat = 0;
        for _ in 0..100 {
            let map = relief(&mut numbers, width, height);
            let statistics = serially(|run| {
                Statistics::new(&flat_surface(&normal), width, Some(&map), run).unwrap()
            });
            let range = statistics.tiles[0].relief.as_ref().unwrap();
            let (turn, radius) = (numbers.between(0.0, 6.3), numbers.between(0.002, 0.3));
            // Its lowest point a little above and below the steepest rise.
            let up = numbers.between(0.8, 1.3) * steepest(range) / pitch;
            let elevation = (up.atan() + radius).min(1.5);
            let (sin, cos) = elevation.sin_cos();
            let light = Vec3::new(cos * turn.cos(), cos * turn.sin(), sin);
            if is_flat_below_disc(range, light, radius, pitch) {
                flat += 1;
                let light = Light::Distant(light);
                let seen = serially(|run| soft_shadows(&map, grid, &light, radius, run)).unwrap();
                // Weights are rounded numbers.
                assert!(seen.iter().all(|&share| share > 1.0 - 1e-6));
            }
        }
        assert!((20..90).contains(&flat), "{flat}");
        // Light at three quarters of the bound nearly always throws a shadow: the bound is not loose.
        // (Where the steepest cell lies at the border that the shadow leaves, there is none.)
        assert!(4 * shaded > 3 * tiles(300), "{shaded}");
    }

    #[test]
    fn a_rise_is_known_all_the_way_round() {
        // A plane that rises by 1 mm per pixel to the right.
        let map: Vec<f32> = (0..300).map(|pixel| (pixel % 20) as f32).collect();
        let normal: Vec<f32> = (0..900).map(|i| f32::from(u8::from(i >= 600))).collect();
        let statistics =
            serially(|run| Statistics::new(&flat_surface(&normal), 20, Some(&map), run)).unwrap();
        let range = statistics.tiles[0].relief.as_ref().unwrap();
        for y in [0.0, 1e-17, -1e-17, 1e-300, -1e-300] {
            assert!((rise(range, [1.0, y]) - 1.0).abs() < 1e-6, "{y}");
        }
        for index in 0..256 {
            let turn = core::f64::consts::TAU * f64::from(index) / 256.0;
            let found = rise(range, [turn.cos(), turn.sin()]);
            // Beyond the border on the left and right the relief is level.
            let exact = turn.cos().max(0.0);
            assert!(found >= exact - 1e-6 && found <= exact + 0.1, "{index}: {found} {exact}");
        }
    }

    #[test]
    fn a_lamp_is_seen_within_its_cone_its_irradiance_and_its_deviation() {
        let mut numbers = Numbers(3);
        for _ in 0..tiles(500) {
            let grid = Grid::whole(700, 520, numbers.between(0.05, 1.0));
            // Every other stands so low that a tile sees it from horizon to horizon.
            let highest = if numbers.next() < 0.5 { 20.0 } else { 900.0 };
            let height = numbers.between(0.5, highest);
            let position =
                Vec3::new(numbers.between(-500.0, 500.0), numbers.between(-500.0, 500.0), height);
            for falloff in [false, true] {
                let lamp = Light::Point { position, falloff };
                let tile = [(numbers.next() * 2.9) as usize, (numbers.next() * 2.9) as usize];
                let seen = light(lamp, grid, tile);
                let (middle, _) = lamp.at(0.0, 0.0);
                for _ in 0..40 {
                    let inside = |corner: usize, size: usize, next: f64| {
                        let last = (corner * SIDE + SIDE).min(size) - 1;
                        (corner * SIDE) as f64 + next * (last - corner * SIDE) as f64
                    };
                    let [u, v] = [numbers.next().round(), numbers.next()];
                    let (x, y) = (grid.x(inside(tile[0], 700, u)), grid.y(inside(tile[1], 520, v)));
                    let (direction, irradiance) = lamp.at(x, y);
                    assert!(angle(direction, seen.towards.axis) <= seen.towards.angle + 1e-9);
                    assert!(irradiance <= seen.irradiance[1] * (1.0 + 1e-12));
                    assert!(irradiance >= seen.irradiance[0] * (1.0 - 1e-12));
                    let away = direction.scale(irradiance) - middle;
                    assert!(away.length_squared().sqrt() <= seen.deviation + 1e-12);
                }
            }
        }
    }
}
