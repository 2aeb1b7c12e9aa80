//! One Torrance-Sparrow lobe for the whole painting, as in both papers [@tominaga-rgb-camera;
//! @tominaga-six-band-adaptation], with the normals and colours that go with it.
//!
//! [`learn`] estimates from the whole painting, or from a sample of it:
//!
//! 1. the separate fit of the papers: (beta, gamma) from the specular part of all samples against phi
//!    ([`histogram`]);
//! 2. the joint fit (`joint`): (beta, gamma) by Levenberg-Marquardt on random subsets of the pixels
//!    (`subset`), each larger than the last (`progressive_sampling`), while every pixel's normal and
//!    colours follow by iteratively reweighted least squares (`irls`) on a robust scale (`scale`);
//! 3. whether the lobe improves on the diffuse part alone, for all pixels together, and the noise by
//!    class of brightness, with which a pixel's own strength is compared with the painting's
//!    (`verdict`).
//!
//! [`apply`] fits the normals and colours of any tile under what was learned; a pixel's result depends
//! on its own samples, its place and the learned lobe only, so that tiles have the bits of the whole.
//! Bright reference, histogram, subset, verdict and share of pixels that agree are those of the pixels
//! that [`learn`] was given. The decisions of step 3 need every given pixel under the lobe, which is
//! most of what [`apply`] does: [`fit`] does both at once for a painting that is at hand.

mod apply;
mod covariance;
mod descent;
mod extract;
pub mod histogram;
mod irls;
mod joint;
mod learn;
mod learned;
mod lobe_equations;
mod maps;
mod measure;
mod normal_covariance;
mod outliers;
mod passes;
mod pixel;
mod progressive_sampling;
mod samples;
mod scale;
mod subset;
#[cfg(test)]
mod tests;
mod verdict;

pub use apply::apply;
pub use extract::Extraction;
pub use learn::{PooledOptions, fit, learn};
pub use learned::{LearnedLobe, PooledLobe};
pub use maps::PooledMapsMut;
pub(in crate::sbrdf) use pixel::tangents;
pub use verdict::Verdict;
