"""Form factors between the cells of a relief as a full matrix, in plain float64 numpy.

Radiosity (Goral et al. 1984): the irradiance of a cell is the integral of (N.w) over the solid
angle of the cells that it sees, over pi. Along each of 32 azimuths a cell sees those that rise
above all before them (horizon mapping, Max 1988), and over the elevations e that one of them fills

    (N.w) cos e = a cos^2 e + z sin e cos e,   a the normal's part along the azimuth,

has the antiderivative (a (e + sin e cos e) + z sin^2 e) / 2. The code compares and integrates the
elevations themselves, all pairs at one distance at a time.

This file is to be right, not fast.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

AZIMUTHS = 32
Array = NDArray[np.float64]


def form_factors(height: NDArray[Any], normal: NDArray[Any]) -> Array:
    """``(n, n)``: the share of its radiosity by which each cell (column) lights another (row).

    ``height`` is ``(y, x)`` in sides of a cell, NaN where there is nothing; ``normal`` is
    ``(3, y, x)``.
    """
    rows, columns = height.shape
    number = np.arange(rows * columns)
    row, column = np.divmod(number, columns)
    start = height.ravel().astype(np.float64)
    x, y, z = (normal / np.linalg.norm(normal, axis=0)).reshape(3, -1).astype(np.float64)
    shares = np.zeros((len(number), len(number)))
    for azimuth in (np.arange(AZIMUTHS) + 0.5) * (2.0 * np.pi / AZIMUTHS):
        right, down = np.cos(azimuth), -np.sin(azimuth)
        along = x * right - y * down
        # Below this elevation a direction lies behind the surface.
        highest = np.arctan2(-along, z)
        for distance in range(1, rows + columns):
            to_row = np.rint(row + distance * down).astype(np.intp)
            to_column = np.rint(column + distance * right).astype(np.intp)
            inside = (to_row >= 0) & (to_row < rows) & (to_column >= 0) & (to_column < columns)
            if not inside.any():
                break
            one, other = number[inside], to_row[inside] * columns + to_column[inside]
            # That of the cell, which is not exactly on the azimuth.
            apart = np.hypot(to_row - row, to_column - column)[inside]
            elevation = np.arctan((start[other] - start[one]) / apart)
            # What is not a number is not above the horizon.
            seen = elevation > highest[one]
            one, other, elevation = one[seen], other[seen], elevation[seen]
            upper = _below(elevation, along[one], z[one])
            shares[one, other] += upper - _below(highest[one], along[one], z[one])
            highest[one] = elevation
    shares *= 2.0 / AZIMUTHS
    return shares


def _below(elevation: Array, along: Array, z: Array) -> Array:
    """Integral of ``(N.w) cos`` over the elevations of directions w up to this one."""
    sine, cosine = np.sin(elevation), np.cos(elevation)
    return np.asarray(0.5 * (along * (elevation + sine * cosine) + z * sine**2))
