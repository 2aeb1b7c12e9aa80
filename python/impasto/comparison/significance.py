"""Which differences are larger than the predicted errors explain: Hotelling's T squared.

A difference divided by its covariance is T squared [@hotelling1931student]. As the covariances come
from residuals with few degrees of freedom, T squared is held against Fisher's F, not against chi
squared. A pixel is marked where a larger value has the probability ``alpha`` without a change.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impasto._internal.student import upper_tail

Floats = NDArray[np.float64]

MOST_FREEDOM = 400
"""More degrees of freedom count as these: quantiles then differ from chi squared by a percent."""


def tail(square: float, rank: int, freedom: int) -> float:
    """The probability of a T squared above ``square``, of 1, 2 or 3 numbers.

    With one number it is Student's; each further pair adds one term (the recurrence of the
    incomplete beta function in its second parameter).
    """
    share = freedom / (freedom + square)
    if rank == 2:
        return math.pow(share, freedom / 2)
    both: float = 2.0 * upper_tail(math.sqrt(square), freedom)
    if rank == 1:
        return both
    ratio = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2))
    return both + 2.0 * math.pow(share, freedom / 2) * math.sqrt((1 - share) / math.pi) * ratio


@lru_cache(maxsize=4096)
def critical(alpha: float, rank: int, freedom: int) -> float:
    """The T squared that is exceeded with probability ``alpha``; by bisection."""
    low, high = 0.0, 1.0
    while tail(high, rank, freedom) > alpha:
        low, high = high, 4.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if tail(middle, rank, freedom) > alpha else (low, middle)
    return high


def criticals(alpha: float, rank: int, freedom: NDArray[np.int64]) -> Floats:
    """:func:`critical` of every pixel; few degrees of freedom occur."""
    bounded = np.clip(freedom, 1, MOST_FREEDOM)
    known = np.bincount(bounded.ravel(), minlength=MOST_FREEDOM + 1) > 0
    table = np.full(MOST_FREEDOM + 1, np.inf)
    for value in np.flatnonzero(known).tolist():
        table[value] = critical(alpha, rank, value)
    return np.asarray(table[bounded])


def squares(difference: Floats, covariance: Floats) -> Floats:
    """T squared ``(n,)`` of differences ``(n, k)`` with covariances ``(n, k, k)``.

    Covariances that are not finite give NaN; those without an inverse are raised by a rounding of
    their trace, in whose directions nothing differs.
    """
    size = difference.shape[1]
    known = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(difference).all(axis=1)
    found = np.full(len(difference), np.nan)
    if known.any():
        own = covariance[known]
        raised = np.trace(own, axis1=1, axis2=2)[:, None, None] * 1e-9 + 1e-30
        solved = np.linalg.solve(own + raised * np.eye(size), difference[known][..., None])
        found[known] = np.einsum("nk,nk->n", difference[known], solved[..., 0])
    return found
