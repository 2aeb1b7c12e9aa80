//! Every pixel's own lobes, with a normal of its own:
//!
//! ```text
//! y = E (rho_b (N.L) t + sum over lobes of  s_b lobe(N, L, V; shape)) + ambient_b
//! ```
//!
//! `t` is what a smooth interface above the diffuse part transmits
//! ([`coated_diffuse`](crate::brdf::coated_diffuse)), 1 without one.
//! A lobe of a [`model`] has a shape and, in every band, a strength: neutral varnish and tinted
//! gold are the same model. Shapes and normal are searched for ([`search`], or step by step while
//! weights are renewed: [`fused`]), everything that
//! enters linearly follows from them in closed form ([`nnls`](crate::lm::nnls)): the search has two unknowns for
//! the normal and a few per lobe, however many bands there are. [`learn_lobes`] finds
//! what the fit needs to know about the whole painting, [`apply_lobes`] fits the pixels of a tile;
//! [`fit_lobes`] is both.
//!
//! All of this is generic over a [`LobeEstimation`], which the caller chooses. Torrance-Sparrow is the
//! only one: Lafortune lobes have three unknowns, and [a fit of their own](crate::sbrdf::lafortune).

mod apply;
mod bounds;
mod brightest;
mod forward_selection;
mod fused;
mod jackknife;
mod learn;
mod maps;
mod model;
mod neutral;
mod normal_equations;
mod options;
mod photographs;
mod prior;
mod residuals;
mod reweight;
mod score;
mod search;
mod seeds;
mod support;
#[cfg(test)]
pub(in crate::sbrdf) mod tests;
mod tile;
mod tile_fit;
mod torrance_sparrow;
mod weights;

pub use apply::{apply_lobes, fit_lobes};
pub use learn::{LearnedLobes, TYPICAL_PIXELS, learn_lobes};
pub use maps::{LobeMapsMut, MOST_LOBES};
pub use model::{LobeEstimation, MAX_SHAPES, Slope, Visit};
pub use options::{LobeOptions, Origin, Precision};
pub use prior::PriorNumbers;
pub use seeds::HALO;
pub(super) use support::SEEN;
