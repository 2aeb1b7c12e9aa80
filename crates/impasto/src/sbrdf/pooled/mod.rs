//! One Torrance-Sparrow lobe for the whole painting, as in both papers [@tominaga2008rgb;
//! @tominaga2008six], with the normals and colours that go with it.

mod extract;

pub mod histogram;
mod irls;
mod joint;
mod learn;
mod measure;
mod outliers;
mod passes;
mod pixel;
mod samples;
mod scale;
mod subset;
#[cfg(test)]
mod tests;
mod verdict;

pub use extract::Extraction;
pub use learn::{Pooled, PooledOptions, fit_pooled};
pub(in crate::sbrdf) use pixel::tangents;
pub use verdict::Verdict;
