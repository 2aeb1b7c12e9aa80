//! Which lobes the photographs support.
//!
//! A narrow lobe can fit one outlying sample with its outermost slope. Its peak, where there is no
//! photograph, may then have any height, and another light would show it.

use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Vec3};

use super::model::LobeEstimation;
use super::photographs::Photographs;
use super::tile::{Estimate, LobeFitTile, TILE};

/// Least fraction of its peak that a lobe must reach in some photograph, which it does within two and
/// a half of its half-widths. At that distance an error of 8 % in the width already changes the
/// strength by a factor of two.
pub(in crate::sbrdf) const SEEN: f64 = 1.0 / 64.0;

/// Whether a pixel's lobe reaches [`SEEN`] of its peak in the photograph nearest to the peak; if not,
/// its strength would be a guess (hard case 4).
pub(super) fn is_supported<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &LobeFitTile,
    pixel: usize,
    lobe: usize,
    level: Level,
) -> bool {
    level.run(Look { photographs, tile, pixel, lobe })
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct Look<'a, M: LobeEstimation> {
    photographs: &'a Photographs<M>,
    tile: &'a LobeFitTile,
    pixel: usize,
    lobe: usize,
}

impl<M: LobeEstimation> Kernel for Look<'_, M> {
    type Output = bool;

    #[inline(always)]
    fn run<I: Isa>(self) -> bool {
        let Self { photographs, tile, pixel, lobe } = self;
        let Estimate { normal, shapes, .. } = &tile.estimates[pixel];
        let [nx, ny, nz] = normal.map(f64::from);
        let normal = Vec3::new(nx, ny, nz);
        let [x, y] = [&tile.x, &tile.y].map(|axis| f64::from(axis[pixel]));
        let model = &photographs.model;
        let nearest = (0..photographs.len())
            .filter(|photograph| tile.grey.weights[photograph * TILE + pixel] > 0.0)
            .map(|photograph| (photographs.facing_at(photograph, x, y).dot(normal), photograph))
            .max_by(|(a, _), (b, _)| a.total_cmp(b));
        nearest.is_some_and(|(_, photograph)| {
            let (_, _, pair) = photographs.at::<f64>(photograph, x, y);
            let lobe = model.lobe_from_unknowns(shapes[lobe].map(f64::from));
            let peak = model.value(&lobe, &pair, model.facing(&pair));
            model.value(&lobe, &pair, normal) >= SEEN * peak
        })
    }
}

/// Removes the lobes that no photograph supports any more after their shapes have moved.
pub(super) fn drop_unsupported<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &mut LobeFitTile,
    fitted: &[usize],
    level: Level,
) {
    for &pixel in fitted {
        let before = tile.estimates[pixel];
        let mut kept = Estimate { lobes: 0, ..before };
        for lobe in
            (0..before.lobes).filter(|&lobe| is_supported(photographs, tile, pixel, lobe, level))
        {
            kept.shapes[kept.lobes] = before.shapes[lobe];
            kept.shape_deviation[kept.lobes] = before.shape_deviation[lobe];
            kept.own_deviation[kept.lobes] = before.own_deviation[lobe];
            kept.lobes += 1;
        }
        tile.estimates[pixel] = kept;
    }
}
