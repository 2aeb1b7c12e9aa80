//! Which lobes the photographs show, and which they only seem to ask for.
//!
//! A narrow lobe beside one odd sample fits it with its outermost slope. Its peak, where no
//! photograph looked, may then be as high as anything: another light would find it there.

use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Vec3};

use super::model::LobeModel;
use super::sight::Sight;
use super::tile::{Place, TILE, Tile};

/// Least share of its peak that a lobe must reach in some photograph: at two and a half of its
/// half-widths. There, eight percent of the width already change the strength by a factor of two.
pub(in crate::sbrdf) const SEEN: f64 = 1.0 / 64.0;

/// Whether a pixel's lobe stands out in the photograph nearest to its peak: else its strength
/// would be a guess (hard case 4).
pub(super) fn sees<M: LobeModel>(
    sight: &Sight<'_, M>,
    tile: &Tile,
    pixel: usize,
    lobe: usize,
    level: Level,
) -> bool {
    level.run(Look { sight, tile, pixel, lobe })
}

/// A kernel, though it has no lanes: elsewhere a fused multiply-add is a call.
struct Look<'a, 'b, M: LobeModel> {
    sight: &'a Sight<'b, M>,
    tile: &'a Tile,
    pixel: usize,
    lobe: usize,
}

impl<M: LobeModel> Kernel for Look<'_, '_, M> {
    type Output = bool;

    #[inline(always)]
    fn run<I: Isa>(self) -> bool {
        let Self { sight, tile, pixel, lobe } = self;
        let Place { normal, shapes, .. } = &tile.places[pixel];
        let [nx, ny, nz] = normal.map(f64::from);
        let normal = Vec3::new(nx, ny, nz);
        let [x, y] = [&tile.x, &tile.y].map(|axis| f64::from(axis[pixel]));
        let model = &sight.model;
        let nearest = (0..sight.photographs())
            .filter(|photograph| tile.grey.weights[photograph * TILE + pixel] > 0.0)
            .map(|photograph| (sight.facing_at(photograph, x, y).dot(normal), photograph))
            .max_by(|(a, _), (b, _)| a.total_cmp(b));
        nearest.is_some_and(|(_, photograph)| {
            let (_, _, pair) = sight.at::<f64>(photograph, x, y);
            let lobe = model.lobe(shapes[lobe].map(f64::from));
            let peak = model.value(&lobe, &pair, model.facing(&pair));
            model.value(&lobe, &pair, normal) >= SEEN * peak
        })
    }
}

/// Leaves out lobes that no photograph shows any more, their shapes having moved.
pub(super) fn drop_unseen<M: LobeModel>(
    sight: &Sight<'_, M>,
    tile: &mut Tile,
    fine: &[usize],
    level: Level,
) {
    for &pixel in fine {
        let before = tile.places[pixel];
        let mut place = Place { lobes: 0, ..before };
        for lobe in (0..before.lobes).filter(|&lobe| sees(sight, tile, pixel, lobe, level)) {
            place.shapes[place.lobes] = before.shapes[lobe];
            place.shape_spread[place.lobes] = before.shape_spread[lobe];
            place.seen_spread[place.lobes] = before.seen_spread[lobe];
            place.lobes += 1;
        }
        tile.places[pixel] = place;
    }
}
