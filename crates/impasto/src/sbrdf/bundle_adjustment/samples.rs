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
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row {
    pub(super) error: f64,
    /// By the unknowns that all bands share, and by those of its own.
    pub(super) shared: [f64; SHARED],
    pub(super) own: [f64; OWN],
    /// By the logarithm of its lamp's strength.
    pub(super) lamp: f64,
}

/// One pixel's rows `(obs, band)`, and their derivatives by inverse distances.
pub(super) struct PixelSamples {
    pub(super) layout: Layout,
    pub(super) rows: Vec<Row>,
    /// `(obs, band, place)`.
    pub(super) places: Vec<f64>,
    /// Its colours in each band.
    colours: Vec<Colours>,
}

impl PixelSamples {
    pub(super) fn new(layout: Layout) -> Self {
        let rows = layout.observations * layout.bands;
        let places = vec![0.0; rows * layout.places];
        Self { layout, rows: vec![Row::default(); rows], places, colours: Vec::new() }
    }

    /// Derivatives by inverse distances of one row.
    #[inline(always)]
    pub(super) fn places_of(&self, row: usize) -> &[f64] {
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

impl<R: Real> Light<R> {
    /// How many numbers it has.
    const NUMBERS: usize = 4 + SHARED;

    /// Writes all lanes of its numbers.
    #[inline(always)]
    fn store(&self, out: &mut [R::Scalar]) {
        let [across, along] = self.diffuse_by_tilt;
        let [first, second, width] = self.lobe_by_shared;
        let numbers = [self.diffuse, across, along, self.lobe, first, second, width];
        for number in 0..Self::NUMBERS {
            numbers[number].store(&mut out[number * R::WIDTH..]);
        }
    }
}

/// Some pixels side by side, one per lane.
pub(super) struct Block {
    /// `(obs, rig, number, lane)`: the light of every photograph under the rig, then under those
    /// whose inverse distances are larger.
    lights: Vec<f64>,
    /// `(obs, band, lane)`: errors and slopes, which lie far apart in the pictures of one pixel.
    errors: Vec<f64>,
    slopes: Vec<f64>,
    rigs: usize,
    width: usize,
}

impl Block {
    /// Room for `width` pixels.
    pub(super) fn new(layout: Layout, width: usize) -> Self {
        let rigs = 1 + layout.places;
        let lights = layout.observations * rigs * Light::<f64>::NUMBERS * width;
        let samples = layout.observations * layout.bands * width;
        Self {
            lights: vec![0.0; lights],
            errors: vec![0.0; samples],
            slopes: vec![0.0; samples],
            rigs,
            width,
        }
    }

    /// The light of one photograph under one of the rigs.
    #[inline(always)]
    fn light(&self, observation: usize, rig: usize, lane: usize) -> Light<f64> {
        let first = (observation * self.rigs + rig) * Light::<f64>::NUMBERS;
        let get = |number: usize| self.lights[(first + number) * self.width + lane];
        Light {
            diffuse: get(0),
            diffuse_by_tilt: [get(1), get(2)],
            lobe: get(3),
            lobe_by_shared: [get(4), get(5), get(6)],
        }
    }
}

/// The colours of a pixel in one band; none is below 0.
#[derive(Clone, Copy)]
struct Colours {
    diffuse: f64,
    ambient: f64,
    strength: f64,
}

impl Colours {
    /// What shows under a light of strength 1.
    #[inline(always)]
    fn shown(&self, light: &Light<f64>) -> f64 {
        self.diffuse * light.diffuse + self.strength * light.lobe + self.ambient
    }

    /// The row of a sample, with the light's strength times the slope of its code as `scale`.
    #[inline(always)]
    fn row(&self, light: &Light<f64>, scale: f64, error: f64) -> Row {
        let Self { diffuse, ambient, strength } = *self;
        let [first, second, width] = light.lobe_by_shared;
        let [across, along] = light.diffuse_by_tilt;
        Row {
            error,
            shared: [
                scale * (diffuse * across + strength * first),
                scale * (diffuse * along + strength * second),
                scale * strength * width,
            ],
            // What is at its bound of 0 stays there.
            own: [
                if diffuse > 0.0 { scale * light.diffuse } else { 0.0 },
                if ambient > 0.0 { scale } else { 0.0 },
                if strength > 0.0 { scale * light.lobe } else { 0.0 },
            ],
            lamp: scale * self.shown(light),
        }
    }
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
    pub(super) fn read_block<R: Real<Scalar = f64>>(&self, first: usize, out: &mut Block) {
        let Adjustment { errors, slopes, .. } = *self.adjustment;
        for plane in 0..self.pairs.len() * self.bands {
            for lane in 0..R::WIDTH {
                let place = plane * self.pixels + (first + lane).min(self.pixels - 1);
                out.errors[plane * R::WIDTH + lane] = errors[place];
                out.slopes[plane * R::WIDTH + lane] = slopes[place];
            }
        }
        let pixels = self.gathered::<R>(first);
        let stride = Light::<R>::NUMBERS * R::WIDTH;
        let mut at = 0;
        for observation in 0..self.pairs.len() {
            self.light(&self.pairs, observation, &pixels).store(&mut out.lights[at..]);
            at += stride;
            for pairs in &self.moved {
                self.light(pairs, observation, &pixels).store(&mut out.lights[at..]);
                at += stride;
            }
        }
    }

    #[inline(always)]
    fn gathered<R: Real<Scalar = f64>>(&self, first: usize) -> Pixels<R> {
        let Self { adjustment, pixels, .. } = *self;
        let grid = adjustment.rig.grid();
        // Three of the normal, two of the place, gamma.
        let mut lanes = [[0.0; MAX_LANES]; 6];
        for lane in 0..R::WIDTH {
            let number = (first + lane).min(pixels - 1);
            let at = |map: &[f32], plane: usize| f64::from(map[plane * pixels + number]);
            for axis in 0..3 {
                lanes[axis][lane] = at(adjustment.surface.normal, axis);
            }
            lanes[3][lane] = grid.x((number % grid.width) as f64);
            lanes[4][lane] = grid.y((number / grid.width) as f64);
            lanes[5][lane] = match self.lobe.shape[0] {
                Parameter::Everywhere(gamma) => f64::from(gamma),
                Parameter::Map(map) => at(map, 0),
            };
        }
        let normal = Vec3::new(R::load(&lanes[0]), R::load(&lanes[1]), R::load(&lanes[2]));
        let place = (R::load(&lanes[3]), R::load(&lanes[4]));
        Pixels { normal, tilts: tangents(normal), place, gamma: R::load(&lanes[5]) }
    }

    /// Reads the pixel in a lane.
    #[inline(always)]
    pub(super) fn read(
        &self,
        number: usize,
        (block, lane): (&Block, usize),
        out: &mut PixelSamples,
    ) {
        let Self { adjustment, pixels, bands, .. } = *self;
        let Adjustment { surface, intensities, .. } = *adjustment;
        let at = |map: &[f32], plane: usize| f64::from(map[plane * pixels + number]);
        let of = |samples: &[f64], plane: usize| samples[plane * block.width + lane];
        out.colours.clear();
        for band in 0..bands {
            let strength = match self.lobe.strength {
                Strength::Tinted(map) => at(map, band),
                Strength::Neutral(Parameter::Map(map)) => at(map, 0),
                Strength::Neutral(Parameter::Everywhere(strength)) => f64::from(strength),
            };
            out.colours.push(Colours {
                diffuse: at(surface.diffuse, band),
                ambient: surface.ambient.map_or(0.0, |map| at(map, band)),
                strength: if strength > 0.0 { strength } else { 0.0 },
            });
        }
        let places = out.layout.places;
        for (observation, &intensity) in intensities.iter().enumerate() {
            let planes = observation * bands..(observation + 1) * bands;
            if planes.clone().all(|plane| of(&block.slopes, plane) == 0.0) {
                out.rows[planes.clone()].fill(Row::default());
                out.places[planes.start * places..planes.end * places].fill(0.0);
                continue;
            }
            let light = block.light(observation, 0, lane);
            for (band, row) in planes.enumerate() {
                let colours = out.colours[band];
                let scale = intensity * of(&block.slopes, row);
                out.rows[row] = colours.row(&light, scale, of(&block.errors, row));
                for place in 0..places {
                    let moved = block.light(observation, 1 + place, lane);
                    let change = colours.shown(&moved) - colours.shown(&light);
                    out.places[row * places + place] = scale * change / adjustment.step;
                }
            }
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
