//! What travels from stage to stage: a few hundred pixels, one array per quantity.

use crate::math::{Isa, Mask, Real, Vec3, tail};

/// Pixels of a block: its arrays stay in the first-level cache, and it is a multiple of every
/// register's lanes.
pub(crate) const BLOCK: usize = 256;

pub(crate) type Plane = [f32; BLOCK];

/// What the pixels of a block are: planes of the painting's maps, or copies of their last values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pixels<'a> {
    /// Unit normals; NaN where there is none.
    pub(crate) normal: [&'a Plane; 3],
    /// Reflectance.
    pub(crate) coefficients: &'a [&'a Plane],
    /// The number of the first pixel.
    pub(crate) start: usize,
    /// How many there are; what stands behind them in a plane may be anything.
    pub(crate) count: usize,
}

impl Pixels<'_> {
    #[inline(always)]
    pub(crate) fn normal<I: Isa>(&self, lane: usize) -> Vec3<I::F32> {
        let [x, y, z] = self.normal;
        Vec3::new(I::F32::load(&x[lane..]), I::F32::load(&y[lane..]), I::F32::load(&z[lane..]))
    }
}

/// The first lane of each register that holds some of so many pixels.
#[inline(always)]
pub(crate) fn lanes<I: Isa>(count: usize) -> impl Iterator<Item = usize> {
    let starts = (0..BLOCK / I::F32::WIDTH).map(|register| register * I::F32::WIDTH);
    starts.take_while(move |&lane| lane < count)
}

/// The light of the pixels that go through all stages together.
#[derive(Debug)]
pub(crate) struct Block {
    /// Where the pixels lie, mm.
    pub(crate) x: Plane,
    pub(crate) y: Plane,
    /// Irradiance of the current lamp at normal incidence.
    pub(crate) reach: Plane,
    /// Diffuse geometry of the lamps of one colour: the sum of `(N.L) E`; 0 before the first.
    pub(crate) diffuse: Plane,
    /// Interface reflection of the lamps of one colour: the sum of `beta D F G / (N.V) E`.
    pub(crate) specular: Plane,
    /// Whether there is any of it.
    pub(crate) shiny: bool,
    /// Light of all colours.
    pub(crate) light: [Plane; 3],
    /// Whether there is none yet, whatever `light` holds.
    dark: bool,
}

impl Block {
    pub(crate) fn new() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            x: zero,
            y: zero,
            reach: zero,
            diffuse: zero,
            specular: zero,
            shiny: false,
            light: [zero; 3],
            dark: true,
        }
    }

    /// Makes room for pixels without light.
    #[inline(always)]
    pub(crate) fn begin(&mut self) {
        self.dark = true;
    }

    /// Before light is set: whether there was none. It is then all set.
    #[inline(always)]
    pub(crate) fn was_dark(&mut self) -> bool {
        core::mem::take(&mut self.dark)
    }

    /// Before light is added.
    #[inline(always)]
    pub(crate) fn lighten(&mut self) {
        if self.was_dark() {
            self.light = [[0.0; BLOCK]; 3];
        }
    }

    /// Shows the background where a pixel has no normal or no light, and says which pixels are
    /// covered.
    #[inline(always)]
    pub(crate) fn cover<I: Isa>(
        &mut self,
        pixels: &Pixels<'_>,
        background: [f32; 3],
        coverage: &mut [f32],
    ) {
        let zero = I::F32::zero();
        for lane in lanes::<I>(pixels.count) {
            // 0 times a number is 0, times anything else it is NaN.
            let mut nothing = zero;
            for plane in pixels.normal {
                nothing = I::F32::load(&plane[lane..]).mul_add(zero, nothing);
            }
            for plane in &self.light {
                nothing = I::F32::load(&plane[lane..]).mul_add(zero, nothing);
            }
            let known = nothing.le(zero);
            tail::store(I::F32::keep(known, I::F32::one()), coverage, lane);
            if !known.all() {
                for (plane, behind) in self.light.iter_mut().zip(background) {
                    let light = I::F32::load(&plane[lane..]);
                    let shown = I::F32::select(known, light, I::F32::splat(behind));
                    shown.store(&mut plane[lane..]);
                }
            }
        }
    }
}

/// The values of a map from `start` on: where they lie, or, fewer than a block, copied, and NaN behind
/// them.
#[inline(always)]
pub(crate) fn plane<'a>(
    map: &'a [f32],
    start: usize,
    count: usize,
    copy: &'a mut Plane,
) -> &'a Plane {
    match map[start..].first_chunk() {
        Some(whole) if count == BLOCK => whole,
        _ => {
            copied(map, start, count, copy);
            copy
        }
    }
}

/// The values of a map from `start` on, NaN behind its end.
#[inline(always)]
pub(crate) fn copied(map: &[f32], start: usize, count: usize, out: &mut Plane) {
    out[..count].copy_from_slice(&map[start..start + count]);
    out[count..].fill(f32::NAN);
}
