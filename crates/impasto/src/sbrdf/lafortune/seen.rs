//! Which lobes the photographs show at their peak, and which are extrapolated.
//!
//! A lobe that leans is strongest under light and view that no photograph may have had; a sharp one
//! beside an odd sample fits it with its outermost slope. From elsewhere either may be as bright as
//! anything: what a photograph shows bounds what any light and any view may.

use crate::brdf::lafortune::{Lobe, Pair, log_peak};
use crate::math::Vec3;
use crate::sbrdf::lobes::SEEN;

use super::estimate::LafortuneEstimate;
use super::luminance::Luminance;

/// The first of a pixel's lobes that no photograph shows at [`SEEN`] of the most light that it
/// reflects anywhere.
pub(super) fn unseen(
    data: &Luminance<'_>,
    pixel: usize,
    found: &LafortuneEstimate,
) -> Option<usize> {
    let [x, y, z] = data.normals[pixel].map(f64::from);
    let [across, up] = data.places[pixel].map(f64::from);
    let samples = data.samples[pixel..].iter().step_by(data.stride).take(data.photographs());
    let pairs = || {
        let counted = samples.clone().enumerate().filter(|(_, sample)| sample.is_finite());
        counted.map(|(photograph, _)| {
            let (light, _) = data.rig.lights()[photograph].at(across, up);
            let view = data.rig.views()[photograph].at(across, up);
            Pair::against(Vec3::new(x, y, z), light, view, light.dot(view))
        })
    };
    (0..found.lobes).find(|&number| {
        let [_, turning, log_exponent] = found.lobe(number);
        let turn = turning / log_exponent.exp();
        let lobe = Lobe::new(1.0, turn, log_exponent);
        let enough = SEEN * log_peak(turn, log_exponent).exp();
        !pairs().any(|pair| pair.cosine * lobe.value(&pair) >= enough)
    })
}
