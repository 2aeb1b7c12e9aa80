//! Levenberg-Marquardt for many small problems; knows nothing of light.
//!
//! One search ([`Reason`] lists its endings) is written once for every kind of number. On plain
//! numbers it is [`minimise`]; on vector registers it is [`fit`], which takes one problem per lane
//! and gives a lane the next problem as soon as it has finished the last. A lane is a closed
//! computation: what becomes of a problem depends neither on its neighbours nor on the width of
//! the registers, by not one bit.
//!
//! A step is `(H + damping diag H) s = J' r` with Nielsen's damping, solved by Cholesky's method
//! scaled to unit diagonal, with a relative floor under its pivots, within bounds. Every test is
//! relative: scaling data or a parameter by a power of two changes no bit of the path, as long as
//! the squares of residuals and of derivatives are numbers of the kind in use.
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
//! Many such decays, side by side in registers:
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
mod normal;
mod options;
mod outcome;
mod polish;
mod search;

pub use batch::{Batch, Column, Occupancy, Rows, fit};
pub use cholesky::{Factor, factor};
pub use minimise::{Problem, minimise};
pub use normal::{Normal, ROWS};
pub use options::{Bounds, Options};
pub use outcome::{Outcome, Reason};
pub use polish::fit_polished;

#[cfg(test)]
mod tests;
