//! The samples of a pixel and their derivatives by its own unknowns and by the numbers of the rig.

#![allow(clippy::needless_range_loop, reason = "plain loops, as in `elimination`")]

use crate::brdf::torrance_sparrow::sharpness;
use crate::math::elementary::phi_squared_slope;
use crate::math::lanes::MAX_LANES;
use crate::math::{Real, Vec3};
use crate::sbrdf::pooled::tangents;
use crate::surface::{GAMMA_MAX, Lobe, Pairs, Parameter, Strength, TorranceSparrow};

use super::problem::{Adjustment, LobeProfile};

/// Unknowns that all bands of a pixel share: two tilts and the logarithm of the lobe's width.
pub(super) const SHARED: usize = 3;
/// Unknowns of one band: diffuse reflectance, ambient light, strength of the lobe.
pub(super) const OWN: usize = 3;

/// How many numbers of each kind there are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) observations: usize,
    pub(super) bands: usize,
    /// Inverse distances that are free.
    pub(super) places: usize,
    /// Whether strengths are free.
    pub(super) strengths: bool,
}

impl Layout {
    /// Numbers of the rig.
    pub(super) fn numbers(&self) -> usize {
        self.places + if self.strengths { self.observations } else { 0 }
    }

    /// The same, and the errors as one more of them.
    pub(super) fn columns(&self) -> usize {
        self.numbers() + 1
    }

    /// Whether some sample depends on two columns, the first of them not the larger: a strength changes
    /// its own photograph alone.
    pub(super) fn share_samples(&self, first: usize, second: usize) -> bool {
        first < self.places || first == second || second == self.numbers()
    }

    /// The number of the product of two columns that share samples.
    #[inline(always)]
    pub(super) fn direct(&self, first: usize, second: usize) -> usize {
        if first < self.places {
            return first * self.columns() + second;
        }
        let own = self.places * self.columns() + 2 * (first - self.places);
        if first == second { own } else { own + 1 }
    }

    /// How many products there are.
    pub(super) fn direct_products(&self) -> usize {
        self.places * self.columns() + 2 * (self.numbers() - self.places)
    }

    /// Unknowns of a pixel: the shared ones, then those of each band.
    pub(super) fn unknowns(&self) -> usize {
        SHARED + OWN * self.bands
    }
}

/// The samples of all pixels.
pub(super) struct Samples<'a> {
    pub(super) adjustment: &'a Adjustment<'a>,
    pub(super) lobe: &'a Lobe<'a>,
    pub(super) pairs: Pairs<TorranceSparrow>,
    pub(super) moved: Vec<Pairs<TorranceSparrow>>,
    pub(super) pixels: usize,
    pub(super) bands: usize,
}

/// The weighted error of one sample, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row<R> {
    pub(super) error: R,
    /// By the unknowns that all bands share, and by those of its own.
    pub(super) shared: [R; SHARED],
    pub(super) own: [R; OWN],
    /// By the logarithm of its lamp's strength.
    pub(super) lamp: R,
}

impl<R: Real> Row<R> {
    /// Of a sample that does not count.
    fn none() -> Self {
        let zero = R::zero();
        Self { error: zero, shared: [zero; SHARED], own: [zero; OWN], lamp: zero }
    }
}

/// Rows `(obs, band)` of some pixels, one per lane, and their derivatives by inverse distances.
pub(super) struct PixelSamples<R> {
    pub(super) layout: Layout,
    pub(super) rows: Vec<Row<R>>,
    /// `(obs, band, place)`.
    places: Vec<R>,
    /// Their colours in each band.
    colours: Vec<Colours<R>>,
    /// A photograph's light under the rigs whose inverse distances are larger.
    moved: Vec<Light<R>>,
}

impl<R: Real> PixelSamples<R> {
    pub(super) fn new(layout: Layout) -> Self {
        let rows = layout.observations * layout.bands;
        let places = vec![R::zero(); rows * layout.places];
        let rows = vec![Row::none(); rows];
        Self { layout, rows, places, colours: Vec::new(), moved: Vec::new() }
    }

    /// Derivatives by inverse distances of one row.
    #[inline(always)]
    pub(super) fn places_of(&self, row: usize) -> &[R] {
        &self.places[row * self.layout.places..(row + 1) * self.layout.places]
    }
}

/// What is known of some pixels, one per lane.
struct Pixels<R: Real> {
    normal: Vec3<R>,
    tilts: [Vec3<R>; 2],
    place: (R, R),
    /// Widths of the lobes; NaN without one.
    gamma: R,
}

/// Light of diffuse reflectance and of a lobe of strength 1, and their derivatives by the unknowns
/// that bands share.
#[derive(Clone, Copy)]
struct Light<R> {
    diffuse: R,
    diffuse_by_tilt: [R; 2],
    lobe: R,
    lobe_by_shared: [R; SHARED],
}

/// The colours of pixels in one band; none is below 0.
#[derive(Clone, Copy)]
struct Colours<R> {
    diffuse: R,
    ambient: R,
    strength: R,
}

impl<R: Real> Colours<R> {
    /// What shows under a light of strength 1.
    #[inline(always)]
    fn shown(&self, light: &Light<R>) -> R {
        let matte = self.diffuse.mul_add(light.diffuse, self.ambient);
        self.strength.mul_add(light.lobe, matte)
    }

    /// The row of a sample, with the light's strength times the slope of its code as `scale`; zeros
    /// where that is 0.
    #[inline(always)]
    fn row(&self, light: &Light<R>, scale: R, error: R) -> Row<R> {
        let Self { diffuse, ambient, strength } = *self;
        let [first, second, width] = light.lobe_by_shared;
        let [across, along] = light.diffuse_by_tilt;
        let counts = counted(scale);
        // What is at its bound of 0 stays there.
        Row {
            error: R::keep(counts, error),
            shared: [
                R::keep(counts, scale * diffuse.mul_add(across, strength * first)),
                R::keep(counts, scale * diffuse.mul_add(along, strength * second)),
                R::keep(counts, scale * strength * width),
            ],
            own: [
                R::keep(counts & diffuse.gt(R::zero()), scale * light.diffuse),
                R::keep(counts & ambient.gt(R::zero()), scale),
                R::keep(counts & strength.gt(R::zero()), scale * light.lobe),
            ],
            lamp: R::keep(counts, scale * self.shown(light)),
        }
    }
}

/// Where a slope is not 0: elsewhere light and colours may be unknown.
#[inline(always)]
fn counted<R: Real>(slope: R) -> R::Mask {
    slope.gt(R::zero()) | slope.lt(R::zero())
}

impl Samples<'_> {
    pub(super) fn layout(&self) -> Layout {
        Layout {
            observations: self.pairs.len(),
            bands: self.bands,
            places: self.moved.len(),
            strengths: self.adjustment.strengths,
        }
    }

    /// Reads the pixels from `first` on; lanes beyond the last repeat it.
    #[inline(always)]
    pub(super) fn read<R: Real<Scalar = f64>>(&self, first: usize, out: &mut PixelSamples<R>) {
        let Self { adjustment, bands, .. } = *self;
        let Adjustment { intensities, errors, slopes, step, .. } = *adjustment;
        let pixels = self.gathered::<R>(first);
        let places = self.moved.len();
        out.colours.clear();
        for band in 0..bands {
            out.colours.push(self.colours(band, first));
        }
        for observation in 0..intensities.len() {
            let light = self.light(&self.pairs, observation, &pixels);
            out.moved.clear();
            for pairs in &self.moved {
                out.moved.push(self.light(pairs, observation, &pixels));
            }
            for band in 0..bands {
                let row = observation * bands + band;
                let colours = out.colours[band];
                let scale = R::of(intensities[observation]) * self.samples(slopes, row, first);
                out.rows[row] = colours.row(&light, scale, self.samples(errors, row, first));
                let counts = counted(scale);
                for place in 0..places {
                    let change = colours.shown(&out.moved[place]) - colours.shown(&light);
                    let slope = scale * change / R::of(step);
                    out.places[row * places + place] = R::keep(counts, slope);
                }
            }
        }
    }

    /// Samples `(obs, band, y, x)` of one plane, of the pixels from `first` on.
    #[inline(always)]
    fn samples<R: Real<Scalar = f64>>(&self, samples: &[f64], plane: usize, first: usize) -> R {
        let own = &samples[plane * self.pixels..(plane + 1) * self.pixels];
        if first + R::WIDTH <= own.len() {
            return R::load(&own[first..]);
        }
        let mut lanes = [0.0; MAX_LANES];
        for lane in 0..R::WIDTH {
            lanes[lane] = own[(first + lane).min(own.len() - 1)];
        }
        R::load(&lanes)
    }

    /// One plane of a map, of the pixels from `first` on.
    #[inline(always)]
    fn map<R: Real<Scalar = f64>>(&self, map: &[f32], plane: usize, first: usize) -> R {
        let own = &map[plane * self.pixels..(plane + 1) * self.pixels];
        let mut lanes = [0.0; MAX_LANES];
        for lane in 0..R::WIDTH {
            lanes[lane] = f64::from(own[(first + lane).min(own.len() - 1)]);
        }
        R::load(&lanes)
    }

    #[inline(always)]
    fn gathered<R: Real<Scalar = f64>>(&self, first: usize) -> Pixels<R> {
        let Self { adjustment, pixels, .. } = *self;
        let grid = adjustment.rig.grid();
        let mut places = [[0.0; MAX_LANES]; 2];
        for lane in 0..R::WIDTH {
            let number = (first + lane).min(pixels - 1);
            places[0][lane] = grid.x((number % grid.width) as f64);
            places[1][lane] = grid.y((number / grid.width) as f64);
        }
        let normal = adjustment.surface.normal;
        let normal = Vec3::new(
            self.map(normal, 0, first),
            self.map(normal, 1, first),
            self.map(normal, 2, first),
        );
        let place = (R::load(&places[0]), R::load(&places[1]));
        let gamma = self.parameter(&self.lobe.shape[0], first);
        Pixels { normal, tilts: tangents(normal), place, gamma }
    }

    #[inline(always)]
    fn parameter<R: Real<Scalar = f64>>(&self, parameter: &Parameter<'_>, first: usize) -> R {
        match *parameter {
            Parameter::Everywhere(value) => R::of(f64::from(value)),
            Parameter::Map(map) => self.map(map, 0, first),
        }
    }

    #[inline(always)]
    fn colours<R: Real<Scalar = f64>>(&self, band: usize, first: usize) -> Colours<R> {
        let surface = self.adjustment.surface;
        let strength: R = match &self.lobe.strength {
            Strength::Tinted(map) => self.map(map, band, first),
            Strength::Neutral(parameter) => self.parameter(parameter, first),
        };
        Colours {
            diffuse: self.map(surface.diffuse, band, first),
            ambient: match surface.ambient {
                Some(map) => self.map(map, band, first),
                None => R::zero(),
            },
            strength: R::keep(strength.gt(R::zero()), strength),
        }
    }

    /// What pixels show of a photograph's light.
    #[inline(always)]
    fn light<R: Real<Scalar = f64>>(
        &self,
        pairs: &Pairs<TorranceSparrow>,
        observation: usize,
        pixels: &Pixels<R>,
    ) -> Light<R> {
        let (zero, one) = (R::zero(), R::one());
        let &Pixels { normal, tilts, place: (x, y), gamma } = pixels;
        let (towards, irradiance, facet) = pairs.at(observation, x, y);
        let (diffuse, by_normal) = match &self.adjustment.surface.coated {
            None => (normal.dot(towards), towards),
            Some(coated) => {
                let slope = coated.slope(normal, towards, facet.view());
                (slope.value, slope.normal)
            }
        };
        // Hard case 24: no light from behind.
        let lit = R::keep(diffuse.gt(zero), irradiance);
        let k = sharpness(gamma);
        let glint = facet.on(normal);
        let lobe = glint.lobe(k);
        let slope = facet.slope(normal, glint, lobe, one, k);
        let outwards = normal - facet.half();
        let (mut factor, mut by_angle) = (one, zero);
        if let Some(profile) = &self.adjustment.profile {
            let phi = glint.phi_squared.sqrt();
            let (at, by_phi) = profile.at(phi);
            factor = at;
            // d phi / dN = d phi^2 / dN / (2 phi).
            let squared = phi_squared_slope(outwards.length_squared() * R::of(0.5));
            let by = glint.weight * lobe * by_phi * squared / (phi + phi);
            by_angle = R::keep(phi.gt(zero), by);
        }
        let by_tilt = slope.normal.scale(factor) + outwards.scale(by_angle);
        // A pixel without a lobe has no width.
        let glossy = R::keep(gamma.le(gamma), irradiance);
        // Beyond the widest lobe the model stays as it is.
        let narrow = R::keep(gamma.lt(R::of(GAMMA_MAX)), glossy);
        let width = R::of(-2.0) * factor * slope.log_sharpness;
        Light {
            diffuse: lit * diffuse,
            diffuse_by_tilt: [lit * tilts[0].dot(by_normal), lit * tilts[1].dot(by_normal)],
            lobe: glossy * (glint.weight * lobe * factor),
            lobe_by_shared: [
                glossy * tilts[0].dot(by_tilt),
                glossy * tilts[1].dot(by_tilt),
                narrow * width,
            ],
        }
    }
}

impl LobeProfile<'_> {
    /// Factors at angles, and their derivatives.
    #[inline(always)]
    fn at<R: Real<Scalar = f64>>(&self, angles: R) -> (R, R) {
        let mut lanes = [[0.0; MAX_LANES]; 2];
        angles.store(&mut lanes[0]);
        for lane in 0..R::WIDTH {
            let (factor, slope) = self.of(lanes[0][lane]);
            (lanes[0][lane], lanes[1][lane]) = (factor, slope);
        }
        (R::load(&lanes[0]), R::load(&lanes[1]))
    }

    /// The factor at an angle, and its derivative.
    fn of(&self, angle: f64) -> (f64, f64) {
        let Self { knots, factors } = *self;
        let after = knots.partition_point(|&knot| knot <= angle);
        if after == 0 {
            return (factors[0], 0.0);
        }
        if after == knots.len() {
            return (factors[after - 1], 0.0);
        }
        let slope = (factors[after] - factors[after - 1]) / (knots[after] - knots[after - 1]);
        (factors[after - 1] + slope * (angle - knots[after - 1]), slope)
    }
}
