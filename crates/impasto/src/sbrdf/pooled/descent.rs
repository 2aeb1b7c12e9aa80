//! Paths of iteratively reweighted least squares [@holland1977robust], one per lane: a lane whose path
//! has ended takes the next pixel.
//!
//! Weights follow the residuals: the curvature of the scale is a share `c` of that of the weighted sum of
//! squares, and a Gauss-Newton step under fixed weights is too short by it. It is known for normal noise
//! ([`Gaussian::curvature`](super::scale::Gaussian)), and 1 where outliers are far and all else
//! agrees. Steps are relaxed [@huber1981robust] by `2 / (1 + c)`, which shortens an error by the same
//! factor at either end, and by more in between.

use crate::math::lanes::{MAX_LANES, put};
use crate::math::{Mask, Real, Vec3};
use crate::pixels::{Run, TILE};

use super::pixel::{Equations, Pixels, tangents};
use super::samples::{Rows, Samples, State};

/// Longest step of a normal, rad: a lobe is not linear for longer.
const LONGEST_STEP: f64 = 0.1;

/// A step that has raised the scale is tried at this share of its length.
const SHORTER: f64 = 0.25;

/// A path from another start that comes as near to a place that is known, rad, with less than this
/// many times its squared scale, would end there.
const MET: f64 = 1e-3;
const MET_SCALE: f64 = 1.01;

/// Lanes wait until a share of them have ended: new samples cost all lanes something.
const WAITING: usize = 4;

/// Where a path begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// At a given normal.
    Given,
    /// At the normal that faces the viewer.
    Facing,
    /// At the facet that mirrors the brightest photograph.
    Brightest,
}

/// How far a path goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stopping {
    /// Steps at most.
    pub(super) steps: usize,
    /// A step that changes the squared scale by a smaller share is the last.
    pub(super) tolerance: f64,
}

/// Where the paths of a tile's pixels have ended.
pub(super) struct Ends {
    pub(super) state: State,
    /// Whether further steps would change nothing.
    pub(super) converged: Vec<bool>,
}

/// Paths of some pixels.
pub(super) struct Paths<'a> {
    pub(super) samples: &'a Samples,
    pub(super) pixels: &'a [usize],
    /// Where each begins, and its squared scale there.
    pub(super) from: &'a State,
    /// A path that meets the end of a known one ends there.
    pub(super) known: Option<&'a Ends>,
    pub(super) to: &'a mut Ends,
    pub(super) stopping: Stopping,
    /// Factor of all steps.
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

    /// Takes the lanes of the mask from the pixels that the lanes hold.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn gather(&mut self, mask: R::Mask, from: &State, held: &[usize; MAX_LANES]) {
        let x = gather(from.normal_plane(0), held);
        let y = gather(from.normal_plane(1), held);
        let z = gather(from.normal_plane(2), held);
        self.normal = Vec3::select(mask, Vec3::new(x, y, z), self.normal);
        for band in 0..self.colours.len() {
            let colour = gather(from.diffuse_plane(band), held);
            self.colours[band] = R::select(mask, colour, self.colours[band]);
        }
        self.scale = R::select(mask, gather(&from.scale, held), self.scale);
    }

    /// Writes some lanes to the pixels that they hold.
    #[inline(always)]
    fn scatter(&self, lanes: u32, to: &mut State, held: &[usize; MAX_LANES]) {
        scatter(self.normal.x, lanes, to.normal_plane_mut(0), held);
        scatter(self.normal.y, lanes, to.normal_plane_mut(1), held);
        scatter(self.normal.z, lanes, to.normal_plane_mut(2), held);
        for band in 0..self.colours.len() {
            scatter(self.colours[band], lanes, to.diffuse_plane_mut(band), held);
        }
        scatter(self.scale, lanes, &mut to.scale, held);
    }
}

/// Memory of paths, as many as a register has lanes.
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
    ended: R::Mask,
    better: R::Mask,
    /// Places visited.
    visits: R,
    best: Place<R>,
    trial: Place<R>,
    tilt: [R; 2],
    changes: Vec<R>,
    fresh: Vec<R>,
    pulls: Vec<R>,
}

impl<R: Real<Scalar = f32>> Lanes<R> {
    pub(super) fn new(bands: usize, observations: usize) -> Self {
        let (zero, no) = (R::zero(), R::Mask::splat(false));
        Self {
            planes: vec![0.0; bands * observations * R::WIDTH],
            x: [0.0; MAX_LANES],
            y: [0.0; MAX_LANES],
            held: [0; MAX_LANES],
            busy: 0,
            active: no,
            ended: no,
            better: no,
            visits: zero,
            best: Place::nowhere(bands),
            trial: Place::nowhere(bands),
            tilt: [zero; 2],
            changes: vec![zero; bands],
            fresh: vec![zero; bands],
            pulls: vec![zero; bands],
        }
    }

    /// Puts a pixel's samples into a lane.
    #[inline(always)]
    fn put(&mut self, lane: usize, samples: &Samples, pixel: usize) {
        let lane = lane % MAX_LANES;
        self.held[lane] = pixel;
        self.x[lane] = samples.x[pixel];
        self.y[lane] = samples.y[pixel];
        let (columns, planes) = (&mut self.planes[..], &samples.planes[..]);
        for plane in 0..planes.len() / TILE {
            put(&mut columns[plane * R::WIDTH + lane], planes[plane * TILE + pixel]);
        }
    }

    fn rows(&self) -> Rows<'_> {
        Rows { planes: &self.planes, stride: R::WIDTH, x: &self.x, y: &self.y }
    }

    /// Writes where the paths of some pixels begin, with the colours of `to`: the normal that is not
    /// given, and the squared scale. False if the run is cancelled.
    #[inline(always)]
    pub(super) fn visit_starts<const GLOSS: bool>(
        &mut self,
        pixels: &mut Pixels<'_, R>,
        samples: &Samples,
        places: &[usize],
        to: &mut State,
        origin: Origin,
        run: &Run<'_>,
    ) -> bool {
        let zero = R::zero();
        for places in places.chunks(R::WIDTH) {
            if run.cancelled() {
                return false;
            }
            for (lane, &pixel) in places.iter().enumerate() {
                self.put(lane, samples, pixel);
            }
            pixels.look(&self.rows(), 0);
            self.trial.gather(R::Mask::splat(true), to, &self.held);
            match origin {
                Origin::Given => {}
                Origin::Facing => self.trial.normal = Vec3::new(zero, zero, R::one()),
                Origin::Brightest => self.trial.normal = pixels.brightest_facet(),
            }
            let Place { normal, colours, scale } = &mut self.trial;
            *scale = pixels.visit::<GLOSS>(*normal, colours, None);
            let lanes = u32::MAX >> (u32::BITS - places.len() as u32);
            self.trial.scatter(lanes, to, &self.held);
        }
        true
    }

    /// Steps down from where the paths begin; false if the run is cancelled. `GLOSS` and `SLOPES` as
    /// in [`Pixels::visit`] and [`Pixels::equations`].
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    pub(super) fn descend<const GLOSS: bool, const SLOPES: usize>(
        &mut self,
        pixels: &mut Pixels<'_, R>,
        mut paths: Paths<'_>,
    ) -> bool {
        let (zero, one) = (R::zero(), R::one());
        let bands = self.changes.len();
        let tolerance = R::of(paths.stopping.tolerance);
        let most = R::of(paths.stopping.steps as f64);
        let (relaxation, shorter) = (R::of(paths.relaxation), R::of(SHORTER));
        let longest = R::of(LONGEST_STEP / paths.relaxation);
        let mut known = Place::nowhere(0);
        let mut known_ended = R::Mask::splat(false);
        let mut next = 0;
        loop {
            if self.waiting(next < paths.pixels.len()) {
                self.store(paths.to);
                if paths.run.cancelled() {
                    return false;
                }
                let fresh = self.refill(&mut paths, &mut next);
                if self.busy == 0 {
                    return true;
                }
                pixels.look(&self.rows(), 0);
                if let Some(ends) = paths.known {
                    known.gather(fresh, &ends.state, &self.held);
                    let ended = gather_flags::<R>(&ends.converged, &self.held);
                    known_ended = (fresh & ended) | (!fresh & known_ended);
                }
            }
            let Self { best, trial, active, better, .. } = self;
            trial.scale = pixels.visit::<GLOSS>(trial.normal, &trial.colours, Some(best.scale));
            // The first place of a path is where it begins.
            let first = self.visits.lt(one);
            let whole = *better & !first;
            *better = *active & (first | trial.scale.lt(best.scale));
            // A lane stops on its own account: its neighbours change no result. The gain of a
            // shortened step is no test of convergence.
            let converged = whole
                & trial.scale.lt(best.scale * (one + tolerance))
                & trial.scale.gt(best.scale * (one - tolerance));
            self.ended = self.ended | (*active & converged);
            *active = *active & !converged;
            if paths.known.is_some() {
                let met = (trial.normal - known.normal).length_squared().lt(R::of(MET * MET))
                    & trial.scale.lt(known.scale * R::of(MET_SCALE));
                *active = *active & !(met & *better & !first & known_ended);
            }
            best.normal = Vec3::select(*better, trial.normal, best.normal);
            best.scale = R::select(*better, trial.scale, best.scale);
            for band in 0..bands {
                best.colours[band] = R::select(*better, trial.colours[band], best.colours[band]);
            }
            self.visits = self.visits + one;
            *active = *active & self.visits.le(most);
            if !active.any() {
                continue;
            }

            let sums = pixels.equations::<SLOPES>(
                trial.normal,
                &trial.colours,
                best.scale,
                &mut self.pulls,
            );
            let tilt = step_of(&sums, &trial.colours, &self.pulls, longest);
            sums.follow(tilt, &trial.colours, &self.pulls, &mut self.fresh);
            // Lanes that did not get better go a part of their last step from where they were best.
            for i in 0..2 {
                let again = self.tilt[i] * shorter;
                self.tilt[i] = R::select(*better, tilt[i] * relaxation, again);
            }
            let along = tangents(best.normal);
            let [a, b] = self.tilt;
            trial.normal = along[1].mul_add(b, along[0].mul_add(a, best.normal)).normalised();
            for band in 0..bands {
                let again = self.changes[band] * shorter;
                let change = R::select(*better, self.fresh[band] * relaxation, again);
                self.changes[band] = change;
                trial.colours[band] = (best.colours[band] + change).max(zero);
            }
        }
    }

    /// Whether it is time for new pixels: enough lanes have ended, or all.
    #[inline(always)]
    fn waiting(&self, more: bool) -> bool {
        let active = self.active.bits();
        let idle = R::WIDTH - active.count_ones() as usize;
        active == 0 || (more && idle >= R::WIDTH.div_ceil(WAITING))
    }

    /// Takes the paths that have ended out of their lanes.
    #[inline(always)]
    fn store(&mut self, to: &mut Ends) {
        let ended = self.busy & !self.active.bits();
        self.best.scatter(ended, &mut to.state, &self.held);
        let converged = self.ended.bits();
        for lane in 0..R::WIDTH {
            if ended >> lane & 1 == 1 {
                to.converged[self.held[lane]] = converged >> lane & 1 == 1;
            }
        }
        self.busy &= !ended;
    }

    /// Puts the next pixels into the lanes that are free; which lanes these are.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn refill(&mut self, paths: &mut Paths<'_>, next: &mut usize) -> R::Mask {
        let mut fresh = [0.0; MAX_LANES];
        for lane in 0..R::WIDTH {
            if self.busy >> lane & 1 == 1 || *next >= paths.pixels.len() {
                continue;
            }
            self.put(lane, paths.samples, paths.pixels[*next]);
            *next += 1;
            self.busy |= 1 << lane;
            fresh[lane] = 1.0;
        }
        let zero = R::zero();
        let fresh = R::load(&fresh).gt(zero);
        self.trial.gather(fresh, paths.from, &self.held);
        self.best.gather(fresh, paths.from, &self.held);
        self.visits = R::select(fresh, zero, self.visits);
        self.active = self.active | fresh;
        self.ended = self.ended & !fresh;
        fresh
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

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
fn gather_flags<R: Real<Scalar = f32>>(flags: &[bool], held: &[usize; MAX_LANES]) -> R::Mask {
    let mut lanes = [0.0; MAX_LANES];
    for lane in 0..R::WIDTH {
        lanes[lane] = f32::from(u8::from(flags[held[lane]]));
    }
    R::load(&lanes).gt(R::zero())
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
fn step_of<R: Real>(sums: &Equations<R>, colours: &[R], pulls: &[R], longest: R) -> [R; 2] {
    let [dx, dy] = sums.reduced(colours, pulls).tilt();
    let length = dx.mul_add(dx, dy * dy).sqrt();
    let short = R::select(length.gt(longest), longest / length, R::one());
    [dx * short, dy * short]
}
