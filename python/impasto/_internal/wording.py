"""Words that depend on a number."""

from __future__ import annotations

import numpy as np


def counted(count: int, noun: str) -> str:
    """``1 photograph``, ``2 photographs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def percent(share: float, sign: str = "") -> str:
    """Two digits of what is small, whole hundredths of what is not; ``sign="+"`` says either."""
    value = 100.0 * share
    return f"{value:{sign}.2g} %" if abs(value) < 10.0 else f"{value:{sign}.0f} %"


MOST = 100.0
"""A larger factor is not worth its digits."""


def factor(times: float) -> str:
    """``1.3``, ``2.8``, ``35``; ``more than 100``."""
    if times > MOST:
        return f"more than {MOST:.0f}"
    return f"{times:.0f}" if times >= 10.0 else f"{times:.1f}"


def scatter(log: float) -> str:
    """A deviation of logarithms: ``20 %``, or ``a factor of 3.5`` where a percentage misleads."""
    times = float(np.exp(min(log, 700.0)))
    return f"{100.0 * (times - 1.0):.0f} %" if times < 2.0 else f"a factor of {factor(times)}"
