"""Colour differences: CIELAB and CIEDE2000 [@sharma2005ciede2000], by colour-science."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour._science import science
from impasto.colour.observers import checked_white, white_point
from impasto.colour.wavelengths import Floats
from impasto.errors import ArgumentError


def lab_from_xyz(xyz: ArrayLike, white: ArrayLike | str = "D65") -> Floats:
    """CIELAB 1976 from XYZ.

    Parameters
    ----------
    xyz
        ``(3, ...)``, white at Y = 1.
    white
        XYZ ``(3,)`` of the white, or the name of its illuminant (2 degree observer, 1 nm).

    Returns
    -------
    ndarray
        ``(3, ...)`` float64: L* 0 to 100, a*, b*. NaN stays NaN.

    Raises
    ------
    ArgumentError
        A first axis that is not 3, or an unusable white.
    """
    values = _planar(xyz, "xyz")
    reference = checked_white(white_point(white) if isinstance(white, str) else white)
    tools = science()
    # XYZ_to_Lab takes the white by its chromaticity, at Y = 1.
    relative = np.moveaxis(values / reference[1], 0, -1)
    lab = tools.XYZ_to_Lab(relative, tools.XYZ_to_xy(reference))
    return np.ascontiguousarray(np.moveaxis(np.asarray(lab, dtype=np.float64), -1, 0))


def delta_e(lab: ArrayLike, other: ArrayLike) -> Floats:
    """CIEDE2000 colour difference, k_L = k_C = k_H = 1.

    Parameters
    ----------
    lab, other
        ``(3, ...)`` CIELAB; shapes broadcast behind the first axis.

    Returns
    -------
    ndarray
        ``(...)`` float64. NaN stays NaN.

    Raises
    ------
    ArgumentError
        A first axis that is not 3, or shapes that do not broadcast.
    """
    first, second = _planar(lab, "lab"), _planar(other, "other")
    try:
        first, second = np.broadcast_arrays(first, second)
    except ValueError as error:
        raise ArgumentError(
            f"other: shape {second.shape} does not fit lab's {first.shape}"
        ) from error
    difference = science().delta_E(
        np.moveaxis(first, 0, -1), np.moveaxis(second, 0, -1), method="CIE 2000"
    )
    return np.asarray(difference, dtype=np.float64)


def _planar(values: ArrayLike, name: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[0] != 3:
        raise ArgumentError(f"{name}: expected shape (3, ...), found {array.shape}")
    return array
