//! From camera bands to spectral reflectance: an [`Estimator`] is built once and applied to every pixel.
//!
//! Every estimator has the same form, [`Features`] of the band responses followed by one matrix:
//!
//! | [`Kind`] | features | matrix |
//! |---|---|---|
//! | Wiener | the responses | Wiener estimation, eq. 5 of [@tominaga-six-band-adaptation] ([`linear`]) |
//! | linear model | the responses | eq. 4-7 of [@tominaga-rgb-camera] ([`linear`]) |
//! | root-polynomial | responses, roots of products of two | ridge regression ([`root_polynomial`]) |
//! | radial basis | responses, Gaussians of their direction | ridge regression ([`radial_basis`]) |
//! | ensemble | those of the last two | the mean of the last two ([`ensemble`]) |
//!
//! All are homogeneous of degree one: twice the light, twice the reflectance. A response carries
//! the unknown scale of shading, and an estimator that is not homogeneous changes the hue with it.
//!
//! The matrix is split into coefficients and an orthonormal basis ([`factor`]), so that a pixel
//! holds a few numbers and not a spectrum. Building is done once, in `f64`; applying ([`apply`])
//! in `f32` lanes over planes. A pixel whose bands are not all finite is estimated from those that
//! are, with an operator made for just these bands and the same basis.

pub mod apply;
mod diagnostics;
pub mod ensemble;
mod estimator;
pub mod factor;
pub mod features;
mod fitted_map;
pub mod linear;
mod operator;
mod problem;
pub mod radial_basis;
mod random;
mod ridge;
pub mod root_polynomial;
mod svd;

pub use diagnostics::Diagnostics;
pub use estimator::{Estimator, Kind};
pub use factor::Factorisation;
pub use features::Features;
pub use fitted_map::FittedMap;
pub use operator::Operator;
pub use problem::SpectralProblem;
