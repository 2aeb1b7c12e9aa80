//! An environment on the card: the CPU's tables, made once, in one array.

use std::sync::Arc;

use bytemuck::Zeroable;
use wgpu::{Buffer, BufferUsages};

use impasto::geometry::View;
use impasto::math::Vec3;
use impasto::pixels::Run;
use impasto::relight::environment::{Environment, Nodes, Tables};
use impasto::surface::{CoatedDiffuse, Lobe, Model, Parameter, Strength, Surface};

use crate::device::Gpu;
use crate::error::{Error, Result};
use crate::layout::{Around, Layout, Widths};
use crate::planes::{Band, Table};

/// Numbers of a vector of the shaders.
const VECTOR: usize = 4;

/// The tables of an environment for one surface, on the card.
#[derive(Debug)]
pub(crate) struct Surroundings {
    environment: Arc<Environment>,
    /// The direction of the eye, if the tables depend on it.
    seen: Option<Vec3<f64>>,
    pub(crate) around: Around,
    pub(crate) tables: Buffer,
}

/// Where a surface's maps are.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Maps<'a> {
    /// In the caller's memory.
    Here(&'a Surface<'a>),
    /// On the card alone.
    There(&'a [Band]),
}

/// Of a surface what the tables depend on, beside its maps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facts<'a> {
    pub(crate) model: Model,
    pub(crate) coated: Option<CoatedDiffuse>,
    pub(crate) table: &'a Table,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
}

impl Facts<'_> {
    /// Whether tables are made for the normals of the painting and the direction of the eye.
    fn are_seen(&self) -> bool {
        matches!(self.model, Model::TorranceSparrow { .. }) && self.table.variant.lobes > 0
    }

    /// A map from the card.
    fn fetched(&self, gpu: &Gpu, bands: &[Band], plane: u32) -> Result<Vec<f32>> {
        let [width, height] = self.size;
        let mut map = vec![0.0; width * height];
        for band in bands {
            let rows = &mut map[band.row * width..][..band.rows * width];
            band.fetch(gpu, plane as usize, rows)?;
        }
        Ok(map)
    }
}

impl Surroundings {
    /// The tables there are, or new ones if these are of another environment or eye.
    pub(crate) fn kept<'a>(
        there: &'a mut Option<Self>,
        gpu: &Gpu,
        (facts, maps): (Facts<'_>, Maps<'_>),
        environment: &Arc<Environment>,
        view: View,
        run: &Run<'_>,
    ) -> Result<&'a Self> {
        let seen = facts.are_seen().then(|| view.direction());
        let serves = |one: &Self| Arc::ptr_eq(&one.environment, environment) && one.seen == seen;
        let one = if let Some(one) = there.take().filter(serves) {
            one
        } else {
            let (around, tables) = match maps {
                Maps::Here(surface) => uploaded(gpu, surface, environment, view, run)?,
                Maps::There(bands) => fetched(gpu, (facts, bands), environment, view, run)?,
            };
            Self { environment: Arc::clone(environment), seen, around, tables }
        };
        Ok(there.insert(one))
    }
}

/// The tables of a surface whose maps are on the card: what they depend on is fetched from there.
fn fetched(
    gpu: &Gpu,
    (facts, bands): (Facts<'_>, &[Band]),
    environment: &Environment,
    view: View,
    run: &Run<'_>,
) -> Result<(Around, Buffer)> {
    let Facts { model, coated, table, .. } = facts;
    let lobes = table.variant.lobes as usize;
    let (mut normal, mut gammas) = (Vec::new(), vec![None; lobes]);
    if facts.are_seen() {
        for axis in 0..3 {
            normal.extend(facts.fetched(gpu, bands, axis)?);
        }
        for (number, gamma) in gammas.iter_mut().enumerate() {
            if table.variant.shape_maps >> (3 * number) & 1 != 0 {
                *gamma = Some(facts.fetched(gpu, bands, table.planes[number][1])?);
            }
        }
    }
    let mut surface =
        Surface { normal: &normal, diffuse: &[], model, lobes: Vec::new(), ambient: None, coated };
    for (numbers, gamma) in table.numbers.iter().zip(&gammas) {
        let gamma = match gamma {
            Some(map) => Parameter::Map(map),
            None => Parameter::Everywhere(numbers[1]),
        };
        let strength = Strength::Neutral(Parameter::Everywhere(1.0));
        surface.lobes.push(Lobe { strength, shape: vec![gamma] });
    }
    uploaded(gpu, &surface, environment, view, run)
}

/// Makes the tables of a surface and uploads them.
fn uploaded(
    gpu: &Gpu,
    surface: &Surface<'_>,
    environment: &Environment,
    view: View,
    run: &Run<'_>,
) -> Result<(Around, Buffer)> {
    let tables = Tables::new(surface, environment, view, run)?;
    let mut placed = Placed::default();
    placed.add(tables.irradiance());
    let widths = tables.widths();
    let mut around = Around::zeroed();
    for (place, lobe) in around.widths.iter_mut().zip(&widths) {
        let first = placed.layouts.len() as u32;
        lobe.tables.iter().for_each(|&nodes| placed.add(nodes));
        let (count, factor) = (lobe.tables.len() as u32, lobe.factor);
        *place = Widths { first, count, factor, narrowest: lobe.narrowest };
    }
    let prefiltered = tables.prefiltered();
    for &nodes in &prefiltered {
        placed.add(nodes);
    }
    let bright: Vec<[f32; VECTOR]> = tables
        .bright()
        .flat_map(|(direction, light)| [direction, light])
        .map(|[x, y, z]| [x, y, z, 0.0])
        .collect();
    (around.bright, around.bright_start) = (bright.len() as u32 / 2, placed.end as u32);
    around.layouts[..placed.layouts.len()].copy_from_slice(&placed.layouts);
    let bytes = (4 * (VECTOR * placed.end + VECTOR * bright.len())) as u64;
    if bytes > gpu.largest_binding() {
        let problem = format!("the tables of an environment hold {bytes} bytes");
        return Err(Error::Unsupported(problem));
    }
    let buffer = gpu.checked(|gpu| {
        let buffer = gpu.buffer(bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST);
        for (layout, nodes) in placed.layouts.iter().zip(&placed.nodes) {
            gpu.write(&buffer, VECTOR * layout.start as usize, nodes);
        }
        gpu.write(&buffer, placed.end, &bright);
        gpu.flush();
        buffer
    })?;
    Ok((around, buffer))
}

/// Tables, one after another.
#[derive(Default)]
struct Placed<'a> {
    layouts: Vec<Layout>,
    nodes: Vec<&'a [f32]>,
    /// Vectors so far.
    end: usize,
}

impl<'a> Placed<'a> {
    fn add(&mut self, Nodes { values, size, scale, middle }: Nodes<'a>) {
        self.layouts.push(Layout { start: self.end as u32, size: size as u32, scale, middle });
        self.nodes.push(values);
        self.end += values.len() / VECTOR;
    }
}
