//! Samples of known angle.

/// Samples and their angles, both `(obs, pixel)`.
#[derive(Clone, Copy, Debug)]
pub struct Highlights<'a> {
    /// Specular light; what is not finite does not count.
    pub samples: &'a [f32],
    /// Angle between normal and half vector, rad; what is not finite does not count.
    pub phi: &'a [f32],
    /// How many pixels there are.
    pub pixels: usize,
}
