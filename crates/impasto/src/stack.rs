//! Borrowed samples: the photographs as they lie in the caller's memory.

use core::ops::Range;

use half::f16;

use crate::error::{Error, Result};
use crate::interreflections::Interreflections;
use crate::math::lanes::prefetch;

/// Sizes of a stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Photographs.
    pub observations: usize,
    /// Camera channels.
    pub bands: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl Shape {
    /// Pixels of one plane.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// Samples of the whole stack.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.observations * self.bands * self.pixels()
    }
}

/// Stored samples in any of the types that files hold, `(obs, band, y, x)` in C order.
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// 8-bit codes.
    U8(&'a [u8]),
    /// 16-bit codes.
    U16(&'a [u16]),
    /// Half-precision numbers.
    F16(&'a [f16]),
    /// Single-precision numbers.
    F32(&'a [f32]),
}

impl Samples<'_> {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(s) => s.len(),
            Self::U16(s) => s.len(),
            Self::F16(s) => s.len(),
            Self::F32(s) => s.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Some of them as linear light.
    #[inline(always)]
    fn convert(&self, range: Range<usize>, out: &mut [f32], linear: impl Fn(f32) -> f32) {
        match self {
            Self::U8(s) => fill(out, &s[range], |stored| linear(f32::from(stored))),
            Self::U16(s) => fill(out, &s[range], |stored| linear(f32::from(stored))),
            Self::F16(s) => fill(out, &s[range], |stored| linear(f16::to_f32(stored))),
            Self::F32(s) => fill(out, &s[range], linear),
        }
    }
}

#[inline(always)]
fn fill<T: Copy>(out: &mut [f32], stored: &[T], linear: impl Fn(T) -> f32) {
    for (out, &stored) in out.iter_mut().zip(stored) {
        *out = linear(stored);
    }
}

/// How a stored number becomes a linear sample: `s * gain + offset`, and `+inf` from `saturation`
/// on.
#[derive(Clone, Copy, Debug)]
pub struct Decode {
    /// Linear light per stored unit, divided by the light's intensity.
    pub gain: f32,
    /// Minus the black level, in linear light.
    pub offset: f32,
    /// Stored number from which a sample is clipped (`+inf` where nothing clips).
    pub saturation: f32,
}

impl Decode {
    /// A stored number as linear light.
    #[inline(always)]
    fn linear(self, stored: f32) -> f32 {
        let linear = stored.mul_add(self.gain, self.offset);
        if stored >= self.saturation { f32::INFINITY } else { linear }
    }

    /// The same sample in another unit: so many times as large.
    #[must_use]
    pub fn times(self, factor: f32) -> Self {
        Self { gain: self.gain * factor, offset: self.offset * factor, ..self }
    }
}

/// All samples of one painting.
///
/// Samples are linear, relative to a white board under unit light; `+inf` is a clipped sample,
/// NaN one that was never taken.
#[derive(Clone, Copy, Debug)]
pub struct Stack<'a> {
    samples: Samples<'a>,
    shape: Shape,
    decode: &'a [Decode],
    mask: Option<&'a [bool]>,
    interreflections: Option<&'a Interreflections<'a>>,
}

impl<'a> Stack<'a> {
    /// A stack over borrowed memory.
    ///
    /// `decode` holds one entry per (observation, band); `mask` is `(y, x)`, true where the
    /// painting is.
    ///
    /// # Errors
    /// If the lengths do not agree with the shape.
    pub fn new(
        samples: Samples<'a>,
        shape: Shape,
        decode: &'a [Decode],
        mask: Option<&'a [bool]>,
    ) -> Result<Self> {
        if samples.len() != shape.samples() || samples.is_empty() {
            let problem = format!("{} samples do not fill {shape:?}", samples.len());
            return Err(Error::argument("samples", problem));
        }
        if decode.len() != shape.observations * shape.bands {
            let problem = format!(
                "expected one entry per observation and band ({}), found {}",
                shape.observations * shape.bands,
                decode.len()
            );
            return Err(Error::argument("decode", problem));
        }
        if mask.is_some_and(|mask| mask.len() != shape.pixels()) {
            return Err(Error::argument("mask", "its size is not that of the photographs"));
        }
        Ok(Self { samples, shape, decode, mask, interreflections: None })
    }

    /// The same photographs without the light that pixels get from others. `decode` then counts in
    /// linear light: what is left of a sample is its stored number.
    ///
    /// # Errors
    /// If the lengths do not agree with the shape.
    pub fn without(self, interreflections: &'a Interreflections<'a>) -> Result<Self> {
        let Shape { observations, bands, height, width } = self.shape;
        interreflections.check(observations, bands, [height, width])?;
        Ok(Self { interreflections: Some(interreflections), ..self })
    }

    /// How stored numbers become linear samples, one entry per (observation, band).
    #[must_use]
    pub fn decode(&self) -> &'a [Decode] {
        self.decode
    }

    /// The same stored numbers, decoded otherwise.
    ///
    /// # Errors
    /// If there is not one entry per (observation, band).
    pub fn decoded<'b>(&self, decode: &'b [Decode]) -> Result<Stack<'b>>
    where
        'a: 'b,
    {
        let stack: Stack<'b> = Stack::new(self.samples, self.shape, decode, self.mask)?;
        Ok(Stack { interreflections: self.interreflections, ..stack })
    }

    /// Sizes.
    #[must_use]
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// `(y, x)`, true where the painting is; none if it is everywhere.
    #[must_use]
    #[inline]
    pub fn mask(&self) -> Option<&'a [bool]> {
        self.mask
    }

    /// Whether a pixel, counted row by row, belongs to the painting.
    #[must_use]
    #[inline]
    pub fn covers(&self, pixel: usize) -> bool {
        self.mask.is_none_or(|mask| mask[pixel])
    }

    /// A number that no finite sample exceeds in size, where the type of what is stored tells.
    #[must_use]
    pub fn largest(&self) -> Option<f32> {
        let code = match self.samples {
            Samples::U8(_) => f32::from(u8::MAX),
            Samples::U16(_) => f32::from(u16::MAX),
            Samples::F16(_) => f32::from(f16::MAX),
            Samples::F32(_) => return None,
        };
        if self.interreflections.is_some() {
            return None;
        }
        let size = |decode: &Decode| code.mul_add(decode.gain.abs(), decode.offset.abs());
        // NaN is larger than any.
        Some(
            self.decode
                .iter()
                .map(size)
                .fold(0.0, |most, size| if size <= most { most } else { size }),
        )
    }

    /// Linear light from which samples of one photograph and band are clipped, `+inf` where none is.
    #[must_use]
    pub fn ceiling(&self, observation: usize, band: usize) -> f32 {
        let decode = self.decode[observation * self.shape.bands + band];
        decode.saturation.mul_add(decode.gain, decode.offset)
    }

    /// Prefetches the memory of so many pixels from `start` on, of one photograph and band, that are
    /// to be read soon.
    #[inline(always)]
    pub fn prefetch(&self, observation: usize, band: usize, start: usize, count: usize) {
        let pixels = self.shape.pixels();
        let plane = observation * self.shape.bands + band;
        let (start, end) = (start.min(pixels), (start + count).min(pixels));
        let range = plane * pixels + start..plane * pixels + end;
        match self.samples {
            Samples::U8(s) => prefetch(&s[range]),
            Samples::U16(s) => prefetch(&s[range]),
            Samples::F16(s) => prefetch(&s[range]),
            Samples::F32(s) => prefetch(&s[range]),
        }
    }

    /// Reads linear samples of one photograph and band, for the pixels from `start` on, into
    /// `out`: as many as there are, at most `out.len()`; what is left of `out` becomes NaN.
    #[inline(always)]
    pub fn read(&self, observation: usize, band: usize, start: usize, out: &mut [f32]) {
        let plane = observation * self.shape.bands + band;
        let pixels = self.shape.pixels();
        let count = out.len().min(pixels - start);
        let range = plane * pixels + start..plane * pixels + start + count;
        let decode = self.decode[plane];
        let (head, tail) = out.split_at_mut(count);
        if let Some(interreflections) = self.interreflections {
            self.read_without(interreflections, plane, range, head);
            for sample in head {
                *sample = decode.linear(*sample);
            }
        } else {
            self.samples.convert(range, head, |stored| decode.linear(stored));
        }
        tail.fill(f32::NAN);
    }

    /// The samples of some pixels without light from others, before they are decoded. Not inlined:
    /// few stacks need it, and it would be compiled for every instruction set.
    #[inline(never)]
    fn read_without(
        &self,
        interreflections: &Interreflections<'_>,
        plane: usize,
        range: Range<usize>,
        out: &mut [f32],
    ) {
        let (band, start) = (plane % self.shape.bands, range.start - plane * self.shape.pixels());
        self.samples.convert(range, out, |stored| interreflections.linear(band, stored));
        interreflections.take_off(plane, start, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Shape = Shape { observations: 1, bands: 1, height: 1, width: 3 };

    #[test]
    fn stored_codes_become_linear_and_clipped_ones_infinite() {
        let decode = [Decode { gain: 0.5, offset: -1.0, saturation: 255.0 }];
        let stack = Stack::new(Samples::U8(&[2, 4, 255]), SHAPE, &decode, None).unwrap();
        let mut out = [0.0; 4];
        stack.read(0, 0, 0, &mut out);
        assert_eq!(&out[..3], &[0.0, 1.0, f32::INFINITY]);
        assert!(out[3].is_nan());
    }

    #[test]
    fn lengths_that_disagree_are_refused() {
        let decode = [Decode { gain: 1.0, offset: 0.0, saturation: f32::INFINITY }];
        assert!(Stack::new(Samples::F32(&[0.0; 4]), SHAPE, &decode, None).is_err());
        assert!(Stack::new(Samples::F32(&[0.0; 3]), SHAPE, &[], None).is_err());
        assert!(Stack::new(Samples::F32(&[0.0; 3]), SHAPE, &decode, Some(&[true])).is_err());
    }
}
