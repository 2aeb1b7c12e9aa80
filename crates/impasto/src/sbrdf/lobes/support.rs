//! Which lobes the photographs support.
//!
//! A narrow lobe can fit one outlying sample with its outermost slope. Its peak, where there is no
//! photograph, may then have any height, and another light would show it.

use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Real, Vec3};

use super::maps::MOST_LOBES;
use super::model::{LobeEstimation, MAX_SHAPES};
use super::photographs::Photographs;
use super::tile::{Estimate, LobeFitTile, STRIDE, gather, gather_normal};

/// Least fraction of its peak that a lobe must reach in some photograph, which it does within two and
/// a half of its half-widths. At that distance an error of 8 % in the width already changes the
/// strength by a factor of two.
pub(in crate::sbrdf) const SEEN: f64 = 1.0 / 64.0;

/// Which lobes of some pixels, in rising order, reach [`SEEN`] of their peak in the photograph nearest
/// to the peak; the strength of any other would be a guess (hard case 4).
pub(super) fn supported<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &LobeFitTile,
    pixels: &[usize],
    level: Level,
) -> Vec<[bool; MOST_LOBES]> {
    level.run(Look { photographs, tile, pixels })
}

struct Look<'a, M: LobeEstimation> {
    photographs: &'a Photographs<M>,
    tile: &'a LobeFitTile,
    pixels: &'a [usize],
}

impl<M: LobeEstimation> Kernel for Look<'_, M> {
    type Output = Vec<[bool; MOST_LOBES]>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let width = I::F32::WIDTH;
        let mut supported = Vec::with_capacity(self.pixels.len());
        for some in self.pixels.chunk_by(|a, b| a / width == b / width) {
            let at = some[0] / width * width;
            let seen = self.seen::<I::F32>(at);
            for &pixel in some {
                let lobes = self.tile.estimates[pixel].lobes;
                let mut own = [false; MOST_LOBES];
                for lobe in 0..lobes {
                    own[lobe] = seen[lobe][pixel - at] > 0.0;
                }
                supported.push(own);
            }
        }
        supported
    }
}

#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
impl<M: LobeEstimation> Look<'_, M> {
    /// 1 for the lobes of the pixels from `at` on that are seen, else 0.
    #[inline(always)]
    fn seen<R: Real<Scalar = f32>>(&self, at: usize) -> [[f32; MAX_LANES]; MOST_LOBES] {
        let Self { photographs, tile, .. } = *self;
        let (model, estimates) = (&photographs.model, &tile.estimates);
        let normal = gather_normal(estimates, at);
        let (x, y) = (R::load(&tile.x[at..]), R::load(&tile.y[at..]));
        let nearest = self.nearest(at, normal, x, y);
        let known = nearest.ge(R::zero());
        let pair = self.pair_of(at, nearest);
        let facing = model.facing(&pair);
        let mut seen = [[0.0; MAX_LANES]; MOST_LOBES];
        for lobe in 0..MOST_LOBES {
            let mut shape = [R::zero(); MAX_SHAPES];
            for number in 0..M::SHAPES {
                shape[number] = gather(estimates, at, |estimate| estimate.shapes[lobe][number]);
            }
            let lobe_of_unknowns = model.lobe_from_unknowns(shape);
            let peak = model.value(&lobe_of_unknowns, &pair, facing);
            let reached = model.value(&lobe_of_unknowns, &pair, normal).ge(R::of(SEEN) * peak);
            R::keep(known & reached, R::one()).store(&mut seen[lobe]);
        }
        seen
    }

    /// The photographs that are nearest to the peaks of the pixels from `at` on, by number; -1 where
    /// none counts.
    #[inline(always)]
    fn nearest<R: Real<Scalar = f32>>(&self, at: usize, normal: Vec3<R>, x: R, y: R) -> R {
        let (mut nearest, mut least) = (R::of(-1.0), R::of(f64::NEG_INFINITY));
        for photograph in 0..self.photographs.len() {
            let weight = R::load(&self.tile.grey.weights[photograph * STRIDE + at..]);
            let cosine = self.photographs.facing_at(photograph, x, y).dot(normal);
            let nearer = weight.gt(R::zero()) & cosine.gt(least);
            least = R::select(nearer, cosine, least);
            nearest = R::select(nearer, R::of(photograph as f64), nearest);
        }
        nearest
    }

    /// Light and view of a photograph of its own for each of the pixels from `at` on.
    #[inline(always)]
    fn pair_of<R: Real<Scalar = f32>>(&self, at: usize, photographs: R) -> M::Pair<R> {
        let mut numbers = [0.0; MAX_LANES];
        photographs.store(&mut numbers);
        let mut lanes = [[[0.0; MAX_LANES]; 3]; 2];
        for lane in 0..R::WIDTH {
            let (x, y) = (self.tile.x[at + lane], self.tile.y[at + lane]);
            let pair = self.photographs.directions(numbers[lane].max(0.0) as usize, x, y);
            for (lanes, direction) in lanes.iter_mut().zip(pair) {
                [lanes[0][lane], lanes[1][lane], lanes[2][lane]] = direction.array();
            }
        }
        let [light, view] = lanes.map(|[x, y, z]| Vec3::new(R::load(&x), R::load(&y), R::load(&z)));
        self.photographs.model.pair(light, view)
    }
}

/// Removes the lobes that no photograph supports any more after their shapes have moved.
pub(super) fn drop_unsupported<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &mut LobeFitTile,
    fitted: &[usize],
    level: Level,
) {
    for (&pixel, supported) in fitted.iter().zip(supported(photographs, tile, fitted, level)) {
        let before = tile.estimates[pixel];
        let mut kept = Estimate { lobes: 0, ..before };
        for lobe in (0..before.lobes).filter(|&lobe| supported[lobe]) {
            kept.shapes[kept.lobes] = before.shapes[lobe];
            kept.shape_deviation[kept.lobes] = before.shape_deviation[lobe];
            kept.own_deviation[kept.lobes] = before.own_deviation[lobe];
            kept.lobes += 1;
        }
        tile.estimates[pixel] = kept;
    }
}

#[cfg(test)]
mod tests {
    use super::super::tile::TILE;
    use super::*;
    use crate::geometry::{Grid, Light, Rig, View};
    use crate::stack::{Decode, Samples, Shape, Stack};
    use crate::surface::{LobeModel, TorranceSparrow};

    const LIGHTS: usize = 9;
    const PIXELS: usize = 60;

    /// Some lamps and cameras are near; for one pixel no photograph counts.
    #[test]
    fn supported_lobes_reach_their_share_in_the_nearest_photograph() {
        let model = TorranceSparrow { index: 1.45 };
        let wave = |i: usize, by: f64| (i as f64 * by).sin();
        let lights: Vec<Light> = (0..LIGHTS)
            .map(|i| {
                let towards = Vec3::new(0.6 * wave(i, 2.4), 0.6 * wave(i, 1.7), 0.8).normalised();
                if i % 2 == 0 {
                    Light::Distant(towards)
                } else {
                    Light::Point { position: towards.scale(90.0), falloff: true }
                }
            })
            .collect();
        let views = (0..LIGHTS).map(|i| {
            let eye = Vec3::new(10.0, -5.0, 80.0);
            if i % 3 == 0 { View::Point(eye) } else { View::Distant(Vec3::new(0.0, 0.0, 1.0)) }
        });
        let rig = Rig::new(lights.clone(), views.clone(), Grid::whole(10, 6, 4.0)).unwrap();
        let photographs = Photographs::new(model, &rig, None);
        let shape = Shape { observations: LIGHTS, bands: 1, height: 6, width: 10 };
        let decode = [Decode { gain: 1.0, offset: 0.0, saturation: f32::INFINITY }; LIGHTS];
        let samples = [0.0; LIGHTS * PIXELS];
        let stack = Stack::new(Samples::F32(&samples), shape, &decode, None).unwrap();
        let mut tile = LobeFitTile::new(&stack);
        rig.grid().coordinates(0, &mut tile.x[..PIXELS], &mut tile.y[..PIXELS]);
        for i in 0..PIXELS {
            let normal = Vec3::new(0.3 * wave(i, 0.9), 0.3 * wave(i, 1.9), 1.0).normalised();
            let mut estimate = Estimate::new(normal.array().map(|v| v as f32));
            estimate.lobes = i % 3;
            estimate.shapes[0][0] = 6.0 + 1.5 * wave(i, 0.4) as f32;
            estimate.shapes[1][0] = 4.0 + 2.0 * wave(i, 0.7) as f32;
            tile.estimates.push(estimate);
            for photograph in 0..LIGHTS {
                let counts = i != 4 && (i + photograph) % 5 != 0;
                tile.grey.weights[photograph * STRIDE + i] = f32::from(u8::from(counts));
            }
        }
        const { assert!(PIXELS <= TILE) };
        let mut close = 0;
        let expected: Vec<[bool; MOST_LOBES]> = (0..PIXELS)
            .map(|i| {
                let Estimate { normal, shapes, lobes, .. } = tile.estimates[i];
                let [x, y, z] = normal.map(f64::from);
                let normal = Vec3::new(x, y, z);
                let [x, y] = [f64::from(tile.x[i]), f64::from(tile.y[i])];
                let (mut nearest, mut pair) = (f64::NEG_INFINITY, None);
                for (photograph, (light, view)) in lights.iter().zip(views.clone()).enumerate() {
                    let (light, view) = (light.at(x, y).0, view.at(x, y));
                    let cosine = (light + view).normalised().dot(normal);
                    let counts = tile.grey.weights[photograph * STRIDE + i] > 0.0;
                    if counts && cosine > nearest {
                        (nearest, pair) = (cosine, Some((light, view)));
                    }
                }
                let mut supported = [false; MOST_LOBES];
                let Some((light, view)) = pair else { return supported };
                for lobe in 0..lobes {
                    let pair = model.pair(light, view);
                    let own = f64::from(shapes[lobe][0]).exp();
                    let facing = (light + view).normalised();
                    let peak = model.value(&own, &pair, facing);
                    let share = model.value(&own, &pair, normal) / peak;
                    supported[lobe] = share >= SEEN;
                    // Single precision changes an exponent of up to 100 by 1e-5.
                    close += usize::from((share / SEEN - 1.0).abs() < 1e-3);
                }
                supported
            })
            .collect();
        assert_eq!(close, 0, "a share at the limit tells nothing");
        let lobes: usize = expected.iter().flatten().map(|&seen| usize::from(seen)).sum();
        assert!((10..50).contains(&lobes), "{lobes}");
        let pixels: Vec<usize> = (0..PIXELS).collect();
        let some: Vec<usize> = pixels.iter().copied().filter(|pixel| pixel % 7 != 2).collect();
        for level in Level::ALL.into_iter().filter(|level| level.available()) {
            assert_eq!(supported(&photographs, &tile, &pixels, level), expected, "{level:?}");
            let found = supported(&photographs, &tile, &some, level);
            assert!(found.iter().zip(&some).all(|(found, &pixel)| *found == expected[pixel]));
        }
    }
}
