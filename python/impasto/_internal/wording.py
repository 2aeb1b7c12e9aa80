"""Words that depend on a number."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """``1 photograph``, ``2 photographs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def percent(share: float, sign: str = "") -> str:
    """Two digits of what is small, whole hundredths of what is not; ``sign="+"`` says either."""
    value = 100.0 * share
    return f"{value:{sign}.2g} %" if abs(value) < 10.0 else f"{value:{sign}.0f} %"
