"""Spectral estimators in plain float64 numpy, written from the papers' equations.

Nothing here is shared with the package: matrices are built and inverted as the equations stand.
"""

from __future__ import annotations

import numpy as np


def wiener(training, response, sigma):
    """Eq. 5 of the six-band paper as printed: R H^T (H R H^T + sigma^2 I)^-1."""
    correlation = training.T @ training / len(training)
    inner = response @ correlation @ response.T + sigma**2 * np.eye(len(response))
    return np.linalg.solve(inner, response @ correlation).T


def wiener_by_least_squares(training, response, sigma):
    """The same minimum, from its definition: ridge regression of the spectra on the responses.

    argmin_G |T - T H^T G^T|^2 / N + sigma^2 |G|^2, by an augmented least-squares problem that
    squares no condition number; the reference where eq. 5 as printed loses digits.
    """
    count = len(training)
    system = np.vstack([training @ response.T / np.sqrt(count), sigma * np.eye(len(response))])
    right = np.vstack([training / np.sqrt(count), np.zeros((len(response), training.shape[1]))])
    return np.linalg.lstsq(system, right, rcond=1e-10)[0].T


def linear_model(training, response, terms):
    """Eq. 4-7 of the RGB paper: sigma = H^-1 rho on the first principal components."""
    basis = np.linalg.eigh(training.T @ training)[1][:, ::-1][:, :terms]
    if terms == len(response):
        return basis @ np.linalg.inv(response @ basis)
    return basis @ np.linalg.pinv(response @ basis)


def root_polynomial_features(rho):
    """rho_i, then sqrt(rho_i rho_j) for i < j; ``(N, band)`` to ``(N, features)``."""
    rho = np.clip(rho, 0, None)
    i, j = np.triu_indices(rho.shape[1], 1)
    return np.hstack([rho, np.sqrt(rho[:, i] * rho[:, j])])
