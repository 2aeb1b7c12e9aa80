//! Where every fit of the gloss begins: the maps of photometric stereo.

use crate::error::{Error, Result};

/// Maps to start from: what photometric stereo gave.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// `(3, y, x)`.
    pub normal: &'a [f32],
    /// `(band, y, x)`.
    pub diffuse: &'a [f32],
    /// `(y, x)` [`Status`](crate::maps::Status) codes.
    pub status: &'a [u8],
}

impl Start<'_> {
    /// One pixel's normal.
    pub(super) fn normal(&self, pixel: usize) -> [f32; 3] {
        let pixels = self.status.len();
        [0, 1, 2].map(|axis| self.normal[axis * pixels + pixel])
    }

    pub(super) fn check(&self, pixels: usize, bands: usize) -> Result<()> {
        let sizes = [
            ("normal", self.normal.len(), 3 * pixels),
            ("diffuse", self.diffuse.len(), bands * pixels),
            ("status", self.status.len(), pixels),
        ];
        match sizes.iter().find(|(_, found, expected)| found != expected) {
            Some((name, found, expected)) => {
                Err(Error::argument(name, format!("{found} values, expected {expected}")))
            }
            None => Ok(()),
        }
    }
}
