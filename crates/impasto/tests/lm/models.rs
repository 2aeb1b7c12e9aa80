//! Hard cases of lobes on the engine; their numbers and names are those of `docs/numerics.md`.
//!
//! A bad problem stands among good ones: what comes out of it is finite, and the others have the
//! bits that they have without it.

use impasto::brdf::lafortune::{Lobe, Pair};
use impasto::brdf::torrance_sparrow::{Facet, sharpness};
use impasto::lm::{Batch, Bounds, Column, Normal, Options, Outcome, Rows, fit};
use impasto::math::elementary::exp;
use impasto::math::{Level, Real, Vec3};

use super::batch::{bits, same};

/// Numbers that look random and never change.
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (high - low).mul_add((self.0 >> 11) as f64 / (1_u64 << 53) as f64, low)
    }
}

fn unit(x: f64, y: f64, z: f64) -> Vec3<f64> {
    Vec3::new(x, y, z).normalised()
}

/// Fits the problems at every level, with and without number `bad`; returns all outcomes.
fn beside<B: Batch<f32, N>, const N: usize>(
    count: usize,
    bad: usize,
    bounds: &Bounds<f32, N>,
    batch: impl Fn() -> B,
    found: impl Fn(B) -> Vec<Option<Outcome<f32, N>>>,
) -> Vec<Outcome<f32, N>> {
    let run = |level: Level, problems: Vec<usize>| {
        let mut batch = batch();
        fit(level, &mut batch, problems, bounds, &Options::single());
        found(batch)
    };
    let whole = run(Level::detect(), (0..count).collect());
    for level in Level::ALL.into_iter().filter(|level| level.available()) {
        same(&bits(&run(level, (0..count).collect())), &bits(&whole), level.name());
        let mut others = whole.clone();
        others[bad] = None;
        let without = run(level, (0..count).filter(|&problem| problem != bad).collect());
        same(&bits(&without), &bits(&others), "without the bad one");
    }
    let whole: Vec<_> = whole.into_iter().map(|o| o.expect("every problem is stored")).collect();
    for outcome in &whole {
        assert!(outcome.normal.cost.is_finite());
        assert!(outcome.parameters.iter().all(|p| p.is_finite()), "{:?}", outcome.parameters);
        assert!(outcome.normal.matrix.iter().flatten().all(|entry| entry.is_finite()));
    }
    whole
}

/// One Lafortune lobe each through bases and samples of its own.
struct Gloss<'a> {
    /// `upright`, `tangential` and the sample, observation by observation.
    problems: &'a [Vec<[f32; 3]>],
    start: [f32; 3],
    found: Vec<Option<Outcome<f32, 3>>>,
}

impl Batch<f32, 3> for Gloss<'_> {
    fn rows(&self) -> usize {
        3 * OBSERVATIONS
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 3] {
        column.fill(self.problems[problem].iter().flatten().copied());
        self.start
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; 3]) -> Normal<R, 3> {
        let lobe = Lobe::new(at[0], at[1], at[2]);
        let mut normal = Normal::zero();
        for i in 0..OBSERVATIONS {
            let (upright, tangential) = (rows.get(3 * i), rows.get(3 * i + 1));
            let slope = lobe.gradient(&Pair { upright, tangential, cosine: R::one() });
            let slopes = [slope.amplitude, slope.turn, slope.log_exponent];
            normal.add(slopes, rows.get(3 * i + 2) - slope.value);
        }
        normal
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 3>) {
        self.found[problem] = Some(*outcome);
    }
}

const OBSERVATIONS: usize = 20;
const GLOSSY: usize = 37;
const BAD: usize = 18;
/// Strength, turn, ln n.
const GLOSS_BOUNDS: Bounds<f32, 3> = Bounds { lower: [0.0, -0.5, -3.0], upper: [1e6, 0.5, 10.0] };

/// Good problems, and the bad one as given.
fn gloss(bad: impl Fn(usize) -> [f32; 3]) -> Vec<Vec<[f32; 3]>> {
    let mut random = Random(3);
    let mut problems: Vec<Vec<[f32; 3]>> = (0..GLOSSY)
        .map(|_| {
            let n = random.between(5.0, 60.0);
            (0..OBSERVATIONS)
                .map(|_| {
                    let upright = random.between(0.3, 0.9);
                    let tangential = upright - random.between(0.7, 1.0);
                    let sample = 0.4 * (upright - tangential).powf(n) + random.between(-0.01, 0.01);
                    [upright, tangential, sample].map(|v| v as f32)
                })
                .collect()
        })
        .collect();
    problems[BAD] = (0..OBSERVATIONS).map(bad).collect();
    problems
}

fn fit_gloss(problems: &[Vec<[f32; 3]>], start: [f32; 3]) -> Outcome<f32, 3> {
    let batch = || Gloss { problems, start, found: vec![None; GLOSSY] };
    beside(GLOSSY, BAD, &GLOSS_BOUNDS, batch, |batch| batch.found)[BAD]
}

#[test]
fn hard_case_9_base_of_a_lobe_at_or_below_0() {
    // At most 0 for every turn within the bounds, and 0 to the bit.
    for bad in [[0.3, 0.8, 0.2], [0.0, 0.0, 0.2], [-0.0, 0.0, 0.2], [-0.5, 0.5, 0.2]] {
        let outcome = fit_gloss(&gloss(|_| bad), [0.3, 0.0, 2.0]);
        // A dark lobe explains nothing and nothing depends on it: what is left is the samples.
        assert_eq!(outcome.deficient(), [true; 3]);
        assert_eq!(outcome.parameters, [0.3, 0.0, 2.0]);
        assert!((outcome.normal.cost / (OBSERVATIONS as f32 * 0.04) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn hard_case_10_tiny_base_exponent_below_1() {
    // d^(n - 1) is up to 1e38 here.
    for size in [1e-38_f32, 1e-30, 1e-12, 1e-9, 1e-6] {
        let problems = gloss(|i| [size * (1 + i) as f32, 0.0, 0.2]);
        for log_exponent in [-3.0, -1.0] {
            let outcome = fit_gloss(&problems, [0.3, 0.1, log_exponent]);
            assert!(outcome.normal.cost <= OBSERVATIONS as f32 * 0.04 * (1.0 + 1e-6));
        }
    }
}

/// A normal, a diffuse part and a Torrance-Sparrow lobe from lights and views of its own.
struct Kinked<'a> {
    facets: &'a [(Vec3<f64>, Facet<f64>)],
    samples: &'a [Vec<f32>],
    found: Vec<Option<Outcome<f32, 5>>>,
}

/// `(x, y, 1)` normalised, and its derivatives by x and y.
#[inline(always)]
fn leaning<R: Real>(x: R, y: R) -> (Vec3<R>, [Vec3<R>; 2]) {
    let long = Vec3::new(x, y, R::one());
    let scale = long.length().recip();
    let normal = long.scale(scale);
    let tangent = |axis: Vec3<R>, along: R| (axis - normal.scale(along)).scale(scale);
    let (o, one) = (R::zero(), R::one());
    (normal, [tangent(Vec3::new(one, o, o), normal.x), tangent(Vec3::new(o, one, o), normal.y)])
}

impl Kinked<'_> {
    /// Slopes by two tilts, the diffuse part, beta and ln k; and the value.
    #[inline(always)]
    fn look<R: Real>(&self, i: usize, at: [R; 5]) -> ([R; 5], R) {
        let (light, facet) = (self.facets[i].0.splat::<R>(), self.facets[i].1.splat::<R>());
        let (normal, tangents) = leaning(at[0], at[1]);
        let k = exp(at[4]);
        let cosine = normal.dot(light).max(R::zero());
        let lit = R::keep(cosine.gt(R::zero()), at[2]);
        let gradient = facet.gradient(normal, at[3], k);
        let tilt = |t: Vec3<R>| t.dot(gradient.normal) + lit * t.dot(light);
        let slopes =
            [tilt(tangents[0]), tilt(tangents[1]), cosine, gradient.beta, gradient.log_sharpness];
        (slopes, at[2].mul_add(cosine, facet.on(normal).value(at[3], k)))
    }
}

impl Batch<f32, 5> for Kinked<'_> {
    fn rows(&self) -> usize {
        self.facets.len()
    }
    fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 5] {
        column.fill(self.samples[problem].iter().copied());
        [0.0, 0.0, 0.5, 10.0, sharpness(0.4_f32).ln()]
    }
    #[inline(always)]
    fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, at: [R; 5]) -> Normal<R, 5> {
        let mut normal = Normal::zero();
        for i in 0..self.facets.len() {
            let (slopes, value) = self.look(i, at);
            normal.add(slopes, rows.get(i) - value);
        }
        normal
    }
    fn store(&mut self, problem: usize, outcome: &Outcome<f32, 5>) {
        self.found[problem] = Some(*outcome);
    }
}

#[test]
fn hard_case_25_kink_of_the_masking_factor() {
    // Seen from above, G has its kink where N.L = 1/2: 24 lights at 60 degrees put a flat normal
    // on 24 kinks at once, and every search starts there. 16 lights higher up, towards the zenith,
    // tell diffuse from gloss and width from strength.
    let mut facets = Vec::new();
    for i in 0..40 {
        let (turn, slant) = (f64::from(i) * 2.4, f64::from(i.max(23) - 23).mul_add(-3.0, 60.0));
        let slant = slant.to_radians();
        let light = unit(slant.sin() * turn.cos(), slant.sin() * turn.sin(), slant.cos());
        facets.push((light, Facet::between(light, unit(0.0, 0.0, 1.0), 1.45)));
    }
    let mut random = Random(11);
    let mut truths = Vec::new();
    let mut samples = Vec::new();
    for problem in 0..300 {
        // A third is flat, its optimum on the kinks themselves.
        let lean = [0.0, 0.02, 0.2][problem % 3];
        let truth = [
            random.between(-lean, lean),
            random.between(-lean, lean),
            random.between(0.2, 0.7),
            random.between(8.0, 20.0),
            sharpness(random.between(0.35, 0.6)).ln(),
        ];
        let exact = Kinked { facets: &facets, samples: &[], found: Vec::new() };
        let shown = |i| exact.look::<f64>(i, truth).1 + random.between(-0.005, 0.005);
        samples.push((0..facets.len()).map(shown).map(|v| v as f32).collect::<Vec<_>>());
        truths.push(truth);
    }
    let bounds = Bounds {
        lower: [-6.0, -6.0, 0.0, 0.0, sharpness(1.25_f32).ln()],
        upper: [6.0, 6.0, 1e6, 1e6, sharpness(5e-4_f32).ln()],
    };
    // One that is no surface at all stands among them.
    samples[BAD] = (0..facets.len()).map(|i| [0.0, 3.0][i % 2]).collect();
    let batch = || Kinked { facets: &facets, samples: &samples, found: vec![None; 300] };
    let found = beside(300, BAD, &bounds, batch, |batch| batch.found);
    for (problem, (outcome, truth)) in found.iter().zip(&truths).enumerate() {
        assert!(outcome.reason.converged(), "{problem}: {:?}", outcome.reason);
        assert!(outcome.iterations <= 60, "{problem}: {} steps", outcome.iterations);
        if problem == BAD {
            continue;
        }
        // No search ends above what the truth leaves of the noise.
        let at = truth.map(|v| v as f32);
        let left: f32 = (0..facets.len())
            .map(|i| samples[problem][i] - batch().look::<f32>(i, at).1)
            .map(|residual| residual * residual)
            .sum();
        assert!(outcome.normal.cost <= left, "{problem}: {} {left}", outcome.normal.cost);
    }
}
