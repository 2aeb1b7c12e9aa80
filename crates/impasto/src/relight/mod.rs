//! From maps to light: eq. 1 of the six-band paper, eq. 9 of the RGB-camera paper.
//!
//! Pixels go through a list of stages, block by block. A [`plan`] says what a scene calls for: what
//! it does not call for anywhere is not in the list, and a tile skips what it can do without
//! ([`statistics`], [`bounds`]). Per lamp: its irradiance, [`shadow`], the diffuse term, the
//! interface term of every lobe; per illuminant: colour, as one matrix. An [`environment`] adds its
//! light in three colours. The picture is light
//! ([`render`]), which goes through the [`view`] if it is slanted, or display codes ([`paint`]).

use crate::error::{Error, Result};
use crate::geometry::Grid;
use crate::pixels::{Run, zeros};
use crate::surface::Surface;

mod area;
mod block;
mod bounds;
mod colour;
pub mod curve;
mod diffuse;
pub mod environment;
pub mod occlusion;
pub mod plan;
mod relief;
pub mod scene;
pub mod shadow;
pub mod show;
mod specular;
mod stages;
pub mod statistics;
mod steps;
pub mod tolerance;
pub mod view;
mod visible;

pub use relief::Relief;
pub use show::Canvas;

use plan::Plan;
use scene::Scene;
use show::Clipped;
use stages::{Shading, Target};

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

/// Lights a painting as planned; where its maps hold no number the picture holds `background`.
///
/// # Errors
/// If sizes disagree, or the caller cancels.
pub fn render(
    surface: &Surface<'_>,
    relief: Relief<'_>,
    scene: &Scene,
    plan: &Plan,
    background: [f32; 3],
    run: &Run<'_>,
) -> Result<Picture> {
    let grid = relief.grid;
    let pixels = grid.width * grid.height;
    if plan.projected() {
        let mut lit = zeros(pixels)?;
        shaded(surface, relief, scene, plan, background, Target::Seen(&mut lit), run)?;
        let height = relief.height.filter(|_| plan.displaced());
        let (light, coverage, grid) =
            view::lit_seen_from(scene.view(), &lit, grid, height, background, run)?;
        return Ok(Picture { light, coverage, grid });
    }
    let (mut light, mut coverage) = (zeros(3 * pixels)?, zeros(pixels)?);
    let target = Target::Light { light: &mut light, coverage: &mut coverage };
    shaded(surface, relief, scene, plan, background, target, run)?;
    Ok(Picture { light, coverage, grid })
}

/// The same as 8-bit display codes, without planes of light in between: a picture that is not
/// projected.
///
/// # Errors
/// If sizes disagree, the plan projects, or the caller cancels.
pub fn paint(
    surface: &Surface<'_>,
    relief: Relief<'_>,
    scene: &Scene,
    plan: &Plan,
    background: [f32; 3],
    canvas: Canvas<'_>,
    run: &Run<'_>,
) -> Result<Clipped> {
    if plan.projected() {
        return Err(Error::argument("view", "a slanted view has light first, then codes"));
    }
    let pixels = relief.grid.width * relief.grid.height;
    if canvas.codes.len() != 3 * pixels || canvas.coverage.len() != pixels {
        return Err(Error::argument("canvas", format!("it is not as large as {pixels} pixels")));
    }
    shaded(surface, relief, scene, plan, background, Target::Codes(canvas), run)
}

/// The painting's own pixels through all stages, into a target of their size.
fn shaded(
    surface: &Surface<'_>,
    relief: Relief<'_>,
    scene: &Scene,
    plan: &Plan,
    background: [f32; 3],
    target: Target<'_>,
    run: &Run<'_>,
) -> Result<Clipped> {
    let grid = checked(surface, relief, scene, plan)?;
    let sources = &area::sources(scene.lamps());
    let stages = &stages::list((surface, relief), (scene, &sources.1), plan, run)?;
    let lights = &sources.0[..];
    let shading = Shading { surface, grid, scene, lights, plan, stages, background, target, run };
    surface.model.visit(shading)
}

/// The grid, if the maps, the scene and the plan belong together.
fn checked(surface: &Surface<'_>, relief: Relief<'_>, scene: &Scene, plan: &Plan) -> Result<Grid> {
    let grid = relief.grid;
    if surface.bands(grid.width * grid.height)? != scene.coefficients() {
        let problem = format!("expected {} planes of the painting's size", scene.coefficients());
        return Err(Error::argument("coefficients", problem));
    }
    plan.fits(grid, scene)?;
    Ok(grid)
}
