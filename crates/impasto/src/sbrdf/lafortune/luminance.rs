//! The samples of some pixels, one number per photograph, with lights and views.

use crate::brdf::lafortune::Pair;
use crate::geometry::Rig;
use crate::lm::{Column, Columns, Normal, ROWS, Rows};
use crate::math::lanes::Isa;
use crate::math::{Element, Kernel, Level, Real, Scalar, Vec3};
use crate::surface::{Lafortune, LightView, Pairs};

/// Squared length of the sum of two directions that are opposite to each other, to a thousandth.
const OPPOSITE: f64 = 1e-6;

/// Most unknowns whose matrix stays in registers.
const IN_REGISTERS: usize = 5;

/// Luminances of some pixels under all lights and from all views of a rig.
#[derive(Clone, Copy, Debug)]
pub struct Luminance<'a> {
    /// Who lit and who looked.
    pub rig: &'a Rig,
    /// `(obs, pixel)` linear light; not finite where a sample does not count.
    pub samples: &'a [f32],
    /// From one photograph's samples to the next's.
    pub stride: usize,
    /// Per pixel: a unit normal.
    pub normals: &'a [[f32; 3]],
    /// Per pixel: millimetres on the painting; near lights need them.
    pub places: &'a [[f32; 2]],
}

impl Luminance<'_> {
    /// Photographs.
    pub(super) fn photographs(&self) -> usize {
        self.rig.observations()
    }

    /// The last rows of a pixel's column: its normal and its place.
    pub(super) fn load<S: Element>(
        &self,
        pixel: usize,
        geometries: &Geometries<S>,
        column: &mut Column<'_, S>,
    ) {
        let rest = self.normals[pixel].into_iter().chain(self.places[pixel]);
        column.fill_from(geometries.len(), rest.map(|value| S::from_f64(f64::from(value))));
    }

    /// The first rows of the columns of some problems: the samples of their pixels in the photographs
    /// of `geometries`.
    pub(super) fn load_rows<S: Element>(
        &self,
        pixel_of: impl Fn(usize) -> usize,
        geometries: &Geometries<S>,
        columns: &mut Columns<'_, S>,
    ) {
        columns.fill_from(0, &geometries.numbers, |number, problem| {
            S::from_f64(f64::from(self.samples[*number * self.stride + pixel_of(problem)]))
        });
    }

    /// How many of a pixel's samples count, among some photographs.
    pub(super) fn count<S: Scalar>(&self, pixel: usize, geometries: &Geometries<S>) -> usize {
        let sample = |number: &&usize| self.samples[**number * self.stride + pixel].is_finite();
        geometries.numbers.iter().filter(sample).count()
    }

    /// The normal that mirrors the light of the brightest photograph of `geometries` into its view; one
    /// that clipped is brightest of all.
    pub(super) fn brightest<S: Scalar>(
        &self,
        pixel: usize,
        geometries: &Geometries<S>,
    ) -> [f32; 3] {
        let [across, up] = self.places[pixel].map(f64::from);
        let (mut peak, mut facing) = (0.0, Vec3::new(0.0, 0.0, 1.0));
        for &photograph in &geometries.numbers {
            let sample = self.samples[photograph * self.stride + pixel];
            if sample > peak {
                let (towards, _) = self.rig.lights()[photograph].at(across, up);
                let between = towards + self.rig.views()[photograph].at(across, up);
                // Hard case 23: no normal mirrors a light into the view opposite to it.
                if between.dot(between) > OPPOSITE {
                    (peak, facing) = (sample, between);
                }
            }
        }
        facing.normalised().array().map(|v| v as f32)
    }

    /// The best surface without lobes.
    pub(super) fn plain(&self, pixel: usize, level: Level) -> Plain {
        level.run(WithoutLobes { data: self, pixel })
    }
}

/// A kernel although it uses no lanes: outside of one a fused multiply-add is a function call.
struct WithoutLobes<'a> {
    data: &'a Luminance<'a>,
    pixel: usize,
}

impl Kernel for WithoutLobes<'_> {
    type Output = Plain;

    #[inline(always)]
    fn run<I: Isa>(self) -> Plain {
        let Self { data, pixel } = self;
        let [x, y, z] = data.normals[pixel].map(f64::from);
        let [across, up] = data.places[pixel].map(f64::from);
        let (mut count, mut own, mut pull, mut square) = (0, 0.0_f64, 0.0_f64, 0.0_f64);
        let [mut mirror, mut retro] = [Side::default(); 2];
        for photograph in 0..data.photographs() {
            let sample = f64::from(data.samples[photograph * data.stride + pixel]);
            if !sample.is_finite() {
                continue;
            }
            let light = data.rig.lights()[photograph];
            let view = data.rig.views()[photograph].at(across, up);
            let (towards, irradiance) = light.at(across, up);
            let pair = Pair::against(Vec3::new(x, y, z), towards, view, towards.dot(view));
            let cosine = pair.cosine * irradiance;
            count += 1;
            own = cosine.mul_add(cosine, own);
            pull = cosine.mul_add(sample, pull);
            square = sample.mul_add(sample, square);
            mirror.add(pair.upright - pair.tangential, cosine, sample);
            retro.add(pair.upright + pair.tangential, cosine, sample);
        }
        let diffuse = if own > 0.0 { (pull / own).max(0.0) } else { 0.0 };
        let cost = (diffuse * own - 2.0 * pull).mul_add(diffuse, square).max(0.0);
        let retro = retro.gain(diffuse, own) > mirror.gain(diffuse, own);
        Plain { count, diffuse, cost, square, retro }
    }
}

/// A pixel without lobes.
pub(super) struct Plain {
    pub(super) count: usize,
    pub(super) diffuse: f64,
    pub(super) cost: f64,
    /// Sum of the squared samples.
    pub(super) square: f64,
    /// Whether what the diffuse part leaves stands towards the light rather than its mirror image.
    pub(super) retro: bool,
}

/// What a broad lobe in one direction would explain.
#[derive(Clone, Copy, Default)]
struct Side {
    own: f64,
    shared: f64,
    pull: f64,
}

impl Side {
    #[inline(always)]
    fn add(&mut self, base: f64, cosine: f64, sample: f64) {
        let squared = base.max(0.0) * base.max(0.0);
        let value = squared * squared * cosine;
        self.own = value.mul_add(value, self.own);
        self.shared = value.mul_add(cosine, self.shared);
        self.pull = value.mul_add(sample, self.pull);
    }

    /// Fall of the cost when the lobe joins a diffuse part whose squares sum up to `own`.
    #[inline(always)]
    fn gain(&self, diffuse: f64, own: f64) -> f64 {
        let left = (-diffuse).mul_add(self.shared, self.pull).max(0.0);
        let new = self.own - self.shared * (self.shared / own);
        if new > 0.0 { left * (left / new) } else { 0.0 }
    }
}

/// Lights and views of some photographs, in the precision of a search.
pub(super) struct Geometries<S: Scalar> {
    /// Which photographs.
    numbers: Vec<usize>,
    pairs: Pairs<Lafortune, S>,
}

impl<S: Element> Geometries<S> {
    /// All photographs.
    pub(super) fn all(rig: &Rig) -> Self {
        Self::some(rig, rig.observations())
    }

    /// So many photographs, spread evenly over the order in which they were taken. An uneven
    /// number keeps step with no pattern of the rig.
    pub(super) fn some(rig: &Rig, count: usize) -> Self {
        Self::of(rig, (0..count).map(|i| i * rig.observations() / count).collect())
    }

    /// These photographs.
    pub(super) fn of(rig: &Rig, numbers: Vec<usize>) -> Self {
        let pairs = numbers.iter().map(|&number| (rig.lights()[number], rig.views()[number]));
        Self { pairs: Pairs::rounded(Lafortune, pairs), numbers }
    }

    pub(super) fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Numbers in a pixel's column.
    pub(super) fn rows(&self) -> usize {
        self.len() + 5
    }

    /// Normal equations of a model against a pixel's column ([`Luminance::load`]): radiance and
    /// its derivatives from light, view, their product and the irradiance.
    #[inline(always)]
    pub(super) fn equations<R: Real<Scalar = S>, const N: usize>(
        &self,
        rows: Rows<'_, R>,
        model: impl Fn(Vec3<R>, Vec3<R>, R, R) -> (R, [R; N]),
    ) -> Normal<R, N> {
        let (zero, count) = (R::zero(), self.len());
        let (x, y) = (rows.get(count + 3), rows.get(count + 4));
        let mut normal = Normal::zero();
        let mut slopes = [[zero; N]; ROWS];
        let mut residuals = [zero; ROWS];
        let mut photograph = 0;
        while photograph < count {
            let end = (photograph + ROWS).min(count);
            for k in photograph..end {
                let sample = rows.get(k);
                let (_, irradiance, LightView { light, view, light_view }) = self.pairs.at(k, x, y);
                // A sample that does not count is a photograph without light: value and slopes
                // are 0 (hard case 26).
                let counts = sample.is_finite();
                let (value, slope) = model(light, view, light_view, R::keep(counts, irradiance));
                let residual = R::keep(counts, sample - value);
                if N > IN_REGISTERS {
                    (slopes[k - photograph], residuals[k - photograph]) = (slope, residual);
                } else {
                    normal.add(slope, residual);
                }
            }
            if N > IN_REGISTERS {
                for k in end - photograph..ROWS {
                    (slopes[k], residuals[k]) = ([zero; N], zero);
                }
                normal.add_rows(&slopes, &residuals);
            }
            photograph = end;
        }
        normal
    }
}
