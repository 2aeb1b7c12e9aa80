//! The list of stages of a picture, and the loop that sends blocks through it.

use super::area::Source;
use super::block::{BLOCK, Block, Pixels, Plane, plane};
use super::colour::{ambient, colour};
use super::diffuse::{self, Interface};
use super::environment::stage::{Lit, Sky};
use super::plan::{LIT, NEAR, Plan, SHADED, lobe_bit};
use super::relief::Relief;
use super::scene::{Colour, Lamp, Scene, Surroundings};
use super::shadow::horizon::seen_where;
use super::shadow::{self, SIDE};
use super::show::{Canvas, Clipped, Codes, Display, Show, ShowScratch};
use super::specular::specular;
use super::view;
use super::visible::Visible;
use crate::error::Result;
use crate::geometry::{Grid, Light};
use crate::math::{Isa, Kernel, Level};
use crate::pixels::{Run, TILE};
use crate::surface::{Lobe, LobeModel, ModelVisitor, Pairs, Surface};

/// What is done to a block; lamps go by their number.
pub(super) enum Stage<'a> {
    /// Irradiance of a lamp at normal incidence.
    Reach(Lamps<'a>),
    Shadow(usize, Visible),
    Diffuse(Lamps<'a>, Interface),
    /// Of a lamp, its points, by the lobes of these numbers.
    Specular(usize, &'a Source, Vec<usize>, &'a [Lobe<'a>], &'a Colour),
    Ambient(&'a Lamp, &'a [f32], &'a Colour),
    Colour(&'a Colour),
    /// All that an environment sheds.
    Environment(Box<Lit<'a>>),
}

/// A lamp as it is, and as the middle of the painting sees it.
#[derive(Clone, Copy)]
pub(super) struct Lamps<'a> {
    number: usize,
    near: &'a Lamp,
    distant: Lamp,
}

impl<'a> Lamps<'a> {
    fn new(number: usize, near: &'a Lamp) -> Self {
        Self {
            number,
            near,
            distant: Lamp { light: Light::Distant(near.light.direction()), ..*near },
        }
    }

    #[inline(always)]
    fn of(&self, parts: u32) -> &Lamp {
        if parts & NEAR == 0 { &self.distant } else { self.near }
    }
}

/// What a plan calls for anywhere, in order.
pub(super) fn list<'a>(
    (surface, relief): (&'a Surface<'a>, Relief<'_>),
    (scene, sources): (&'a Scene, &'a [Source]),
    plan: &Plan,
    run: &Run<'_>,
) -> Result<Vec<Stage<'a>>> {
    let mut stages = Vec::new();
    let interface = surface.coated.map(|coated| (coated, scene.view()));
    for (index, colour) in scene.colours().iter().enumerate() {
        let lamps = scene.lamps().iter().enumerate();
        for (number, lamp) in lamps.filter(|(_, lamp)| lamp.colour == index) {
            if plan.needs(number, LIT) {
                let lamps = Lamps::new(number, lamp);
                stages.push(Stage::Reach(lamps));
                if let (true, Some(height)) = (plan.needs(number, SHADED), relief.height) {
                    let shaded = |column: usize, row: usize| {
                        plan.parts(column * SIDE, row * SIDE)[number] & SHADED != 0
                    };
                    let (grid, light) = (relief.grid, &lamp.light);
                    let visible = if lamp.has_size() {
                        let light = (light, lamp.radius);
                        let seen = seen_where(height, grid, light, shaded, run)?;
                        Visible::Shares(seen)
                    } else {
                        Visible::Bits(shadow::visible_where(height, grid, light, shaded, run)?)
                    };
                    stages.push(Stage::Shadow(number, visible));
                }
                stages.push(Stage::Diffuse(lamps, interface));
                let needed = |lobe: &usize| plan.needs(number, lobe_bit(*lobe));
                let seen: Vec<usize> = (0..surface.lobes.len()).filter(needed).collect();
                if !seen.is_empty() {
                    let (source, lobes) = (&sources[number], &surface.lobes[..]);
                    stages.push(Stage::Specular(number, source, seen, lobes, colour));
                }
            }
            stages.extend(surface.ambient.map(|ambient| Stage::Ambient(lamp, ambient, colour)));
        }
        stages.push(Stage::Colour(colour));
    }
    if let Some(Surroundings { environment, colours, albedo }) = scene.environment() {
        let light = (environment.as_ref(), *colours);
        let sky = match relief.height.filter(|_| plan.needs_sky()) {
            Some(height) => {
                let albedo = if plan.bounces() { *albedo as f32 } else { 0.0 };
                let wanted = |column, row| plan.hides_sky(column, row);
                Some(Sky::over(height, relief.grid, albedo, wanted, run)?)
            }
            None => None,
        };
        let lit = Lit::new(surface, scene, light, sky, run)?;
        stages.push(Stage::Environment(Box::new(lit)));
    }
    Ok(stages)
}

/// Where a picture goes.
pub(super) enum Target<'a> {
    /// `(3, y, x)` and `(y, x)`.
    Light {
        light: &'a mut [f32],
        coverage: &'a mut [f32],
    },
    /// `(y, x)`, to be seen from the side.
    Seen(&'a mut [view::Lit]),
    Codes(Canvas<'a>),
}

/// Some rows of a target.
enum Rows<'a> {
    Light { light: [&'a mut [f32]; 3], coverage: &'a mut [f32] },
    Seen(&'a mut [view::Lit]),
    Codes(Canvas<'a>),
}

impl<'a> Target<'a> {
    /// Pieces of so many pixels.
    fn pieces(self, pixels: usize) -> Vec<Rows<'a>> {
        match self {
            Self::Light { light, coverage } => {
                let (red, rest) = light.split_at_mut(coverage.len());
                let (green, blue) = rest.split_at_mut(coverage.len());
                let [red, green, blue] = [red, green, blue].map(|plane| plane.chunks_mut(pixels));
                let light = red.zip(green).zip(blue).map(|((r, g), b)| [r, g, b]);
                let pieces = light.zip(coverage.chunks_mut(pixels));
                pieces.map(|(light, coverage)| Rows::Light { light, coverage }).collect()
            }
            Self::Seen(lit) => lit.chunks_mut(pixels).map(Rows::Seen).collect(),
            Self::Codes(Canvas { codes, coverage, display }) => {
                let pieces = codes.chunks_mut(3 * pixels).zip(coverage.chunks_mut(pixels));
                let canvas = |(codes, coverage)| Canvas { codes, coverage, display };
                pieces.map(|piece| Rows::Codes(canvas(piece))).collect()
            }
        }
    }
}

impl Rows<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Light { coverage, .. } | Self::Codes(Canvas { coverage, .. }) => coverage.len(),
            Self::Seen(lit) => lit.len(),
        }
    }
}

/// The whole picture through all stages.
pub(super) struct Shading<'a, 's, 'r> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) grid: Grid,
    pub(super) scene: &'a Scene,
    /// The points of all lamps.
    pub(super) lights: &'a [Light],
    pub(super) plan: &'a Plan,
    pub(super) stages: &'a [Stage<'s>],
    pub(super) background: [f32; 3],
    pub(super) target: Target<'a>,
    pub(super) run: &'a Run<'r>,
}

/// Memory of one worker.
struct Scratch {
    block: Block,
    /// What is left of maps at the end of a row.
    rest: Vec<Plane>,
    show: ShowScratch,
}

impl ModelVisitor for Shading<'_, '_, '_> {
    type Output = Result<Clipped>;

    fn visit<M: LobeModel>(self, model: M) -> Self::Output {
        let Self { surface, grid, scene, lights, plan, stages, background, target, run } = self;
        let view = scene.view();
        let pairs = Pairs::new(model, lights.iter().map(|light| (*light, view)));
        let rows = (TILE / grid.width).max(1);
        let pieces = target.pieces(rows * grid.width).into_iter().enumerate().collect();
        let clipped = run.map(
            pieces,
            || {
                Box::new(Scratch {
                    block: Block::new(),
                    rest: vec![[0.0; BLOCK]; 3 + scene.coefficients()],
                    show: ShowScratch::default(),
                })
            },
            |scratch, (index, target)| {
                let first = index * rows;
                let (level, pairs) = (run.level, &pairs);
                let shade = Shade {
                    surface,
                    grid,
                    plan,
                    stages,
                    pairs,
                    background,
                    level,
                    scratch,
                    first,
                    target,
                };
                level.run(shade)
            },
        )?;
        Ok(clipped.into_iter().fold(Clipped::default(), Clipped::plus))
    }
}

/// Some rows through all stages.
struct Shade<'a, 's, M: LobeModel> {
    surface: &'a Surface<'a>,
    grid: Grid,
    plan: &'a Plan,
    stages: &'a [Stage<'s>],
    pairs: &'a Pairs<M, f32>,
    background: [f32; 3],
    level: Level,
    scratch: &'a mut Scratch,
    /// The first row.
    first: usize,
    target: Rows<'a>,
}

impl<M: LobeModel> Kernel for Shade<'_, '_, M> {
    type Output = Clipped;

    #[inline(always)]
    fn run<I: Isa>(mut self) -> Clipped {
        let Self { surface, grid, plan, stages, pairs, background, .. } = self;
        let size = grid.width * grid.height;
        let placed =
            |stage: &Stage<'_>| matches!(stage, Stage::Environment(lit) if lit.needs_place());
        let needs_place =
            (0..pairs.len()).any(|lamp| !pairs.is_distant(lamp)) || stages.iter().any(placed);
        let mut clipped = Clipped::default();
        for row in 0..self.target.len() / grid.width {
            for column in (0..grid.width).step_by(BLOCK) {
                let Scratch { block, rest, show } = &mut *self.scratch;
                let count = BLOCK.min(grid.width - column);
                let at = (self.first + row) * grid.width + column;
                let parts = plan.parts(column, self.first + row);
                if let Rows::Codes(canvas) = &mut self.target {
                    let matrix = canvas.display.matrix;
                    if let Some(above) = plan.all_beyond(column, self.first + row, matrix) {
                        let start = row * grid.width + column;
                        clipped = clipped.plus(canvas.fill(above, start..start + count));
                        continue;
                    }
                }
                block.begin();
                let maps =
                    surface.normal.chunks_exact(size).chain(surface.diffuse.chunks_exact(size));
                let maps = maps.zip(rest).map(|(map, rest)| plane(map, at, count, rest));
                let maps: Vec<&Plane> = maps.collect();
                let normal = [maps[0], maps[1], maps[2]];
                let pixels = &Pixels { normal, coefficients: &maps[3..], start: at, count };
                if needs_place {
                    grid.coordinates(at, &mut block.x[..count], &mut block.y[..count]);
                }
                for stage in stages {
                    match stage {
                        Stage::Reach(lamps) => {
                            if parts[lamps.number] & LIT != 0 {
                                diffuse::reach::<I>(block, count, lamps.of(parts[lamps.number]));
                            }
                        }
                        Stage::Shadow(number, visible) => {
                            if parts[*number] & SHADED != 0 {
                                visible.shade(block, column, self.first + row);
                            }
                        }
                        Stage::Diffuse(lamps, interface) => {
                            if parts[lamps.number] & LIT != 0 {
                                let lamp = lamps.of(parts[lamps.number]);
                                diffuse::diffuse::<I>(block, pixels, lamp, *interface);
                            }
                        }
                        Stage::Specular(number, source, seen, lobes, colour) => {
                            let seen =
                                seen.iter().filter(|&&lobe| parts[*number] & lobe_bit(lobe) != 0);
                            let lobes = seen.map(|&lobe| &lobes[lobe]);
                            specular::<I, M>(block, pixels, pairs, source, lobes, colour);
                        }
                        Stage::Ambient(lamp, map, colour) => {
                            ambient::<I>(block, lamp, map, colour, (at, count));
                        }
                        Stage::Colour(one) => colour::<I>(block, pixels, one),
                        Stage::Environment(lit) => {
                            let corner = [column, self.first + row];
                            lit.shade::<I>(block, pixels, corner);
                        }
                    }
                }
                let start = row * grid.width + column;
                match &mut self.target {
                    Rows::Light { light, coverage } => {
                        block.cover::<I>(pixels, background, &mut coverage[start..start + count]);
                        for (light, plane) in light.iter_mut().zip(&block.light) {
                            light[start..start + count].copy_from_slice(&plane[..count]);
                        }
                    }
                    Rows::Seen(lit) => {
                        let mut covered = [0.0; BLOCK];
                        block.cover::<I>(pixels, [0.0; 3], &mut covered[..count]);
                        let [red, green, blue] = &block.light;
                        let light = red.iter().zip(green).zip(blue).zip(&covered);
                        let lit = &mut lit[start..start + count];
                        for (lit, (((red, green), blue), covered)) in lit.iter_mut().zip(light) {
                            *lit = [*red, *green, *blue, *covered];
                        }
                    }
                    Rows::Codes(Canvas { codes, coverage, display }) => {
                        block.cover::<I>(pixels, background, &mut coverage[start..start + count]);
                        let codes = Codes::Eight(&mut codes[3 * start..3 * (start + count)]);
                        let planes = block.light.as_flattened();
                        let Display { matrix, curve } = *display;
                        let start = 0;
                        let shown = Show { planes, pixels: BLOCK, start, matrix, curve, codes };
                        clipped = clipped.plus(shown.on(show, self.level));
                    }
                }
            }
        }
        clipped
    }
}
