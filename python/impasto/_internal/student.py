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
