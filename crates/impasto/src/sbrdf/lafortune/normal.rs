//! The normal of a pixel by a cosine lobe and a diffuse term: Snel's first pass [@snel], by
//! Levenberg-Marquardt [@levenberg1944; @marquardt1963] from several starts.

use crate::brdf::cosine_lobe::{CosineLobe, PARAMETERS};
use crate::lm::{Batch, Bounds, Column, Columns, Normal, Options, Outcome, Rows, fit};
use crate::math::{Level, Real, Vec3};

use super::luminance::{Geometries, Luminance};

/// Exponent that Snel starts from: moderate, free to become a highlight or nearly diffuse.
const START: f64 = 20.0;

/// Steepest slope: 84 degrees.
pub(super) const STEEPEST: f32 = 10.0;

/// A pixel's normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalEstimate {
    /// Unit normal.
    pub normal: [f32; 3],
    /// Standard deviation along its worst axis, radians, by the pixel's own residuals.
    pub sigma: f32,
    /// Sum of squared residuals.
    pub cost: f32,
}

/// A pixel's cosine lobe.
#[derive(Clone, Copy, Debug)]
pub(super) struct CosineFit {
    pub(super) facing: NormalEstimate,
    /// `[rho_d, rho_s, ln n, p, q]`; NaN where no search converged.
    pub(super) at: [f32; PARAMETERS],
}

/// What a pixel is searched from: Snel's start, the painting's own plane; the normal that `data`
/// holds; and the one that mirrors the brightest photograph into its view. A lobe that starts
/// beside the highlight may find no way to it; the smallest cost counts.
const STARTS: usize = 3;

/// Estimates the normals of some pixels, in their order; where no search converges, the normal is the
/// one in `data`.
pub fn fit_normal(
    level: Level,
    data: &Luminance<'_>,
    pixels: &[usize],
    options: &Options,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Vec<NormalEstimate> {
    let found = fit_cosine_lobe(level, data, Geometries::all(data.rig), pixels, options, stopped);
    found.into_iter().map(|fit| fit.facing).collect()
}

/// Finds the cosine lobes of some pixels in some photographs.
pub(super) fn fit_cosine_lobe(
    level: Level,
    data: &Luminance<'_>,
    geometries: Geometries<f32>,
    pixels: &[usize],
    options: &Options,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Vec<CosineFit> {
    let found = pixels
        .iter()
        .map(|&pixel| CosineFit {
            facing: NormalEstimate { normal: data.normals[pixel], sigma: f32::NAN, cost: f32::NAN },
            at: [f32::NAN; PARAMETERS],
        })
        .collect();
    let place = usize::MAX;
    let half_of = |&pixel: &usize| (0.5 * data.plain(pixel, level).diffuse) as f32;
    let mut lanes = CosineLobeBatch {
        data,
        strengths: pixels.iter().take_while(|_| !stopped()).map(half_of).collect(),
        geometries,
        pixels,
        best: vec![(f32::INFINITY, place); pixels.len()],
        found,
    };
    let bounds = Bounds {
        lower: [0.0, 0.0, 0.0, -STEEPEST, -STEEPEST],
        upper: [f32::MAX, f32::MAX, 10.0, STEEPEST, STEEPEST],
    };
    let problems = (0..STARTS * lanes.strengths.len()).take_while(|_| !stopped());
    fit(level, &mut lanes, problems, &bounds, options);
    lanes.found
}

struct CosineLobeBatch<'a> {
    data: &'a Luminance<'a>,
    geometries: Geometries<f32>,
    pixels: &'a [usize],
    /// Per pixel: where strengths start, half of the diffuse reflectance without a lobe.
    strengths: Vec<f32>,
    /// The smallest cost so far, and the start that led to it.
    best: Vec<(f32, usize)>,
    found: Vec<CosineFit>,
}

impl Batch<f32, PARAMETERS> for CosineLobeBatch<'_> {
    fn rows(&self) -> usize {
        self.geometries.rows()
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; PARAMETERS] {
        let pixel = self.pixels[problem / STARTS];
        self.data.load(pixel, &self.geometries, column);
        let [p, q] = slopes(match problem % STARTS {
            0 => [0.0, 0.0, 1.0],
            1 => self.data.normals[pixel],
            _ => self.data.brightest(pixel, &self.geometries),
        });
        let strength = self.strengths[problem / STARTS];
        [strength, strength, START.ln() as f32, p, q]
    }
    fn load_rows(&mut self, columns: &mut Columns<'_, f32>) {
        let pixels = self.pixels;
        self.data.load_rows(|problem| pixels[problem / STARTS], &self.geometries, columns);
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(
        &self,
        rows: Rows<'_, R>,
        at: [R; PARAMETERS],
    ) -> Normal<R, PARAMETERS> {
        let model = CosineLobe::new(at);
        self.geometries.equations(rows, |light, view, light_view, irradiance| {
            let (value, slope) = model.gradient(light, view, light_view);
            (value * irradiance, slope.map(|slope| slope * irradiance))
        })
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, PARAMETERS>) {
        let (place, start) = (problem / STARTS, problem % STARTS);
        let cost = outcome.normal.cost;
        let free = self.data.count(self.pixels[place], &self.geometries) as f32 - PARAMETERS as f32;
        // CosineLobeBatch end in any order: of equal costs the first start's counts.
        if !outcome.reason.converged() || free < 1.0 || (cost, start) >= self.best[place] {
            return;
        }
        let covariance = outcome.covariance(cost / free);
        let tilts = [covariance[3][3], covariance[4][3], covariance[4][4]];
        let [.., p, q] = outcome.parameters;
        let facing = facing([p, q], tilts, cost);
        if facing.sigma.is_finite() {
            self.best[place] = (cost, start);
            self.found[place] = CosineFit { facing, at: outcome.parameters };
        }
    }
}

/// The slopes of a normal.
pub(super) fn slopes([x, y, z]: [f32; 3]) -> [f32; 2] {
    [x, y].map(|v| (-v / z.max(0.1)).clamp(-STEEPEST, STEEPEST))
}

/// The normal of slopes, with the variances `pp`, `pq`, `qq` of the slopes.
pub(super) fn facing([p, q]: [f32; 2], [pp, pq, qq]: [f32; 3], cost: f32) -> NormalEstimate {
    let Vec3 { x, y, z } = Vec3::new(-p, -q, 1.0).normalised();
    let (middle, half) = (0.5 * (pp + qq), 0.5 * (pp - qq));
    // A change of slope turns the normal by at most its cosine.
    let sigma = (middle + half.mul_add(half, pq * pq).sqrt()).sqrt() * z;
    NormalEstimate { normal: [x, y, z], sigma, cost }
}
