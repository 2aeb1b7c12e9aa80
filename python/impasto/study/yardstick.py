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
SIDE = 0.02
"""CPU seconds of the yardstick on either side of them, at least: a single run of it scatters more
than the fits do."""


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
        before = self._side()
        marks = [_clocks()]
        while marks[-1][0] - marks[0][0] < ENOUGH:
            result = fit()
            marks.append(_clocks())
        yard = (before + self._side()) / 2.0
        cpu, wall = np.diff(marks, axis=0).min(axis=0) / megapixels
        runs = len(marks) - 1
        return result, Turn(float(cpu), float(wall), float(yard[0]), float(yard[1]), runs)

    def _side(self) -> NDArray[np.float64]:
        """CPU and wall seconds of a run, in the mean of some."""
        start = now = _clocks()
        runs = 0
        while now[0] - start[0] < SIDE:
            self._fit()
            now = _clocks()
            runs += 1
        return np.asarray((now - start) / runs)


@cache
def _photographs() -> Stack:
    made, _ = specimens(Sizes(painting=EDGE, paintings=1), 0, None)
    stack: Stack = made["own model"]()[0].stack
    return stack


def _clocks() -> NDArray[np.float64]:
    return np.array([time.process_time(), time.perf_counter()])
