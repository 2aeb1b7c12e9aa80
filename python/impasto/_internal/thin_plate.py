"""Thin-plate splines over directions, for numbers that lamps of a dome share with neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def over_directions(
    directions: NDArray[np.float64], values: NDArray[np.float64], others: NDArray[np.float64]
) -> NDArray[np.float64]:
    """``(m,)`` values at ``others`` ``(m, 3)`` from those at ``directions`` ``(n, 3)``.

    The spline is over stereographic coordinates and clipped to the range of the values.
    """
    found = thin_plate(stereographic(directions), values, stereographic(others))
    return np.clip(found, values.min(), values.max())


def stereographic(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(n, 2)`` stereographic coordinates: a hemisphere becomes the unit disc, angles stay."""
    height = np.maximum(1.0 + directions[:, 2:], np.finfo(np.float32).eps)
    return np.asarray(directions[:, :2] / height)


def thin_plate(
    places: NDArray[np.float64], values: NDArray[np.float64], others: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Thin-plate spline through ``values`` at other places: ``sum w r^2 log r`` plus a plane."""

    def bend(of: NDArray[np.float64]) -> NDArray[np.float64]:
        square = ((of[:, None] - places) ** 2).sum(axis=2)
        return np.asarray(0.5 * square * np.log(np.where(square > 0.0, square, 1.0)))

    def plane(of: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([np.ones(len(of)), of])

    corner = np.zeros((3, 3))
    system = np.block([[bend(places), plane(places)], [plane(places).T, corner]])
    # Least squares: two lights in one direction have the mean of their strengths.
    weights = np.linalg.lstsq(system, np.concatenate([values, np.zeros(3)]), rcond=None)[0]
    return np.asarray(np.hstack([bend(others), plane(others)]) @ weights)
