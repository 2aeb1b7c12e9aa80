//! From maps to light: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper.
//!
//! Pixels go through a list of stages, block by block; what a scene does not call for is not in
//! the list ([`Effects`]). Per lamp: its irradiance, [`shadow`], the diffuse term, the interface
//! term of every coat; per illuminant: colour, as one matrix. The whole picture then goes through
//! the [`view`] if it is slanted, and to the display ([`show`]).

use crate::effects::Effects;
use crate::error::{Error, Result};
use crate::geometry::{Grid, Light};
use crate::math::{Isa, Kernel};
use crate::pixels::{Run, TILE};
use crate::scene::{Colour, Lamp, Scene};

mod block;
mod colour;
pub mod curve;
mod diffuse;
pub mod shadow;
pub mod show;
mod specular;
pub mod view;

use block::{BLOCK, Block, Plane, copied};

/// One number for the whole painting, or a map `(y, x)`.
#[derive(Clone, Copy, Debug)]
pub enum Parameter<'a> {
    /// The same everywhere.
    Everywhere(f32),
    /// One per pixel.
    Map(&'a [f32]),
}

/// A coat of varnish or the paint's own surface: one Torrance-Sparrow lobe.
#[derive(Clone, Copy, Debug)]
pub struct Coat<'a> {
    /// Strength.
    pub beta: Parameter<'a>,
    /// Half-width of the facets' tilt, radians.
    pub gamma: Parameter<'a>,
    /// Index of refraction.
    pub index: f64,
}

/// A lobe with a strength per reflectance coefficient: gilding, metal leaf, bronzing.
#[derive(Clone, Copy, Debug)]
pub struct Tinted<'a> {
    /// Strength `(k, y, x)`.
    pub strength: &'a [f32],
    /// Half-width of the facets' tilt, radians; of no account where the strength is 0.
    pub gamma: Parameter<'a>,
    /// Index of refraction.
    pub index: f64,
}

/// The maps of a painting.
#[derive(Clone, Debug)]
pub struct Surface<'a> {
    /// Where the pixels lie.
    pub grid: Grid,
    /// Unit normals `(3, y, x)`, NaN where unknown.
    pub normal: &'a [f32],
    /// Reflectance coefficients `(k, y, x)`, NaN where unknown.
    pub coefficients: &'a [f32],
    /// One entry per interface; none for a matte painting.
    pub coats: Vec<Coat<'a>>,
    /// Lobes of the material's own colour.
    pub tinted: Vec<Tinted<'a>>,
    /// Coefficients `(k, y, x)` of what the surface shows whatever a lamp's direction.
    pub ambient: Option<&'a [f32]>,
    /// Height in mm, `(y, x)`: given, shadows are cast.
    pub height: Option<&'a [f32]>,
}

/// Light that reaches the eye.
#[derive(Clone, Debug)]
pub struct Picture {
    /// `(3, y, x)`, in the output unit of the scene's colours.
    pub light: Vec<f32>,
    /// `(y, x)`: how much of the pixel shows the painting, 0 where its maps hold no number.
    pub coverage: Vec<f32>,
    /// Columns and rows.
    pub grid: Grid,
}

enum Stage<'a> {
    Reach(&'a Lamp),
    Shadow(Vec<f32>),
    Diffuse(&'a Lamp),
    Specular(&'a Lamp, Coat<'a>),
    Tinted(&'a Lamp, Tinted<'a>, &'a Colour),
    Ambient(&'a Lamp, &'a [f32], &'a Colour),
    Colour(&'a Colour),
}

/// Lights a painting; where its maps hold no number the picture holds `background`.
///
/// # Errors
/// If sizes disagree, or the caller cancels.
pub fn render(
    surface: &Surface<'_>,
    scene: &Scene,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<Picture> {
    check(surface, scene)?;
    let effects = Effects::of(scene, !surface.coats.is_empty(), surface.height.is_some());
    let stages = stages(surface, scene, effects, run)?;
    let pixels = surface.grid.width * surface.grid.height;
    let (mut light, mut coverage) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let (red, rest) = light.split_at_mut(pixels);
    let (green, blue) = rest.split_at_mut(pixels);
    let tiles = red
        .chunks_mut(TILE)
        .zip(green.chunks_mut(TILE))
        .zip(blue.chunks_mut(TILE))
        .zip(coverage.chunks_mut(TILE))
        .enumerate()
        .map(|(index, (((red, green), blue), coverage))| {
            (index * TILE, [red, green, blue], coverage)
        })
        .collect();
    run.for_each(
        tiles,
        || (Box::new(Block::new()), vec![[0.0; BLOCK]; scene.coefficients()]),
        |(block, coefficients), (start, light, coverage)| {
            let view = scene.view();
            run.level.run(Shade {
                surface,
                stages: &stages,
                view,
                background,
                block,
                coefficients,
                start,
                light,
                coverage,
            });
        },
    )?;
    if !effects.slanted_view {
        return Ok(Picture { light, coverage, grid: surface.grid });
    }
    let projection = view::Projection::new(scene.view(), surface.grid);
    let (light, coverage) = projection.resample(&light, &coverage, background, run)?;
    Ok(Picture { light, coverage, grid: projection.picture })
}

fn check(surface: &Surface<'_>, scene: &Scene) -> Result<()> {
    let pixels = surface.grid.width * surface.grid.height;
    if pixels == 0 || surface.normal.len() != 3 * pixels {
        return Err(Error::argument("normal", "expected shape (3, y, x)"));
    }
    if surface.coefficients.len() != scene.coefficients() * pixels {
        let problem = format!("expected {} planes of the painting's size", scene.coefficients());
        return Err(Error::argument("coefficients", problem));
    }
    let fits = |parameter: Parameter<'_>| match parameter {
        Parameter::Everywhere(_) => true,
        Parameter::Map(map) => map.len() == pixels,
    };
    let planes = scene.coefficients() * pixels;
    let whole = |tinted: &Tinted<'_>| tinted.strength.len() == planes && fits(tinted.gamma);
    if !surface.tinted.iter().all(whole) {
        return Err(Error::argument("specular", "expected (k, y, x) and gamma a number or (y, x)"));
    }
    if surface.ambient.is_some_and(|ambient| ambient.len() != planes) {
        return Err(Error::argument("ambient", "expected (k, y, x)"));
    }
    if !surface.coats.iter().all(|coat| fits(coat.beta) && fits(coat.gamma)) {
        return Err(Error::argument("beta", "beta and gamma are numbers or maps (y, x)"));
    }
    Ok(())
}

fn stages<'a>(
    surface: &Surface<'a>,
    scene: &'a Scene,
    effects: Effects,
    run: &Run<'_>,
) -> Result<Vec<Stage<'a>>> {
    let mut stages = Vec::new();
    for (index, colour) in scene.colours().iter().enumerate() {
        for lamp in scene.lamps().iter().filter(|lamp| lamp.colour == index) {
            stages.push(Stage::Reach(lamp));
            if let (true, Some(relief)) = (effects.cast_shadows, surface.height) {
                let visible = shadow::cast_shadows(relief, surface.grid, &lamp.light, run)?;
                stages.push(Stage::Shadow(visible));
            }
            stages.push(Stage::Diffuse(lamp));
            if effects.specular {
                stages.extend(surface.coats.iter().map(|&coat| Stage::Specular(lamp, coat)));
            }
            let tinted = |&tinted| Stage::Tinted(lamp, tinted, colour);
            stages.extend(surface.tinted.iter().map(tinted));
            stages.extend(surface.ambient.map(|ambient| Stage::Ambient(lamp, ambient, colour)));
        }
        stages.push(Stage::Colour(colour));
    }
    Ok(stages)
}

/// One tile through all stages.
struct Shade<'a, 's> {
    surface: &'a Surface<'a>,
    stages: &'a [Stage<'s>],
    view: crate::math::Vec3<f64>,
    background: [f32; 3],
    block: &'a mut Block,
    coefficients: &'a mut [Plane],
    start: usize,
    light: [&'a mut [f32]; 3],
    coverage: &'a mut [f32],
}

impl Kernel for Shade<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { surface, stages, view, background, block, coefficients, start, .. } = self;
        let pixels = surface.grid.width * surface.grid.height;
        let light = self.light;
        let near = |stage: &Stage<'_>| matches!(stage, Stage::Reach(lamp) if matches!(lamp.light, Light::Point { .. }));
        let needs_place = stages.iter().any(near);
        let total = self.coverage.len();
        for first in (0..total).step_by(BLOCK) {
            let count = BLOCK.min(total - first);
            let at = start + first;
            for (axis, plane) in block.normal.iter_mut().enumerate() {
                copied(surface.normal, axis * pixels + at, count, plane);
            }
            for (k, plane) in coefficients.iter_mut().enumerate() {
                copied(surface.coefficients, k * pixels + at, count, plane);
            }
            if needs_place {
                surface.grid.coordinates(at, &mut block.x, &mut block.y);
            }
            block.light = [[0.0; BLOCK]; 3];
            block.diffuse.fill(0.0);
            block.specular.fill(0.0);
            for stage in stages {
                match stage {
                    Stage::Reach(lamp) => diffuse::reach::<I>(block, lamp),
                    Stage::Shadow(visible) => {
                        for (reach, seen) in block.reach.iter_mut().zip(&visible[at..at + count]) {
                            *reach *= seen;
                        }
                    }
                    Stage::Diffuse(lamp) => diffuse::diffuse::<I>(block, lamp),
                    Stage::Specular(lamp, coat) => {
                        specular::specular::<I>(block, lamp, coat, view, (at, count));
                    }
                    Stage::Tinted(lamp, tinted, colour) => {
                        specular::tinted::<I>(block, lamp, tinted, colour, view, (at, count));
                    }
                    Stage::Ambient(lamp, ambient, colour) => {
                        colour::ambient::<I>(block, lamp, ambient, colour, (at, count));
                    }
                    Stage::Colour(colour) => colour::colour::<I>(block, coefficients, colour),
                }
            }
            for pixel in 0..count {
                let values = [0, 1, 2].map(|channel| block.light[channel][pixel]);
                let known = values.iter().all(|value| value.is_finite());
                self.coverage[first + pixel] = if known { 1.0 } else { 0.0 };
                for channel in 0..3 {
                    light[channel][first + pixel] =
                        if known { values[channel] } else { background[channel] };
                }
            }
        }
    }
}
