"""The tables of ASTM E308, as in the software of spectrophotometers.

For comparing numbers with other laboratories. Use :func:`xyz_from_spectrum` for everything else: it
takes any grid and is closer to the 1 nm integral.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from impasto.colour._science import science
from impasto.colour.illuminants import Illuminant
from impasto.colour.observers import STANDARD_OBSERVER, fine_weights
from impasto.colour.wavelengths import Floats, checked_wavelengths
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
        A grid without a table in the standard, and all errors of :func:`xyz_from_spectrum`.
    """
    grid = checked_wavelengths(wavelengths)
    step = _checked_step(grid)
    tools = science()
    fine, weights = fine_weights(illuminant, observer, grid)
    nanometres = np.arange(RANGE[0], RANGE[1] + 0.5)
    # Some observers start at 390 nm: weights below are 0.
    seen = np.zeros((nanometres.size, 3))
    inside = (fine >= RANGE[0]) & (fine <= RANGE[1])
    seen[np.rint(fine[inside] - RANGE[0]).astype(int)] = weights[:, inside].T
    standard = tools.SpectralShape(*RANGE, step)
    # The light is in the weights already; colour-science multiplies the two.
    table = tools.colorimetry.tristimulus_weighting_factors_ASTME2022(
        tools.MultiSpectralDistributions(seen, nanometres),
        tools.SpectralDistribution(np.ones(nanometres.size), nanometres),
        standard,
    )
    # Steps that do not divide the range have their last node below its end.
    nodes = tools.SpectralShape(RANGE[0], RANGE[0] + step * (len(table) - 1), step)
    measured = tools.SpectralShape(grid[0], grid[-1], step)
    adjust = tools.colorimetry.adjust_tristimulus_weighting_factors_ASTME308
    return np.ascontiguousarray(adjust(table, nodes, measured).T / 100.0)


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
