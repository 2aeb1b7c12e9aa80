"""Spectral primary decomposition after Mallett and Yuksel [@mallett2019spectral].

Three curves over wavelength that are nowhere negative and sum to one. Light of D65 behind each of
them has the chromaticity of red, green and blue of sRGB, so that a colour in linear sRGB is the
light of one lamp behind three filters, and white is the lamp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour._science import science
from impasto.colour.illuminants import Illuminant, spectrum
from impasto.colour.wavelengths import Floats, checked_wavelengths


def primary_transmittances(wavelengths: ArrayLike) -> Floats:
    """What filters of sRGB's red, green and blue transmit, ``(3, n)``; they sum to 1.

    Parameters
    ----------
    wavelengths
        ``(n,)`` nm. Values at 380 and 780 nm continue outside.
    """
    grid = checked_wavelengths(wavelengths)
    table = science().recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    columns = np.stack([np.interp(grid, table.wavelengths, row) for row in table.values.T])
    return np.asarray(columns / columns.sum(axis=0))


def primary_spectra(illuminant: Illuminant, wavelengths: ArrayLike) -> Floats:
    """Spectra ``(3, n)`` of red, green and blue whose sum is an illuminant.

    Parameters
    ----------
    illuminant
        Linear sRGB (1, 1, 1).
    wavelengths
        ``(n,)`` nm.
    """
    grid = checked_wavelengths(wavelengths)
    return np.asarray(spectrum(illuminant, grid) * primary_transmittances(grid))
