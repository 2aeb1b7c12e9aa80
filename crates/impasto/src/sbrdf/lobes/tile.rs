//! A tile's samples and weights, and where its pixels stand.

use crate::geometry::Rig;
use crate::math::Vec3;
use crate::sbrdf::Start;
use crate::stack::Stack;

use super::maps::MOST_LOBES;
use super::model::MAX_SHAPES;

/// Pixels of a tile: few enough that a cancelled call ends within a moment with hundreds of
/// photographs, enough for the lanes to refill.
pub(super) const TILE: usize = 256;

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
            converged: false,
        }
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
        let samples = self.samples[pixel..].iter().step_by(TILE);
        samples
            .zip(&self.ceilings)
            .map(|(&s, &ceiling)| if s == f32::INFINITY { ceiling } else { s })
    }

    /// One pixel's weights.
    pub(super) fn weights_of(&self, pixel: usize) -> impl Iterator<Item = f32> {
        self.weights[pixel..].iter().step_by(TILE).copied()
    }
}

/// All that is known of a tile.
pub(super) struct Tile {
    pub(super) start: usize,
    pub(super) count: usize,
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
}

/// Of a weighted sum of squares: f32 keeps 24 bits, and a sample shown is a sum of some ten rounded
/// terms.
pub(super) const ROUNDING: f32 = 1.0 / (1_u64 << 40) as f32;

/// Share of a pixel's mean sample below which light is no longer what noise grows with, before
/// anything is known of the surface.
const FIRST_FLOOR: f32 = 0.1;

/// Share of a pixel's colour below which samples tell no shadow from noise.
const SHADE: f32 = 0.03;

impl Tile {
    pub(super) fn new(stack: &Stack<'_>) -> Self {
        let shape = stack.shape();
        let ceilings: Vec<f32> = (0..shape.observations * shape.bands)
            .map(|plane| stack.ceiling(plane / shape.bands, plane % shape.bands))
            .collect();
        Self {
            start: 0,
            count: 0,
            x: vec![0.0; TILE],
            y: vec![0.0; TILE],
            colour: Plate::new(ceilings, shape.bands),
            grey: Plate::new(vec![f32::INFINITY; shape.observations], 1),
            usable: vec![0; TILE],
            rounding: vec![0.0; TILE],
            places: Vec::with_capacity(TILE),
        }
    }

    /// Takes up the pixels from `start` on, at the normals `(3, y, x)`.
    pub(super) fn read(&mut self, stack: &Stack<'_>, rig: &Rig, start: usize, known: &Start<'_>) {
        let pixels = stack.shape().pixels();
        let bands = self.colour.bands;
        self.start = start;
        self.count = TILE.min(pixels - start);
        rig.grid().coordinates(start, &mut self.x, &mut self.y);
        for (plane, out) in self.colour.samples.chunks_mut(TILE).enumerate() {
            stack.read(plane / bands, plane % bands, start, out);
        }
        self.places.clear();
        for pixel in 0..self.count {
            let normal = [0, 1, 2].map(|axis| known.normal[axis * pixels + start + pixel]);
            self.places.push(Place::new(normal));
            self.weigh(pixel);
            let colours: Vec<f32> =
                (0..bands).map(|band| known.diffuse[band * pixels + start + pixel]).collect();
            self.shade(rig, pixel, &colours);
        }
    }

    /// Takes weight from samples that have less light than the surface of photometric stereo, which
    /// are shadows (hard case 24).
    fn shade(&mut self, rig: &Rig, pixel: usize, colours: &[f32]) {
        let [nx, ny, nz] = self.places[pixel].normal;
        let normal = Vec3::new(nx, ny, nz);
        let bands = colours.len();
        let mean = colours.iter().sum::<f32>() / bands as f32;
        let floor = SHADE * mean;
        for (photograph, light) in rig.lights().iter().enumerate() {
            let (towards, irradiance) = light.at(self.x[pixel], self.y[pixel]);
            let matt = normal.dot(towards).max(0.0) * irradiance;
            for (band, &colour) in colours.iter().enumerate() {
                let place = (photograph * bands + band) * TILE + pixel;
                let sample = self.colour.samples[place];
                self.colour.weights[place] *= lit(sample + floor, matt.mul_add(colour, floor));
            }
            let place = photograph * TILE + pixel;
            let sample = self.grey.samples[place];
            self.grey.weights[place] *= lit(sample + floor, matt.mul_add(mean, floor));
        }
    }

    /// First weights of a pixel: variance proportional to the sample, with a floor.
    fn weigh(&mut self, pixel: usize) {
        let bands = self.colour.bands;
        let planes = self.colour.planes();
        let (mut sum, mut count) = (0.0, 0.0);
        self.usable[pixel] = 0;
        for photograph in 0..planes / bands {
            let (mut grey, mut whole) = (0.0, true);
            for plane in photograph * bands..(photograph + 1) * bands {
                let place = plane * TILE + pixel;
                let sample = &mut self.colour.samples[place];
                let light =
                    if *sample == f32::INFINITY { self.colour.ceilings[plane] } else { *sample };
                // Squares must be numbers, too (hard case 26).
                let counts = (light * light).is_finite();
                self.colour.weights[place] = f32::from(u8::from(counts));
                if counts {
                    sum += light;
                    count += 1.0;
                    grey += light;
                } else {
                    *sample = 0.0;
                    whole = false;
                }
            }
            let place = photograph * TILE + pixel;
            self.usable[pixel] += usize::from(whole);
            self.grey.samples[place] = if whole { grey / bands as f32 } else { 0.0 };
            self.grey.weights[place] = f32::from(u8::from(whole));
        }
        let mean = sum / f32::max(count, 1.0);
        let floor = FIRST_FLOOR * mean;
        for plate in [&mut self.colour, &mut self.grey] {
            let samples = plate.samples[pixel..].iter().step_by(TILE);
            for ((weight, &sample), &ceiling) in
                plate.weights[pixel..].iter_mut().step_by(TILE).zip(samples).zip(&plate.ceilings)
            {
                let light = if sample == f32::INFINITY { ceiling } else { sample };
                let variance = light.max(floor);
                *weight = if *weight > 0.0 && variance > 0.0 { mean / variance } else { 0.0 };
            }
        }
        let squares = self.grey.column(pixel).zip(self.grey.weights_of(pixel));
        self.rounding[pixel] = ROUNDING * squares.map(|(y, weight)| weight * y * y).sum::<f32>();
    }
}

/// Share of a first weight that a sample keeps beside what a diffuse surface would show.
fn lit(sample: f32, matt: f32) -> f32 {
    if matt > sample {
        let share = sample.max(0.0) / matt;
        share * share * share
    } else {
        1.0
    }
}
