//! Tables over directions: Lambert's azimuthal equal-area projection [@snyder1987map], read by cubic
//! convolution [@keys1981cubic].
//!
//! A direction at the angle theta from z lies at `sin(theta / 2)` from the middle of the table:
//! `(x, y) / sqrt(2 (1 + z))`. The projection is smooth everywhere but in the direction -z, into the
//! painting, from where no light comes. Octahedral maps, which are usual, have folds through the
//! middle of the map, where most lookups of a painting fall: a cubic is no better there than a straight
//! line.
//!
//! Nodes are filled group by group: a group holds one node per lane of the widest register, whatever
//! the register, so that every level gives the same bits.

use super::map::Cone;
use crate::error::Result;
use crate::math::lanes::MAX_LANES;
use crate::math::{Isa, Real, Vec3};
use crate::pixels::Run;

/// Nodes of a group, 4 x 4.
pub(crate) const GROUP: usize = MAX_LANES;

/// Side of a group.
const SIDE: usize = 4;

/// Half the table's width if it holds all directions.
pub(crate) const SPHERE: f64 = 1.0;

/// If it holds those that face the viewer: `sin(45 degrees)`, and a little of what lies behind.
pub(crate) const HEMISPHERE: f64 = 0.7125;

/// `CHANNELS` numbers per node, `(size, size, CHANNELS)`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table<const CHANNELS: usize> {
    pub(crate) layout: Layout,
    pub(crate) nodes: Vec<f32>,
}

/// Where nodes lie. The outermost ring only supports the cubic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Layout {
    /// Nodes of a side, a multiple of 4.
    pub(crate) size: usize,
    /// Half the width of the table.
    extent: f64,
}

/// The nodes of a table and where they lie: at `(x, y)` of the projection it has the value of column
/// `x * scale + middle` and row `y * scale + middle`, by cubic convolution of sixteen nodes. Columns and
/// rows are kept between 1 and `size - 2`.
#[derive(Clone, Copy, Debug)]
pub struct Nodes<'a> {
    /// `(size, size, channels)`: 4 channels (red, green, blue and nothing), of Lafortune lobes 16,
    /// four times as many: the components of a vector, and a scalar.
    pub values: &'a [f32],
    /// Nodes of a side.
    pub size: usize,
    /// Nodes per unit of the projection.
    pub scale: f32,
    /// The column of the middle of the projection.
    pub middle: f32,
}

impl<'a> Nodes<'a> {
    pub(super) fn new(values: &'a [f32], layout: Layout) -> Self {
        let [scale, middle] = layout.placing();
        Self { values, size: layout.size, scale, middle }
    }
}

/// Sixteen neighbouring nodes.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Unit vectors, axis by axis.
    pub(crate) direction: [[f32; GROUP]; 3],
    /// What holds them.
    pub(crate) cone: Cone,
    /// Its column and row among the groups.
    place: [usize; 2],
}

impl Layout {
    /// So many nodes as keep neighbours in the middle of the table within `spacing` rad, but at least
    /// 24 and at most `most`.
    pub(crate) fn new(extent: f64, spacing: f64, most: usize) -> Self {
        // The scale in the middle is two radians per unit.
        let needed = (4.0 * extent / spacing).min(1e6) as usize + 3;
        let size = needed.clamp(24, most).next_multiple_of(SIDE);
        Self { size, extent }
    }

    /// Nodes of the whole table.
    pub(crate) fn count(&self) -> usize {
        self.size * self.size
    }

    /// Nodes per unit of the projection.
    #[inline(always)]
    fn scale(&self) -> f64 {
        (self.size - 3) as f64 / (2.0 * self.extent)
    }

    /// The direction of a node.
    fn direction(&self, [column, row]: [usize; 2]) -> Vec3<f64> {
        let at = |place: usize| (place as f64 - 1.0) / self.scale() - self.extent;
        let (x, y) = (at(column), at(row));
        // Beyond the circle of all directions lies the last one.
        let square = (x * x + y * y).min(1.0);
        let stretch = 2.0 * (1.0 - square).sqrt();
        Vec3::new(x * stretch, y * stretch, 1.0 - 2.0 * square)
    }

    /// The groups of nodes, row by row.
    pub(crate) fn groups(&self) -> impl Iterator<Item = Group> + '_ {
        let side = self.size / SIDE;
        (0..side * side).map(move |index| self.group([index % side, index / side]))
    }

    fn group(&self, place: [usize; 2]) -> Group {
        let [left, top] = place.map(|place| place * SIDE);
        let node = |index: usize| self.direction([left + index % SIDE, top + index / SIDE]);
        let mut direction = [[0.0; GROUP]; 3];
        for index in 0..GROUP {
            for (axis, value) in direction.iter_mut().zip(node(index).array()) {
                axis[index] = value as f32;
            }
        }
        Group { direction, cone: Cone::around((0..GROUP).map(node)), place }
    }

    /// Nodes per unit of the projection, and the place among them of its middle.
    #[inline(always)]
    pub(crate) fn placing(&self) -> [f32; 2] {
        [self.scale() as f32, (self.extent * self.scale() + 1.0) as f32]
    }

    /// The node left of and above a place of the projection, and how far it lies beyond it.
    #[inline(always)]
    pub(crate) fn cell(&self, place: f32) -> (usize, f32) {
        let [scale, middle] = self.placing();
        let at = Real::mul_add(place, scale, middle);
        // `max` answers with its argument for NaN: a node must be chosen.
        let last = (self.size - 2) as f32;
        let at = Real::min(Real::max(at, 1.0), last);
        let cell = (at as usize).min(self.size - 3);
        (cell, at - cell as f32)
    }
}

/// Vectors from planes of their components.
#[inline(always)]
pub(crate) fn vectors<I: Isa, const N: usize>(planes: [&[f32; N]; 3], lane: usize) -> Vec3<I::F32> {
    let [x, y, z] = planes;
    Vec3::new(I::F32::load(&x[lane..]), I::F32::load(&y[lane..]), I::F32::load(&z[lane..]))
}

/// `1 + z` of a direction straight away from the eye, less than a twelfth of a degree beside it.
const AWAY: f64 = 1e-6;

/// Place of unit vectors in the projection.
#[inline(always)]
pub(crate) fn projected<R: Real>(direction: Vec3<R>) -> [R; 2] {
    let above = direction.z + R::one();
    let scale = (above + above).sqrt().recip();
    // All of the rim is that direction, whose x and y are little more than roundings.
    let away = above.lt(R::of(AWAY));
    let place = |value: R, rim: R| R::select(away, rim, value * scale);
    [place(direction.x, R::one()), place(direction.y, R::zero())]
}

/// Weights of four neighbours for a place between the second and the third: cubic convolution with
/// a = -1/2.
#[inline(always)]
pub(crate) fn cubic(f: f32) -> [f32; 4] {
    let fma = |a: f32, b: f32, c: f32| Real::mul_add(a, b, c);
    [
        fma(fma(-0.5, f, 1.0), f, -0.5) * f,
        fma(fma(1.5, f, -2.5), f * f, 1.0),
        fma(fma(-1.5, f, 2.0), f, 0.5) * f,
        fma(0.5, f, -0.5) * (f * f),
    ]
}

/// Weights of four equally spaced neighbours for any place, the first at -1: Lagrange's cubic.
#[inline(always)]
pub(crate) fn lagrange(f: f32) -> [f32; 4] {
    let (before, after, last) = (f + 1.0, f - 1.0, f - 2.0);
    [
        f * after * last * (-1.0 / 6.0),
        before * after * last * 0.5,
        before * f * last * -0.5,
        before * f * after * (1.0 / 6.0),
    ]
}

#[cfg(test)]
impl Group {
    /// Of these directions, for a test.
    pub(crate) fn of(direction: [[f32; GROUP]; 3]) -> Self {
        let node = |i: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(direction[axis][i]));
            Vec3::new(x, y, z)
        };
        Self { direction, cone: Cone::around((0..GROUP).map(node)), place: [0, 0] }
    }
}

impl<const CHANNELS: usize> Table<CHANNELS> {
    /// A table of values per node, `fill` answering for a group; those that `wanted` refuses stay 0.
    pub(crate) fn new(
        layout: Layout,
        wanted: impl Fn(usize) -> bool,
        run: &Run<'_>,
        fill: impl Fn(&Group) -> [[f32; CHANNELS]; GROUP] + Send + Sync,
    ) -> Result<Self> {
        let groups: Vec<Group> = (layout.groups().enumerate())
            .filter_map(|(index, group)| wanted(index).then_some(group))
            .collect();
        // A few groups at a time: work that is worth a thread's while.
        let jobs = groups.chunks(16).collect();
        let filled: Vec<Vec<_>> =
            run.map(jobs, || (), |(), groups: &[Group]| groups.iter().map(&fill).collect())?;
        let mut nodes = vec![0.0; layout.count() * CHANNELS];
        for (group, values) in groups.iter().zip(filled.iter().flatten()) {
            for (index, value) in values.iter().enumerate() {
                let row = group.place[1] * SIDE + index / SIDE;
                let column = group.place[0] * SIDE + index % SIDE;
                let start = (row * layout.size + column) * CHANNELS;
                nodes[start..start + CHANNELS].copy_from_slice(value);
            }
        }
        Ok(Self { layout, nodes })
    }
}

impl Table<4> {
    /// The first three channels at a place of the projection.
    #[inline(always)]
    pub(crate) fn at<I: Isa>(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let ((column, right), (row, down)) = (self.layout.cell(x), self.layout.cell(y));
        let (across, along) = (cubic(right), cubic(down));
        // A row of four nodes is sixteen numbers side by side.
        let start = ((row - 1) * self.layout.size + column - 1) * 4;
        let rows = &self.nodes[start..start + 3 * self.layout.size * 4 + 16];
        let mut sums = [0.0; 16];
        for lane in (0..16).step_by(I::F32::WIDTH) {
            let mut sum = I::F32::zero();
            for (number, &weight) in along.iter().enumerate() {
                let values = I::F32::load(&rows[number * self.layout.size * 4 + lane..]);
                sum = values.mul_add(I::F32::splat(weight), sum);
            }
            sum.store(&mut sums[lane..]);
        }
        [0, 1, 2].map(|channel| {
            let mut sum = 0.0;
            for (node, &weight) in across.iter().enumerate() {
                sum = Real::mul_add(sums[4 * node + channel], weight, sum);
            }
            sum
        })
    }
}

impl Table<16> {
    /// Adds `weight` times the values at a place of the projection to four partial sums.
    #[inline(always)]
    pub(crate) fn add<I: Isa>(
        nodes: &[f32],
        layout: Layout,
        [x, y]: [f32; 2],
        weight: f32,
        sums: &mut [[f32; 16]; 4],
    ) {
        let ((column, right), (row, down)) = (layout.cell(x), layout.cell(y));
        let (across, along) = (cubic(right), cubic(down));
        let start = ((row - 1) * layout.size + column - 1) * 16;
        let rows = &nodes[start..start + (3 * layout.size + 4) * 16];
        for (number, (sums, along)) in sums.iter_mut().zip(along).enumerate() {
            let row = &rows[number * layout.size * 16..][..64];
            let weights = across.map(|across| I::F32::splat(across * (along * weight)));
            for lane in (0..16).step_by(I::F32::WIDTH) {
                let mut sum = I::F32::load(&sums[lane..]);
                for (node, &weight) in weights.iter().enumerate() {
                    sum = I::F32::load(&row[16 * node + lane..]).mul_add(weight, sum);
                }
                sum.store(&mut sums[lane..]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Kernel, Level};
    use crate::pixels::serially;

    struct Read<'a>(&'a Table<4>, [f32; 2]);

    impl Kernel for Read<'_> {
        type Output = [f32; 3];
        #[inline(always)]
        fn run<I: Isa>(self) -> [f32; 3] {
            self.0.at::<I>(self.1)
        }
    }

    fn smooth(x: f64, y: f64, z: f64) -> [f32; 3] {
        [x, y * z, (2.0 * x - y).sin()].map(|value| value as f32)
    }

    #[test]
    fn a_smooth_function_comes_back_everywhere() {
        let layout = Layout::new(HEMISPHERE, 0.045, 1024);
        let table = serially(|run| {
            Table::<4>::new(
                layout,
                |_| true,
                run,
                |group| {
                    let [x, y, z] = &group.direction;
                    let node = |i: usize| smooth(x[i].into(), y[i].into(), z[i].into());
                    core::array::from_fn(|i| [node(i)[0], node(i)[1], node(i)[2], 0.0])
                },
            )
        })
        .unwrap();
        for i in 0..2000 {
            let t = f64::from(i);
            let (tilt, azimuth) = (0.5 * core::f64::consts::PI * (t * 0.618).fract(), t * 2.4);
            let direction =
                Vec3::new(tilt.sin() * azimuth.cos(), tilt.sin() * azimuth.sin(), tilt.cos());
            let place = projected(direction).map(|place| place as f32);
            for level in Level::ALL.into_iter().filter(|level| level.available()) {
                let found = level.run(Read(&table, place));
                let expected = smooth(direction.x, direction.y, direction.z);
                for (found, expected) in found.iter().zip(expected) {
                    // Neighbours are 0.064 rad apart at 90 degrees: 0.016 h^3 f''' with f''' up to 11.
                    assert!((found - expected).abs() < 5e-5, "{tilt} {found} {expected}");
                }
                assert_eq!(found, Level::Baseline.run(Read(&table, place)));
            }
        }
    }

    #[test]
    fn any_place_reads_a_node() {
        let layout = Layout::new(SPHERE, 0.1, 1024);
        for place in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 1.0, 0.0] {
            let (cell, beyond) = layout.cell(place);
            assert!(cell >= 1 && cell + 2 < layout.size && (0.0..=1.0).contains(&beyond));
        }
    }

    #[test]
    fn what_faces_away_lies_on_the_rim() {
        for x in [0.0_f32, 1e-7, 1e-4, 1e-3, 1e-2] {
            // The second as a vector of single precision may be longer than 1.
            for z in [-(1.0 - x * x).sqrt(), -(1.0 - x * x).sqrt() - 6e-8] {
                let [x, y] = projected(Vec3::new(x, 0.0, z));
                // 1 + z has a rounding of 6e-8, of at least 1e-6.
                assert!((x.hypot(y) - 1.0).abs() < 0.06, "{x} {y}");
            }
        }
    }

    #[test]
    fn weights_sum_to_one_and_keep_straight_lines() {
        for i in 0..=20 {
            let f = i as f32 / 20.0;
            for weights in [cubic(f), lagrange(f), lagrange(f - 1.0), lagrange(f + 1.0)] {
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            }
            let line = |w: [f32; 4]| -w[0] + w[2] + 2.0 * w[3];
            assert!((line(cubic(f)) - f).abs() < 1e-6 && (line(lagrange(f)) - f).abs() < 1e-6);
        }
    }
}
