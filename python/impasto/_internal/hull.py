"""The convex hull of points in the plane."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def into_hull(points: Points, wanted: Points) -> tuple[Points, NDArray[np.float64]]:
    """The nearest places in the convex hull of some points.

    Parameters
    ----------
    points
        ``(n, 2)``, at least one; they may lie on a line.
    wanted
        ``(m, 2)``.

    Returns
    -------
    places, distance
        ``(m, 2)`` the nearest place in the hull, ``(m,)`` how far it is: 0 inside.
    """
    corners = points[cv2.convexHull(points.astype(np.float32), returnPoints=False)[:, 0]]
    edges = np.roll(corners, -1, axis=0) - corners
    from_corner = wanted[:, None] - corners
    length = (edges**2).sum(axis=-1)
    along = (from_corner * edges).sum(axis=-1) / np.where(length > 0.0, length, 1.0)
    steps = np.clip(along, 0.0, 1.0)[..., None] * edges
    away = np.linalg.norm(from_corner - steps, axis=-1)
    nearest = np.arange(len(wanted)), away.argmin(axis=1)
    places, distance = (corners + steps)[nearest], away[nearest]
    turn = edges[:, 0] * from_corner[..., 1] - edges[:, 1] * from_corner[..., 0]
    inside = (turn > 0.0).all(axis=1) | (turn < 0.0).all(axis=1)
    return np.where(inside[:, None], wanted, places), np.where(inside, 0.0, distance)
