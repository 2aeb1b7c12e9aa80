//! A joint search for normal and lobes by Levenberg-Marquardt [@levenberg1944; @marquardt1963],
//! from where the first two passes ended.
//!
//! A cosine lobe stands in for lobes that lean away from the mirror direction: the normal that it
//! finds leans with them. Once lobes are known, everything but their number is free, on the same
//! samples.

use crate::brdf::lafortune::Pair;
use crate::lm::{Batch, Column, Columns, Normal, Options, Outcome, Rows, fit};
use crate::math::{Element, Real, Scalar, Vec3};

use super::estimate::LafortuneEstimate;
use super::lobes::{LafortuneSearch, Shapes, bounds};
use super::luminance::{Geometries, Luminance};
use super::normal::{NormalEstimate, STEEPEST, facing, slopes};

/// How double precision goes on where single precision met a matrix that it could not tell from a
/// singular one, or did not get to an end.
const POLISH: Options = Options {
    max_iterations: 100,
    cost: 1e-9,
    step: 1e-7,
    gradient: 1e-7,
    offset: 0.0,
    damping: 1e-2,
    memory: 0.0,
};

/// Searches on for normal and lobes of some pixels at once; `found` takes what is better. Returns the
/// new normals in its order: none where nothing better was found.
pub(super) fn fit_jointly(
    search: &LafortuneSearch<'_>,
    pixels: &[usize],
    found: &mut [LafortuneEstimate],
) -> Vec<Option<NormalEstimate>> {
    let facing = &mut *vec![None; pixels.len()];
    let mut joint = JointFit { search, pixels, found, facing };
    joint.run::<6>();
    joint.run::<9>();
    joint.run::<12>();
    facing.to_vec()
}

struct JointFit<'a> {
    search: &'a LafortuneSearch<'a>,
    pixels: &'a [usize],
    found: &'a mut [LafortuneEstimate],
    facing: &'a mut [Option<NormalEstimate>],
}

impl JointFit<'_> {
    /// The pixels with `N / 3 - 1` lobes.
    fn run<const N: usize>(&mut self) {
        let lobes = N / 3 - 1;
        let these: Vec<_> =
            (0..self.pixels.len()).filter(|&i| self.found[i].lobes == lobes).collect();
        let doubtful = self.search::<f32, N>(&these, self.search.options);
        self.search::<f64, N>(&doubtful, &POLISH);
    }

    /// Searches on and returns whose equations the precision could not solve.
    fn search<S: Element, const N: usize>(
        &mut self,
        these: &[usize],
        options: &Options,
    ) -> Vec<usize> {
        let LafortuneSearch { data, turning, level, photographs, stopped, .. } = *self.search;
        // Two slopes, then what a search on a known normal has.
        let mut bounds = bounds::<S, N>(2, turning);
        let steepest = S::from_f64(STEEPEST.into());
        for slope in 0..2 {
            (bounds.lower[slope], bounds.upper[slope]) = (-steepest, steepest);
        }
        let problems = (0..these.len()).take_while(|_| !stopped());
        let mut lanes = JointBatch::<S, N> {
            data,
            geometries: Geometries::some(data.rig, photographs),
            pixels: self.pixels,
            these,
            found: self.found,
            facing: self.facing,
            doubtful: Vec::new(),
        };
        fit(level, &mut lanes, problems, &bounds, options);
        let mut doubtful = lanes.doubtful;
        doubtful.sort_unstable();
        doubtful
    }
}

struct JointBatch<'a, S: Scalar, const N: usize> {
    data: &'a Luminance<'a>,
    geometries: Geometries<S>,
    pixels: &'a [usize],
    these: &'a [usize],
    found: &'a mut [LafortuneEstimate],
    facing: &'a mut [Option<NormalEstimate>],
    doubtful: Vec<usize>,
}

impl<S: Element, const N: usize> Batch<S, N> for JointBatch<'_, S, N> {
    const COVARIANCE: bool = true;

    fn rows(&self) -> usize {
        self.geometries.rows()
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, S>) -> [S; N] {
        let i = self.these[problem];
        let pixel = self.pixels[i];
        self.data.load(pixel, &self.geometries, column);
        let normal = self.facing[i].map_or(self.data.normals[pixel], |facing| facing.normal);
        let [p, q] = slopes(normal);
        core::array::from_fn(|unknown| match unknown {
            0 => S::from_f64(p.into()),
            1 => S::from_f64(q.into()),
            _ => S::from_f64(self.found[i].at[unknown - 2]),
        })
    }
    fn load_rows(&mut self, columns: &mut Columns<'_, S>) {
        let Self { pixels, these, .. } = *self;
        self.data.load_rows(|problem| pixels[these[problem]], &self.geometries, columns);
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        let model = JointModel::new(&at);
        self.geometries.equations(rows, |light, view, light_view, irradiance| {
            model.gradient(light, view, light_view, irradiance)
        })
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<S, N>) {
        let i = self.these[problem];
        if !outcome.reason.converged() || outcome.deficient().contains(&true) {
            self.doubtful.push(i);
        }
        let samples = self.data.count(self.pixels[i], &self.geometries);
        let free = samples as f64 - N as f64;
        let cost = outcome.normal.cost.to_f64();
        if free < 1.0 || cost >= self.found[i].cost {
            return;
        }
        let covariance = outcome.covariance(S::from_f64(cost / free));
        let tilts = [covariance[0][0], covariance[1][0], covariance[1][1]];
        let [p, q] = [0, 1].map(|slope| outcome.parameters[slope].to_f64() as f32);
        let facing = facing([p, q], tilts.map(|tilt| tilt.to_f64() as f32), cost as f32);
        if facing.sigma.is_finite() {
            self.facing[i] = Some(facing);
            (self.found[i].cost, self.found[i].samples) = (cost, samples);
            for (at, &value) in self.found[i].at.iter_mut().zip(&outcome.parameters[2..]) {
                *at = value.to_f64();
            }
            self.found[i].sort();
        }
    }
}

/// Lobes about a normal of slopes p and q.
pub(super) struct JointModel<R> {
    normal: Vec3<R>,
    upright: R,
    shapes: Shapes<R>,
}

impl<R: Real> JointModel<R> {
    #[inline(always)]
    pub(super) fn new<const N: usize>(at: &[R; N]) -> Self {
        let (p, q) = (at[0], at[1]);
        let upright = q.mul_add(q, p.mul_add(p, R::one())).sqrt().recip();
        let normal = Vec3::new(-(p * upright), -(q * upright), upright);
        Self { normal, upright, shapes: Shapes::new(&at[2..]) }
    }

    /// Radiance and its derivatives.
    #[inline(always)]
    pub(super) fn gradient<const N: usize>(
        &self,
        light: Vec3<R>,
        view: Vec3<R>,
        light_view: R,
        irradiance: R,
    ) -> (R, [R; N]) {
        let mut pair = Pair::against(self.normal, light, view, light_view);
        pair.cosine = pair.cosine * irradiance;
        let mut slope = [R::zero(); N];
        let [reflectance, bend] = self.shapes.reflectance(&pair, &mut slope[2..]);
        // d/dN = f L + (N.L) df/dN, along (N.V) L + (N.L) V, as in the cosine lobe.
        let lit = R::keep(pair.cosine.gt(R::zero()), irradiance);
        let bend = pair.cosine * bend;
        let along_light = bend.mul_add(self.normal.dot(view), reflectance * lit);
        let along = view.mul_add(bend * self.normal.dot(light), light.scale(along_light));
        let inward = along.dot(self.normal);
        slope[0] = self.normal.x.mul_add(inward, -along.x) * self.upright;
        slope[1] = self.normal.y.mul_add(inward, -along.y) * self.upright;
        (pair.cosine * reflectance, slope)
    }
}
