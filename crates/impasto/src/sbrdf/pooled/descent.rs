//! Paths of iteratively reweighted least squares [@holland1977robust], one pixel per lane: a lane whose
//! path has ended begins its pixel's next path, or takes the next pixel.
//!
//! Weights follow the residuals: the curvature of the scale is a share of that of the weighted sum of
//! squares, and Gauss-Newton steps under fixed weights fall short. They are relaxed
//! [@huber1981robust]: the first by what normal noise asks for, each other by how it differs from the one
//! before (Aitken's accelerator for vectors [@irons1969aitken]).

use crate::math::lanes::{MAX_LANES, put};
use crate::math::{Mask, Real, Vec3};
use crate::pixels::Run;

use super::pixel::{Equations, FARTHEST, Pixels, tangents};
use super::samples::{PooledTile, Rows, STRIDE, Samples, TileMut};

/// Longest step of a normal, rad: a lobe is not linear for longer.
const LONGEST_STEP: f64 = 0.1;

/// A step that has raised the scale is tried at this share of its length.
const SHORTER: f64 = 0.25;

/// Factors of steps: no shorter than under fixed weights, and not much longer. Up to twice as long, they are
/// fewer, but end in other valleys: where the frames of `tests/test_merge.py` meet, normals differ by a tenth
/// more.
const FACTORS: [f64; 2] = [1.0, 1.3];

/// A path from another start that comes as near to a place that is known, rad, with less than this
/// many times its squared scale, would end there.
const MET: f64 = 1e-3;
const MET_SCALE: f64 = 1.01;

/// Paths of a pixel that starts again: from where it was, from the normal that faces the viewer, and
/// from the facet that mirrors the brightest photograph.
const PATHS: f64 = 3.0;

/// Lanes wait until one in so many has ended: new samples cost all lanes something.
const WAITING: usize = 4;

/// How far a path goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stopping {
    /// Steps at most.
    pub(super) steps: usize,
    /// A step that changes the squared scale by a smaller share is the last.
    pub(super) tolerance: f64,
}

/// The paths of a tile's pixels.
pub(super) struct Paths<'a> {
    pub(super) samples: &'a Samples,
    /// Where they begin.
    pub(super) tile: &'a PooledTile<'a>,
    pub(super) stopping: Stopping,
    /// The squared scale up to which a pixel that has converged does not start again; none starts
    /// again without one.
    pub(super) noise: Option<f64>,
    /// Factor of a path's first step.
    pub(super) relaxation: f64,
    pub(super) run: &'a Run<'a>,
}

/// A place: normal, colours and squared scale.
struct Place<R: Real> {
    normal: Vec3<R>,
    colours: Vec<R>,
    scale: R,
}

impl<R: Real<Scalar = f32>> Place<R> {
    fn nowhere(bands: usize) -> Self {
        let zero = R::zero();
        Self { normal: Vec3::new(zero, zero, R::one()), colours: vec![zero; bands], scale: zero }
    }

    /// Takes some lanes of another place.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn take(&mut self, lanes: R::Mask, other: &Self) {
        self.normal = Vec3::select(lanes, other.normal, self.normal);
        self.scale = R::select(lanes, other.scale, self.scale);
        for band in 0..self.colours.len() {
            self.colours[band] = R::select(lanes, other.colours[band], self.colours[band]);
        }
    }
}

/// Memory of as many paths as a register has lanes.
pub(super) struct Lanes<R: Real> {
    /// The samples of the pixels in the lanes, plane by plane.
    planes: Vec<f32>,
    x: [f32; MAX_LANES],
    y: [f32; MAX_LANES],
    /// Which pixel is in a lane, if the lane's bit says that one is.
    held: [usize; MAX_LANES],
    busy: u32,
    /// Paths that go on.
    active: R::Mask,
    /// Further steps would change nothing.
    converged: R::Mask,
    better: R::Mask,
    /// Places visited.
    visits: R,
    best: Place<R>,
    /// Largest square of a photograph at the best place.
    farthest: R,
    trial: Place<R>,
    tilt: [R; 2],
    /// The last step under fixed weights, and what it was multiplied by.
    unrelaxed: [R; 2],
    factor: R,
    changes: Vec<R>,
    fresh: Vec<R>,
    pulls: Vec<R>,
    /// Paths that the pixel has had before.
    before: R,
    /// The best place of all the pixel's paths.
    least: Place<R>,
    /// Where the pixel's first path has ended.
    first: (Vec3<R>, R),
    first_converged: R::Mask,
    brightest: Vec3<R>,
}

impl<R: Real<Scalar = f32>> Lanes<R> {
    pub(super) fn new(bands: usize, observations: usize) -> Self {
        let (zero, no) = (R::zero(), R::Mask::splat(false));
        let up = Vec3::new(zero, zero, R::one());
        Self {
            planes: vec![0.0; bands * observations * R::WIDTH],
            x: [0.0; MAX_LANES],
            y: [0.0; MAX_LANES],
            held: [0; MAX_LANES],
            busy: 0,
            active: no,
            converged: no,
            better: no,
            visits: zero,
            best: Place::nowhere(bands),
            farthest: zero,
            trial: Place::nowhere(bands),
            tilt: [zero; 2],
            unrelaxed: [zero; 2],
            factor: zero,
            changes: vec![zero; bands],
            fresh: vec![zero; bands],
            pulls: vec![zero; bands],
            before: zero,
            least: Place::nowhere(bands),
            first: (up, zero),
            first_converged: no,
            brightest: up,
        }
    }

    /// Writes where the best path of every pixel ends, of some only if the run is cancelled. `GLOSS` and
    /// `SLOPES` as in [`Pixels::leave`] and [`Pixels::equations`].
    #[inline(always)]
    pub(super) fn descend<const GLOSS: bool, const SLOPES: usize>(
        &mut self,
        pixels: &mut Pixels<'_, R>,
        paths: &Paths<'_>,
        out: &mut TileMut<'_>,
    ) {
        let mut next = 0;
        loop {
            if self.waiting(next < paths.tile.count) {
                self.store(out);
                if paths.run.cancelled() {
                    return;
                }
                if self.busy == 0 && next == paths.tile.count {
                    return;
                }
                self.refill(paths, &mut next);
                let rows = Rows { planes: &self.planes, stride: R::WIDTH, x: &self.x, y: &self.y };
                pixels.look(&rows, 0);
                if paths.noise.is_some() {
                    self.brightest = pixels.brightest_facet();
                }
            }
            let stopped = self.arrive::<GLOSS>(pixels, paths);
            if stopped.any() {
                self.turn(stopped, paths.noise);
            }
            if self.active.any() {
                self.step::<SLOPES>(pixels, R::of(paths.relaxation));
            }
        }
    }

    /// Residuals where the last step has led; which paths end here.
    #[inline(always)]
    fn arrive<const GLOSS: bool>(
        &mut self,
        pixels: &mut Pixels<'_, R>,
        paths: &Paths<'_>,
    ) -> R::Mask {
        let one = R::one();
        let Self { best, trial, better, .. } = self;
        let first = self.visits.lt(one);
        pixels.leave::<GLOSS>(trial.normal, &trial.colours);
        let scale = pixels.scale(R::select(first, pixels.above(), best.scale));
        trial.scale = scale;
        let whole = *better & !first;
        *better = self.active & ((first & scale.is_finite()) | (!first & scale.lt(best.scale)));
        // A lane stops on its own account: its neighbours change no result. The gain of a
        // shortened step is no test of convergence.
        let tolerance = R::of(paths.stopping.tolerance);
        let converged = whole
            & scale.lt(best.scale * (one + tolerance))
            & scale.gt(best.scale * (one - tolerance));
        self.converged = self.converged | (self.active & converged);
        let mut goes_on = self.active & !converged & (!first | *better);
        if paths.noise.is_some() {
            let (normal, known) = self.first;
            let met = (trial.normal - normal).length_squared().lt(R::of(MET * MET))
                & scale.lt(known * R::of(MET_SCALE))
                & self.first_converged;
            let again = *better & !first & self.before.gt(R::zero());
            goes_on = goes_on & !(again & met);
        }
        best.take(*better, trial);
        self.farthest = R::select(*better, pixels.farthest(), self.farthest);
        self.visits = self.visits + one;
        goes_on = goes_on & self.visits.le(R::of(paths.stopping.steps as f64));
        let stopped = self.active & !goes_on;
        self.active = goes_on;
        stopped
    }

    /// From the end of a path to the start of the pixel's next, if it needs one.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn turn(&mut self, stopped: R::Mask, noise: Option<f64>) {
        let (zero, one) = (R::zero(), R::one());
        let best = &self.best;
        let first = stopped & self.before.lt(one);
        self.first.0 = Vec3::select(first, best.normal, self.first.0);
        self.first.1 = R::select(first, best.scale, self.first.1);
        self.first_converged = (first & self.converged) | (!first & self.first_converged);
        self.least.take(stopped & (first | best.scale.lt(self.least.scale)), best);
        let Some(noise) = noise else { return };
        // No photograph is farther off than the painting's noise: no other place has a reason to be
        // better.
        let described =
            self.farthest.lt(best.scale * R::of(FARTHEST)) & best.scale.lt(R::of(noise));
        let again = stopped
            & !(first & described & self.converged)
            & self.least.scale.is_finite()
            & self.before.lt(R::of(PATHS - 1.0));
        self.before = R::select(again, self.before + one, self.before);
        let up = Vec3::new(zero, zero, one);
        let start = Vec3::select(self.before.gt(one), self.brightest, up);
        self.trial.normal = Vec3::select(again, start, self.trial.normal);
        for band in 0..self.changes.len() {
            let (own, other) = (self.trial.colours[band], self.least.colours[band]);
            self.trial.colours[band] = R::select(again, other, own);
        }
        self.visits = R::select(again, zero, self.visits);
        self.converged = self.converged & !again;
        self.active = self.active | again;
    }

    /// From the last place to the next; paths that begin are there already.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn step<const SLOPES: usize>(&mut self, pixels: &Pixels<'_, R>, relaxation: R) {
        let (zero, shorter) = (R::zero(), R::of(SHORTER));
        let under_way = self.visits.gt(zero);
        let (normal, scale) = (self.trial.normal, self.best.scale);
        let (colours, pulls) = (&self.trial.colours, &mut self.pulls);
        let sums = pixels.equations::<SLOPES>(normal, colours, scale, pulls);
        let tilt = step_of(&sums, colours, pulls);
        sums.follow(tilt, colours, pulls, &mut self.fresh);
        let factor = self.factor(tilt, relaxation);
        // Lanes that did not get better go a part of their last step from where they were best.
        for i in 0..2 {
            self.tilt[i] = R::select(self.better, tilt[i] * factor, self.tilt[i] * shorter);
        }
        let Self { best, trial, .. } = self;
        let along = tangents(best.normal);
        let [a, b] = self.tilt;
        let normal = along[1].mul_add(b, along[0].mul_add(a, best.normal)).normalised();
        trial.normal = Vec3::select(under_way, normal, trial.normal);
        for band in 0..self.changes.len() {
            let again = self.changes[band] * shorter;
            let change = R::select(self.better, self.fresh[band] * factor, again);
            self.changes[band] = change;
            let colour = (best.colours[band] + change).max(zero);
            trial.colours[band] = R::select(under_way, colour, trial.colours[band]);
        }
    }

    /// The factor of a step, from the step under fixed weights here and the one before: where steps along a
    /// line shrink evenly, the last factor times the last step over the change of the step leads to the end.
    #[inline(always)]
    fn factor(&mut self, step: [R; 2], first: R) -> R {
        let [a, b] = self.unrelaxed;
        let change = [step[0] - a, step[1] - b];
        let square = change[0].mul_add(change[0], change[1] * change[1]);
        let along = a.mul_add(change[0], b * change[1]);
        let factor = -(self.factor * along) / square;
        let factor = factor.max(R::of(FACTORS[0])).min(R::of(FACTORS[1]));
        let known = self.better & self.visits.gt(R::one()) & square.gt(R::zero()) & !self.limited();
        // From a place that was not better, a step says nothing about the next.
        let better = self.better;
        self.unrelaxed = [R::keep(better, step[0]), R::keep(better, step[1])];
        let longest = R::of(LONGEST_STEP) / step[0].mul_add(step[0], step[1] * step[1]).sqrt();
        self.factor = R::select(known, factor, first).min(longest);
        self.factor
    }

    /// Whether the last step was as long as may be: it says nothing about how far the end is.
    #[inline(always)]
    fn limited(&self) -> R::Mask {
        let [a, b] = self.unrelaxed;
        a.mul_add(a, b * b).gt(R::of(0.99 * LONGEST_STEP * LONGEST_STEP))
    }

    /// Whether it is time for new pixels: enough lanes have ended, or all.
    #[inline(always)]
    fn waiting(&self, more: bool) -> bool {
        let active = self.active.bits();
        let idle = R::WIDTH - active.count_ones() as usize;
        active == 0 || (more && idle >= R::WIDTH.div_ceil(WAITING))
    }

    /// Writes the pixels whose paths have ended, where the ends are numbers.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn store(&mut self, out: &mut TileMut<'_>) {
        let ended = self.busy & !self.active.bits();
        self.busy &= !ended;
        let Place { normal, colours, scale } = &self.least;
        let finite = scale.is_finite() & (normal.x + normal.y + normal.z).is_finite();
        let lanes = ended & finite.bits();
        scatter(normal.x, lanes, out.normal[0], &self.held);
        scatter(normal.y, lanes, out.normal[1], &self.held);
        scatter(normal.z, lanes, out.normal[2], &self.held);
        for band in 0..colours.len() {
            scatter(colours[band], lanes, out.diffuse[band], &self.held);
        }
        scatter(*scale, lanes, out.scale, &self.held);
    }

    /// Puts the next pixels into the lanes that are free.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn refill(&mut self, paths: &Paths<'_>, next: &mut usize) {
        let Paths { samples, tile, .. } = *paths;
        let mut fresh = [0.0; MAX_LANES];
        if self.busy == 0 && *next + R::WIDTH <= tile.count {
            let from = *next..*next + R::WIDTH;
            for plane in 0..self.planes.len() / R::WIDTH {
                let row = &samples.planes[plane * STRIDE..][from.clone()];
                self.planes[plane * R::WIDTH..][..R::WIDTH].copy_from_slice(row);
            }
            self.x[..R::WIDTH].copy_from_slice(&samples.x[from.clone()]);
            self.y[..R::WIDTH].copy_from_slice(&samples.y[from]);
            for lane in 0..R::WIDTH {
                self.held[lane] = *next + lane;
                fresh[lane] = 1.0;
            }
            self.busy = u32::MAX >> (u32::BITS - R::WIDTH as u32);
            *next += R::WIDTH;
        }
        let (mut begun, mut count) = ([0; MAX_LANES], 0);
        for lane in 0..R::WIDTH {
            if self.busy >> lane & 1 == 1 || *next >= tile.count {
                continue;
            }
            self.held[lane] = *next;
            self.x[lane] = samples.x[*next];
            self.y[lane] = samples.y[*next];
            begun[count] = lane;
            count += 1;
            self.busy |= 1 << lane;
            fresh[lane] = 1.0;
            *next += 1;
        }
        if count > 0 {
            self.put(&begun[..count], samples);
        }
        let (zero, held) = (R::zero(), &self.held);
        let fresh = R::load(&fresh).gt(zero);
        let begin = |plane: &[f32], old: R| R::select(fresh, gather(plane, held), old);
        let Vec3 { x, y, z } = self.trial.normal;
        let [nx, ny, nz] = [tile.normal[0], tile.normal[1], tile.normal[2]];
        self.trial.normal = Vec3::new(begin(nx, x), begin(ny, y), begin(nz, z));
        for band in 0..self.changes.len() {
            self.trial.colours[band] = begin(tile.diffuse[band], self.trial.colours[band]);
        }
        self.trial.scale = R::splat(f32::NAN);
        self.best.take(fresh, &self.trial);
        self.before = R::select(fresh, zero, self.before);
        self.visits = R::select(fresh, zero, self.visits);
        self.converged = self.converged & !fresh;
        self.active = self.active | fresh;
    }

    /// Puts the samples of pixels into their lanes, plane by plane: the pixels are neighbours.
    #[inline(always)]
    fn put(&mut self, lanes: &[usize], samples: &Samples) {
        let columns = self.planes.chunks_exact_mut(R::WIDTH);
        for (column, plane) in columns.zip(samples.planes.as_chunks::<STRIDE>().0) {
            for &lane in lanes {
                put(&mut column[lane], plane[self.held[lane] % STRIDE]);
            }
        }
    }
}

/// The values of the pixels that the lanes hold.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
fn gather<R: Real<Scalar = f32>>(plane: &[f32], held: &[usize; MAX_LANES]) -> R {
    let mut lanes = [0.0; MAX_LANES];
    for lane in 0..R::WIDTH {
        lanes[lane] = plane[held[lane]];
    }
    R::load(&lanes)
}

/// Writes some lanes to the pixels that they hold.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
fn scatter<R: Real<Scalar = f32>>(
    value: R,
    lanes: u32,
    plane: &mut [f32],
    held: &[usize; MAX_LANES],
) {
    let mut values = [0.0; MAX_LANES];
    value.store(&mut values);
    for lane in 0..R::WIDTH {
        if lanes >> lane & 1 == 1 {
            plane[held[lane]] = values[lane];
        }
    }
}

/// The tilt that solves the equations, not too long.
#[inline(always)]
fn step_of<R: Real>(sums: &Equations<R>, colours: &[R], pulls: &[R]) -> [R; 2] {
    let [dx, dy] = sums.reduced(colours, pulls).tilt();
    let length = dx.mul_add(dx, dy * dy).sqrt();
    let longest = R::of(LONGEST_STEP);
    let short = R::select(length.gt(longest), longest / length, R::one());
    [dx * short, dy * short]
}
