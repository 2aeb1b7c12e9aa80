//! Sandwich covariance [@huber1967sandwich; @white1980] of the painting's lobe.

use crate::lm;

use super::pixel::CommonLobe;

/// From (beta, log k) to (log beta, log gamma): d log gamma = -1/2 d log k.
pub(super) fn relative(lobe: CommonLobe, covariance: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let scale = [1.0 / lobe.beta, -0.5];
    core::array::from_fn(|i| core::array::from_fn(|j| covariance[i][j] * scale[i] * scale[j]))
}

/// Covariance of parameters that minimise a sum over pixels, from the scatter of the pixels'
/// gradients: noise that differs from pixel to pixel, and pixels that the model does not describe,
/// count for what they are.
pub(super) fn sandwich(
    factor: &lm::Factor<f64, 2>,
    scatter: &[[f64; 2]; 2],
    curvature: f64,
) -> [[f64; 2]; 2] {
    let half: [[f64; 2]; 2] = core::array::from_fn(|j| {
        factor.solve(&core::array::from_fn(|i| scatter[i.max(j)][i.min(j)]))
    });
    let full: [[f64; 2]; 2] = core::array::from_fn(|i| factor.solve(&[half[0][i], half[1][i]]));
    let shrink = 1.0 / (curvature * curvature);
    full.map(|row| row.map(|v| v * shrink))
}
