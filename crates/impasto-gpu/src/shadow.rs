//! Which pixels see each lamp, one bit per pixel and lamp, or which share of a lamp with a size; and
//! which share of the sky; on the card.
//!
//! Distant lamps: the sweep of `impasto::relight::shadow` as a compute shader, one invocation per
//! line. Near lamps, reliefs larger than the card's largest array, and all shares: the CPU's functions.

use std::borrow::Cow;

use wgpu::{Buffer, BufferUsages};

use impasto::geometry::{Grid, Light};
use impasto::math::Vec3;
use impasto::pixels::Run;
use impasto::relight::environment::Sky;
use impasto::relight::shadow::horizon::seen_where;
use impasto::relight::shadow::{Shares, cast_shadows};

use crate::device::Gpu;
use crate::error::{Error, Result};
use crate::layout::{Displacement, Sweep, workgroups};
use crate::pipeline::Kernel;
use crate::scene::Disc;

/// Pixels of a word: of bits, and of shares.
const WORD: usize = 32;
const PAIR: usize = 2;

/// A relief, the lamps whose shadows it threw last, and what it hides of the sky.
#[derive(Debug)]
pub(crate) struct Relief<'a> {
    height: Cow<'a, [f32]>,
    grid: Grid,
    /// On the card, if it fits and a distant lamp has asked for it.
    uploaded: Option<Buffer>,
    depths: Option<Buffer>,
    cast: Option<(Vec<Disc>, Buffer)>,
    sky: Option<Buffer>,
}

impl<'a> Relief<'a> {
    /// `(y, x)`, mm.
    pub(crate) fn height(&self) -> &[f32] {
        &self.height
    }

    pub(crate) fn new(height: Cow<'a, [f32]>, grid: Grid) -> Result<Self> {
        if height.len() != grid.width * grid.height {
            let problem = "its size is not that of the painting";
            return Err(impasto::Error::argument("height", problem).into());
        }
        Ok(Self { height, grid, uploaded: None, depths: None, cast: None, sky: None })
    }

    /// Words of one lamp's visibility.
    fn words(&self, (_, radius): &Disc) -> usize {
        self.height.len().div_ceil(if *radius > 0.0 { PAIR } else { WORD })
    }

    /// The first word of each light's visibility, and behind the last how many there are.
    pub(crate) fn first_words(&self, lights: &[Disc]) -> Vec<usize> {
        let sums = lights.iter().scan(0, |sum, light| {
            *sum += self.words(light);
            Some(*sum)
        });
        std::iter::once(0).chain(sums).collect()
    }

    /// The visibility of all lights, one after another.
    pub(crate) fn visibility(
        &mut self,
        gpu: &Gpu,
        lights: &[Disc],
        run: &Run<'_>,
    ) -> Result<Buffer> {
        if let Some((_, visibility)) = self.cast.as_ref().filter(|(cast, _)| cast == lights) {
            return Ok(visibility.clone());
        }
        let first_words = self.first_words(lights);
        let bytes = first_words.last().map_or(0, |&words| 4 * words as u64);
        if bytes > gpu.largest_binding() {
            let (lamps, pixels) = (lights.len(), self.height.len());
            let problem = format!("shadows of {lamps} lamps on {pixels} pixels");
            return Err(Error::Unsupported(problem));
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let visibility = gpu.checked(|gpu| gpu.buffer(bytes, usage))?;
        for ((light, radius), first) in lights.iter().zip(first_words) {
            if *radius > 0.0 {
                let seen = seen_where(&self.height, self.grid, (light, *radius), |_, _| true, run)?;
                write_shares(gpu, &visibility, first, &seen)?;
                continue;
            }
            let walk = match *light {
                Light::Distant(towards) => Walk::new(towards, self.grid),
                Light::Point { .. } => None,
            };
            let fits = |walk: &Walk| 4 * walk.samples() <= gpu.largest_binding();
            match walk.filter(fits) {
                Some(walk) if 4 * self.height.len() as u64 <= gpu.largest_binding() => {
                    self.sweep(gpu, &walk, first, &visibility)?;
                }
                _ => {
                    let seen = cast_shadows(&self.height, self.grid, light, run)?;
                    let bits = bits(&seen);
                    gpu.checked(|gpu| gpu.write(&visibility, first, &bits))?;
                }
            }
        }
        self.cast = Some((lights.to_vec(), visibility.clone()));
        Ok(visibility)
    }

    /// The share of the sky that each pixel sees, 16 bits each; where tiles are not `wanted`, all of it.
    pub(crate) fn sky(
        &mut self,
        gpu: &Gpu,
        wanted: impl Fn(usize, usize) -> bool + Sync,
        run: &Run<'_>,
    ) -> Result<Buffer> {
        if let Some(sky) = &self.sky {
            return Ok(sky.clone());
        }
        let bytes = 4 * self.height.len().div_ceil(PAIR) as u64;
        if bytes > gpu.largest_binding() {
            let problem = format!("the sky's shares on {} pixels", self.height.len());
            return Err(Error::Unsupported(problem));
        }
        let Sky { seen, .. } = Sky::over(&self.height, self.grid, 0.0, wanted, run)?;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let sky = gpu.checked(|gpu| gpu.buffer(bytes, usage))?;
        write_shares(gpu, &sky, 0, &seen)?;
        Ok(self.sky.insert(sky).clone())
    }

    /// Casts the shadows of one distant light on the card.
    fn sweep(&mut self, gpu: &Gpu, walk: &Walk, first: usize, visibility: &Buffer) -> Result<()> {
        if self.uploaded.is_none() {
            let height = &self.height;
            self.uploaded = Some(gpu.checked(|gpu| gpu.filled(height, BufferUsages::STORAGE))?);
        }
        let bytes = 4 * walk.samples();
        if self.depths.as_ref().is_none_or(|depths| depths.size() < bytes) {
            self.depths = None;
            self.depths = Some(gpu.checked(|gpu| gpu.buffer(bytes, BufferUsages::STORAGE))?);
        }
        let (Some(relief), Some(depths)) = (&self.uploaded, &self.depths) else {
            return Ok(());
        };
        let sweep = Sweep {
            pixels: self.height.len() as u32,
            words: self.height.len().div_ceil(WORD) as u32,
            first_word: first as u32,
            ..walk.sweep
        };
        gpu.checked(|gpu| {
            let uniform = gpu.filled(&[sweep], BufferUsages::UNIFORM);
            let displacements = gpu.filled(&walk.displacements, BufferUsages::STORAGE);
            let arrays = [&uniform, relief, &displacements, depths, visibility];
            let mut encoder = gpu.encoder();
            for (kernel, count) in [(Kernel::Sweep, sweep.lines), (Kernel::Lit, sweep.words)] {
                let (pipeline, group) = (gpu.kernel(kernel), gpu.bind_group(kernel, &arrays));
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &group, &[]);
                let [x, y] = workgroups(count);
                pass.dispatch_workgroups(x, y, 1);
            }
            gpu.submit(encoder);
        })
    }
}

/// A sweep over the relief towards darkness: the numbers of `impasto::relight::shadow`.
#[derive(Debug)]
struct Walk {
    sweep: Sweep,
    displacements: Vec<Displacement>,
}

impl Walk {
    /// None for a light overhead: nothing is in shadow.
    fn new(light: Vec3<f64>, grid: Grid) -> Option<Self> {
        // Rows run down, y runs up.
        let (x, down) = (light.x, -light.y);
        if x == 0.0 && down == 0.0 {
            return None;
        }
        let sideways = x.abs() > down.abs();
        let (across, along) = if sideways { (down, x) } else { (x, down) };
        let (width, steps) =
            if sideways { (grid.height, grid.width) } else { (grid.width, grid.height) };
        let shear = -across / along.abs();
        let fall = light.z * grid.pitch * shear.mul_add(shear, 1.0).sqrt() / across.hypot(along);
        let displacements: Vec<_> = (0..steps)
            .map(|step| {
                let shift = shear * step as f64;
                let whole = shift.floor();
                Displacement { whole: whole as i32, fraction: (shift - whole) as f32 }
            })
            .collect();
        // Lines that meet the picture anywhere, one more on each side for interpolation back.
        let last = displacements[steps - 1].whole;
        let width = (width as u32).cast_signed();
        let (first_line, last_line) = ((-last).min(0) - 2, width - last.min(0) + 1);
        let sweep = Sweep {
            width,
            steps: steps as u32,
            first_line,
            lines: (last_line - first_line) as u32,
            across: if sideways { grid.width as u32 } else { 1 },
            along: if sideways { 1 } else { grid.width as u32 },
            fall: fall as f32,
            walk: u32::from(along > 0.0) | if sideways { 2 } else { 0 },
            columns: grid.width as u32,
            pixels: 0,
            words: 0,
            first_word: 0,
        };
        Some(Self { sweep, displacements })
    }

    /// Depths that it writes.
    fn samples(&self) -> u64 {
        u64::from(self.sweep.lines) * u64::from(self.sweep.steps)
    }
}

/// Writes shares from a word on, two to a word, the first of them below.
fn write_shares(gpu: &Gpu, buffer: &Buffer, first: usize, shares: &Shares) -> Result<()> {
    let mut codes = shares.codes();
    codes.resize(codes.len().next_multiple_of(PAIR), 0);
    let words: Vec<u32> = codes
        .chunks_exact(PAIR)
        .map(|pair| u32::from(pair[0]) | u32::from(pair[1]) << 16)
        .collect();
    gpu.checked(|gpu| gpu.write(buffer, first, &words))
}

/// One bit per pixel, from 1 and 0.
fn bits(seen: &[f32]) -> Vec<u32> {
    let word = |pixels: &[f32]| {
        pixels.iter().rev().fold(0, |word, &seen| word << 1 | u32::from(seen > 0.0))
    };
    seen.chunks(WORD).map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_stand_in_the_order_of_pixels() {
        let mut seen = vec![0.0; 40];
        (seen[0], seen[5], seen[39]) = (1.0, 1.0, 1.0);
        assert_eq!(bits(&seen), [0b10_0001, 1 << 7]);
    }

    #[test]
    fn a_light_overhead_has_no_walk() {
        let grid = Grid::whole(10, 20, 0.5);
        assert!(Walk::new(Vec3::new(0.0, 0.0, 1.0), grid).is_none());
        let walk = Walk::new(Vec3::new(0.8, 0.0, 0.6), grid).unwrap();
        // 0.6 / 0.8 of a pixel of 0.5 mm per column.
        assert!((walk.sweep.fall - 0.375).abs() < 1e-6);
        assert_eq!((walk.sweep.steps, walk.sweep.walk, walk.sweep.lines), (10, 3, 23));
    }
}
