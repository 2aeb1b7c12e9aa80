//! Prefiltered environment maps [@kautz2000unified; @mcallister2002efficient] for Lafortune lobes, here
//! of vectors, which makes the filter exact.
//!
//! The lobe is `d^n` with `d = p.u` for light from u, and `p = Cxy V + (Cz - Cxy) (N.V) N`: about the
//! direction of p it is the same on all sides, for every view. Its light
//!
//! ```text
//! |p|^n integral of (p^.u)^n (N.u) L(u) du  =  |p|^n  N . V_n(p^)
//! V_n(p^) = integral of (p^.u)^n u L(u) du
//! ```
//!
//! needs no approximation: `N.u` is linear in N, so N leaves the integral, and a map of vectors over
//! directions p^ holds the rest. The scalar scheme ([`scalar`](super::scalar)) takes `N.p^` out
//! instead. Only light below a tilted facet's own horizon that is still in front of the painting counts
//! as negative here; it matters for broad lobes alone.
//!
//! Maps stand at every half octave of the exponent, and a cubic in `log2 n` of `(n + 2) V_n`, which
//! hardly changes, gives those between. A map has the more nodes the sharper its lobe is; beyond the
//! last exponent, 1448, the lobe is as wide as there and as strong as it should be: sharper ones would
//! show the texels of the map.

use super::map::{Cone, Map};
use super::table::{GROUP, Group, Layout, Nodes, SPHERE, Table, lagrange, vectors};
use crate::error::{Error, Result};
use crate::math::elementary::{exp, ln_in_range};
use crate::math::{Isa, Kernel, Real, Vec3};
use crate::pixels::Run;

/// Exponents `2^(-1) .. 2^(10.5)`, two per octave.
pub(crate) const LEVELS: usize = 24;

/// Logarithm to base 2 of the first exponent.
const FIRST: f64 = -1.0;

/// Neighbouring nodes in widths `1 / sqrt(n)` of the lobe, up to [`BROAD`] and beyond: the cubic is
/// wrong by 0.05 % and 0.2 % of the peak that a point of light makes.
const SPACING: [f64; 2] = [0.33, 0.5];

/// Largest exponent of dense maps; those of sharper lobes are large as it is.
const BROAD: f64 = 300.0;

/// Light at which a lobe has fallen to `exp(-21)`, 1e-9, is left out.
const DARK: f64 = 21.0;

/// Numbers of a node: red, green, blue and nothing of the three components of `(n + 2) V_n` and of
/// the scalar `(n + 2) G_n`.
const CHANNELS: usize = 16;

/// Maps of all exponents, one after another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Prefiltered {
    nodes: Vec<f32>,
    starts: [usize; LEVELS],
    layouts: [Layout; LEVELS],
}

fn exponent(level: usize) -> f64 {
    (FIRST + 0.5 * level as f64).exp2()
}

fn layouts() -> ([Layout; LEVELS], [usize; LEVELS], usize) {
    let layouts = core::array::from_fn(|level| {
        let n = exponent(level);
        let spacing = if n < BROAD { SPACING[0] } else { SPACING[1] };
        Layout::new(SPHERE, spacing / n.sqrt(), 1024)
    });
    let mut starts = [0; LEVELS];
    let mut total = 0;
    for (start, layout) in starts.iter_mut().zip(&layouts) {
        *start = total;
        total += layout.count() * CHANNELS;
    }
    (layouts, starts, total)
}

impl Prefiltered {
    /// Filters a map.
    pub(crate) fn new(map: &Map, run: &Run<'_>) -> Result<Self> {
        let (layouts, starts, total) = layouts();
        let bundles = weighted(map);
        let mut nodes = Vec::with_capacity(total);
        for (level, layout) in layouts.iter().enumerate() {
            let table = Table::<CHANNELS>::new(
                *layout,
                |_| true,
                run,
                |group| run.level.run(Filter { group, bundles: &bundles, level }),
            )?;
            nodes.extend(table.nodes);
        }
        Ok(Self { nodes, starts, layouts })
    }

    /// Maps that were filtered before.
    pub(crate) fn from_nodes(nodes: Vec<f32>) -> Result<Self> {
        let (layouts, starts, total) = layouts();
        if nodes.len() != total || !nodes.iter().all(|value| value.is_finite()) {
            let problem = format!("expected {total} finite numbers, found {}", nodes.len());
            return Err(Error::argument("lobes", problem));
        }
        Ok(Self { nodes, starts, layouts })
    }

    /// The numbers to keep.
    pub(crate) fn nodes(&self) -> &[f32] {
        &self.nodes
    }

    /// Table by table.
    pub(super) fn tables(&self) -> impl Iterator<Item = Nodes<'_>> {
        self.starts.iter().zip(self.layouts).map(|(&start, layout)| {
            Nodes::new(&self.nodes[start..start + layout.count() * CHANNELS], layout)
        })
    }

    /// `(n + 2) V_n` and `(n + 2) G_n` towards a place of the projection; `level` is a place among the
    /// exponents, [`level_of`] it.
    #[inline(always)]
    pub(crate) fn at<I: Isa>(&self, place: [f32; 2], level: f32) -> [f32; CHANNELS] {
        let first = (level as usize).clamp(1, LEVELS - 3) - 1;
        let weights = lagrange(level - (first + 1) as f32);
        let mut sums = [[0.0; CHANNELS]; 4];
        for (number, &weight) in weights.iter().enumerate() {
            let layout = self.layouts[first + number];
            let start = self.starts[first + number];
            let nodes = &self.nodes[start..start + layout.count() * CHANNELS];
            Table::add::<I>(nodes, layout, place, weight, &mut sums);
        }
        let mut total = [0.0; CHANNELS];
        for (channel, total) in total.iter_mut().enumerate() {
            *total = (sums[0][channel] + sums[1][channel]) + (sums[2][channel] + sums[3][channel]);
        }
        total
    }
}

/// Where an exponent lies among those of the maps.
#[inline(always)]
pub(crate) fn level_of<R: Real>(exponent: R) -> R {
    // Half octaves, from the first exponent on.
    let [least, most] = [self::exponent(0), self::exponent(LEVELS - 1)].map(R::of);
    let log = ln_in_range(least.max(exponent).min(most));
    let level = log.mul_add(R::of(2.0 * core::f64::consts::LOG2_E), R::of(-2.0 * FIRST));
    level.max(R::zero()).min(R::of((LEVELS - 1) as f64))
}

/// A bundle of texels with what is summed of each.
struct Weighted {
    cone: Cone,
    texels: Vec<([f32; 3], [[f32; 3]; 4])>,
}

fn weighted(map: &Map) -> Vec<Weighted> {
    map.bundles
        .iter()
        .map(|bundle| Weighted {
            cone: bundle.cone,
            texels: bundle
                .texels
                .iter()
                .map(|texel| {
                    let [x, y, z] = texel.direction;
                    let [red, green, blue] = texel.light;
                    let by = |factor: f32| [red * factor, green * factor, blue * factor];
                    (texel.direction, [by(x), by(y), by(z), by(1.0)])
                })
                .collect(),
        })
        .collect()
}

/// The light about a group of directions, at one exponent.
struct Filter<'a> {
    group: &'a Group,
    bundles: &'a [Weighted],
    level: usize,
}

impl Kernel for Filter<'_> {
    type Output = [[f32; CHANNELS]; GROUP];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let Self { group, bundles, level } = self;
        let n = exponent(level);
        let dark = (-DARK / n).exp();
        // Twice as far in the exponent nothing is left, and powers of it are still normal numbers.
        let floor = I::F32::of((-2.0 * DARK / n).exp());
        let mut totals = [[0.0_f64; CHANNELS]; GROUP];
        for bundle in bundles {
            if bundle.cone.nearest_cosine(&group.cone) < dark {
                continue;
            }
            for lane in (0..GROUP).step_by(I::F32::WIDTH) {
                let direction = vectors::<I, GROUP>(group.direction.each_ref(), lane);
                let mut sums = [[I::F32::zero(); 3]; 4];
                for &([x, y, z], ref light) in &bundle.texels {
                    let cosine = direction.dot(Vec3::new(x, y, z).fill());
                    let cosine = cosine.max(floor).min(I::F32::one());
                    let power = power(cosine, level);
                    for (sums, light) in sums.iter_mut().zip(light) {
                        for (sum, &light) in sums.iter_mut().zip(light) {
                            *sum = power.mul_add(I::F32::splat(light), *sum);
                        }
                    }
                }
                for (part, sums) in sums.iter().enumerate() {
                    for (channel, sum) in sums.iter().enumerate() {
                        let mut values = [0.0; GROUP];
                        sum.store(&mut values);
                        for (total, &value) in
                            totals[lane..].iter_mut().zip(&values[..I::F32::WIDTH])
                        {
                            total[4 * part + channel] += f64::from(value);
                        }
                    }
                }
            }
        }
        totals.map(|total| total.map(|value| ((n + 2.0) * value) as f32))
    }
}

/// `cosine^n` of the n of a level: its root of a power of two, squared again and again.
#[inline(always)]
fn power<R: Real>(cosine: R, level: usize) -> R {
    // n = 2^(1/2 or 0) 2^(level / 2 - 1).
    let mut power = if level.is_multiple_of(2) {
        cosine.sqrt()
    } else {
        exp(ln_in_range(cosine) * R::of(core::f64::consts::FRAC_1_SQRT_2))
    };
    for _ in 0..level / 2 {
        power = power * power;
    }
    power
}

#[cfg(test)]
pub(super) fn group_at(
    map: &Map,
    level: usize,
    isa: crate::math::Level,
) -> [[f32; CHANNELS]; GROUP] {
    let layout = layouts().0[level];
    let middle = layout.groups().nth((layout.size / 8) * (layout.size / 4) + layout.size / 8);
    isa.run(Filter { group: &middle.unwrap(), bundles: &weighted(map), level })
}

#[cfg(test)]
pub(super) fn about_z(map: &Map, level: usize) -> [f64; CHANNELS] {
    let up = Vec3::new(0.0, 0.0, 1.0).array();
    let direction = up.map(|value| [value; GROUP]);
    let group = Group::of(direction);
    let filter = Filter { group: &group, bundles: &weighted(map), level };
    crate::math::Level::detect().run(filter)[0].map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_those_of_the_exponents() {
        for level in 0..LEVELS {
            let n = exponent(level);
            for i in 1..50 {
                let cosine = (-f64::from(i) / (5.0 * n)).exp();
                assert!((power(cosine, level) / cosine.powf(n) - 1.0).abs() < 1e-12, "{level}");
                // 2e-7 of a root, times the exponent over its own, and two ulps of a logarithm.
                let single =
                    f64::from(power(cosine as f32, level)) / f64::from(cosine as f32).powf(n);
                let tolerance = 4e-7 * n.max(1.0) + 2.4e-7 * f64::from(i) / 5.0;
                assert!((single - 1.0).abs() < tolerance, "{level} {single}");
            }
            assert!((f64::from(level_of(n as f32)) - level as f64).abs() < 1e-5);
        }
        assert_eq!(level_of(1e6_f32), (LEVELS - 1) as f32);
        assert!(level_of(f32::NAN) <= (LEVELS - 1) as f32);
    }

    #[test]
    fn kept_maps_are_checked() {
        let (_, _, total) = layouts();
        assert!(Prefiltered::from_nodes(vec![0.0; total]).is_ok());
        assert!(Prefiltered::from_nodes(vec![0.0; total - 1]).is_err());
        assert!(Prefiltered::from_nodes(vec![f32::NAN; total]).is_err());
    }
}
