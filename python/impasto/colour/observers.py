"""CIE XYZ from a spectrum, integrated on a 1 nm grid."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from impasto._internal.checks import one_of
from impasto.colour._science import science
from impasto.colour.illuminants import Illuminant, sampled, temperature_if_given
from impasto.colour.wavelengths import Floats, checked_wavelengths, interpolation_matrix
from impasto.errors import ArgumentError

STANDARD_OBSERVER = "CIE 1931 2 Degree Standard Observer"
OBSERVERS = (
    STANDARD_OBSERVER,
    "CIE 1964 10 Degree Standard Observer",
    "CIE 2015 2 Degree Standard Observer",
    "CIE 2015 10 Degree Standard Observer",
)
"""The observers whose colour-matching functions are XYZ on a 1 nm grid."""


class White(NamedTuple):
    """A white known only by its colour, such as that of a display; any luminance."""

    xyz: tuple[float, float, float]


def xyz_from_spectrum(
    wavelengths: ArrayLike, illuminant: Illuminant, observer: str = STANDARD_OBSERVER
) -> Floats:
    """The operator W with XYZ = W @ S for a reflectance S under a light source.

    W = (colour-matching functions x light, at 1 nm, Y = 1 for S = 1)^T P, with P the interpolation
    of the reflectance (:func:`interpolation_matrix`). The light is never resampled to the data
    grid: plain sums over 10 nm are wrong by 1 to 6 CIEDE2000 under fluorescent and mercury lamps.

    Parameters
    ----------
    wavelengths
        ``(n,)`` nm, strictly increasing: where the reflectances are sampled.
    illuminant
        A light source, see :data:`Illuminant`; an array ``(n,)`` stands on ``wavelengths``.
    observer
        One of :data:`OBSERVERS`.

    Returns
    -------
    ndarray
        ``(3, n)`` float64.

    Raises
    ------
    ArgumentError
        Wavelengths that are no grid in nm or lie outside visible light, an unusable light source
        (see :func:`spectrum`), an unknown observer.
    """
    grid = checked_wavelengths(wavelengths)
    fine, weights = fine_weights(illuminant, observer, grid)
    if grid[-1] < fine[0] or grid[0] > fine[-1]:
        raise ArgumentError(
            f"wavelengths: {grid[0]:g} to {grid[-1]:g} nm lie outside the observer's "
            f"{fine[0]:g} to {fine[-1]:g} nm"
        )
    return np.asarray(weights @ interpolation_matrix(grid, fine))


def white_point(illuminant: Illuminant, observer: str = STANDARD_OBSERVER) -> Floats:
    """XYZ ``(3,)`` of a perfect white under a light source, Y = 1.

    Parameters
    ----------
    illuminant
        A name, a temperature or a pair ``(wavelengths, values)``, see :data:`Illuminant`.
    observer
        One of :data:`OBSERVERS`.
    """
    return white_of(illuminant, observer, "illuminant")


def white_of(illuminant: Illuminant | White, observer: str, name: str) -> Floats:
    """:func:`white_point`; errors call the light source ``name``."""
    if isinstance(illuminant, White):
        xyz = checked_white(illuminant.xyz, name)
        return np.asarray(xyz / xyz[1])
    return np.asarray(fine_weights(illuminant, observer, None, name)[1].sum(axis=1))


def checked_white(white: ArrayLike, name: str = "white") -> Floats:
    """Three finite tristimulus values with Y > 0, or an :class:`ArgumentError`."""
    xyz = np.asarray(white, dtype=np.float64)
    if xyz.shape != (3,) or not np.isfinite(xyz).all() or not xyz[1] > 0:
        raise ArgumentError(
            f"{name}: expected finite XYZ (3,) with Y > 0, found "
            f"{xyz if xyz.size <= 3 else f'shape {xyz.shape}'}"
        )
    return xyz


def fine_weights(
    illuminant: Illuminant, observer: str, own_grid: Floats | None, name: str = "illuminant"
) -> tuple[Floats, Floats]:
    """The observer's 1 nm grid ``(m,)`` and the weights ``(3, m)``; the Y row sums to 1."""
    one_of(observer, OBSERVERS, "observer")
    fine, functions = matching_functions(observer)
    power = sampled(illuminant, fine, own_grid, name)
    # The largest value becomes 1 first: tables in W m^-3 or of a cold blackbody would otherwise
    # run into the ends of the range of a double.
    peak = power.max()
    weights = functions * (power / peak if peak > 0 else power)
    luminance = weights[1].sum()
    if not luminance > 0:
        raise ArgumentError(
            f"{name}: {_describe(illuminant)} emits no light that the {observer} sees"
        )
    return fine, np.asarray(weights / luminance)


def _describe(illuminant: Illuminant) -> str:
    if isinstance(illuminant, str):
        return repr(illuminant)
    kelvin = temperature_if_given(illuminant)
    return "the spectrum" if kelvin is None else f"{kelvin:g} K"


@lru_cache(maxsize=8)
def matching_functions(observer: str) -> tuple[Floats, Floats]:
    """Wavelengths ``(m,)`` in steps of 1 nm and functions ``(3, m)``."""
    table = science().MSDS_CMFS[observer]
    return (
        np.asarray(table.wavelengths, dtype=np.float64),
        np.ascontiguousarray(np.asarray(table.values, dtype=np.float64).T),
    )
