//! Numbers that describe how well a reflectance estimator is posed.

/// How well the bands determine the spectrum, and what the estimator does about it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Diagnostics {
    /// Condition number of `H R H^T`.
    pub condition: f64,
    /// `sum s^2 / (s^2 + noise^2)` over the singular values of the whitened bands: how many
    /// independent numbers the bands deliver above the noise.
    pub effective_rank: f64,
    /// Root mean square over wavelengths of the estimate's change per unit of white noise.
    pub noise_gain: f64,
    /// Root mean square error over the training spectra and wavelengths, noise included.
    pub training_rmse: f64,
    /// By how much the dropped coefficients raise the training error.
    pub truncation: f64,
    /// Chosen ridge weight, 0 where there is none.
    pub ridge: f64,
    /// Chosen width parameter of the Gaussians, 0 where there are none.
    pub gamma: f64,
}
