//! Levenberg-Marquardt [@levenberg1944; @marquardt1963] for many small least-squares problems.
//!
//! It knows nothing of light or images: it fits a parabola or an exponential decay as well as a
//! reflectance lobe. The crate's feature `lm` alone builds this module and [`math`](crate::math)
//! without any dependency.
//!
//! | to fit | implement | call | see |
//! |---|---|---|---|
//! | one problem | [`Problem`] | [`minimise`] | [a decay](#one-problem), [a lobe](#a-reflectance-lobe-of-your-own) |
//! | many of one kind | [`Batch`] | [`fit`] | [many decays](#many-problems-side-by-side) |
//! | many, doubtful ones again in `f64` | [`Batch`] for `f32` and `f64` | [`fit_polished`] | |
//!
//! A model enters as its [`Normal`] equations: for each sample, the derivatives of the model by its
//! parameters and the residual `y - f`, summed by [`Normal::add`]. An [`Outcome`] holds the
//! parameters, why the search ended ([`Reason`]), and the covariance.
//!
//! The search is written once for every kind of number: [`minimise`] runs it on plain numbers,
//! [`fit`] on vector registers, one problem per lane. A lane that has finished takes the next
//! problem. A lane is a closed computation: neither its neighbours nor the width of the registers
//! change a problem's result by one bit.
//!
//! A step is `(H + damping diag H) s = J' r` with Nielsen's damping [@nielsen1999damping], solved by
//! Cholesky's method scaled to unit diagonal, with a relative floor under its pivots, within bounds. Every test is
//! relative: scaling data or a parameter by a power of two changes no bit of the path, as long as
//! the squares of residuals and of derivatives are numbers of the kind in use.
//!
//! # One problem
//!
//! An exponential decay `a exp(-b t)` through four points:
//!
//! ```
//! use impasto::lm::{Bounds, Normal, Options, Problem, minimise};
//!
//! struct Decay([(f64, f64); 4]);
//! impl Problem<f64, 2> for Decay {
//!     fn normal(&self, [a, b]: [f64; 2]) -> Normal<f64, 2> {
//!         let mut normal = Normal::zero();
//!         for (t, y) in self.0 {
//!             let decay = (-b * t).exp();
//!             normal.add([decay, -t * a * decay], y - a * decay);
//!         }
//!         normal
//!     }
//! }
//!
//! let points = [0.0, 1.0, 2.0, 3.0].map(|t: f64| (t, 5.0 * (-0.7 * t).exp()));
//! let outcome = minimise(&Decay(points), [1.0, 0.1], &Bounds::none(), &Options::default());
//! assert!(outcome.reason.converged());
//! assert!((outcome.parameters[0] - 5.0).abs() < 1e-6 && (outcome.parameters[1] - 0.7).abs() < 1e-6);
//! ```
//!
//! # A reflectance lobe of your own
//!
//! Samples of a glossy surface, `y = (N.L) (d + s D(N.H))`, with the facet distribution of GGX
//! [@walter2007microfacet], `D = t / (pi q^2)`, `q = (N.H)^2 (t - 1) + 1`, `t` the squared roughness.
//! The unknowns are `d`, `s` and `u = ln t`: a logarithm keeps `t` positive, and one step means the
//! same for sharp and for broad lobes. Write down the value and its three derivatives:
//!
//! ```
//! use impasto::lm::{Bounds, Normal, Options, Problem, minimise};
//!
//! /// Cosines `[N.L, N.H]` and the sample.
//! struct Ggx(Vec<([f64; 2], f64)>);
//!
//! /// The model and its derivatives by `[d, s, u]`.
//! fn ggx([nl, nh]: [f64; 2], [d, s, u]: [f64; 3]) -> (f64, [f64; 3]) {
//!     let t = u.exp();
//!     let q = nh * nh * (t - 1.0) + 1.0;
//!     let facets = t / (std::f64::consts::PI * q * q);
//!     let by_u = facets * (1.0 - 2.0 * t * nh * nh / q);
//!     (nl * (d + s * facets), [nl, nl * facets, nl * s * by_u])
//! }
//!
//! impl Problem<f64, 3> for Ggx {
//!     fn normal(&self, at: [f64; 3]) -> Normal<f64, 3> {
//!         let mut normal = Normal::zero();
//!         for &(cosines, sample) in &self.0 {
//!             let (value, slope) = ggx(cosines, at);
//!             normal.add(slope, sample - value);
//!         }
//!         normal
//!     }
//! }
//!
//! // 40 photographs of a surface of roughness 0.2.
//! let truth = [0.3, 0.05, 0.04_f64.ln()];
//! let samples = (0..40).map(|i| {
//!     let tilt = 0.02 * f64::from(i);
//!     let cosines = [(0.6 + tilt).cos(), tilt.cos()];
//!     (cosines, ggx(cosines, truth).0)
//! });
//! let problem = Ggx(samples.collect());
//!
//! // Test derivatives before the first fit: `descent` is minus half the slope of the cost.
//! let at = [0.2, 0.1, -2.0];
//! for i in 0..3 {
//!     let cost = |step: f64| {
//!         let mut near = at;
//!         near[i] += step;
//!         problem.normal(near).cost
//!     };
//!     let slope = (cost(1e-5) - cost(-1e-5)) / 2e-5;
//!     assert!((problem.normal(at).descent[i] / (-0.5 * slope) - 1.0).abs() < 1e-6);
//! }
//!
//! // No negative reflectance; roughness from 0.01 to 1.
//! let bounds = Bounds { lower: [0.0, 0.0, -9.2], upper: [f64::MAX, f64::MAX, 0.0] };
//! let outcome = minimise(&problem, [0.1, 0.1, -1.0], &bounds, &Options::default());
//! assert!(outcome.reason.converged());
//! for (found, truth) in outcome.parameters.iter().zip(truth) {
//!     assert!((found / truth - 1.0).abs() < 1e-6);
//! }
//! // Standard deviations, for samples with noise of 0.001.
//! let deviations = outcome.covariance(1e-6);
//! assert!(deviations[2][2].sqrt() < 0.1);
//! ```
//!
//! With noise, outliers or several lobes, start from more than one place and keep the smallest
//! `outcome.normal.cost`; [`Outcome::deficient`] names parameters that the samples do not determine.
//! For every pixel of a picture, write the model generic over [`Real`](crate::math::Real) and
//! implement [`Batch`].
//!
//! # Many problems, side by side
//!
//! The same decays in vector registers, one problem per lane:
//!
//! ```
//! use impasto::lm::{Batch, Bounds, Column, Normal, Options, Outcome, Rows, fit};
//! use impasto::math::{Level, Real, elementary::exp};
//!
//! const TIMES: [f64; 8] = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5];
//!
//! struct Decays {
//!     samples: Vec<[f32; 8]>,
//!     rates: Vec<f32>,
//! }
//!
//! impl Batch<f32, 2> for Decays {
//!     fn rows(&self) -> usize {
//!         TIMES.len()
//!     }
//!     // A lane takes a problem: its numbers go to a column, the start is returned.
//!     fn load(&mut self, problem: usize, column: &mut Column<'_, f32>) -> [f32; 2] {
//!         column.fill(self.samples[problem]);
//!         [self.samples[problem][0], 1.0]
//!     }
//!     // Residuals, derivatives and their products in one pass, all lanes at once.
//!     #[inline(always)]
//!     fn normal<R: Real<Scalar = f32>>(&self, rows: Rows<'_, R>, [a, b]: [R; 2]) -> Normal<R, 2> {
//!         let mut normal = Normal::zero();
//!         for (i, &t) in TIMES.iter().enumerate() {
//!             let decay = exp(-(b * R::of(t)));
//!             normal.add([decay, -(R::of(t) * a * decay)], rows.get(i) - a * decay);
//!         }
//!         normal
//!     }
//!     fn store(&mut self, problem: usize, outcome: &Outcome<f32, 2>) {
//!         self.rates[problem] = outcome.parameters[1];
//!     }
//! }
//!
//! let truth: Vec<f32> = (0..1000).map(|i| 0.2 + 0.001 * i as f32).collect();
//! let samples = truth.iter().map(|b| TIMES.map(|t| 5.0 * (-b * t as f32).exp())).collect();
//! let mut decays = Decays { samples, rates: vec![0.0; 1000] };
//! let bounds = Bounds { lower: [0.0, 0.0], upper: [1e6, 50.0] };
//! fit(Level::detect(), &mut decays, 0..1000, &bounds, &Options::single());
//! for (rate, truth) in decays.rates.iter().zip(&truth) {
//!     assert!((rate / truth - 1.0).abs() < 1e-4);
//! }
//! ```

mod batch;
mod cholesky;
mod ending;
mod minimise;
pub mod nnls;
mod normal;
mod options;
mod outcome;
mod polish;
mod search;

pub use batch::{Batch, Column, Columns, Occupancy, Rows, fit};
pub use cholesky::{Factor, factor};
pub use minimise::{Problem, minimise};
pub use normal::{Normal, ROWS};
pub use options::{Bounds, Options};
pub use outcome::{Outcome, Reason};
pub use polish::fit_polished;

#[cfg(test)]
mod tests;
