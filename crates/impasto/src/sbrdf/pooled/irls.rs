//! Every pixel's normal and colours under the painting's lobe by iteratively reweighted least squares
//! [@holland1977robust].
//!
//! A pixel's estimate is the S-estimate [@rousseeuw1984s], of smallest robust scale
//! ([`scale`](super::scale)). Gauss-Newton steps on the weighted sum of squares lead to it
//! ([`descent`](super::descent)); a step that does not lower the scale is shortened.

use crate::math::Kernel;
use crate::math::lanes::Isa;
use crate::pixels::Run;

use super::descent::{Lanes, Paths, Stopping};
use super::pixel::{CommonLobe, Pixels};
use super::samples::{Photographs, PooledTile, Samples, TileMut};
use super::scale::Gaussian;

/// Squared scales up to this many noise floors are noise: twice those that a quarter of the painting
/// stays below.
const NOISE: f64 = 8.0;

pub(super) struct Irls<'a, 'b> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'b PooledTile<'a>,
    pub(super) out: &'b mut TileMut<'a>,
    pub(super) samples: &'b Samples,
    pub(super) lobe: CommonLobe,
    pub(super) stopping: Stopping,
    /// Whether pixels that are not well described, or not in so many steps, start from two more
    /// normals, one that faces the viewer and the facet that mirrors the brightest photograph: a
    /// highlight that photometric stereo took for the diffuse part turns a normal far away, where no
    /// small step leads back.
    pub(super) restart: bool,
    pub(super) noise_floor: f64,
    pub(super) gaussian: Gaussian,
}

impl Kernel for Irls<'_, '_> {
    type Output = ();

    /// Nothing that a cancelled run leaves is used.
    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { photographs, run, tile, out, samples, lobe, stopping, gaussian, .. } = self;
        let pixels = &mut Pixels::<I::F32>::new(photographs, lobe);
        let lanes = &mut Lanes::new(photographs.bands, photographs.pairs.len());
        let noise = self.restart.then_some(self.noise_floor * NOISE);
        // Between the factors that normal noise and far outliers ask for.
        let relaxation = 2.0 / (1.0 + gaussian.curvature);
        let paths = &Paths { samples, tile, stopping, noise, relaxation, run };
        if lobe.beta > 0.0 {
            lanes.descend::<true, 2>(pixels, paths, out);
        } else {
            lanes.descend::<false, 0>(pixels, paths, out);
        }
    }
}
