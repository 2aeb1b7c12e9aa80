//! Numbers, lanes, elementary functions and vectors.

pub mod elementary;
pub mod lanes;
pub mod real;
#[cfg(feature = "painting")]
pub mod tail;
pub mod two;
pub mod vec3;

pub use lanes::{Element, Isa, Kernel, Level};
pub use real::{Mask, Real, Scalar};
pub use two::Two;
pub use vec3::Vec3;
