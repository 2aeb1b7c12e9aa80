"""Student's t distribution for whole degrees of freedom [@student1908mean]."""

from __future__ import annotations

import math


def upper_tail(t: float, freedom: int) -> float:
    """The probability of more than ``t``, by the finite series for whole degrees of freedom."""
    if freedom < 1:
        raise ValueError(f"freedom: expected 1 or more, found {freedom}")
    angle = math.atan2(t, math.sqrt(freedom))
    cosine, sine = math.cos(angle), math.sin(angle)
    if freedom % 2:
        term = total = cosine if freedom > 1 else 0.0
        for number in range(3, freedom - 1, 2):
            term *= (number - 1) / number * cosine * cosine
            total += term
        within = (angle + sine * total) * 2.0 / math.pi
    else:
        term = total = 1.0
        for number in range(2, freedom - 1, 2):
            term *= (number - 1) / number * cosine * cosine
            total += term
        within = sine * total
    return 0.5 * (1.0 - within)


def quantile(probability: float, freedom: int) -> float:
    """The ``t`` that is exceeded with a probability of at most a half; by bisection."""
    if not 0.0 < probability <= 0.5:
        raise ValueError(f"probability: expected above 0 and at most 0.5, found {probability}")
    low, high = 0.0, 1.0
    while upper_tail(high, freedom) > probability:
        low, high = high, 2.0 * high
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if upper_tail(middle, freedom) > probability else (low, middle)
    return high
