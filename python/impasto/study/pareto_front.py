"""The Pareto front of time against error, and its knee."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points that no other point beats in both coordinates, the cheapest first.

    Parameters
    ----------
    points
        Pairs (time, error); less is better in both.
    """
    least = float("inf")
    front = []
    for index in sorted(range(len(points)), key=lambda i: points[i]):
        if points[index][1] < least:
            least = points[index][1]
            front.append(index)
    return front


def knee(points: Sequence[tuple[float, float]]) -> int:
    """Index of the point that lies farthest below the chord of a front, on logarithmic axes.

    Below the knee a little more time buys much accuracy; above it much time buys little.

    Parameters
    ----------
    points
        A front as :func:`pareto_front` orders it. With fewer than three points it is the last one.
    """
    logs = np.log(np.asarray(points, dtype=np.float64))
    extent = logs[-1] - logs[0]
    if len(points) < 3 or not (extent[0] > 0.0 and extent[1] < 0.0):
        return len(points) - 1
    along = (logs - logs[0]) / extent
    # Both run from 0 to 1: the share of the gain, less the share of the time spent.
    return int((along[:, 1] - along[:, 0]).argmax())
