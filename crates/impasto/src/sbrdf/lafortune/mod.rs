//! Lafortune lobes for every pixel, as Snel, Heuberger, Pasman and Jansen fit them: three passes.
//!
//! 1. [`normal`]: a cosine lobe and a diffuse term about a free normal, on the luminance (the mean
//!    of the bands);
//! 2. [`sequence`]: with that normal, lobes on the luminance, one more at a time as long as the
//!    Bayesian information criterion falls. A cosine lobe leans with lobes that lean: normal and
//!    lobes are then searched for together ([`turned`]) and, where the normal was wrong or samples
//!    are gross [`outliers`], lobes added anew ([`settle`]);
//! 3. colours: with those shapes, what enters linearly, band by band, by non-negative least
//!    squares.
//!
//! How far what they found can be [`trust`]ed is told last, from the slopes of all unknowns at once.
//!
//! All passes compare radiance, `(N.L) f`: samples are never divided by a cosine that the fit is
//! still to find. Under one view alone, normal and lobe axes cannot be told apart (hard cases 17
//! and 18): the normal is then given and lobes are Phong's.

mod aside;
mod colours;
mod fit;
mod found;
mod lobes;
mod luminance;
mod maps;
mod normal;
mod outliers;
mod scratch;
mod seen;
mod sequence;
mod settle;
mod trust;
mod turned;

pub use fit::{LafortuneOptions, fit_lafortune};
pub use found::{Found, MOST_LOBES};
pub use luminance::Luminance;
pub use maps::LafortuneMaps;
pub use normal::{Facing, fit_normal};
pub use sequence::Sequence;

#[cfg(test)]
mod tests;
