//! Reflection models: value and derivatives, written once for every kind of number.
//!
//! A model knows directions and parameters; it knows no image, no solver and no thread. All values
//! are radiance relative to a white board under unit irradiance (`docs/models`).

pub mod coated_diffuse;
pub mod cosine_lobe;
pub mod lafortune;
pub mod lambert;
pub mod torrance_sparrow;
