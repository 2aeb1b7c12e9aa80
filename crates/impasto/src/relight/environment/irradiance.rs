//! Irradiance environment map [@ramamoorthi2001irradiance]: what falls on a facet of any normal, as a
//! table over normals.
//!
//! Normals of a painting fill a small cap, and the clipped sky has an edge: a table with 64 x 64 nodes
//! is exact to 1e-4 there, spherical harmonics of degree 2 to several per cent
//! (`benches/python/environment.py`). A sun or a spot makes a crease in the table, where a facet turns
//! away from it; texels that carry a share of all light that matters are left out of the table and
//! are lit from as distant lamps, exactly.

use super::map::{Map, Texel};
use super::table::{GROUP, Group, HEMISPHERE, Layout, Nodes, Table, projected, vectors};
use crate::error::Result;
use crate::math::{Isa, Kernel, Real, Vec3};
use crate::pixels::Run;
use crate::relight::block::{BLOCK, Plane};
use crate::surface::CoatedDiffuse;

/// Neighbouring nodes, rad: 64 of a side.
const SPACING: f64 = 0.0463;

/// Share of all light from which on a texel is a lamp of its own.
const BRIGHT: f64 = 2e-3;

/// Most lamps.
const MOST: usize = 64;

/// Irradiance by the normal; a white board facing the viewer has 1 in an environment of radiance
/// 1 / pi, as under a lamp of intensity 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Irradiance {
    table: Table<4>,
    bright: Vec<Texel>,
    coated: Option<CoatedDiffuse>,
}

impl Irradiance {
    /// The table of a map, for diffuse light that crosses an interface or not.
    pub(crate) fn new(map: &Map, coated: Option<CoatedDiffuse>, run: &Run<'_>) -> Result<Self> {
        let sum = |texel: &Texel| texel.light.iter().map(|&light| f64::from(light)).sum::<f64>();
        let total: f64 = map.texels().map(sum).sum();
        let mut bright: Vec<Texel> =
            map.texels().filter(|texel| sum(texel) > BRIGHT * total).copied().collect();
        // A stable sort: equals stay in the order of the map.
        bright.sort_by(|a, b| sum(b).total_cmp(&sum(a)));
        bright.truncate(MOST);
        let least = if bright.len() == MOST { sum(&bright[MOST - 1]) } else { BRIGHT * total };
        bright.retain(|texel| sum(texel) > least);
        let rest: Vec<Vec<Texel>> = (map.bundles.iter())
            .map(|bundle| bundle.texels.iter().filter(|t| sum(t) <= least).copied().collect())
            .collect();
        let layout = Layout::new(HEMISPHERE, SPACING, 1024);
        let table = Table::new(
            layout,
            |_| true,
            run,
            |group| run.level.run(Gather { group, rest: &rest, coated }),
        )?;
        Ok(Self { table, bright, coated })
    }

    pub(super) fn nodes(&self) -> Nodes<'_> {
        Nodes::new(&self.table.nodes, self.table.layout)
    }

    /// Direction and light of what is not in the table.
    pub(super) fn bright(&self) -> impl Iterator<Item = ([f32; 3], [f32; 3])> + '_ {
        self.bright.iter().map(|texel| (texel.direction, texel.light))
    }

    /// Irradiance of normals, whose places in the projection are `places`; what an
    /// interface transmits towards `view` is in it. NaN where the normal is.
    #[inline(always)]
    pub(crate) fn shade<I: Isa>(
        &self,
        normals: [&Plane; 3],
        places: &[Plane; 2],
        view: impl Fn(usize) -> Vec3<I::F32>,
        out: &mut [Plane; 3],
    ) {
        for pixel in 0..BLOCK {
            let found = self.table.at::<I>([places[0][pixel], places[1][pixel]]);
            for (out, found) in out.iter_mut().zip(found) {
                out[pixel] = found;
            }
        }
        let zero = I::F32::zero();
        for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
            let normal = vectors::<I, BLOCK>(normals, lane);
            // What overshoots beside an edge may be negative.
            let mut sums = [0, 1, 2].map(|channel| zero.max(I::F32::load(&out[channel][lane..])));
            for texel in &self.bright {
                let [x, y, z] = texel.direction;
                let fallen = entering(self.coated, normal, Vec3::new(x, y, z).fill());
                for (sum, &light) in sums.iter_mut().zip(&texel.light) {
                    *sum = fallen.mul_add(I::F32::splat(light), *sum);
                }
            }
            let leaving = match self.coated {
                None => I::F32::one(),
                // Light along the normal enters without loss.
                Some(coated) => coated.value(normal, normal, view(lane)),
            };
            // False where any component is NaN.
            let length = normal.length_squared();
            let known = length.le(length);
            for (sum, out) in sums.into_iter().zip(out.iter_mut()) {
                let value = I::F32::select(known, sum * leaving, I::F32::of(f64::NAN));
                value.store(&mut out[lane..]);
            }
        }
    }

    /// Irradiance of one normal, frontal view.
    pub(crate) fn of(&self, normal: Vec3<f64>, run: &Run<'_>) -> [f64; 3] {
        let normals = normal.array().map(|value| [value as f32; BLOCK]);
        run.level.run(One { irradiance: self, normals: &normals })
    }
}

struct One<'a> {
    irradiance: &'a Irradiance,
    normals: &'a [Plane; 3],
}

impl Kernel for One<'_> {
    type Output = [f64; 3];

    #[inline(always)]
    fn run<I: Isa>(self) -> [f64; 3] {
        let mut out = [[0.0; BLOCK]; 3];
        let [x, y] = projected(vectors::<I, BLOCK>(self.normals.each_ref(), 0));
        let mut places = [[0.0; BLOCK]; 2];
        for lane in (0..BLOCK).step_by(I::F32::WIDTH) {
            x.store(&mut places[0][lane..]);
            y.store(&mut places[1][lane..]);
        }
        let view = |_| Vec3::new(I::F32::zero(), I::F32::zero(), I::F32::one());
        self.irradiance.shade::<I>(self.normals.each_ref(), &places, view, &mut out);
        out.map(|plane| f64::from(plane[0]))
    }
}

/// `N.L`, times what an interface lets in.
#[inline(always)]
fn entering<R: Real>(coated: Option<CoatedDiffuse>, normal: Vec3<R>, light: Vec3<R>) -> R {
    match coated {
        None => normal.dot(light).max(R::zero()),
        // A view along the normal sees all that leaves.
        Some(coated) => coated.value(normal, light, normal),
    }
}

/// The light that falls on a group of normals.
struct Gather<'a> {
    group: &'a Group,
    rest: &'a [Vec<Texel>],
    coated: Option<CoatedDiffuse>,
}

impl Kernel for Gather<'_> {
    type Output = [[f32; 4]; GROUP];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        // Sums of sums: single precision holds those of a bundle.
        let mut totals = [[0.0_f64; 3]; GROUP];
        for texels in self.rest {
            for lane in (0..GROUP).step_by(I::F32::WIDTH) {
                let normal = vectors::<I, GROUP>(self.group.direction.each_ref(), lane);
                let mut sums = [I::F32::zero(); 3];
                for texel in texels {
                    let [x, y, z] = texel.direction;
                    let fallen = entering(self.coated, normal, Vec3::new(x, y, z).fill());
                    for (sum, &light) in sums.iter_mut().zip(&texel.light) {
                        *sum = fallen.mul_add(I::F32::splat(light), *sum);
                    }
                }
                for (channel, sum) in sums.into_iter().enumerate() {
                    let mut values = [0.0; GROUP];
                    sum.store(&mut values);
                    for (total, &value) in totals[lane..].iter_mut().zip(&values[..I::F32::WIDTH]) {
                        total[channel] += f64::from(value);
                    }
                }
            }
        }
        totals.map(|[red, green, blue]| [red as f32, green as f32, blue as f32, 0.0])
    }
}
