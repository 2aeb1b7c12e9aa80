"""A fixed fit that is timed beside every other: how fast the machine is at that moment."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto.stack import Stack
from impasto.study.specimens import Sizes, specimens
from impasto.study.turns import Turn

T = TypeVar("T")

EDGE = 24
"""Pixels of the yardstick: some ten milliseconds, for which a machine's speed lasts."""
ENOUGH = 0.04
"""CPU seconds that the runs of one turn take together, at least: fits of milliseconds run often."""


class Yardstick:
    """A fixed fit of lobes to a small painting, always the same.

    Parameters
    ----------
    threads
        As the fits have that are timed beside it.
    """

    def __init__(self, threads: int | None) -> None:
        self._stack = _photographs()
        self._threads = threads
        # Threads, and what is imported late.
        self._fit()

    def _fit(self) -> None:
        impasto.fit_sbrdf(self._stack, pooling="pixel", threads=self._threads)

    def beside(self, fit: Callable[[], T], megapixels: float) -> tuple[T, Turn]:
        """Run a fit, a short one some times: its result, and one turn.

        The turn of a short fit is the least of its runs: in the others another process has had the
        processor, and left nothing in its caches.
        """
        before = _clocks()
        self._fit()
        marks = [_clocks()]
        while marks[-1][0] - marks[0][0] < ENOUGH:
            result = fit()
            marks.append(_clocks())
        self._fit()
        yard = ((marks[0] - before) + (_clocks() - marks[-1])) / 2.0
        cpu, wall = np.diff(marks, axis=0).min(axis=0) / megapixels
        return result, Turn(float(cpu), float(wall), float(yard[0]), float(yard[1]))


@cache
def _photographs() -> Stack:
    made, _ = specimens(Sizes(painting=EDGE), 0, None)
    return made["own model"]().stack


def _clocks() -> NDArray[np.float64]:
    return np.array([time.process_time(), time.perf_counter()])
