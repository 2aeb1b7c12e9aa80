"""Coordinate search with a parabola through three values along each axis.

For a few numbers whose objective is expensive and noisy: no derivatives, no randomness.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Point = NDArray[np.float64]

_SWEEPS = 4
_FARTHEST = 2.0
"""The longest move along one axis, in steps."""


def coordinate_search(
    objective: Callable[[Point], float],
    start: Point,
    steps: Point,
    *,
    low: Point,
    high: Point,
    halvings: int = 2,
) -> tuple[Point, float]:
    """A minimum near ``start`` inside ``low`` to ``high``, and its value.

    Each axis in turn is tried one step to either side; the vertex of the parabola through the three
    values is tried as well, and the best of all is kept. Where a sweep over the axes moves by
    less than half a step, the steps are halved.
    """
    known: dict[tuple[float, ...], float] = {}

    def value(at: Point) -> float:
        key = tuple(at.tolist())
        if key not in known:
            known[key] = objective(at)
        return known[key]

    best, least = np.clip(start, low, high), 0.0
    least = value(best)
    for level in range(halvings + 1):
        step = steps / 2.0**level
        for _ in range(_SWEEPS):
            before = best
            for axis in range(len(best)):
                best, least = _along(value, best, least, axis, step[axis], low, high)
            if (np.abs(best - before) < 0.5 * step).all():
                break
    return best, least


def _along(
    value: Callable[[Point], float],
    best: Point,
    least: float,
    axis: int,
    step: float,
    low: Point,
    high: Point,
) -> tuple[Point, float]:
    """The best point along one axis, and its value."""

    def moved(by: float) -> Point:
        at = best.copy()
        at[axis] = np.clip(at[axis] + by, low[axis], high[axis])
        return at

    if step <= 0.0:
        return best, least
    below, above = moved(-step), moved(step)
    tried = [(least, best), (value(below), below), (value(above), above)]
    bend = tried[1][0] + tried[2][0] - 2.0 * least
    even = below[axis] == best[axis] - step and above[axis] == best[axis] + step
    if bend > 0.0 and even:
        vertex = 0.5 * step * (tried[1][0] - tried[2][0]) / bend
        there = moved(float(np.clip(vertex, -_FARTHEST * step, _FARTHEST * step)))
        tried.append((value(there), there))
    elif bend <= 0.0:  # a slope: as far as one move may go
        far = moved(_FARTHEST * step if tried[2][0] < tried[1][0] else -_FARTHEST * step)
        tried.append((value(far), far))
    least, best = min(tried, key=lambda one: one[0])
    return best, least
