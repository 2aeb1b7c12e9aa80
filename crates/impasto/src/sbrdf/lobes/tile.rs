//! A tile's samples and weights, and where its pixels stand.

use crate::geometry::Rig;
use crate::math::lanes::{Isa, MAX_LANES};
use crate::math::{Kernel, Level, Mask, Real, Vec3};
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::maps::MOST_LOBES;
use super::model::MAX_SHAPES;

/// Pixels of a tile: few enough that a cancelled call ends within a moment with hundreds of
/// photographs, enough for the lanes to refill.
pub(super) const TILE: usize = 256;

/// Numbers of the places from `at` on, as lanes; those beyond the last repeat it.
#[inline(always)]
pub(super) fn gather<R: Real<Scalar = f32>>(
    places: &[Place],
    at: usize,
    number: impl Fn(&Place) -> f32,
) -> R {
    let mut lanes = [0.0; MAX_LANES];
    for (lane, value) in lanes.iter_mut().enumerate().take(R::WIDTH) {
        *value = number(&places[(at + lane).min(places.len() - 1)]);
    }
    R::load(&lanes)
}

/// Where one pixel stands.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) normal: [f32; 3],
    /// How many lobes it has.
    pub(super) lobes: usize,
    pub(super) shapes: [[f32; MAX_SHAPES]; MOST_LOBES],
    /// Weighted sum of squares.
    pub(super) cost: f32,
    /// Standard deviation of the normal along its worst axis, and of every shape's first number,
    /// for residuals of unit variance.
    pub(super) normal_spread: f32,
    pub(super) shape_spread: [f32; MOST_LOBES],
    /// The same of a shape's first number, by the photographs alone.
    pub(super) seen_spread: [f32; MOST_LOBES],
    /// Whether the last search ended by its own tests.
    pub(super) converged: bool,
}

impl Place {
    pub(super) fn new(normal: [f32; 3]) -> Self {
        Self {
            normal,
            lobes: 0,
            shapes: [[0.0; MAX_SHAPES]; MOST_LOBES],
            cost: f32::INFINITY,
            normal_spread: f32::NAN,
            shape_spread: [f32::NAN; MOST_LOBES],
            seen_spread: [f32::NAN; MOST_LOBES],
            converged: false,
        }
    }
}

/// Where a pixel stood without a lobe, with one ..., as far as lobes were worth their unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ladder {
    pub(super) rungs: [Place; MOST_LOBES + 1],
    /// How many lobes were.
    pub(super) lobes: usize,
}

impl Ladder {
    pub(super) fn top(&self) -> &Place {
        &self.rungs[self.lobes]
    }
}

/// Samples `(obs, band, pixel)` of a tile with a weight each.
pub(super) struct Plate {
    pub(super) bands: usize,
    /// Linear; `+inf` where clipped, 0 where unusable.
    pub(super) samples: Vec<f32>,
    /// Inverse of the expected variance in units of the pixel's mean sample: free of scale, so that
    /// costs go with its square (hard case 28). 0 where a sample does not count.
    pub(super) weights: Vec<f32>,
    /// What a clipped sample reached at least, per (obs, band).
    pub(super) ceilings: Vec<f32>,
}

impl Plate {
    pub(super) fn new(ceilings: Vec<f32>, bands: usize) -> Self {
        let size = ceilings.len() * TILE;
        Self { bands, samples: vec![0.0; size], weights: vec![0.0; size], ceilings }
    }

    /// Photographs times bands.
    pub(super) fn planes(&self) -> usize {
        self.ceilings.len()
    }

    /// One pixel's samples, clipped ones at their ceiling.
    pub(super) fn column(&self, pixel: usize) -> impl Iterator<Item = f32> {
        let light = move |(plane, &ceiling): (&[f32; TILE], &f32)| {
            let sample = plane[pixel % TILE];
            if sample == f32::INFINITY { ceiling } else { sample }
        };
        self.samples.as_chunks().0.iter().zip(&self.ceilings).map(light)
    }

    /// Some pixels' samples of one plane, clipped ones at their ceiling.
    #[inline(always)]
    fn light<R: Real<Scalar = f32>>(&self, plane: usize, at: usize) -> R {
        let sample = R::load(&self.samples[plane * TILE + at..]);
        let clipped = sample.gt(R::of(f64::from(f32::MAX)));
        R::select(clipped, R::splat(self.ceilings[plane]), sample)
    }

    /// Leaves samples a share of their weight beside what a diffuse surface would show.
    #[inline(always)]
    fn darken<R: Real<Scalar = f32>>(&mut self, plane: usize, at: usize, matt: R, floor: R) {
        let sample = R::load(&self.samples[plane * TILE + at..]) + floor;
        let share = sample.max(R::zero()) / matt;
        let lit = R::select(matt.gt(sample), share * share * share, R::one());
        let weights = &mut self.weights[plane * TILE + at..];
        (R::load(weights) * lit).store(weights);
    }

    /// One pixel's weights.
    pub(super) fn weights_of(&self, pixel: usize) -> impl Iterator<Item = f32> {
        self.weights.as_chunks::<TILE>().0.iter().map(move |plane| plane[pixel % TILE])
    }
}

/// All that is known of a tile.
pub(super) struct Tile {
    /// Which, in the order of the image.
    pub(super) pixels: Vec<usize>,
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) colour: Plate,
    /// The mean over the bands, where all of them count.
    pub(super) grey: Plate,
    /// Usable photographs per pixel.
    pub(super) usable: Vec<usize>,
    /// What rounding leaves of the mean of the bands, as a weighted sum of squares.
    pub(super) rounding: Vec<f32>,
    pub(super) places: Vec<Place>,
    /// Colours of photometric stereo, `(band, pixel)`.
    matt: Vec<f32>,
}

/// Of a weighted sum of squares: f32 keeps 24 bits, and a sample shown is a sum of some ten rounded
/// terms.
pub(super) const ROUNDING: f32 = 1.0 / (1_u64 << 40) as f32;

/// Share of a pixel's mean sample below which light is no longer what noise grows with, before
/// anything is known of the surface.
const FIRST_FLOOR: f64 = 0.1;

/// Share of a pixel's colour below which samples tell no shadow from noise.
const SHADE: f64 = 0.03;

impl Tile {
    pub(super) fn new(stack: &Stack<'_>) -> Self {
        let shape = stack.shape();
        let ceilings: Vec<f32> = (0..shape.observations * shape.bands)
            .map(|plane| stack.ceiling(plane / shape.bands, plane % shape.bands))
            .collect();
        Self {
            pixels: Vec::with_capacity(TILE),
            x: vec![0.0; TILE],
            y: vec![0.0; TILE],
            colour: Plate::new(ceilings, shape.bands),
            grey: Plate::new(vec![f32::INFINITY; shape.observations], 1),
            usable: vec![0; TILE],
            rounding: vec![0.0; TILE],
            places: Vec::with_capacity(TILE),
            matt: vec![0.0; shape.bands * TILE],
        }
    }

    /// Takes up some pixels, at most [`TILE`], at the normals `(3, y, x)`.
    pub(super) fn read(
        &mut self,
        stack: &Stack<'_>,
        rig: &Rig,
        chosen: &[usize],
        known: &Start<'_>,
        level: Level,
    ) {
        let pixels = stack.shape().pixels();
        let bands = self.colour.bands;
        self.pixels.clear();
        self.pixels.extend_from_slice(chosen);
        let mut at = 0;
        for run in chosen.chunk_by(|pixel, next| pixel + 1 == *next) {
            let end = at + run.len();
            rig.grid().coordinates(run[0], &mut self.x[at..end], &mut self.y[at..end]);
            for (plane, out) in self.colour.samples.chunks_mut(TILE).enumerate() {
                stack.read(plane / bands, plane % bands, run[0], &mut out[at..end]);
            }
            at = end;
        }
        self.places.clear();
        self.places.extend(chosen.iter().map(|&pixel| Place::new(known.normal(pixel))));
        for (band, colours) in self.matt.chunks_mut(TILE).enumerate() {
            for (colour, pixel) in colours.iter_mut().zip(chosen) {
                *colour = known.diffuse[band * pixels + pixel];
            }
        }
        level.run(Weigh { tile: self, rig });
    }
}

/// First weights of a tile's pixels.
struct Weigh<'a> {
    tile: &'a mut Tile,
    rig: &'a Rig,
}

impl Kernel for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self { tile, rig } = self;
        for at in (0..tile.places.len()).step_by(I::F32::WIDTH) {
            tile.weigh::<I::F32>(at);
            tile.shade::<I::F32>(rig, at);
        }
    }
}

impl Tile {
    /// Variance proportional to the sample, with a floor.
    #[inline(always)]
    fn weigh<R: Real<Scalar = f32>>(&mut self, at: usize) {
        let (zero, one) = (R::zero(), R::one());
        let bands = self.colour.bands;
        let (mut sum, mut count, mut usable) = (zero, zero, zero);
        for photograph in 0..self.colour.planes() / bands {
            let (mut grey, mut whole) = (zero, R::Mask::splat(true));
            for plane in photograph * bands..(photograph + 1) * bands {
                let light = self.colour.light::<R>(plane, at);
                // Squares must be numbers, too (hard case 26).
                let counts = (light * light).is_finite();
                let place = plane * TILE + at;
                let sample = R::load(&self.colour.samples[place..]);
                R::keep(counts, sample).store(&mut self.colour.samples[place..]);
                R::keep(counts, one).store(&mut self.colour.weights[place..]);
                sum = sum + R::keep(counts, light);
                count = count + R::keep(counts, one);
                grey = grey + R::keep(counts, light);
                whole = whole & counts;
            }
            let place = photograph * TILE + at;
            usable = usable + R::keep(whole, one);
            let grey = R::keep(whole, grey / R::of(bands as f64));
            grey.store(&mut self.grey.samples[place..]);
            R::keep(whole, one).store(&mut self.grey.weights[place..]);
        }
        let mean = sum / count.max(one);
        let floor = R::of(FIRST_FLOOR) * mean;
        for plate in [&mut self.colour, &mut self.grey] {
            for plane in 0..plate.planes() {
                let variance = plate.light::<R>(plane, at).max(floor);
                let weights = &mut plate.weights[plane * TILE + at..];
                let counts = R::load(weights).gt(zero) & variance.gt(zero);
                R::keep(counts, mean / variance).store(weights);
            }
        }
        let mut squares = zero;
        for plane in 0..self.grey.planes() {
            let sample = R::load(&self.grey.samples[plane * TILE + at..]);
            let weight = R::load(&self.grey.weights[plane * TILE + at..]);
            squares = (weight * sample).mul_add(sample, squares);
        }
        (R::splat(ROUNDING) * squares).store(&mut self.rounding[at..]);
        let mut numbers = [0.0; MAX_LANES];
        usable.store(&mut numbers);
        for (usable, &number) in self.usable[at..].iter_mut().zip(&numbers[..R::WIDTH]) {
            *usable = number as usize;
        }
    }

    /// Takes weight from samples that have less light than the surface of photometric stereo, which
    /// are shadows (hard case 24).
    #[inline(always)]
    fn shade<R: Real<Scalar = f32>>(&mut self, rig: &Rig, at: usize) {
        let zero = R::zero();
        let bands = self.colour.bands;
        let normal = Vec3::new(
            gather::<R>(&self.places, at, |place| place.normal[0]),
            gather(&self.places, at, |place| place.normal[1]),
            gather(&self.places, at, |place| place.normal[2]),
        );
        let (x, y) = (R::load(&self.x[at..]), R::load(&self.y[at..]));
        let mut mean = zero;
        for band in 0..bands {
            mean = mean + R::load(&self.matt[band * TILE + at..]);
        }
        let mean = mean / R::of(bands as f64);
        let floor = R::of(SHADE) * mean;
        for (photograph, light) in rig.lights().iter().enumerate() {
            let (towards, irradiance) = light.at(x, y);
            let matt = normal.dot(towards).max(zero) * irradiance;
            for band in 0..bands {
                let colour = R::load(&self.matt[band * TILE + at..]);
                self.colour.darken(
                    photograph * bands + band,
                    at,
                    matt.mul_add(colour, floor),
                    floor,
                );
            }
            self.grey.darken(photograph, at, matt.mul_add(mean, floor), floor);
        }
    }
}
