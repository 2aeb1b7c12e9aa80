//! Numbers, lanes, elementary functions and vectors.

pub mod elementary;
pub mod lanes;
pub mod real;
pub mod vec3;

pub use lanes::{Isa, Kernel, Level};
pub use real::{Mask, Real, Scalar};
pub use vec3::Vec3;
