//! Torrance-Sparrow lobes [@torrance1967theory] in an environment: tables over the normal, for one view.
//!
//! With one view and one gamma the interface reflection of a whole environment depends on the normal
//! alone: one table. For a gamma of every pixel tables stand at every quarter octave, and a cubic in
//! `log gamma` of `Y / gamma` gives those between: light from a point makes a peak whose height does not
//! depend on gamma, an even sky one that goes with its square.
//!
//! A table's nodes are as dense as its gamma asks for, and only those are computed that some pixel's
//! normal needs. What is narrower than the texels of the map, or than a table of 1024 nodes can hold,
//! is as wide as these and as strong as it should be (`gamma^2`).

use core::sync::atomic::{AtomicBool, Ordering};

use super::map::{Cone, Map};
use super::table::{GROUP, Group, HEMISPHERE, Layout, Nodes, Table, lagrange, projected, vectors};
use crate::error::Result;
use crate::math::elementary::ln;
use crate::math::{Isa, Kernel, Real, Vec3};
use crate::pixels::{Run, tiles};
use crate::relight::block::{BLOCK, Plane};
use crate::surface::{GAMMA_MAX, GAMMA_MIN, Lobe, LobeModel, Parameter, TorranceSparrow};

/// Neighbouring nodes in units of gamma, from [`BROAD`] on and below.
const SPACING: [f64; 2] = [0.22, 0.35];

/// Least gamma of dense tables.
const BROAD: f64 = 0.045;

/// Most nodes of a table's side.
const MOST: usize = 1024;

/// Gamma of the first of the levels; each next one is a quarter octave narrower.
const WIDEST: f64 = GAMMA_MAX;

/// `exp(-21)`, 1e-9 of the peak, is left out.
const DARK: f64 = 21.0;

type Facet = <TorranceSparrow as LobeModel>::Pair<f32>;

/// The map as one view sees it: facets that mirror its texels to the eye.
struct Mirrored {
    facets: Vec<(Facet, [f32; 3])>,
    /// Their half vectors.
    cone: Cone,
}

/// What one lobe shows.
pub(crate) struct Glossy<'a> {
    pub(crate) lobe: &'a Lobe<'a>,
    widths: Kept<'a>,
    narrowest: f64,
}

/// The tables of a Torrance-Sparrow lobe.
#[derive(Clone, Debug)]
pub struct Widths<'a> {
    /// One, or, for a gamma of every pixel, one at every quarter octave from the widest on, of
    /// `Y / gamma`.
    pub tables: Vec<Nodes<'a>>,
    /// Of one table: the factor on it.
    pub factor: f32,
    /// Narrower lobes are as wide as this, and as strong as they should be.
    pub narrowest: f32,
}

enum Kept<'a> {
    /// Of a gamma, and the factor on it.
    One(Table<4>, f32),
    Many(&'a [f32], Vec<Table<4>>),
}

impl<'a> Glossy<'a> {
    /// Tables for a lobe under a map, seen from `view`, where `normals` `(3, y, x)` need them.
    pub(crate) fn new(
        lobe: &'a Lobe<'a>,
        map: &Map,
        (model, view): (TorranceSparrow, Vec3<f64>),
        normals: &[f32],
        run: &Run<'_>,
    ) -> Result<Self> {
        // Texels of this spacing, seen in a mirror that turns half as far, run into each other.
        let narrowest =
            (0.3 * map.spacing).max(4.0 * HEMISPHERE / (SPACING[1] * (MOST - 4) as f64));
        let narrowest = narrowest.min(WIDEST / 4.0);
        let mirrored = || mirrored(map, model, view);
        let widths = match lobe.shape[0] {
            Parameter::Everywhere(gamma) => {
                let kept = f64::from(gamma).max(narrowest).min(WIDEST);
                let layout = layout(kept);
                let needed = Needed::new(&[layout], normals, None, run)?;
                let table = table((kept, 1.0), layout, &needed.0[0], (model, &mirrored()), run)?;
                let below = f64::from(gamma).max(GAMMA_MIN) / narrowest;
                Kept::One(table, (below * below).min(1.0) as f32)
            }
            Parameter::Map(gammas) => {
                let levels = (4.0 * (WIDEST / narrowest).log2()).floor() as usize + 1;
                let kept = |level: usize| WIDEST * (-0.25 * level as f64).exp2();
                let layouts: Vec<Layout> = (0..levels).map(|level| layout(kept(level))).collect();
                let needed = Needed::new(&layouts, normals, Some((gammas, narrowest)), run)?;
                let mirrored = mirrored();
                let tables = (layouts.iter().zip(&needed.0).enumerate())
                    .map(|(level, (&layout, needed))| {
                        let gamma = kept(level);
                        table((gamma, gamma.recip()), layout, needed, (model, &mirrored), run)
                    })
                    .collect::<Result<_>>()?;
                Kept::Many(gammas, tables)
            }
        };
        Ok(Self { lobe, widths, narrowest })
    }

    pub(super) fn widths(&self) -> Widths<'_> {
        let (tables, factor) = match &self.widths {
            Kept::One(table, factor) => (core::slice::from_ref(table), *factor),
            Kept::Many(_, tables) => (&tables[..], 1.0),
        };
        let tables = tables.iter().map(|table| Nodes::new(&table.nodes, table.layout)).collect();
        Widths { tables, factor, narrowest: self.narrowest as f32 }
    }

    /// What the lobe reflects at unit strength at the normals whose places in the projection are
    /// `places`; NaN where gamma is.
    #[inline(always)]
    pub(crate) fn shade<I: Isa>(
        &self,
        places: &[Plane; 2],
        (start, count): (usize, usize),
        out: &mut [Plane; 3],
    ) {
        match &self.widths {
            Kept::One(table, factor) => {
                let known = self.lobe.shape[0].at::<f32>(0);
                let factor = if known.is_nan() { f32::NAN } else { *factor };
                for pixel in 0..BLOCK {
                    let found = table.at::<I>([places[0][pixel], places[1][pixel]]);
                    for (out, found) in out.iter_mut().zip(found) {
                        out[pixel] = Real::max(found, 0.0) * factor;
                    }
                }
            }
            Kept::Many(gammas, tables) => {
                for (pixel, &gamma) in gammas[start..start + count].iter().enumerate() {
                    let at = Level::of(gamma, self.narrowest, tables.len());
                    let mut sums = [0.0; 3];
                    for (table, weight) in tables[at.first..at.first + 4].iter().zip(at.weights) {
                        let found = table.at::<I>([places[0][pixel], places[1][pixel]]);
                        for (sum, found) in sums.iter_mut().zip(found) {
                            *sum = Real::mul_add(found, weight, *sum);
                        }
                    }
                    for (out, sum) in out.iter_mut().zip(sums) {
                        out[pixel] = Real::max(sum, 0.0) * at.factor;
                    }
                }
            }
        }
    }
}

fn layout(gamma: f64) -> Layout {
    let spacing = if gamma < BROAD { SPACING[1] } else { SPACING[0] };
    Layout::new(HEMISPHERE, spacing * gamma, MOST)
}

/// Where a gamma lies among the levels.
struct Level {
    first: usize,
    weights: [f32; 4],
    /// From `Y / gamma` to Y; NaN for no gamma.
    factor: f32,
}

impl Level {
    #[inline(always)]
    fn of(gamma: f32, narrowest: f64, levels: usize) -> Self {
        let given = Real::max(gamma, GAMMA_MIN as f32);
        let below = Real::min(given / narrowest as f32, 1.0);
        let kept = Real::min(Real::max(given, narrowest as f32), WIDEST as f32);
        let place = ln(WIDEST as f32 / kept) * (4.0 * core::f32::consts::LOG2_E);
        let first = (place as usize).clamp(1, levels - 3) - 1;
        let known = if gamma.is_nan() { f32::NAN } else { 1.0 };
        Self {
            first,
            weights: lagrange(place - (first + 1) as f32),
            factor: kept * (below * below) * known,
        }
    }
}

/// For each table, which groups of nodes some pixel needs.
struct Needed(Vec<Vec<AtomicBool>>);

impl Needed {
    fn new(
        layouts: &[Layout],
        normals: &[f32],
        gammas: Option<(&[f32], f64)>,
        run: &Run<'_>,
    ) -> Result<Self> {
        let groups = |layout: &Layout| {
            (0..layout.count() / GROUP).map(|_| AtomicBool::new(false)).collect::<Vec<_>>()
        };
        let needed: Vec<Vec<AtomicBool>> = layouts.iter().map(groups).collect();
        let pixels = normals.len() / 3;
        run.for_each(
            tiles(pixels),
            || (),
            |(), (start, count)| {
                for pixel in start..start + count {
                    let normal = Vec3::new(
                        normals[pixel],
                        normals[pixels + pixel],
                        normals[2 * pixels + pixel],
                    );
                    let place = projected(normal);
                    let levels = match gammas {
                        None => 0..1,
                        Some((gammas, narrowest)) => {
                            let first = Level::of(gammas[pixel], narrowest, layouts.len()).first;
                            first..first + 4
                        }
                    };
                    for level in levels {
                        let (layout, needed) = (&layouts[level], &needed[level]);
                        let [column, row] = place.map(|place| layout.cell(place).0);
                        for row in [row - 1, row + 2] {
                            for column in [column - 1, column + 2] {
                                let group = row / 4 * (layout.size / 4) + column / 4;
                                needed[group].store(true, Ordering::Relaxed);
                            }
                        }
                    }
                }
            },
        )?;
        Ok(Self(needed))
    }
}

fn mirrored(map: &Map, model: TorranceSparrow, view: Vec3<f64>) -> Vec<Mirrored> {
    let seen = map.bundles.iter().map(|bundle| {
        let facets = bundle.texels.iter().map(|texel| {
            let pair = model.pair(texel.towards().normalised(), view);
            (model.splat(&pair), texel.light)
        });
        let facets: Vec<(Facet, [f32; 3])> = facets.collect();
        let halves = facets.iter().map(|(facet, _)| {
            let half = facet.half();
            Vec3::new(f64::from(half.x), f64::from(half.y), f64::from(half.z))
        });
        let cone = Cone::around(halves);
        Mirrored { facets, cone }
    });
    seen.collect()
}

/// The table of a gamma, times a factor.
fn table(
    (gamma, factor): (f64, f64),
    layout: Layout,
    needed: &[AtomicBool],
    (model, mirrored): (TorranceSparrow, &[Mirrored]),
    run: &Run<'_>,
) -> Result<Table<4>> {
    Table::new(
        layout,
        |group| needed[group].load(Ordering::Relaxed),
        run,
        |group| run.level.run(Gather { group, mirrored, model, gamma, factor }),
    )
}

/// What a group of normals reflects.
struct Gather<'a> {
    group: &'a Group,
    mirrored: &'a [Mirrored],
    model: TorranceSparrow,
    gamma: f64,
    factor: f64,
}

impl Kernel for Gather<'_> {
    type Output = [[f32; 4]; GROUP];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let Self { group, mirrored, model, gamma, factor } = self;
        let farthest = gamma * (DARK / core::f64::consts::LN_2).sqrt();
        let dark = if farthest < core::f64::consts::PI { farthest.cos() } else { -1.0 };
        let parameters = [I::F32::of(gamma), I::F32::zero(), I::F32::zero()];
        let lobe = model.lobe_from_parameters(parameters);
        let mut totals = [[0.0_f64; 3]; GROUP];
        for bundle in mirrored {
            if bundle.cone.nearest_cosine(&group.cone) < dark {
                continue;
            }
            for lane in (0..GROUP).step_by(I::F32::WIDTH) {
                let normal = vectors::<I, GROUP>(group.direction.each_ref(), lane);
                let mut sums = [I::F32::zero(); 3];
                for (facet, light) in &bundle.facets {
                    let pair = model.splat(facet);
                    let value = model.value(&lobe, &pair, normal);
                    for (sum, &light) in sums.iter_mut().zip(light) {
                        *sum = value.mul_add(I::F32::splat(light), *sum);
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
        totals.map(|light| {
            let [red, green, blue] = light.map(|light| (light * factor) as f32);
            [red, green, blue, 0.0]
        })
    }
}
