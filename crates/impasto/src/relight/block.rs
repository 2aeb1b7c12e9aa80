//! What travels from stage to stage: a few hundred pixels, one array per quantity.

/// Pixels of a block: its arrays stay in the first-level cache, and it is a multiple of every
/// register's lanes.
pub(crate) const BLOCK: usize = 256;

pub(crate) type Plane = [f32; BLOCK];

/// The pixels that go through all stages together.
#[derive(Debug)]
pub(crate) struct Block {
    /// How many there are; the rest of each array holds anything.
    pub(crate) count: usize,
    /// Unit normals; NaN where there is none.
    pub(crate) normal: [Plane; 3],
    /// Where the pixels lie, mm.
    pub(crate) x: Plane,
    pub(crate) y: Plane,
    /// Irradiance of the current lamp at normal incidence.
    pub(crate) reach: Plane,
    /// Diffuse geometry of the lamps of one colour: the sum of `(N.L) E`.
    pub(crate) diffuse: Plane,
    /// Interface reflection of the lamps of one colour: the sum of `beta D F G / (N.V) E`.
    pub(crate) specular: Plane,
    /// Light of all colours.
    pub(crate) light: [Plane; 3],
}

impl Block {
    pub(crate) fn new() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            count: BLOCK,
            normal: [zero; 3],
            x: zero,
            y: zero,
            reach: zero,
            diffuse: zero,
            specular: zero,
            light: [zero; 3],
        }
    }

    /// Makes room for so many pixels without light.
    #[inline(always)]
    pub(crate) fn begin(&mut self, count: usize) {
        self.count = count;
        self.light = [[0.0; BLOCK]; 3];
        self.diffuse = [0.0; BLOCK];
        self.specular = [0.0; BLOCK];
    }

    /// Shows the background where a pixel has no normal or no light, and says which pixels are
    /// covered.
    #[inline(always)]
    pub(crate) fn cover(&mut self, background: [f32; 3], coverage: &mut [f32]) {
        for (pixel, covered) in coverage.iter_mut().enumerate() {
            let normal: f32 = self.normal.iter().map(|plane| 0.0 * plane[pixel]).sum();
            let light: f32 = self.light.iter().map(|plane| 0.0 * plane[pixel]).sum();
            let known = normal + light == 0.0;
            *covered = if known { 1.0 } else { 0.0 };
            for (plane, background) in self.light.iter_mut().zip(background) {
                plane[pixel] = if known { plane[pixel] } else { background };
            }
        }
    }
}

/// The values of a map from `start` on, NaN behind its end.
#[inline(always)]
pub(crate) fn copied(map: &[f32], start: usize, count: usize, out: &mut Plane) {
    out[..count].copy_from_slice(&map[start..start + count]);
    out[count..].fill(f32::NAN);
}
