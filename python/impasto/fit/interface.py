"""Spectra of coloured highlights: the smoothest reflectance [@vantrigt1990smoothest] of a lobe.

Gilding, metal leaf and bronzing reflect with a colour of their own. What a lobe's strengths in a
few bands say about its spectrum is little, and no training set of paints knows metals; but spectra
of metals are smooth. Of all spectra that have the strengths, the one with the least sum of squared
differences between neighbouring wavelengths is taken. It is linear in the strengths, and constant
where they are equal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto._internal.waiting import wait_for
from impasto.colour.wavelengths import Floats

_ROWS = 1 << 16
"""Pixels whose spectra are in memory at a time."""


def smoothest_reflectance(responses: Floats) -> Floats:
    """The operator from responses of bands to the smoothest reflectance.

    Parameters
    ----------
    responses
        ``(band, n)``: :meth:`impasto.Camera.operator`.

    Returns
    -------
    ndarray
        ``(n, band)`` float64: spectra that have the responses, the sum of squares of their first
        differences least (van Trigt 1990, the discrete form).
    """
    bands, count = responses.shape
    differences = np.diff(np.eye(count), axis=0)
    # The conditions of Lagrange; bands that are nearly combinations of others share the work.
    system = np.zeros((count + bands, count + bands))
    system[:count, :count] = differences.T @ differences
    system[:count, count:] = responses.T
    system[count:, :count] = responses
    right = np.concatenate([np.zeros((count, bands)), np.eye(bands)])
    return np.asarray(np.linalg.lstsq(system, right)[0][:count])


def interface_operator(responses: Floats, basis: Floats) -> Floats:
    """From strengths in bands to coefficients of a basis, for the lobes of a reflectance.

    Parameters
    ----------
    responses
        ``(band, n)``: :meth:`impasto.Camera.operator`.
    basis
        ``(k, n)``, orthonormal rows.

    Returns
    -------
    ndarray
        ``(k, band)`` float64: the smoothest reflectance in the basis, corrected to have the
        strengths again as well as the basis can.
    """
    coefficients = basis @ smoothest_reflectance(responses)
    seen = responses @ basis.T
    missing = np.eye(len(responses)) - seen @ coefficients
    return np.asarray(coefficients + np.linalg.pinv(seen) @ missing)


def spectra_of_lobes(
    strength: NDArray[np.float32], operator: Floats, basis: Floats
) -> NDArray[np.float32]:
    """Coefficients of the spectra of a lobe's strengths; no spectrum is negative.

    A spectrum that would be negative is mixed with the constant one of the same mean strength until
    it is not. Twice the strengths, twice the spectrum.

    Parameters
    ----------
    strength
        ``(band, y, x)``, none negative; NaN stays NaN.
    operator, basis
        ``(k, band)`` of :func:`interface_operator`, and ``(k, n)``.

    Returns
    -------
    ndarray
        ``(k, y, x)`` float32.
    """
    bands, height, width = strength.shape
    planes = strength.reshape(bands, -1)
    found = np.empty((len(operator), planes.shape[1]), np.float32)
    white = operator.sum(axis=1)

    def fill(start: int) -> None:
        part = slice(start, start + _ROWS)
        given = planes[:, part].astype(np.float64)
        own = operator @ given
        even = white[:, None] * given.mean(axis=0)
        spectrum, constant = basis.T @ own, basis.T @ even
        with np.errstate(invalid="ignore", divide="ignore"):
            share = constant / (constant - spectrum)
            share = np.where(spectrum < 0.0, np.clip(share, 0.0, 1.0), 1.0).min(axis=0)
        found[:, part] = even + share * (own - even)

    for start in range(0, planes.shape[1], _ROWS):
        wait_for(fill, start)
    return found.reshape(-1, height, width)
