//! Lafortune lobes on a known normal, 100 or 690 observations per pixel.
//!
//! Either side is handed samples, normals, lights and views, and fits the diffuse strength and
//! (strength, turn, ln n) of each lobe to the radiance `f (N.L)`.

use impasto::brdf::lafortune::{Lobe, Pair};
use impasto::geometry::{Grid, Light, Rig};
use impasto::lm::{Batch, Bounds, Column, Normal, Occupancy, Options, Outcome, ROWS, Rows, fit};
use impasto::math::{Element, Level, Real, Vec3};
use impasto::sbrdf::lafortune::{LafortuneEstimate, LafortuneSelection, Luminance};
use levenberg_marquardt::LeastSquaresProblem;
use nalgebra::{Const, Dyn, OMatrix, OVector, Owned, SVector, U1};

use crate::random::Random;

/// Exponents of Snel's starts, in the order in which lobes are added.
const STARTS: [f64; 3] = [50.0, 5.0, 20.0];

/// What every diffuse part and lobe starts from.
const STRENGTH: f64 = 0.2;

/// Pixels under lights and views that all share.
pub(crate) struct Scene {
    pub(crate) directions: Vec<[Vec3<f64>; 2]>,
    pub(crate) normals: Vec<Vec3<f64>>,
    /// `[observation][pixel]`.
    pub(crate) samples: Vec<Vec<f32>>,
    /// The parameters behind the samples, four for one lobe.
    pub(crate) truth: Vec<[f64; 10]>,
}

fn unit(random: &mut Random, spread: f64) -> Vec3<f64> {
    Vec3::new(spread * random.normal(), spread * random.normal(), 1.0).normalised()
}

impl Scene {
    /// Half the views about the mirror direction of the flat painting, as far as slopes of 0.15
    /// turn it; noise of 0.005. Another seed is another sample.
    pub(crate) fn new(pixels: usize, observations: usize, lobes: usize, seed: u64) -> Self {
        let mut random = Random(observations as u64 + seed);
        let directions = (0..observations)
            .map(|i| {
                let light = unit(&mut random, 0.6);
                let mut view = unit(&mut random, 0.6);
                if i % 2 == 0 {
                    let off = unit(&mut random, 0.3);
                    view = Vec3::new(off.x - light.x, off.y - light.y, light.z).normalised();
                }
                [light, view]
            })
            .collect();
        let mut scene = Self {
            directions,
            normals: Vec::new(),
            samples: vec![vec![0.0; pixels]; observations],
            truth: Vec::new(),
        };
        for pixel in 0..pixels {
            let normal = unit(&mut random, 0.15);
            let mut truth = [0.0; 10];
            truth[0] = random.between(0.1, 0.4);
            for (lobe, exponent) in [60.0, 6.0, 20.0].into_iter().enumerate().take(lobes) {
                truth[1 + 3 * lobe] = random.between(0.1, 0.6);
                let exponent: f64 = exponent * random.between(0.6, 1.4);
                // A lobe's brightness goes with (1 + turn)^n from the mirror to the normal: up to
                // a factor of e either way.
                truth[2 + 3 * lobe] = random.between(-1.0, 1.0) / exponent;
                truth[3 + 3 * lobe] = exponent.ln();
            }
            scene.normals.push(normal);
            scene.truth.push(truth);
            for i in 0..observations {
                let pair = scene.pair(pixel, i);
                let lobes = [1, 4, 7].map(|j| Lobe::new(truth[j], truth[j + 1], truth[j + 2]));
                let value = model::<f64, 10>(&lobes, truth[0], &pair).0;
                scene.samples[i][pixel] = 0.005_f64.mul_add(random.normal(), value) as f32;
            }
        }
        scene
    }

    pub(crate) fn pair(&self, pixel: usize, observation: usize) -> Pair<f64> {
        let [light, view] = self.directions[observation];
        Pair::against(self.normals[pixel], light, view, light.dot(view))
    }
}

/// Radiance and derivatives.
#[inline(always)]
fn model<R: Real, const N: usize>(lobes: &[Lobe<R>; 3], diffuse: R, pair: &Pair<R>) -> (R, [R; N]) {
    let mut slope = [R::zero(); N];
    let mut reflectance = diffuse;
    slope[0] = pair.cosine;
    for (j, lobe) in lobes.iter().enumerate().take((N - 1) / 3) {
        let g = lobe.gradient(pair);
        reflectance = reflectance + g.value;
        slope[1 + 3 * j] = pair.cosine * g.amplitude;
        slope[2 + 3 * j] = pair.cosine * g.turn;
        slope[3 + 3 * j] = pair.cosine * g.log_exponent;
    }
    (pair.cosine * reflectance, slope)
}

/// Both sides' first guess for one lobe, and MINPACK's for three at once.
pub(crate) fn start<const N: usize>() -> [f64; N] {
    let mut at = [0.0; N];
    at[0] = STRENGTH;
    for (lobe, exponent) in STARTS.iter().enumerate().take((N - 1) / 3) {
        at[1 + 3 * lobe] = STRENGTH;
        at[3 + 3 * lobe] = exponent.ln();
    }
    at
}

/// Pixels side by side in registers.
struct Lanes<'a, S, const N: usize> {
    scene: &'a Scene,
    /// Light, view and their product, splat to all lanes.
    directions: Vec<[S; 7]>,
    starts: &'a [[f64; N]],
    costs: Vec<f64>,
}

impl<S: Element, const N: usize> Batch<S, N> for Lanes<'_, S, N> {
    fn rows(&self) -> usize {
        self.directions.len() + 3
    }
    #[inline]
    fn load(&mut self, pixel: usize, column: &mut Column<'_, S>) -> [S; N] {
        let samples = self.scene.samples.iter();
        let samples = samples.map(|plane| S::from_f64(f64::from(plane[pixel])));
        let normal = self.scene.normals[pixel];
        let normal = [normal.x, normal.y, normal.z].map(S::from_f64);
        column.fill(samples.chain(normal));
        self.starts[pixel].map(S::from_f64)
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = S>>(&self, rows: Rows<'_, R>, at: [R; N]) -> Normal<R, N> {
        let count = self.directions.len();
        let up = Vec3::new(rows.get(count), rows.get(count + 1), rows.get(count + 2));
        let mut lobes = [Lobe::new(R::zero(), R::zero(), R::zero()); 3];
        for (j, lobe) in lobes.iter_mut().enumerate().take((N - 1) / 3) {
            *lobe = Lobe::new(at[1 + 3 * j], at[2 + 3 * j], at[3 + 3 * j]);
        }
        let mut normal = Normal::zero();
        let mut slopes = [[R::zero(); N]; ROWS];
        let mut residuals = [R::zero(); ROWS];
        for (block, directions) in self.directions.chunks(ROWS).enumerate() {
            for (k, &[lx, ly, lz, vx, vy, vz, light_view]) in directions.iter().enumerate() {
                let light = Vec3::new(R::splat(lx), R::splat(ly), R::splat(lz));
                let view = Vec3::new(R::splat(vx), R::splat(vy), R::splat(vz));
                let pair = Pair::against(up, light, view, R::splat(light_view));
                let (value, slope) = model(&lobes, at[0], &pair);
                let residual = rows.get(block * ROWS + k) - value;
                if N > 4 {
                    (slopes[k], residuals[k]) = (slope, residual);
                } else {
                    normal.add(slope, residual);
                }
            }
            if N > 4 {
                for k in directions.len()..ROWS {
                    (slopes[k], residuals[k]) = ([R::zero(); N], R::zero());
                }
                normal.add_rows(&slopes, &residuals);
            }
        }
        normal
    }
    #[inline]
    fn store(&mut self, pixel: usize, outcome: &Outcome<S, N>) {
        self.costs[pixel] = outcome.normal.cost.to_f64();
    }
}

/// Costs that a search found, and how busy its lanes were.
pub(crate) type Costs = (Vec<f64>, Occupancy);

/// One joint fit of all pixels from the given starts.
pub(crate) fn joint<S: Element, const N: usize>(
    scene: &Scene,
    starts: &[[f64; N]],
    options: &Options,
) -> Costs {
    let directions = scene
        .directions
        .iter()
        .map(|[l, v]| [l.x, l.y, l.z, v.x, v.y, v.z, l.dot(*v)].map(S::from_f64));
    let count = starts.len();
    let mut lanes =
        Lanes { scene, directions: directions.collect(), starts, costs: vec![0.0; count] };
    let mut bounds = Bounds { lower: [S::zero(); N], upper: [S::from_f64(1e6); N] };
    for lobe in 0..(N - 1) / 3 {
        (bounds.lower[2 + 3 * lobe], bounds.upper[2 + 3 * lobe]) = (-S::one(), S::one());
        bounds.upper[3 + 3 * lobe] = S::from_f64(10.0);
    }
    let occupancy = fit(Level::detect(), &mut lanes, 0..count, &bounds, options);
    (lanes.costs, occupancy)
}

/// The same pixels as the core's own pass over lobes takes them.
pub(crate) struct Photographs {
    rig: Rig,
    samples: Vec<f32>,
    normals: Vec<[f32; 3]>,
    places: Vec<[f32; 2]>,
}

impl Photographs {
    pub(crate) fn of(scene: &Scene) -> Self {
        let count = scene.normals.len();
        let lights = scene.directions.iter().map(|&[light, _]| Light::Distant(light)).collect();
        let views: Vec<_> = scene.directions.iter().map(|&[_, view]| view).collect();
        let grid = Grid::whole(count, 1, 1.0);
        Self {
            rig: Rig::new(lights, views, grid).expect("a light for every view"),
            samples: scene.samples.concat(),
            normals: scene.normals.iter().map(|n| [n.x, n.y, n.z].map(|v| v as f32)).collect(),
            places: vec![[0.0; 2]; count],
        }
    }
}

/// Lobes added one at a time, as `fit_sbrdf` adds them: three, or as many as the Bayesian
/// information criterion asks for.
pub(crate) fn sequential(
    photographs: &Photographs,
    select: bool,
    options: &Options,
) -> (Vec<LafortuneEstimate>, Occupancy) {
    let Photographs { rig, samples, normals, places } = photographs;
    let data = Luminance { rig, samples, stride: normals.len(), normals, places };
    let pixels: Vec<usize> = (0..normals.len()).collect();
    let sequence = LafortuneSelection { lobes: 3, select, turning: true, options: *options };
    sequence.fit(Level::detect(), &data, &pixels, &|| false)
}

/// One pixel for MINPACK, in plain double precision with the library's logarithm and exponential;
/// what does not change during the fit is computed beforehand.
pub(crate) struct Port<const N: usize> {
    samples: Vec<f64>,
    pairs: Vec<Pair<f64>>,
    place: SVector<f64, N>,
}

/// `[rho, Cxy, Cz, d psi / d turn, n]` of a lobe.
type Constants = [f64; 5];

impl<const N: usize> Port<N> {
    pub(crate) fn new(scene: &Scene, pixel: usize, start: [f64; N]) -> Self {
        let count = scene.directions.len();
        Self {
            samples: scene.samples.iter().map(|plane| f64::from(plane[pixel])).collect(),
            pairs: (0..count).map(|i| scene.pair(pixel, i)).collect(),
            place: SVector::from(start),
        }
    }

    fn lobes(&self) -> [Constants; 3] {
        let mut lobes = [[0.0; 5]; 3];
        for (j, lobe) in lobes.iter_mut().enumerate().take((N - 1) / 3) {
            let turn = self.place[2 + 3 * j];
            let scale = 1.0 / (1.0 + turn * turn);
            let (cosine, sine) = ((1.0 - turn * turn) * scale, 2.0 * turn * scale);
            let exponent = self.place[3 + 3 * j].exp();
            *lobe = [self.place[1 + 3 * j], sine - cosine, sine + cosine, 2.0 * scale, exponent];
        }
        lobes
    }
}

impl<const N: usize> LeastSquaresProblem<f64, Dyn, Const<N>> for Port<N> {
    type ResidualStorage = Owned<f64, Dyn, U1>;
    type JacobianStorage = Owned<f64, Dyn, Const<N>>;
    type ParameterStorage = Owned<f64, Const<N>>;

    fn set_params(&mut self, place: &SVector<f64, N>) {
        self.place = *place;
    }
    fn params(&self) -> SVector<f64, N> {
        self.place
    }
    fn residuals(&self) -> Option<OVector<f64, Dyn>> {
        let lobes = self.lobes();
        let residual = |(y, pair): (&f64, &Pair<f64>)| {
            let mut sum = self.place[0];
            for [rho, cxy, cz, _, n] in lobes.iter().take((N - 1) / 3) {
                let base = cxy * pair.tangential + cz * pair.upright;
                if base > 0.0 {
                    sum += rho * (n * base.ln()).exp();
                }
            }
            pair.cosine * sum - y
        };
        let residuals = self.samples.iter().zip(&self.pairs).map(residual);
        Some(OVector::<f64, Dyn>::from_iterator(self.samples.len(), residuals))
    }
    fn jacobian(&self) -> Option<OMatrix<f64, Dyn, Const<N>>> {
        let lobes = self.lobes();
        let mut jacobian = OMatrix::<f64, Dyn, Const<N>>::zeros(self.samples.len());
        for (i, pair) in self.pairs.iter().enumerate() {
            jacobian[(i, 0)] = pair.cosine;
            for (j, [rho, cxy, cz, rate, n]) in lobes.iter().enumerate().take((N - 1) / 3) {
                let base = cxy * pair.tangential + cz * pair.upright;
                if base > 0.0 {
                    let log = n * base.ln();
                    let power = log.exp() * pair.cosine;
                    let turning = cz * pair.tangential - cxy * pair.upright;
                    jacobian[(i, 1 + 3 * j)] = power;
                    jacobian[(i, 2 + 3 * j)] = rho * n * power / base * turning * rate;
                    jacobian[(i, 3 + 3 * j)] = rho * power * log;
                }
            }
        }
        Some(jacobian)
    }
}
