"""Words that depend on a number."""

from __future__ import annotations


def counted(count: int, noun: str) -> str:
    """``1 photograph``, ``2 photographs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
