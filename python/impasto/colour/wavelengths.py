"""Wavelength grids: checks, and interpolation between grids."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

NODES = 4
"""Points of one Lagrange polynomial: third degree, as in ASTM E2022."""
LARGEST_GAIN = 2.0
"""Most by which a cubic may amplify noise; even grids stay below 1.63. Samples at 400, 401, 700 and
701 nm reach 150 in the middle: a straight line is better there."""


def checked_wavelengths(wavelengths: ArrayLike, name: str = "wavelengths") -> Floats:
    """A strictly increasing grid ``(n,)`` in nm, or an :class:`ArgumentError`."""
    try:
        grid = np.asarray(wavelengths, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"{name}: expected numbers in nm, found {wavelengths!r}") from error
    if grid.ndim != 1 or grid.size == 0:
        raise ArgumentError(f"{name}: expected shape (n,) with n >= 1, found {grid.shape}")
    if not np.isfinite(grid).all():
        index = int(np.flatnonzero(~np.isfinite(grid))[0])
        raise ArgumentError(f"{name}: expected finite numbers, found {grid[index]} at {index}")
    if (np.diff(grid) <= 0).any():
        index = int(np.flatnonzero(np.diff(grid) <= 0)[0])
        raise ArgumentError(
            f"{name}: expected strictly increasing values, found {grid[index]:g} followed by "
            f"{grid[index + 1]:g} at {index + 1}; sort them (and the data) first"
        )
    if grid[0] <= 0 or grid[-1] < 100.0:
        raise ArgumentError(
            f"{name}: expected nanometres (visible light is 360 to 830), found "
            f"{grid[0]:g} to {grid[-1]:g}; multiply micrometres by 1e3, metres by 1e9"
        )
    return grid


def checked_spectra(values: ArrayLike, grid: Floats, argument: str, row: str) -> Floats:
    """A copy of spectra ``(row, n)`` on a grid of ``n`` wavelengths.

    Raises
    ------
    ArgumentError
        Another shape, no spectrum at all, a value that is not finite: the first one is named.
    """
    spectra = np.array(values, dtype=np.float64)
    if spectra.ndim != 2 or spectra.shape[1] != grid.size or len(spectra) == 0:
        raise ArgumentError(
            f"{argument}: expected shape ({row}, {grid.size}), found {spectra.shape}"
        )
    if not np.isfinite(spectra).all():
        which, index = np.argwhere(~np.isfinite(spectra))[0]
        raise ArgumentError(
            f"{argument}: expected finite numbers, found {spectra[which, index]} in {row} "
            f"{which} at {grid[index]:g} nm"
        )
    return spectra


def interpolation_matrix(wavelengths: ArrayLike, at: ArrayLike) -> Floats:
    """The matrix that interpolates a spectrum from one wavelength grid to another.

    Between two samples the curve is the third-degree Lagrange polynomial through the four nearest
    samples (fewer samples: a parabola, a line, a constant). This is the rule of ASTM E2022; of the
    linear rules measured on the CES 99 spectra it is the one that keeps every CIE illuminant within
    0.2 CIEDE2000 on 10 nm data (a cubic spline is twice as good on average but reaches 0.29 under
    FL3.1). Where very uneven samples would let the cubic swing, a straight line takes its place.
    Outside the samples the end values continue: a paint does not stop reflecting where the
    spectrometer stopped.

    Parameters
    ----------
    wavelengths
        ``(n,)`` nm, strictly increasing, not necessarily evenly spaced.
    at
        ``(m,)`` nm, in any order.

    Returns
    -------
    ndarray
        ``(m, n)`` float64; rows sum to 1, and a row is exactly a unit vector where ``at`` hits a
        sample.

    Raises
    ------
    ArgumentError
        A grid that does not increase, is not finite, or is not in nm.
    """
    grid = checked_wavelengths(wavelengths)
    points = np.asarray(at, dtype=np.float64)
    if points.ndim != 1 or not np.isfinite(points).all():
        raise ArgumentError(f"at: expected finite wavelengths (m,), found shape {points.shape}")
    return _interpolation_matrix(grid.tobytes(), points.tobytes()).copy()


@lru_cache(maxsize=32)
def _interpolation_matrix(grid_bytes: bytes, points_bytes: bytes) -> Floats:
    grid = np.frombuffer(grid_bytes)
    points = np.clip(np.frombuffer(points_bytes), grid[0], grid[-1])
    cubic = lagrange_rows(grid, points, NODES)
    swinging = np.abs(cubic).sum(axis=1) > LARGEST_GAIN
    if swinging.any():
        cubic[swinging] = lagrange_rows(grid, points[swinging], 2)
    return cubic


def lagrange_rows(grid: Floats, points: Floats, nodes: int) -> Floats:
    """``(m, n)`` weights of the polynomial through the ``nodes`` samples around each point."""
    count = min(nodes, grid.size)
    first = np.clip(np.searchsorted(grid, points) - count // 2, 0, grid.size - count)
    columns = first[:, None] + np.arange(count)
    near = grid[columns]
    weights = np.ones_like(near)
    for i in range(count):
        for j in range(count):
            if i != j:
                weights[:, i] *= (points - near[:, j]) / (near[:, i] - near[:, j])
    matrix = np.zeros((points.size, grid.size))
    np.put_along_axis(matrix, columns, weights, axis=1)
    return matrix
