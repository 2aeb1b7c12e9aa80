"""The tables of ASTM E308: what a spectrophotometer's own software computes.

For comparing numbers with other laboratories. Use :func:`xyz_from_spectrum` for everything else: it
takes any grid and is closer to the 1 nm integral.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour.illuminants import Illuminant
from impasto.colour.observers import STANDARD_OBSERVER, fine_weights
from impasto.colour.wavelengths import NODES, Floats, checked_wavelengths, lagrange_rows
from impasto.errors import ArgumentError

RANGE = (360.0, 780.0)
"""The practice of E308: sums run from 360 to 780 nm."""


def xyz_from_spectrum_astm(
    wavelengths: ArrayLike, illuminant: Illuminant, observer: str = STANDARD_OBSERVER
) -> Floats:
    """The operator W with XYZ = W @ S made of ASTM E2022 weights, adjusted as in ASTM E308.

    Weights at the data's step over 360 to 780 nm: third-degree Lagrange interpolation inside, a
    parabola in the first and last interval; the weights of missing end wavelengths are added to
    the outermost measured ones.

    Parameters
    ----------
    wavelengths
        ``(n,)`` nm, n >= 3, in equal steps of a whole number of nm that would fall on 360.
    illuminant, observer
        See :func:`xyz_from_spectrum`.

    Returns
    -------
    ndarray
        ``(3, n)`` float64, Y = 1 for S = 1.

    Raises
    ------
    ArgumentError
        A grid that the standard has no table for, and whatever :func:`xyz_from_spectrum` refuses.
    """
    grid = checked_wavelengths(wavelengths)
    step = _checked_step(grid)
    start, stop = RANGE
    fine, weights = fine_weights(illuminant, observer, grid)
    # Some observers start at 390 nm: nothing is seen below, and no weight is lost.
    inside = (fine >= start) & (fine <= stop)
    fine, weights = fine[inside], weights[:, inside]
    weights = weights / weights[1].sum()
    nodes = np.arange(start, stop + 0.5, step)
    # Beyond the last node (steps that do not divide the range) its value continues.
    at = np.minimum(fine, nodes[-1])
    rows = lagrange_rows(nodes, at, NODES)
    for end in (slice(0, 3), slice(-3, None)):
        edge = nodes[end]
        parabola = (at < edge[1]) if end.start == 0 else (at > edge[1])
        rows[parabola] = 0.0
        rows[parabola, end] = lagrange_rows(edge, at[parabola], 3)
    table = weights @ rows
    nearest = np.rint((np.clip(nodes, grid[0], grid[-1]) - grid[0]) / step).astype(int)
    folded = nearest[:, None] == np.arange(grid.size)
    return np.asarray(table @ folded)


def _checked_step(grid: Floats) -> float:
    start, stop = RANGE
    if grid.size < 3:
        raise ArgumentError(f"wavelengths: expected at least 3, found {grid.size}")
    if grid[0] < start or grid[-1] > stop:
        raise ArgumentError(
            f"wavelengths: expected values between {start:g} and {stop:g} nm, "
            f"found {grid[0]:g} to {grid[-1]:g}"
        )
    steps = np.diff(grid)
    step = float(steps[0])
    if (steps != step).any():
        raise ArgumentError(
            f"wavelengths: expected equal steps, found {steps.min():g} to {steps.max():g} nm; "
            "xyz_from_spectrum takes any grid"
        )
    if step % 1.0 or (grid[0] - start) % step:
        raise ArgumentError(
            f"wavelengths: expected steps of a whole number of nm that fall on {start:g}, found "
            f"{grid[0]:g}, {grid[1]:g} ...; xyz_from_spectrum takes any grid"
        )
    return step
