//! The normal that mirrors a pixel's brightest light into its view.

use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Real, Vec3};

use super::model::LobeEstimation;
use super::photographs::Photographs;
use super::tile::{LobeFitTile, STRIDE};

/// The normals that mirror the brightest photograph of each of a tile's pixels, per irradiance: a near
/// lamp is no brighter for being nearer, and it shines on every pixel from elsewhere.
pub(super) fn brightest<M: LobeEstimation>(
    photographs: &Photographs<M>,
    tile: &LobeFitTile,
    level: Level,
) -> Vec<[f32; 3]> {
    level.run(Look { photographs, tile })
}

struct Look<'a, M: LobeEstimation> {
    photographs: &'a Photographs<M>,
    tile: &'a LobeFitTile,
}

impl<M: LobeEstimation> Kernel for Look<'_, M> {
    type Output = Vec<[f32; 3]>;

    #[inline(always)]
    fn run<I: Isa>(self) -> Vec<[f32; 3]> {
        let Self { photographs, tile } = self;
        let count = tile.estimates.len();
        let mut normals = vec![[0.0; 3]; count];
        for at in (0..count).step_by(I::F32::WIDTH) {
            let (x, y) = (I::F32::load(&tile.x[at..]), I::F32::load(&tile.y[at..]));
            let zero = I::F32::zero();
            let (mut most, mut facing) =
                (I::F32::of(f64::NEG_INFINITY), Vec3::new(zero, zero, zero));
            for photograph in 0..photographs.len() {
                let sample = I::F32::load(&tile.grey.samples[photograph * STRIDE + at..]);
                let light = sample / photographs.irradiance(photograph, x, y);
                let brighter = light.gt(most);
                most = I::F32::select(brighter, light, most);
                let own = photographs.facing_at(photograph, x, y);
                facing.x = I::F32::select(brighter, own.x, facing.x);
                facing.y = I::F32::select(brighter, own.y, facing.y);
                facing.z = I::F32::select(brighter, own.z, facing.z);
            }
            let mut lanes = [[0.0; MAX_LANES]; 3];
            facing.x.store(&mut lanes[0]);
            facing.y.store(&mut lanes[1]);
            facing.z.store(&mut lanes[2]);
            for (lane, normal) in normals[at..].iter_mut().enumerate().take(I::F32::WIDTH) {
                *normal = [lanes[0][lane], lanes[1][lane], lanes[2][lane]];
            }
        }
        normals
    }
}
