//! How often passes look at the caller's flag, counted instead of timed; and that tiles have the bits of
//! the whole.

use super::apply::{APPLIED, Application, begin, photographs};
use super::descent::Stopping;
use super::lobe_equations::ScaleReference;
use super::passes::Passes;
use super::pixel::CommonLobe;
use super::samples::{Begin, State};
use super::scale::Gaussian;
use super::verdict::Strengths;
use super::{Extraction, LearnedLobe, PooledMapsMut, apply, fit, learn};
use crate::error::Result;
use crate::geometry::{Light, Rig};
use crate::maps::Status;
use crate::math::{Isa, Kernel, Level, Real, Vec3};
use crate::pixels::{Run, looks, serially};
use crate::sbrdf::Start;
use crate::sbrdf::tests::{PIXELS, Painting, SHAPE, pooled_options};
use crate::stack::{Samples, Shape, Stack};
use crate::surface::{Pairs, TorranceSparrow};

/// Pixels of a register.
struct Width;

impl Kernel for Width {
    type Output = usize;

    #[inline(always)]
    fn run<I: Isa>(self) -> usize {
        I::F32::WIDTH
    }
}

/// Maps of a painting.
#[derive(Clone, Debug)]
struct Maps {
    normal: Vec<f32>,
    diffuse: Vec<f32>,
    residual: Vec<f32>,
    sigma: Vec<f32>,
    misfit: Vec<f32>,
    status: Vec<u8>,
}

impl Maps {
    fn new(pixels: usize) -> Self {
        let map = |planes: usize| vec![-7.0; planes * pixels];
        Self {
            normal: map(3),
            diffuse: map(2),
            residual: map(1),
            sigma: map(1),
            misfit: map(1),
            status: vec![77; pixels],
        }
    }

    fn out(&mut self) -> PooledMapsMut<'_> {
        PooledMapsMut {
            normal: &mut self.normal,
            diffuse: &mut self.diffuse,
            residual: &mut self.residual,
            sigma: &mut self.sigma,
            misfit: &mut self.misfit,
            status: &mut self.status,
        }
    }

    /// The bits of every map, of the pixels of a tile.
    fn bits(&self, width: usize, [column, row]: [usize; 2], size: [usize; 2]) -> Vec<u32> {
        let pixels = self.status.len();
        let places: Vec<usize> = (row..row + size[1])
            .flat_map(|row| (column..column + size[0]).map(move |column| row * width + column))
            .collect();
        let maps = [&self.normal, &self.diffuse, &self.residual, &self.sigma, &self.misfit];
        let planes = maps.into_iter().flat_map(|map| map.chunks(pixels));
        let numbers = planes.flat_map(|plane| places.iter().map(|&place| plane[place].to_bits()));
        numbers.chain(places.iter().map(|&place| u32::from(self.status[place]))).collect()
    }
}

/// Squared scales at the ends of all pixels' paths.
fn scales(painting: &Painting, start: &Start<'_>, stopping: Stopping, restart: bool) -> Vec<f32> {
    let lobe = CommonLobe { beta: 10.0, log_sharpness: 3.0 };
    let stack = &painting.stack();
    let ends = |run: &Run<'_>| {
        let pairs = &Pairs::of_rig(TorranceSparrow { index: 1.45 }, &painting.rig);
        let photographs = &photographs(stack, &painting.rig, start, pairs, false);
        let scale_reference = ScaleReference { brightness: 0.5, noise_floor: 0.0 };
        let passes = Passes { photographs, run, scale_reference, gaussian: Gaussian::of(2) };
        let state = State::new(begin(start, 1.0), PIXELS, run)?;
        let mut to = state.copied(run)?;
        passes.irls(&state, &mut to, lobe, stopping, restart)?;
        Ok::<_, crate::error::Error>(to.scale)
    };
    serially(ends).unwrap()
}

#[test]
fn an_applied_path_leaves_less_than_its_last_step_gained() {
    let painting = Painting::new();
    let ends = |stopping| scales(&painting, &painting.start(), stopping, false);
    let (applied, longest) = (ends(APPLIED), ends(Stopping { steps: 400, tolerance: 0.0 }));
    let left = |(&scale, &least): (&f32, &f32)| f64::from(scale / least) - 1.0;
    let mut left: Vec<f64> = applied.iter().zip(&longest).map(left).collect();
    left.sort_by(f64::total_cmp);
    // Steps that shrink to a third leave an eighth of the last fall: twice that at the median. One path
    // in ten may creep along a valley, where steps shrink by less than a quarter.
    assert!(left[PIXELS / 2] < 0.25 * APPLIED.tolerance, "{}", left[PIXELS / 2]);
    assert!(left[9 * PIXELS / 10] < APPLIED.tolerance, "{}", left[9 * PIXELS / 10]);
}

#[test]
fn other_starts_find_what_paths_from_a_wrong_normal_miss() {
    let painting = Painting::new();
    let tilted = Vec3::new(-0.9, 0.2, 0.4).normalised().array();
    let normal: Vec<f32> = (0..3 * PIXELS).map(|i| tilted[i / PIXELS] as f32).collect();
    let wrong = Start { normal: &normal, ..painting.start() };
    let near = scales(&painting, &painting.start(), APPLIED, false);
    let missed = |start: &Start<'_>, restart| {
        let found = scales(&painting, start, APPLIED, restart);
        found.iter().zip(&near).filter(|&(found, near)| *found > 1.01 * near).count()
    };
    // A hundredth more than where paths from the true normals end is more than either leaves.
    let (alone, restarted) = (missed(&wrong, false), missed(&wrong, true));
    assert!(alone > PIXELS / 10, "{alone}");
    assert!(restarted <= PIXELS / 100, "{restarted}");
}

type Pass<'a> = &'a dyn Fn(&Passes<'_>, Begin<'_>) -> Result<()>;

#[test]
fn a_pass_looks_before_every_register_of_pixels() {
    let painting = Painting::new();
    let (stack, start) = (&painting.stack(), &painting.start());
    let lobe = CommonLobe { beta: 10.0, log_sharpness: 3.0 };
    let looks_of = |level: Level, pass: Pass<'_>| {
        let all = |run: &Run<'_>| {
            let run = &Run { level, ..*run };
            let pairs = &Pairs::of_rig(TorranceSparrow { index: 1.45 }, &painting.rig);
            let photographs = &photographs(stack, &painting.rig, start, pairs, false);
            let scale_reference = ScaleReference { brightness: 0.5, noise_floor: 0.0 };
            let gaussian = Gaussian::of(2);
            pass(&Passes { photographs, run, scale_reference, gaussian }, begin(start, 1.0))
        };
        looks::count(all)
    };
    // How often each visits every pixel: extraction first measures how large samples are, and application
    // fits without a lobe, with it, and measures.
    let passes: [(&str, usize, Pass<'_>); 3] = [
        ("extract", 2, &|passes, begin| passes.extract(begin, Extraction::Residual).map(drop)),
        ("irls", 1, &|passes, begin| {
            let state = State::new(begin, PIXELS, passes.run)?;
            let mut to = state.copied(passes.run)?;
            let stopping = Stopping { steps: 1, tolerance: 2e-5 };
            passes.irls(&state, &mut to, lobe, stopping, true).map(drop)
        }),
        ("apply", 3, &|passes, begin| {
            let application =
                Application { passes: *passes, begin, lobe, refined: true, unit: 1.0 };
            let mut strengths = Strengths::unknown(PIXELS, passes.run)?;
            application.whole(&mut Maps::new(PIXELS).out(), &mut strengths).map(drop)
        }),
    ];
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        let registers = PIXELS / level.run(Width);
        let nothing = looks_of(level, &|_, _| Ok(()));
        for (name, times, pass) in passes {
            let looks = looks_of(level, pass) - nothing;
            // Besides, a few: before and after each tile, and for copies.
            assert!(looks >= times * registers, "{name} on {level:?}: {looks}");
        }
    }
}

/// What a painting's fit learns, and its maps.
fn fitted(painting: &Painting, start: &Start<'_>, joint: bool) -> (LearnedLobe, Maps) {
    let options = pooled_options(joint);
    let mut maps = Maps::new(PIXELS);
    let (stack, rig) = (painting.stack(), &painting.rig);
    let learned = serially(|run| {
        let learned = learn(&stack, rig, start, &options, run)?;
        let again = fit(&stack, rig, start, &options, &mut maps.out(), run)?;
        assert_eq!(learned.lobe, again.lobe);
        Ok::<_, crate::error::Error>(learned)
    });
    (learned.unwrap(), maps)
}

#[test]
fn a_tile_has_the_bits_of_the_whole() {
    let mut painting = Painting::new();
    // Near lights, so that a pixel's place matters; some pixels without a normal, and one whose squares overflow.
    let near = painting.rig.lights().iter().map(|light| {
        let position = light.direction().scale(60.0);
        Light::Point { position, falloff: true }
    });
    let whole = painting.rig.grid();
    let lights: Vec<Light> = near.collect();
    painting.rig = Rig::new(lights.clone(), painting.rig.views().to_vec(), whole).unwrap();
    let mut status = vec![0; PIXELS];
    for pixel in (0..PIXELS).step_by(37) {
        status[pixel] = Status::TooFewSamples.code();
    }
    for plane in painting.samples.chunks_mut(PIXELS) {
        plane[123] = f32::MAX;
    }
    for joint in [true, false] {
        for power in [0, 40] {
            let factor = 2.0_f32.powi(power);
            let mut painting = painting.clone();
            painting.samples.iter_mut().for_each(|sample| *sample *= factor);
            let diffuse: Vec<f32> = painting.start().diffuse.iter().map(|v| v * factor).collect();
            let start = Start { diffuse: &diffuse, status: &status, ..painting.start() };
            let (learned, maps) = fitted(&painting, &start, joint);
            assert_eq!(learned.lobe.refined, joint);
            for [column, row, width, height] in
                [[0, 0, 40, 16], [0, 0, 7, 5], [13, 3, 27, 13], [39, 15, 1, 1], [5, 7, 30, 2]]
            {
                let shape = Shape { height, width, ..SHAPE };
                let cut = |plane: &[f32]| -> Vec<f32> {
                    let rows = plane.chunks(40).skip(row).take(height);
                    rows.flat_map(|line| line[column..column + width].iter().copied()).collect()
                };
                let planes =
                    |map: &[f32]| -> Vec<f32> { map.chunks(PIXELS).flat_map(cut).collect() };
                let samples = planes(&painting.samples);
                let stack =
                    Stack::new(Samples::F32(&samples), shape, &painting.decode, None).unwrap();
                let grid = whole.tile([column, row], width, height).unwrap();
                let rig = Rig::new(lights.clone(), painting.rig.views().to_vec(), grid).unwrap();
                let status: Vec<u8> = status
                    .chunks(40)
                    .skip(row)
                    .take(height)
                    .flat_map(|line| line[column..column + width].to_vec())
                    .collect();
                let (normal, diffuse) = (planes(start.normal), planes(start.diffuse));
                let start = Start { normal: &normal, diffuse: &diffuse, status: &status };
                let mut tile = Maps::new(width * height);
                serially(|run| apply(&learned.lobe, &stack, &rig, &start, &mut tile.out(), run))
                    .unwrap();
                let here = tile.bits(width, [0, 0], [width, height]);
                assert_eq!(here, maps.bits(40, [column, row], [width, height]), "{joint} {power}");
            }
        }
    }
}

#[test]
fn what_is_learned_with_another_number_of_classes_is_refused() {
    let painting = Painting::new();
    let (learned, mut maps) = fitted(&painting, &painting.start(), false);
    let mut lobe = learned.lobe;
    lobe.noise.pop();
    let (stack, rig) = (painting.stack(), &painting.rig);
    let refused =
        |run: &Run<'_>| apply(&lobe, &stack, rig, &painting.start(), &mut maps.out(), run);
    assert!(serially(refused).is_err());
}
