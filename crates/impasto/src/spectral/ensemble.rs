//! The mean of the root-polynomial and the radial-basis estimate: the basic ensemble method
//! [@perrone1993disagree].
//!
//! The two regressions err differently: the roots of products extrapolate to surfaces that no training
//! spectrum resembles, the Gaussians follow the training spectra where there are many. The squared
//! error of a mean is the mean of the squared errors less the variance between the estimates.

use nalgebra::DMatrix;

use super::features::Features;
use super::fitted_map::FittedMap;
use super::problem::SpectralProblem;
use super::{radial_basis, root_polynomial};
use crate::error::{Error, Result};

/// Fits both regressions; the sums of the root-polynomial come too, for pixels with missing bands.
///
/// # Errors
/// If the training set is too small for either.
pub fn fit(
    problem: &SpectralProblem,
    seed: u64,
) -> Result<(FittedMap, root_polynomial::Regression)> {
    let (polynomial, regression) = root_polynomial::fit(problem, seed)?;
    let radial = radial_basis::fit(problem, seed)?;
    let Features::RadialBasis(centres) = radial.features else {
        return Err(Error::argument("estimator", "a radial basis without centres"));
    };
    let features = Features::Ensemble(centres);
    let (rows, first) = (polynomial.map.nrows(), polynomial.map.ncols());
    let mut map = DMatrix::zeros(rows, features.count());
    map.columns_mut(0, first).copy_from(&(polynomial.map * 0.5));
    map.columns_mut(first, radial.map.ncols()).copy_from(&(radial.map * 0.5));
    // Beside their lengths and Gaussians these samples hold the noisy responses.
    let responses = radial.samples.columns(1, problem.bands()).into_owned();
    let samples = features.of_rows(&responses);
    let fit = FittedMap {
        features,
        map,
        samples,
        targets: radial.targets,
        lossless: false,
        ridge: radial.ridge,
    };
    Ok((fit, regression))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_mean_of_both_also_where_a_response_is_negative_or_dark() {
        let (bands, wavelengths, spectra) = (3, 7, 40);
        let wave =
            |step: usize, phase: f64| (step as f64).mul_add(0.7, phase).sin().mul_add(0.3, 0.5);
        let response: Vec<f64> = (0..bands * wavelengths)
            .map(|at| wave(at % wavelengths, 2.0 * (at / wavelengths) as f64) / 3.5)
            .collect();
        let training: Vec<f64> = (0..spectra * wavelengths)
            .map(|at| {
                wave(
                    at % wavelengths * (1 + at / wavelengths % 3),
                    0.37 * (at / wavelengths) as f64,
                )
            })
            .collect();
        let problem = SpectralProblem::new(&response, &training, wavelengths, 1e-3).unwrap();
        let (both, _) = fit(&problem, 1).unwrap();
        let (polynomial, _) = root_polynomial::fit(&problem, 1).unwrap();
        let radial = radial_basis::fit(&problem, 1).unwrap();
        let rho = DMatrix::from_row_slice(
            4,
            bands,
            &[0.4, 0.5, 0.3, -0.01, 0.2, 0.1, 1e-4, 2e-4, 1e-4, 0.0, 0.0, 0.0],
        );
        let of = |fit: &FittedMap| fit.features.of_rows(&rho) * fit.map.transpose();
        let mean = (of(&polynomial) + of(&radial)) * 0.5;
        // Sums of 150 products of some units, in double precision.
        assert!((of(&both) - &mean).amax() <= 1e-11 * mean.amax());
    }
}
