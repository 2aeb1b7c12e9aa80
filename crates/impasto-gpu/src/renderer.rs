//! A surface on the card: uploaded once, shown as often as wanted.

use std::borrow::Cow;

use bytemuck::Zeroable;
use wgpu::{Buffer, BufferUsages};

use impasto::geometry::Grid;
use impasto::pixels::Run;
use impasto::relight::environment::Scheme;
use impasto::relight::plan::{Over, Plan, SHADED, lobe_bit};
use impasto::relight::scene::Scene;
use impasto::relight::show::{Codes, Display, codes_from_planes};
use impasto::relight::view::{Projection, seen_from};
use impasto::relight::{self, Picture};
use impasto::surface::{CoatedDiffuse, Model, Surface};

use crate::device::Gpu;
use crate::environment::{Facts, Maps, Surroundings};
use crate::error::{Error, Result};
use crate::layout::{Around, Frame, workgroups};
use crate::pipeline::{Kernel, Variant};
use crate::planes::{Band, Planes, Table};
use crate::scene::{Lit, tables as tone_tables};
use crate::shadow::Relief;

/// Arrays are no larger, whatever the card allows: places in them are 32-bit numbers.
const LARGEST_ARRAY: u64 = 1 << 31;

/// Bytes of a pixel as light and coverage, and as four codes.
const LIGHT: u64 = 16;
const CODES: u64 = 4;

/// A picture as display codes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Screen {
    /// `(y, x, 4)`: red, green and blue; the last is the coverage, 0 to 255.
    pub codes: Vec<u8>,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// A surface on a graphics card.
#[derive(Debug)]
pub struct Renderer {
    gpu: Gpu,
    shown: Shown,
    bands: Vec<Band>,
    relief: Option<Relief<'static>>,
    around: Option<Surroundings>,
    shadows: bool,
    parallax: bool,
    target: Option<Target>,
}

/// What is shown, but for its maps.
#[derive(Clone, Copy, Debug)]
struct Shown {
    grid: Grid,
    model: Model,
    /// The interface above the diffuse part.
    coated: Option<CoatedDiffuse>,
    table: Table,
}

/// Where a band's picture is written, and where the CPU reads it.
#[derive(Debug)]
struct Target {
    written: Buffer,
    read: Buffer,
}

/// One picture's arrays, whatever the band.
struct Arrays {
    lit: Lit,
    lamps: Buffer,
    colours: Buffer,
    visibility: Buffer,
    curve: Buffer,
    around: Buffer,
    tables: Buffer,
    sky: Buffer,
    variant: Variant,
}

/// What a picture of a surface depends on besides the scene.
struct Under<'a, 'r> {
    relief: Option<&'a mut Relief<'r>>,
    /// What is simulated; without a plan all that is there.
    plan: Option<&'a Plan>,
    maps: Maps<'a>,
    around: &'a mut Option<Surroundings>,
}

impl Shown {
    fn new(surface: &Surface<'_>, grid: Grid, table: &Table) -> Self {
        Self { grid, model: surface.model, coated: surface.coated, table: *table }
    }

    /// The rows of each band: as many as fit into an array.
    fn bands(&self, gpu: &Gpu, planes: usize) -> Result<Vec<(usize, usize)>> {
        let Grid { width, height, .. } = self.grid;
        let largest = gpu.largest_binding().min(LARGEST_ARRAY);
        let row = (4 * planes as u64).max(LIGHT) * width as u64;
        let rows = (largest / row) as usize;
        if rows == 0 {
            let problem = format!("a row of {width} pixels is larger than an array on the card");
            return Err(Error::Unsupported(problem));
        }
        Ok((0..height).step_by(rows).map(|row| (row, rows.min(height - row))).collect())
    }

    fn frame(&self, arrays: &Arrays, band: &Band) -> Frame {
        let (grid, table) = (&self.grid, &self.table);
        // In pixels: exact in single precision, but for scales whose pixels do not fill the painting.
        let corner = [grid.right(0.0), 0.0 - grid.down(band.row as f64)];
        let index = match self.model {
            Model::TorranceSparrow { index } => index as f32,
            Model::Lafortune => 1.0,
        };
        let coat = self.coated.map_or([1.0; 3], |coat| {
            [coat.index(), coat.index().recip(), coat.scale()].map(|value| value as f32)
        });
        Frame {
            view: arrays.lit.view,
            pitch: grid.pitch as f32,
            background: arrays.lit.background,
            index,
            corner: corner.map(|place| place as f32),
            coat: [coat[0], coat[1]],
            coat_scale: coat[2],
            pixels: (band.rows * grid.width) as u32,
            width: grid.width as u32,
            first: (band.row * grid.width) as u32,
            lamps: arrays.lit.count,
            ambient: table.ambient,
            unused: [0; 2],
            numbers: table.numbers,
            planes: table.planes,
        }
    }

    /// What a scene calls for, on the card.
    fn arrays(
        &self,
        gpu: &Gpu,
        under: Under<'_, '_>,
        scene: &Scene,
        background: [f32; 3],
        display: Option<&Display<'_>>,
        run: &Run<'_>,
    ) -> Result<Arrays> {
        let coefficients = self.table.variant.coefficients as usize;
        if coefficients != scene.coefficients() {
            let problem = format!("expected {} planes, found {coefficients}", scene.coefficients());
            return Err(impasto::Error::argument("coefficients", problem).into());
        }
        let Under { mut relief, plan, maps, around } = under;
        let mut lit = Lit::of(scene, self.model, background, display);
        let empty = gpu.checked(|gpu| gpu.buffer(16, BufferUsages::STORAGE))?;
        let throws = |lamp| plan.is_none_or(|plan| plan.needs(lamp, SHADED));
        let shadows = relief.is_some() && (0..scene.lamps().len()).any(throws);
        let visibility = match relief.as_deref_mut().filter(|_| shadows) {
            None => empty.clone(),
            Some(relief) => {
                let first_words = relief.first_words(&lit.lights);
                for (lamp, first) in lit.lamps.iter_mut().zip(first_words) {
                    lamp.visibility = first as u32;
                }
                relief.visibility(gpu, &lit.lights, run)?
            }
        };
        let mut variant = Variant {
            one_lamp: lit.count == 1,
            near_lights: lit.near_lights,
            near_view: lit.near_view,
            shadows,
            sized_lamps: lit.lights.iter().any(|(_, radius)| *radius > 0.0),
            environment: scene.environment().is_some(),
            codes: display.is_some(),
            ..self.table.variant
        };
        let (mut uniform, mut tables, mut sky) = (Around::zeroed(), empty.clone(), empty);
        if let Some(surroundings) = scene.environment() {
            let size = [self.grid.width, self.grid.height];
            let (model, coated, table) = (self.model, self.coated, &self.table);
            let facts = (Facts { model, coated, table, size }, maps);
            let environment = &surroundings.environment;
            let found = Surroundings::kept(around, gpu, facts, environment, scene.view(), run)?;
            (uniform, tables) = (found.around, found.tables.clone());
            uniform.colours = surroundings.colours.map(|one| (one * (coefficients + 1)) as u32);
            variant.scalar = environment.scheme() == Scheme::Scalar
                && self.model == Model::Lafortune
                && variant.lobes > 0;
            let hidden = plan.is_none_or(Plan::needs_sky);
            if let Some(relief) = relief.filter(|_| hidden) {
                let wanted = |column, row| plan.is_none_or(|plan| plan.hides_sky(column, row));
                sky = relief.sky(gpu, wanted, run)?;
                variant.sky = true;
                let bounces = plan.is_none_or(Plan::bounces);
                uniform.albedo = if bounces { surroundings.albedo as f32 } else { 0.0 };
            }
        }
        gpu.checked(|gpu| Arrays {
            lamps: gpu.filled(&lit.lamps, BufferUsages::STORAGE),
            colours: gpu.filled(&lit.colours, BufferUsages::STORAGE),
            curve: match display {
                None => gpu.buffer(8, BufferUsages::STORAGE),
                Some(display) => gpu.filled(&tone_tables(display.curve), BufferUsages::STORAGE),
            },
            around: gpu.filled(&[uniform], BufferUsages::UNIFORM),
            visibility,
            tables,
            sky,
            variant,
            lit,
        })
    }

    /// Renders a band, and gives its bytes to `read`.
    fn draw(
        &self,
        gpu: &Gpu,
        arrays: &Arrays,
        band: &Band,
        target: &mut Option<Target>,
        read: impl FnOnce(&[u8]),
    ) -> Result<()> {
        let frame = self.frame(arrays, band);
        let pixel = if arrays.variant.codes { CODES } else { LIGHT };
        let bytes = pixel * u64::from(frame.pixels);
        let there = target.take();
        let target = target.insert(Target::of(gpu, bytes, there)?);
        let kernel = Kernel::Render(arrays.variant);
        gpu.checked(|gpu| {
            let uniform = gpu.filled(&[frame], BufferUsages::UNIFORM);
            let Arrays { lamps, colours, visibility, curve, around, tables, sky, .. } = arrays;
            let (maps, written) = (&band.maps, &target.written);
            let of_scene = [lamps, colours, maps, visibility, curve, tables, sky];
            let all = [&[&uniform][..], &of_scene, &[written, around]].concat();
            let (pipeline, group) = (gpu.kernel(kernel), gpu.bind_group(kernel, &all));
            let mut encoder = gpu.encoder();
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &group, &[]);
                let [x, y] = workgroups(frame.pixels);
                pass.dispatch_workgroups(x, y, 1);
            }
            encoder.copy_buffer_to_buffer(&target.written, 0, &target.read, 0, bytes);
            gpu.submit(encoder);
        })?;
        gpu.read(&target.read, bytes, read)
    }
}

impl Target {
    /// Room for so many bytes; the one there is, if it is large enough.
    fn of(gpu: &Gpu, bytes: u64, there: Option<Self>) -> Result<Self> {
        match there {
            Some(target) if target.written.size() >= bytes => Ok(target),
            _ => gpu.checked(|gpu| Self {
                written: gpu.buffer(bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC),
                read: gpu.buffer(bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST),
            }),
        }
    }
}

/// The planes of a picture, filled band by band.
struct Planar {
    light: Vec<f32>,
    coverage: Vec<f32>,
}

impl Planar {
    fn new(pixels: usize) -> Self {
        Self { light: vec![0.0; 3 * pixels], coverage: vec![0.0; pixels] }
    }

    fn take(&mut self, first: usize, bytes: &[u8]) {
        let pixels = self.coverage.len();
        let count = bytes.len() / LIGHT as usize;
        let planes = self.light.chunks_mut(pixels).chain(std::iter::once(&mut self.coverage[..]));
        for (plane, bytes) in planes.zip(bytes.chunks_exact(4 * count)) {
            bytemuck::cast_slice_mut(&mut plane[first..first + count]).copy_from_slice(bytes);
        }
    }
}

impl Renderer {
    /// Uploads a surface. `relief.height`, if it is given, is copied: shadows are cast.
    ///
    /// # Errors
    /// If sizes disagree, the card has too little memory or is lost, or the surface has more than 8
    /// lobes.
    pub fn new(gpu: &Gpu, surface: &Surface<'_>, relief: relight::Relief<'_>) -> Result<Self> {
        let grid = relief.grid;
        let Planes { maps, table } = Planes::of(surface, grid.width * grid.height)?;
        let shown = Shown::new(surface, grid, &table);
        let bands = shown.bands(gpu, maps.len())?.into_iter();
        let bands =
            bands.map(|rows| Band::new(gpu, &maps, grid.width, rows)).collect::<Result<_>>()?;
        let relief = match relief.height {
            Some(height) => Some(Relief::new(Cow::Owned(height.to_vec()), grid)?),
            None => None,
        };
        Ok(Self {
            gpu: gpu.clone(),
            shown,
            bands,
            relief,
            around: None,
            shadows: true,
            parallax: true,
            target: None,
        })
    }

    /// Columns, rows and the width of a pixel.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.shown.grid
    }

    /// The card.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Whether pictures have cast shadows and parallax, if the renderer was given heights; at first
    /// they have both.
    pub fn set_over(&mut self, Over { shadows, parallax }: Over) {
        (self.shadows, self.parallax) = (shadows, parallax);
    }

    /// The surface under the lights of a scene: what [`relight::render`] gives.
    ///
    /// # Errors
    /// If the scene does not fit the surface, the caller cancels, or the card fails.
    pub fn light(&mut self, scene: &Scene, background: [f32; 3], run: &Run<'_>) -> Result<Picture> {
        let Self { gpu, shown, bands, relief, around, shadows, parallax, target } = self;
        let cast = relief.as_mut().filter(|_| *shadows);
        let under = Under { relief: cast, plan: None, maps: Maps::There(bands), around };
        let arrays = shown.arrays(gpu, under, scene, background, None, run)?;
        let mut planar = Planar::new(shown.grid.width * shown.grid.height);
        for band in &*bands {
            cancelled(run)?;
            let first = band.row * shown.grid.width;
            shown.draw(gpu, &arrays, band, target, |bytes| planar.take(first, bytes))?;
        }
        let height = relief.as_ref().filter(|_| *parallax).map(Relief::height);
        let moved = *parallax && relief.is_some();
        let view = (scene, is_slanted(scene, shown.grid, moved)?);
        seen(shown.grid, planar, height, view, background, run)
    }

    /// The surface under the lights of a scene, as codes of a display.
    ///
    /// A slanted view is resampled and encoded on the CPU.
    ///
    /// # Errors
    /// As of [`Self::light`].
    pub fn codes(
        &mut self,
        scene: &Scene,
        background: [f32; 3],
        display: &Display<'_>,
        run: &Run<'_>,
    ) -> Result<Screen> {
        let grid = self.shown.grid;
        if is_slanted(scene, grid, self.parallax && self.relief.is_some())? {
            return encoded(&self.light(scene, background, run)?, display, run);
        }
        let Self { gpu, shown, bands, relief, around, shadows, target, .. } = self;
        let relief = relief.as_mut().filter(|_| *shadows);
        let under = Under { relief, plan: None, maps: Maps::There(bands), around };
        let arrays = shown.arrays(gpu, under, scene, background, Some(display), run)?;
        let mut codes = vec![0; 4 * grid.width * grid.height];
        for band in &*bands {
            cancelled(run)?;
            let first = 4 * band.row * grid.width;
            shown.draw(gpu, &arrays, band, target, |bytes| {
                codes[first..first + bytes.len()].copy_from_slice(bytes);
            })?;
        }
        Ok(Screen { codes, width: grid.width, height: grid.height })
    }
}

/// Lights a painting once, as [`relight::render`] does: band by band, so that no more than one band
/// of its maps is on the card.
///
/// What the plan does without everywhere is neither uploaded nor computed; the rest is simulated in
/// all tiles.
///
/// # Errors
/// As of [`Renderer::new`] and [`Renderer::light`].
pub fn render(
    gpu: &Gpu,
    surface: &Surface<'_>,
    relief: relight::Relief<'_>,
    scene: &Scene,
    plan: &Plan,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<Picture> {
    let grid = relief.grid;
    surface.bands(grid.width * grid.height)?;
    plan.fits(grid, scene)?;
    let on = |part| (0..scene.lamps().len()).any(|lamp| plan.needs(lamp, part));
    // An environment shows every lobe.
    let shows = |lobe| scene.environment().is_some() || on(lobe_bit(lobe));
    let lobes = surface.lobes.iter().enumerate().filter(|(number, _)| shows(*number));
    let surface = &Surface { lobes: lobes.map(|(_, lobe)| lobe.clone()).collect(), ..*surface };
    let Planes { maps, table } = Planes::of(surface, grid.width * grid.height)?;
    let shown = Shown::new(surface, grid, &table);
    let height = relief.height;
    let mut relief = match height.filter(|_| on(SHADED) || plan.needs_sky()) {
        Some(height) => Some(Relief::new(Cow::Borrowed(height), grid)?),
        None => None,
    };
    let (relief, here) = (relief.as_mut(), Maps::Here(surface));
    let under = Under { relief, plan: Some(plan), maps: here, around: &mut None };
    let arrays = shown.arrays(gpu, under, scene, background, None, run)?;
    let mut planar = Planar::new(grid.width * grid.height);
    let mut target = None;
    for rows in shown.bands(gpu, maps.len())? {
        cancelled(run)?;
        let band = Band::new(gpu, &maps, grid.width, rows)?;
        let first = band.row * grid.width;
        shown.draw(gpu, &arrays, &band, &mut target, |bytes| planar.take(first, bytes))?;
    }
    let height = height.filter(|_| plan.displaced());
    seen(grid, planar, height, (scene, plan.projected()), background, run)
}

fn cancelled(run: &Run<'_>) -> Result<()> {
    if run.cancelled() { Err(impasto::Error::Cancelled.into()) } else { Ok(()) }
}

/// Whether the view moves any pixel.
fn is_slanted(scene: &Scene, grid: Grid, parallax: bool) -> Result<bool> {
    if !scene.is_projected() {
        return Ok(false);
    }
    // A near eye straight in front leaves the plane where it is, but no heights.
    Ok((parallax && !scene.view().is_distant())
        || Projection::new(scene.view(), grid)?.displacement() > 0.0)
}

/// The picture as the scene's eye sees it, foreshortened on the CPU.
fn seen(
    grid: Grid,
    planar: Planar,
    relief: Option<&[f32]>,
    (scene, projected): (&Scene, bool),
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<Picture> {
    let Planar { light, coverage } = planar;
    if !projected {
        return Ok(Picture { light, coverage, grid });
    }
    let (light, coverage, grid) =
        seen_from(scene.view(), (&light, &coverage), grid, relief, background, run)?;
    Ok(Picture { light, coverage, grid })
}

/// A picture's codes, made on the CPU.
fn encoded(picture: &Picture, display: &Display<'_>, run: &Run<'_>) -> Result<Screen> {
    let Grid { width, height, .. } = picture.grid;
    let mut rgb = vec![0; 3 * width * height];
    codes_from_planes(&picture.light, display.matrix, display.curve, Codes::Eight(&mut rgb), run)?;
    let pixels = rgb.chunks_exact(3).zip(&picture.coverage);
    let codes = pixels
        .flat_map(|(rgb, covered)| {
            [rgb[0], rgb[1], rgb[2], (covered.clamp(0.0, 1.0) * 255.0).round() as u8]
        })
        .collect();
    Ok(Screen { codes, width, height })
}
