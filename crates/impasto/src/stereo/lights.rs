//! Directions and irradiances of the lights at one register of pixels.

use crate::geometry::Rig;
use crate::math::{Real, Vec3};

/// Directions and irradiances at one register of pixels.
pub(super) trait Lights<R: Real> {
    /// Whether they are the same at every pixel.
    const DISTANT: bool;

    fn new(rig: &Rig) -> Self;
    /// Seen from the points `(x, y)` in mm.
    fn aim(&mut self, rig: &Rig, x: R, y: R);
    /// Direction to the light times its irradiance.
    fn at(&self, light: usize) -> Vec3<R>;
    /// One over its irradiance.
    fn per_irradiance(&self, light: usize) -> R;
}

/// One number per component, which fills a register on its way out of memory.
pub(super) struct Distant(Vec<Vec3<f32>>);

impl<R: Real<Scalar = f32>> Lights<R> for Distant {
    const DISTANT: bool = true;

    fn new(rig: &Rig) -> Self {
        Self(rig.lights().iter().map(|light| light.direction().splat()).collect())
    }
    #[inline(always)]
    fn aim(&mut self, _: &Rig, _: R, _: R) {}
    #[inline(always)]
    fn at(&self, light: usize) -> Vec3<R> {
        self.0[light].fill()
    }
    #[inline(always)]
    fn per_irradiance(&self, _: usize) -> R {
        R::one()
    }
}

/// Every pixel has its own.
pub(super) struct Near<R>(Vec<(Vec3<R>, R)>);

impl<R: Real> Lights<R> for Near<R> {
    const DISTANT: bool = false;

    #[inline(always)]
    fn new(rig: &Rig) -> Self {
        let zero = R::zero();
        Self(vec![(Vec3::new(zero, zero, zero), zero); rig.observations()])
    }
    #[inline(always)]
    fn aim(&mut self, rig: &Rig, x: R, y: R) {
        for (light, seen) in rig.lights().iter().zip(&mut self.0) {
            let (towards, irradiance) = light.at(x, y);
            *seen = (towards.scale(irradiance), irradiance.recip());
        }
    }
    #[inline(always)]
    fn at(&self, light: usize) -> Vec3<R> {
        self.0[light].0
    }
    #[inline(always)]
    fn per_irradiance(&self, light: usize) -> R {
        self.0[light].1
    }
}
