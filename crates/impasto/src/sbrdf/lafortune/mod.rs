//! Lafortune lobes [@lafortune1997nonlinear] for every pixel, in the three passes of Snel, Heuberger,
//! Pasman and Jansen [@snel].
//!
//! 1. `normal`: a cosine lobe and a diffuse term about a free normal, on the luminance (the mean
//!    of the bands). A `consensus` over disjoint subsets of the photographs rejects outliers;
//! 2. `forward_selection`: with that normal, lobes on the luminance, one more at a time as long as
//!    the Bayesian information criterion falls. A lobe that leans makes the cosine lobe lean with
//!    it: a `joint` search then frees normal and lobes together. Where the normal was wrong or
//!    samples are `outliers`, lobes are selected anew (`refine`);
//! 3. `colours`: with those shapes, diffuse part and strengths are linear: non-negative least
//!    squares, band by band.
//!
//! The `covariance` of all unknowns is computed last, from their derivatives at the minimum.
//!
//! All passes compare radiance, `(N.L) f`: samples are never divided by a cosine that is still
//! unknown. Under one view alone, normal and lobe axes cannot be separated (hard cases 17 and 18):
//! the normal is then given and lobes are Phong's.

mod colours;
mod consensus;
mod covariance;
mod estimate;
mod fit;
mod forward_selection;
mod joint;
mod lobes;
mod luminance;
mod maps;
mod normal;
mod outliers;
mod refine;
mod scratch;
mod seen;

pub use estimate::{LafortuneEstimate, MOST_LOBES};
pub use fit::{LafortuneOptions, fit_lafortune};
pub use forward_selection::LafortuneSelection;
pub use luminance::Luminance;
pub use maps::LafortuneMapsMut;
pub use normal::{NormalEstimate, fit_normal};

#[cfg(test)]
mod tests;
