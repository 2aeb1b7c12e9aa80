//! The normal that mirrors a pixel's brightest light into its view.

use crate::math::lanes::Isa;
use crate::math::{Kernel, Level};

use super::model::LobeEstimation;
use super::photographs::Photographs;
use super::tile::{LobeFitTile, STRIDE};

/// The normal that mirrors the brightest photograph, per irradiance: a near lamp is no brighter
/// for being nearer, and it shines on every pixel from elsewhere.
pub(super) fn brightest<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &LobeFitTile,
    pixel: usize,
    level: Level,
) -> [f32; 3] {
    level.run(Look { photographs, tile, pixel })
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct Look<'a, M: LobeEstimation> {
    photographs: &'a Photographs<M>,
    tile: &'a LobeFitTile,
    pixel: usize,
}

impl<M: LobeEstimation> Kernel for Look<'_, M> {
    type Output = [f32; 3];

    #[inline(always)]
    fn run<I: Isa>(self) -> [f32; 3] {
        let Self { photographs, tile, pixel } = self;
        let [x, y] = [&tile.x, &tile.y].map(|axis| f64::from(axis[pixel]));
        let samples = tile.grey.samples[pixel..].iter().step_by(STRIDE);
        let mut best = (f64::NEG_INFINITY, 0);
        for (photograph, &sample) in samples.enumerate() {
            let (_, irradiance, _) = photographs.at::<f64>(photograph, x, y);
            let light = f64::from(sample) / irradiance;
            if light > best.0 {
                best = (light, photograph);
            }
        }
        photographs.facing_at(best.1, x, y).array().map(|v| v as f32)
    }
}
