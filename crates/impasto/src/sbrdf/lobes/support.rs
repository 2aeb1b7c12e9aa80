//! Which lobes the photographs support.
//!
//! A narrow lobe can fit one outlying sample with its outermost slope. Its peak, where there is no
//! photograph, may then have any height, and another light would show it.

use crate::math::lanes::Isa;
use crate::math::{Kernel, Level, Vec3};

use super::maps::MOST_LOBES;
use super::model::LobeEstimation;
use super::photographs::Photographs;
use super::tile::{Estimate, LobeFitTile, STRIDE};

/// Least fraction of its peak that a lobe must reach in some photograph, which it does within two and
/// a half of its half-widths. At that distance an error of 8 % in the width already changes the
/// strength by a factor of two.
pub(in crate::sbrdf) const SEEN: f64 = 1.0 / 64.0;

/// Which of a pixel's lobes reach [`SEEN`] of their peak in the photograph nearest to the peak; the
/// strength of any other would be a guess (hard case 4).
pub(super) fn supported<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &LobeFitTile,
    pixel: usize,
    level: Level,
) -> [bool; MOST_LOBES] {
    level.run(Look { photographs, tile, pixel })
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct Look<'a, M: LobeEstimation> {
    photographs: &'a Photographs<M>,
    tile: &'a LobeFitTile,
    pixel: usize,
}

impl<M: LobeEstimation> Kernel for Look<'_, M> {
    type Output = [bool; MOST_LOBES];

    #[inline(always)]
    fn run<I: Isa>(self) -> [bool; MOST_LOBES] {
        let Self { photographs, tile, pixel } = self;
        let Estimate { normal, shapes, lobes, .. } = &tile.estimates[pixel];
        let mut supported = [false; MOST_LOBES];
        if *lobes == 0 {
            return supported;
        }
        let [nx, ny, nz] = normal.map(f64::from);
        let normal = Vec3::new(nx, ny, nz);
        let [x, y] = [&tile.x, &tile.y].map(|axis| f64::from(axis[pixel]));
        let model = &photographs.model;
        let nearest = (0..photographs.len())
            .filter(|photograph| tile.grey.weights[photograph * STRIDE + pixel] > 0.0)
            .map(|photograph| (photographs.facing_at(photograph, x, y).dot(normal), photograph))
            .max_by(|(a, _), (b, _)| a.total_cmp(b));
        if let Some((_, photograph)) = nearest {
            let (_, _, pair) = photographs.at::<f64>(photograph, x, y);
            for (shape, supported) in shapes[..*lobes].iter().zip(&mut supported) {
                let lobe = model.lobe_from_unknowns(shape.map(f64::from));
                let peak = model.value(&lobe, &pair, model.facing(&pair));
                *supported = model.value(&lobe, &pair, normal) >= SEEN * peak;
            }
        }
        supported
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
        let supported = supported(photographs, tile, pixel, level);
        for lobe in (0..before.lobes).filter(|&lobe| supported[lobe]) {
            kept.shapes[kept.lobes] = before.shapes[lobe];
            kept.shape_deviation[kept.lobes] = before.shape_deviation[lobe];
            kept.own_deviation[kept.lobes] = before.own_deviation[lobe];
            kept.lobes += 1;
        }
        tile.estimates[pixel] = kept;
    }
}
