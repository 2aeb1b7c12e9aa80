//! From maps to light: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper.
//!
//! Pixels go through a list of stages, block by block; what a scene does not call for is not in
//! the list ([`effects`]). Per lamp: its irradiance, [`shadow`], the diffuse term, the interface
//! term of every lobe; per illuminant: colour, as one matrix. An [`environment`] adds its light
//! in three colours. The whole picture then goes through
//! the [`view`] if it is slanted, and to the display ([`show`]).

use crate::error::{Error, Result};
use crate::geometry::{Grid, View};
use crate::math::{Isa, Kernel};
use crate::pixels::{Run, TILE};
use crate::surface::{Lobe, LobeModel, ModelVisitor, Pairs, Surface};

mod block;
mod colour;
pub mod curve;
mod diffuse;
pub mod effects;
pub mod environment;
pub mod scene;
pub mod shadow;
pub mod show;
mod specular;
pub mod view;
mod visible;

use block::{BLOCK, Block, Plane, copied};
use diffuse::Interface;
use effects::Effects;
use scene::{Colour, Lamp, Scene, Surroundings};
use visible::Visible;

/// Where a painting's pixels lie.
#[derive(Clone, Copy, Debug)]
pub struct Relief<'a> {
    /// Columns, rows and the width of a pixel.
    pub grid: Grid,
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
    /// Irradiance of a lamp at normal incidence.
    Reach(&'a Lamp),
    Shadow(Visible),
    Diffuse(&'a Lamp, Interface),
    /// Of a lamp by its number.
    Specular(usize, &'a Lobe<'a>, &'a Colour),
    Ambient(&'a Lamp, &'a [f32], &'a Colour),
    Colour(&'a Colour),
    /// All that an environment sheds.
    Environment(Box<environment::stage::Lit<'a>>),
}

/// Lights a painting; where its maps hold no number the picture holds `background`.
///
/// # Errors
/// If sizes disagree, or the caller cancels.
pub fn render(
    surface: &Surface<'_>,
    relief: Relief<'_>,
    scene: &Scene,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<Picture> {
    let grid = relief.grid;
    let pixels = grid.width * grid.height;
    if surface.bands(pixels)? != scene.coefficients() {
        let problem = format!("expected {} planes of the painting's size", scene.coefficients());
        return Err(Error::argument("coefficients", problem));
    }
    let effects = Effects::of(scene, grid, !surface.lobes.is_empty(), relief.height.is_some());
    let stages = stages(surface, relief, scene, effects, run)?;
    let (light, coverage) =
        surface.model.visit(Shading { surface, grid, scene, stages: &stages, background, run })?;
    let View::Distant(view) = scene.view() else {
        return Ok(Picture { light, coverage, grid });
    };
    if !effects.slanted_view {
        return Ok(Picture { light, coverage, grid });
    }
    let projection = view::Projection::new(view, grid);
    let (light, coverage) = projection.resample(&light, &coverage, background, run)?;
    Ok(Picture { light, coverage, grid: projection.picture })
}

/// The whole picture through all stages but the projection.
struct Shading<'a, 's, 'r> {
    surface: &'a Surface<'a>,
    grid: Grid,
    scene: &'a Scene,
    stages: &'a [Stage<'s>],
    background: [f32; 3],
    run: &'a Run<'r>,
}

impl ModelVisitor for Shading<'_, '_, '_> {
    /// Light `(3, y, x)` and coverage `(y, x)`.
    type Output = Result<(Vec<f32>, Vec<f32>)>;

    fn visit<M: LobeModel>(self, model: M) -> Self::Output {
        let Self { surface, grid, scene, stages, background, run } = self;
        let pixels = grid.width * grid.height;
        let view = scene.view();
        let pairs = Pairs::new(model, scene.lamps().iter().map(|lamp| (lamp.light, view)));
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
                run.level.run(Shade {
                    surface,
                    grid,
                    stages,
                    pairs: &pairs,
                    background,
                    block,
                    coefficients,
                    start,
                    light,
                    coverage,
                });
            },
        )?;
        Ok((light, coverage))
    }
}

fn stages<'a>(
    surface: &'a Surface<'a>,
    relief: Relief<'_>,
    scene: &'a Scene,
    effects: Effects,
    run: &Run<'_>,
) -> Result<Vec<Stage<'a>>> {
    let mut stages = Vec::new();
    let interface = surface.coated.map(|coated| (coated, scene.view()));
    for (index, colour) in scene.colours().iter().enumerate() {
        let lamps = scene.lamps().iter().enumerate();
        for (number, lamp) in lamps.filter(|(_, lamp)| lamp.colour == index) {
            stages.push(Stage::Reach(lamp));
            if let (true, Some(height)) = (effects.cast_shadows, relief.height) {
                let visible = shadow::cast_shadows(height, relief.grid, &lamp.light, run)?;
                stages.push(Stage::Shadow(Visible::new(&visible, run)?));
            }
            stages.push(Stage::Diffuse(lamp, interface));
            if effects.specular {
                let specular = |lobe| Stage::Specular(number, lobe, colour);
                stages.extend(surface.lobes.iter().map(specular));
            }
            stages.extend(surface.ambient.map(|ambient| Stage::Ambient(lamp, ambient, colour)));
        }
        stages.push(Stage::Colour(colour));
    }
    if let Some(Surroundings { environment, colours }) = scene.environment() {
        let light = (environment.as_ref(), *colours);
        let lit = environment::stage::Lit::new(surface, scene, light, effects.specular, run)?;
        stages.push(Stage::Environment(Box::new(lit)));
    }
    Ok(stages)
}

/// One tile through all stages.
struct Shade<'a, 's, M: LobeModel> {
    surface: &'a Surface<'a>,
    pairs: &'a Pairs<M, f32>,
    grid: Grid,
    stages: &'a [Stage<'s>],
    background: [f32; 3],
    block: &'a mut Block,
    coefficients: &'a mut [Plane],
    start: usize,
    light: [&'a mut [f32]; 3],
    coverage: &'a mut [f32],
}

impl<M: LobeModel> Kernel for Shade<'_, '_, M> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { surface, pairs, grid, stages, background, block, coefficients, start, .. } =
            self;
        let pixels = grid.width * grid.height;
        let light = self.light;
        let needs_place = (0..pairs.len()).any(|lamp| !pairs.is_distant(lamp))
            || stages
                .iter()
                .any(|stage| matches!(stage, Stage::Environment(lit) if lit.needs_place()));
        let total = self.coverage.len();
        for first in (0..total).step_by(BLOCK) {
            let count = BLOCK.min(total - first);
            let at = start + first;
            for (axis, plane) in block.normal.iter_mut().enumerate() {
                copied(surface.normal, axis * pixels + at, count, plane);
            }
            for (k, plane) in coefficients.iter_mut().enumerate() {
                copied(surface.diffuse, k * pixels + at, count, plane);
            }
            if needs_place {
                grid.coordinates(at, &mut block.x, &mut block.y);
            }
            block.light = [[0.0; BLOCK]; 3];
            block.diffuse.fill(0.0);
            block.specular.fill(0.0);
            for stage in stages {
                match stage {
                    Stage::Reach(lamp) => diffuse::reach::<I>(block, lamp),
                    Stage::Shadow(visible) => visible.shade(block, at),
                    Stage::Diffuse(lamp, interface) => {
                        diffuse::diffuse::<I>(block, lamp, *interface);
                    }
                    Stage::Specular(lamp, lobe, colour) => {
                        let lobe = (*lamp, *lobe);
                        specular::specular::<I, M>(block, pairs, lobe, colour, (at, count));
                    }
                    Stage::Ambient(lamp, ambient, colour) => {
                        colour::ambient::<I>(block, lamp, ambient, colour, (at, count));
                    }
                    Stage::Colour(colour) => colour::colour::<I>(block, coefficients, colour),
                    Stage::Environment(lit) => lit.shade::<I>(block, coefficients, (at, count)),
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
