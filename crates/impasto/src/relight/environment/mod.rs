//! Environment light: distant light from all directions, as three channels of radiance.
//!
//! Each channel is one of the scene's colours, so that
//!
//! ```text
//! light = sum over channels j of  matrix_j coefficients E_j(N) + interface_j (sum over lobes of Y_j(N, V))
//! ```
//!
//! and radiance is relative: an environment of radiance 1 / pi in all directions shows a white board
//! that faces the viewer as white, as a lamp of intensity 1 does. Whatever the model, an integral over
//! all directions becomes a lookup: [`irradiance`] for the diffuse part, [`torrance_sparrow`] and
//! [`lafortune`] for lobes. [`map`] holds the directions, [`table`] is what is looked up, [`stage`] lights
//! a block of pixels, [`tables`] is what it looks up.

mod irradiance;
mod lafortune;
mod light;
mod map;
mod scalar;
pub(crate) mod stage;
mod table;
mod tables;
#[cfg(test)]
mod tests;
mod torrance_sparrow;

pub use light::{Environment, LOBES_VERSION};
pub use map::{Map, Rotation};
pub use scalar::Scheme;
pub use stage::Sky;
pub use table::Nodes;
pub use tables::Tables;
pub use torrance_sparrow::Widths;
