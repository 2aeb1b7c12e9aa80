//! Iteratively reweighted least squares [@holland1977robust]: every pixel's normal and colours under
//! the painting's lobe, and the equations of the lobe that remain when they are eliminated (variable
//! projection [@golub1973varpro]).
//!
//! A pixel's estimate is the S-estimate [@rousseeuw1984s], of smallest robust scale
//! ([`scale`](super::scale)). Gauss-Newton steps on the weighted sum of squares lead to it
//! ([`descent`](super::descent)); a step that does not lower the scale is shortened. The colours are eliminated first, then the normal;
//! the Schur complement that is left is the pixel's 2 x 2 part of the normal equations of
//! (beta, log k). The pooled step thereby accounts for normals and colours that will follow it
//! (variable projection [@golub1973varpro]); a separate fit of the lobe does not.

use crate::lm::Normal;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::tail::load;
use crate::math::{Kernel, Mask, Real};
use crate::pixels::Run;

use super::descent::{Ends, Lanes, Origin, Paths, Stopping};
use super::pixel::{CommonLobe, Pixels};
use super::samples::{Photographs, PooledTile, Samples, State, TileMut};
use super::scale::Gaussian;

/// What the scales of pixels are compared with.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaleReference {
    /// A bright colour of the painting, the unit of scales.
    pub(super) brightness: f64,
    /// Added to every squared scale before its logarithm is taken: a pixel whose few codes the model
    /// happens to meet exactly determines no more than the noise of the painting permits.
    pub(super) noise_floor: f64,
}

/// The normal equations of (beta, log k), a sum over pixels, each in units of its own scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct LobeEquations {
    /// Samples.
    pub(super) count: f64,
    /// Samples times the logarithm of squared scale plus noise floor, over the brightness squared.
    pub(super) log_scale: f64,
    pub(super) descent: [f64; 2],
    pub(super) matrix: [[f64; 2]; 2],
    /// The same of pixels whose residuals are rounding: they contribute to no step, but determine
    /// (beta, log k) as well as rounding permits.
    pub(super) exact: [[f64; 2]; 2],
    /// Sum of the outer products of the pixels' gradients, or the expected value of those.
    pub(super) scatter: [[f64; 2]; 2],
}

impl LobeEquations {
    pub(super) fn zero() -> Self {
        let zero = [[0.0; 2]; 2];
        Self {
            count: 0.0,
            log_scale: 0.0,
            descent: [0.0; 2],
            matrix: zero,
            exact: zero,
            scatter: zero,
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.log_scale += other.log_scale;
        for i in 0..2 {
            self.descent[i] += other.descent[i];
            for j in 0..=i {
                self.matrix[i][j] += other.matrix[i][j];
                self.exact[i][j] += other.exact[i][j];
                self.scatter[i][j] += other.scatter[i][j];
            }
        }
    }

    /// Information of all pixels about (beta, log k).
    pub(super) fn information(&self) -> [[f64; 2]; 2] {
        core::array::from_fn(|i| core::array::from_fn(|j| self.matrix[i][j] + self.exact[i][j]))
    }

    /// As a sum of squares: the number of samples times the geometric mean over the pixels of squared
    /// scale plus noise floor. Where all pixels are equally noisy it is the weighted sum of squares; a
    /// pixel that the model does not describe cannot outweigh the others.
    pub(super) fn normal(&self, brightness: f64) -> Normal<f64, 2> {
        let mean = if self.count > 0.0 { (self.log_scale / self.count).exp() } else { 0.0 };
        let mean = mean * brightness * brightness;
        Normal {
            cost: mean * self.count,
            descent: self.descent.map(|v| v * mean),
            matrix: self.matrix.map(|row| row.map(|v| v * mean)),
        }
    }
}

pub(super) struct Irls<'a, 'b> {
    pub(super) photographs: &'a Photographs<'a>,
    pub(super) run: &'a Run<'a>,
    pub(super) tile: &'b PooledTile<'a>,
    pub(super) out: TileMut<'b>,
    pub(super) samples: &'a Samples,
    pub(super) lobe: CommonLobe,
    pub(super) stopping: Stopping,
    /// Where pixels that are not well described, or not in so many steps, start again: a highlight
    /// that photometric stereo took for the diffuse part turns a normal far away, where no small
    /// step leads back.
    pub(super) restarts: &'static [Origin],
    pub(super) scale_reference: ScaleReference,
    pub(super) gaussian: Gaussian,
}

impl Kernel for Irls<'_, '_> {
    type Output = LobeEquations;

    #[inline(always)]
    fn run<I: Isa>(self) -> LobeEquations {
        // A tile of which no pixel is estimated.
        if self.tile.count == 0 {
            return LobeEquations::zero();
        }
        let pixels = &mut Pixels::<I::F32>::new(self.photographs, self.lobe);
        let lanes = &mut Lanes::new(self.photographs.bands, self.photographs.pairs.len());
        match self.ends(pixels, lanes) {
            Some(ends) => self.equations(pixels, &ends),
            None => LobeEquations::zero(),
        }
    }
}

impl Irls<'_, '_> {
    /// Where the best path of every pixel ends; none if the run is cancelled.
    #[inline(always)]
    fn ends<R: Real<Scalar = f32>>(
        &self,
        pixels: &mut Pixels<'_, R>,
        lanes: &mut Lanes<R>,
    ) -> Option<State> {
        let mut places: Vec<usize> = (0..self.tile.count).collect();
        let mut best = State::of_tile(self.tile);
        let mut first = None;
        if self.lobe.beta <= 0.0 {
            let from = (best.clone(), &places[..]);
            let ends = self.paths::<_, false, 0>(pixels, lanes, from, Origin::Given, None)?;
            best.clone_from(&ends.state);
            first = Some(ends);
        }
        for &origin in [Origin::Given].iter().chain(self.restarts) {
            match &first {
                Some(_) if origin == Origin::Given => continue,
                Some(ends) if origin == self.restarts[0] => {
                    places = self.undescribed(pixels, ends)?;
                }
                _ => {}
            }
            let from = (best.clone(), &places[..]);
            let ends = self.paths::<_, true, 2>(pixels, lanes, from, origin, first.as_ref())?;
            let Some(_) = first else {
                best.clone_from(&ends.state);
                first = Some(ends);
                continue;
            };
            for &place in &places {
                if ends.state.scale[place] < best.scale[place] {
                    best.copy_pixel(place, &ends.state);
                    best.scale[place] = ends.state.scale[place];
                }
            }
        }
        Some(best)
    }

    /// The paths of some pixels; the others end where they begin, with the scale that they have.
    #[inline(always)]
    fn paths<R: Real<Scalar = f32>, const GLOSS: bool, const SLOPES: usize>(
        &self,
        pixels: &mut Pixels<'_, R>,
        lanes: &mut Lanes<R>,
        (mut start, places): (State, &[usize]),
        origin: Origin,
        known: Option<&Ends>,
    ) -> Option<Ends> {
        let Self { run, samples, stopping, gaussian, .. } = *self;
        if !lanes.visit_starts::<GLOSS>(pixels, samples, places, &mut start, origin, run) {
            return None;
        }
        let mut ends = Ends { state: start.clone(), converged: vec![false; start.scale.len()] };
        let finite = |place: &usize| start.scale[*place].is_finite();
        let finite: Vec<usize> = places.iter().copied().filter(finite).collect();
        let to = &mut ends;
        let relaxation = 2.0 / (1.0 + gaussian.curvature);
        let paths =
            Paths { samples, pixels: &finite, from: &start, known, to, stopping, relaxation, run };
        lanes.descend::<GLOSS, SLOPES>(pixels, paths).then_some(ends)
    }

    /// Pixels whose path has not converged, or ended at more than the noise of the painting.
    #[inline(always)]
    fn undescribed<R: Real<Scalar = f32>>(
        &self,
        pixels: &mut Pixels<'_, R>,
        first: &Ends,
    ) -> Option<Vec<usize>> {
        let count = self.tile.count;
        let tile = first.state.tile(0, count);
        let mut places = Vec::with_capacity(count);
        let mut colours = vec![R::zero(); self.photographs.bands];
        for at in (0..count).step_by(R::WIDTH) {
            if self.run.cancelled() {
                return None;
            }
            pixels.look(&self.samples.rows(), at);
            tile.colours_at(at, &mut colours);
            let scale: R = load(&first.state.scale, at);
            let scale = pixels.visit::<true>(tile.normal_at(at), &colours, Some(scale));
            let described = pixels.described(scale, self.scale_reference.noise_floor);
            for lane in 0..R::WIDTH.min(count - at) {
                let place = at + lane;
                let known = described.lane(lane) && first.converged[place];
                if !known && first.state.scale[place].is_finite() {
                    places.push(place);
                }
            }
        }
        Some(places)
    }

    /// Writes where the pixels have ended, and adds up the equations of the lobe there.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "loops with indices stay in line")]
    fn equations<R: Real<Scalar = f32>>(
        mut self,
        pixels: &mut Pixels<'_, R>,
        ends: &State,
    ) -> LobeEquations {
        let (count, bands) = (self.tile.count, self.photographs.bands);
        let tile = ends.tile(0, count);
        let mut colours = vec![R::zero(); bands];
        let mut pulls = vec![R::zero(); bands];
        let mut equations = LobeEquations::zero();
        for at in (0..count).step_by(R::WIDTH) {
            // A tile of hundreds of photographs takes long.
            if self.run.cancelled() {
                break;
            }
            pixels.look(&self.samples.rows(), at);
            tile.colours_at(at, &mut colours);
            let normal = tile.normal_at::<R>(at);
            let scale: R = load(&ends.scale, at);
            let last_scale = pixels.visit::<true>(normal, &colours, Some(scale));
            let fine = scale.is_finite() & (normal.x + normal.y + normal.z).is_finite();
            self.out.write(at, normal, &colours, scale, fine);

            let sums = pixels.equations::<4>(normal, &colours, last_scale, &mut pulls);
            let lobe = sums.reduced(&colours, &pulls).without_tilts();
            let values = [
                last_scale,
                pixels.floor,
                pixels.used,
                sums.square,
                lobe.descent[0],
                lobe.descent[1],
                lobe.matrix[0],
                lobe.matrix[1],
                lobe.matrix[2],
            ];
            let mut lanes = [[0.0_f32; MAX_LANES]; 9];
            for i in 0..values.len() {
                values[i].store(&mut lanes[i]);
            }
            for lane in 0..R::WIDTH.min(count - at) {
                let mut values = [0.0; 9];
                for i in 0..values.len() {
                    values[i] = f64::from(lanes[i][lane]);
                }
                equations.merge(&equations_of(values, bands, self.scale_reference));
            }
        }
        equations
    }
}

/// One pixel's part of the equations.
fn equations_of(values: [f64; 9], bands: usize, scale_reference: ScaleReference) -> LobeEquations {
    let [scale, floor, used, square, db, dk, bb, kb, kk] = values;
    let count = used * bands as f64;
    // As many samples as unknowns determine no scale (hard case 30); NaN fails the tests (hard case 26).
    let determined =
        count > (bands + 2) as f64 && scale > 0.0 && values.iter().all(|value| value.is_finite());
    if !determined {
        return LobeEquations::zero();
    }
    let ScaleReference { brightness, noise_floor } = scale_reference;
    // d log s^2 = -2 sum(w r dr) / sum(w r^2), and the pixel counts with its samples. At the floor
    // the scale moves no more.
    let moves = scale > floor && square > 0.0;
    let share = if moves { scale / (scale + noise_floor) } else { 0.0 };
    let rate = share * count / (square * bands as f64).max(f64::MIN_POSITIVE);
    let descent = [db * rate, dk * rate];
    let known = |rate: f64| [[bb * rate, 0.0], [kb * rate, kk * rate]];
    // A sample within one scale counts for more where the scale moves: this errs on the safe side.
    let exact = known(if moves { 0.0 } else { (scale + noise_floor).recip() });
    LobeEquations {
        count,
        log_scale: count * ((scale + noise_floor) / (brightness * brightness)).ln(),
        descent,
        matrix: known(rate),
        exact,
        // Rounding has no gradient: its scatter is the information (Fisher's identity).
        scatter: [
            [descent[0] * descent[0] + exact[0][0], 0.0],
            [descent[1] * descent[0] + exact[1][0], descent[1] * descent[1] + exact[1][1]],
        ],
    }
}
