//! A surface's maps as planes of one array: only what the surface has.

use wgpu::{Buffer, BufferUsages};

use impasto::surface::{Lobe, Model, Parameter, Strength, Surface};

use crate::device::Gpu;
use crate::error::{Error, Result};
use crate::layout::MAX_LOBES;
use crate::pipeline::Variant;

/// Where each map of a surface stands, and what is no map.
#[derive(Clone, Debug)]
pub(crate) struct Planes<'a> {
    /// Each as long as the painting has pixels: normal, diffuse, ambient, lobe by lobe.
    pub(crate) maps: Vec<&'a [f32]>,
    pub(crate) table: Table,
}

/// What a kernel must know of the planes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Table {
    /// Number of the first plane of ambient light.
    pub(crate) ambient: u32,
    /// Per lobe strength and shape: the numbers that hold everywhere ...
    pub(crate) numbers: [[f32; 4]; MAX_LOBES],
    /// ... and the planes of those that do not.
    pub(crate) planes: [[u32; 4]; MAX_LOBES],
    /// What the surface calls for; the scene adds its own.
    pub(crate) variant: Variant,
}

impl<'a> Planes<'a> {
    /// The planes of a surface of so many pixels.
    pub(crate) fn of(surface: &'a Surface<'_>, pixels: usize) -> Result<Self> {
        let bands = surface.bands(pixels)?;
        if surface.lobes.len() > MAX_LOBES {
            let problem = format!("{} lobes, of at most {MAX_LOBES}", surface.lobes.len());
            return Err(Error::Unsupported(problem));
        }
        let mut maps: Vec<&[f32]> = surface.normal.chunks(pixels).collect();
        maps.extend(surface.diffuse.chunks(pixels));
        let ambient = maps.len() as u32;
        maps.extend(surface.ambient.iter().flat_map(|map| map.chunks(pixels)));
        let mut table = Table {
            ambient,
            numbers: [[0.0; 4]; MAX_LOBES],
            planes: [[0; 4]; MAX_LOBES],
            variant: Variant {
                model: match surface.model {
                    Model::TorranceSparrow { .. } => 0,
                    Model::Lafortune => 1,
                },
                lobes: surface.lobes.len() as u32,
                coefficients: bands as u32,
                coated: surface.coated.is_some(),
                ambient: surface.ambient.is_some(),
                ..Variant::default()
            },
        };
        for (number, lobe) in surface.lobes.iter().enumerate() {
            table.add(number, lobe, pixels, &mut maps);
        }
        Ok(Self { maps, table })
    }
}

/// Some rows of the painting, with their maps on the card.
#[derive(Debug)]
pub(crate) struct Band {
    pub(crate) row: usize,
    pub(crate) rows: usize,
    pub(crate) maps: Buffer,
}

impl Band {
    /// Uploads some rows of maps of a width.
    pub(crate) fn new(
        gpu: &Gpu,
        maps: &[&[f32]],
        width: usize,
        (row, rows): (usize, usize),
    ) -> Result<Self> {
        let (first, count) = (row * width, rows * width);
        let maps = gpu.checked(|gpu| {
            let copied = BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            let size = (4 * maps.len() * count) as u64;
            let buffer = gpu.buffer(size, BufferUsages::STORAGE | copied);
            for (number, map) in maps.iter().enumerate() {
                gpu.write(&buffer, number * count, &map[first..first + count]);
            }
            gpu.flush();
            buffer
        })?;
        Ok(Self { row, rows, maps })
    }

    /// Copies the rows of one map from the card.
    pub(crate) fn fetch(&self, gpu: &Gpu, plane: usize, rows: &mut [f32]) -> Result<()> {
        let bytes = (4 * rows.len()) as u64;
        let read = gpu.checked(|gpu| {
            let read = gpu.buffer(bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
            let mut encoder = gpu.encoder();
            encoder.copy_buffer_to_buffer(&self.maps, plane as u64 * bytes, &read, 0, bytes);
            gpu.submit(encoder);
            read
        })?;
        gpu.read(&read, bytes, |values| {
            bytemuck::cast_slice_mut(rows).copy_from_slice(values);
        })
    }
}

impl Table {
    fn add<'a>(
        &mut self,
        number: usize,
        lobe: &'a Lobe<'_>,
        pixels: usize,
        maps: &mut Vec<&'a [f32]>,
    ) {
        let (numbers, planes) = (&mut self.numbers[number], &mut self.planes[number]);
        planes[0] = maps.len() as u32;
        match lobe.strength {
            Strength::Neutral(Parameter::Everywhere(value)) => numbers[0] = value,
            Strength::Neutral(Parameter::Map(map)) => {
                self.variant.strength_maps |= 1 << number;
                maps.push(map);
            }
            Strength::Tinted(map) => {
                self.variant.tinted |= 1 << number;
                maps.extend(map.chunks(pixels));
            }
        }
        for (place, parameter) in lobe.shape.iter().enumerate() {
            planes[place + 1] = maps.len() as u32;
            match parameter {
                Parameter::Everywhere(value) => numbers[place + 1] = *value,
                Parameter::Map(map) => {
                    self.variant.shape_maps |= 1 << (3 * number + place);
                    maps.push(map);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_there_becomes_a_plane() {
        let (normal, diffuse, gamma) = ([0.0; 30], [0.0; 20], [0.1; 10]);
        let lobe = |strength| Lobe { strength, shape: vec![Parameter::Map(&gamma)] };
        let surface = Surface {
            normal: &normal,
            diffuse: &diffuse,
            model: Model::TorranceSparrow { index: 1.45 },
            lobes: vec![
                lobe(Strength::Neutral(Parameter::Everywhere(3.0))),
                lobe(Strength::Tinted(&diffuse)),
            ],
            ambient: None,
            coated: None,
        };
        let Planes { maps, table } = Planes::of(&surface, 10).unwrap();
        assert_eq!(maps.len(), 3 + 2 + 1 + 2 + 1);
        assert!(maps.iter().all(|map| map.len() == 10));
        assert_eq!((table.numbers[0][0], table.planes[0][1], table.planes[1][0]), (3.0, 5, 6));
        let Variant { lobes, strength_maps, tinted, shape_maps, .. } = table.variant;
        assert_eq!((lobes, strength_maps, tinted, shape_maps), (2, 0, 2, 0b1001));
        assert!(matches!(Planes::of(&surface, 9), Err(Error::Refused(_))));
        let many = Surface { lobes: vec![surface.lobes[0].clone(); 9], ..surface };
        assert!(matches!(Planes::of(&many, 10), Err(Error::Unsupported(_))));
    }
}
