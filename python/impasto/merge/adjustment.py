"""All frames at once: placements, gains and levels by robust least squares.

Weights are Huber's, by iteratively reweighted least squares [@huber1964].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.merge.placement import Placement

Floats = NDArray[np.float64]
Pair: TypeAlias = tuple[int, int]

ROUNDS = 20
HUBER = 1.345
"""Standard deviations from which on a residual counts less: 95 % efficiency for normal noise."""
LIKELIER = 10.0
"""Difference of BIC that is very strong evidence, as Kass and Raftery call it."""


@dataclass(frozen=True, eq=False)
class Matches:
    """The same points in two frames.

    Attributes
    ----------
    first, second
        ``(n, 2)`` columns and rows in either frame.
    weight
        ``(n,)`` reciprocal variances, up to a factor.
    """

    first: Floats
    second: Floats
    weight: Floats


def adjusted(
    matches: Mapping[Pair, Matches], count: int, reference: int, *, affine: bool = False
) -> list[Placement]:
    """Placements in which matches lie on each other best; the reference stays where it is.

    Parameters
    ----------
    matches
        By numbers of frames; they connect all of them.
    count
        Of frames.
    reference
        The frame whose pixels are those of the merged painting.
    affine
        Whether a frame may be sheared and stretched, as by a panel that leans; else it is only
        scaled, rotated and shifted.
    """
    size = 6 if affine else 4
    rows = [_equations(one.first, affine) for one in matches.values()]
    others = [_equations(one.second, affine) for one in matches.values()]
    total = sum(len(one) for one in rows)
    system = np.zeros((total, count * size))
    start = 0
    for (i, j), one, other in zip(matches, rows, others, strict=True):
        stop = start + len(one)
        system[start:stop, i * size : (i + 1) * size] = one
        system[start:stop, j * size : (j + 1) * size] = -other
        start = stop
    weight = np.concatenate([np.repeat(one.weight, 2) for one in matches.values()])
    fixed = _parameters(Placement.identity(), affine)
    own = slice(reference * size, (reference + 1) * size)
    right = -system[:, own] @ fixed
    free = np.delete(system, np.arange(own.start, own.stop), axis=1)
    # Columns of one size: offsets are unlike coefficients of coordinates.
    norm = np.maximum(np.linalg.norm(free, axis=0), 1e-12)

    def solve(factor: Floats) -> Floats:
        root = np.sqrt(weight * factor)
        found = np.linalg.lstsq(free / norm * root[:, None], right * root, rcond=None)[0]
        return np.asarray(found / norm)

    def residual(solution: Floats) -> Floats:
        return np.asarray(np.sqrt(weight) * (free @ solution - right))

    solution = solve(np.ones(total))
    for _ in range(ROUNDS):
        # A point is off or not, not one of its coordinates.
        off = np.linalg.norm(residual(solution).reshape(-1, 2), axis=1) / np.sqrt(2.0)
        solution = solve(np.repeat(huber(off), 2))
    every = np.insert(solution, own.start, fixed)
    return [_placement(part, affine) for part in every.reshape(count, size)]


def affine_is_likelier(
    matches: Mapping[Pair, Matches],
    similar: Sequence[Placement],
    affine: Sequence[Placement],
) -> bool:
    """Whether BIC [@schwarz1978bic] prefers affine maps by :data:`LIKELIER`.

    Noise is Laplace's, whose likelihood is a sum of absolute residuals: a few matches that are off
    do not decide.
    """
    numbers = 2 * sum(len(one.weight) for one in matches.values())
    costs = []
    for placements in (similar, affine):
        off = [np.abs(misses(one, placements, pair)).ravel() for pair, one in matches.items()]
        costs.append(2.0 * numbers * np.log(max(float(np.concatenate(off).mean()), 1e-9)))
    unknowns = 2 * (len(similar) - 1)
    return bool(costs[0] - costs[1] - unknowns * np.log(numbers) > LIKELIER)


def misses(one: Matches, placements: Sequence[Placement], pair: Pair) -> Floats:
    """``(n, 2)``: by how many pixels matches miss each other in the merged painting."""
    i, j = pair
    return placements[i].to(one.first) - placements[j].to(one.second)


def huber(residual: Floats) -> Floats:
    """Huber's weights, with the scale of the median absolute residual."""
    scale = 1.4826 * float(np.median(np.abs(residual)))
    if scale <= 0.0:
        return np.ones_like(residual)
    return np.asarray(np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300)))


def _equations(points: Floats, affine: bool) -> Floats:
    """``(2 n, unknowns)``: what unknowns make of points, x and y in turn."""
    x, y = points.T
    one, none = np.ones_like(x), np.zeros_like(x)
    if affine:
        columns = ((x, y, none, none, one, none), (none, none, x, y, none, one))
        return np.array(columns).transpose(2, 0, 1).reshape(2 * len(x), 6)
    return np.array(((x, -y, one, none), (y, x, none, one))).transpose(2, 0, 1).reshape(-1, 4)


def _parameters(placement: Placement, affine: bool) -> Floats:
    (a, b), (c, d) = placement.linear.tolist()
    x, y = placement.offset.tolist()
    return np.array([a, b, c, d, x, y] if affine else [a, c, x, y])


def _placement(values: Floats, affine: bool) -> Placement:
    if affine:
        return Placement(values[:4].reshape(2, 2), values[4:].copy())
    a, b, x, y = values.tolist()
    return Placement(np.array([[a, -b], [b, a]]), np.array([x, y]))
