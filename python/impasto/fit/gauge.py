"""The gauge of semi-calibrated photometric stereo: what photographs leave open of strengths.

Photographs of a nearly flat, matte painting do not determine it [@cho2020semicalibrated]:
``g_k (n . l_k)`` stays when strengths take what a tilt of all normals gives (of the kind of the
bas-relief ambiguity [@belhumeur1999basrelief]), and a fall-off with the elevation of a lamp passes
for the shape of the reflectance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_GRAZING = 0.05
"""Cosines below this count as this: the logarithm of a lamp at the horizon has no bound."""


def log_cosine(lights: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(obs,)`` logarithm of the cosine of incidence on a plane."""
    return np.log(np.maximum(lights @ normal, _GRAZING))


def log_elevation(lights: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(obs,)`` logarithm of the sine of the elevation above the picture."""
    return log_cosine(lights, np.array([0.0, 0.0, 1.0]))


def log_strengths_of_tilt(
    lights: NDArray[np.float64], normal: NDArray[np.float64], tilt: NDArray[np.float64]
) -> NDArray[np.float64]:
    """``(obs,)`` logarithms of factors of strengths that a tilt of a flat, matte painting mimics.

    Parameters
    ----------
    lights
        ``(obs, 3)`` directions.
    normal
        The mean normal that is tilted.
    tilt
        Along x and along y, in radians.
    """
    rotated = normal + np.array([*tilt, 0.0])
    rotated = rotated / np.linalg.norm(rotated)
    log = log_cosine(lights, rotated) - log_cosine(lights, normal)
    return np.asarray(log - np.median(log))


def fall_off(
    log: NDArray[np.float64],
    elevation: NDArray[np.float64],
    usual: NDArray[np.bool_],
    fewest: int,
) -> NDArray[np.float64]:
    """The part of ``log`` that is linear in the logarithm of the lamps' elevation.

    It is fitted to the ``usual`` lamps, and 0 where these are less than ``fewest``.
    """
    if usual.sum() < fewest:
        return np.zeros(len(log))
    plane = np.column_stack([np.ones(len(log)), elevation])
    line = np.linalg.lstsq(plane[usual], log[usual], rcond=None)[0]
    return np.asarray((elevation - elevation[usual].mean()) * line[1])
