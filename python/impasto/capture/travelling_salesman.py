"""Orders with short travel: the travelling salesman problem, by nearest neighbour and 2-opt.

A tour that always goes to the nearest place [@rosenkrantz1977tsp] is improved by reversals of parts
of it, until none makes it shorter [@croes1958tsp]. The way is open: it does not return.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

SWEEPS = 100
"""Passes over all reversals at most; a few dozen are needed for a thousand places."""
GAIN = 1e-9
"""Least shortening of a reversal: rounding errors are none."""


def nearest_neighbour(costs: Floats, groups: Sequence[int], start: Floats) -> list[int]:
    """One place of each group, always the nearest that is left.

    Parameters
    ----------
    costs
        ``(n, n)`` from place to place, symmetric.
    groups
        ``(n,)``: which places stand for one and the same; one of each group is visited.
    start
        ``(n,)`` costs from where the tour begins.

    Returns
    -------
    list
        Numbers of places in their order.
    """
    group = np.asarray(groups)
    if costs.shape != (len(group), len(group)) or start.shape != (len(group),):
        raise ArgumentError(
            f"costs: expected ({len(group)}, {len(group)}), found shape {costs.shape}"
        )
    left = np.ones(len(group), dtype=bool)
    tour: list[int] = []
    here = start
    while left.any():
        one = int(np.where(left, here, np.inf).argmin())
        tour.append(one)
        left[group == group[one]] = False
        here = costs[one]
    return tour


def two_opt(costs: Floats, tour: Sequence[int], start: Floats) -> list[int]:
    """The tour without a reversal that would make it shorter.

    Parameters
    ----------
    costs, start
        As in :func:`nearest_neighbour`.
    tour
        Numbers of places in their order; the first one may change, too.
    """
    order = list(tour)
    for _ in range(SWEEPS):
        better = False
        for first in range(len(order) - 1):
            places = np.array(order)
            before = start if first == 0 else costs[order[first - 1]]
            ends = places[first + 1 :]
            # Behind the last place nothing follows, and nothing is lost.
            after = np.zeros((2, len(ends)))
            after[0, :-1] = costs[places[first], places[first + 2 :]]
            after[1, :-1] = costs[ends[:-1], places[first + 2 :]]
            gain = before[places[first]] + after[1] - before[ends] - after[0]
            best = int(gain.argmax())
            if gain[best] > GAIN:
                stop = first + 2 + best
                order[first:stop] = order[first:stop][::-1]
                better = True
        if not better:
            break
    return order


def length_of(costs: Floats, tour: Sequence[int], start: Floats) -> float:
    """The cost of a tour."""
    if not tour:
        return 0.0
    return float(start[tour[0]] + costs[tour[:-1], tour[1:]].sum())
