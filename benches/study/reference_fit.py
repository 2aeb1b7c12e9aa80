"""A fixed fit that is timed beside every other: it measures the speed of the machine then."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import impasto
from impasto.stack import Stack
from study.data_sets import Sizes, available
from study.timing import Timing

T = TypeVar("T")

EDGE = 24
"""Pixels of the reference fit: some ten milliseconds, for which a machine's speed lasts."""
ENOUGH = 0.04
"""CPU seconds of the runs of one timing together, at least: fits of milliseconds run often."""
SIDE = 0.02
"""CPU seconds of the reference fit on either side of them, at least: single runs of it scatter more
than the fits do."""


class ReferenceFit:
    """A fixed fit of lobes to a small painting, always the same.

    Parameters
    ----------
    threads
        As the fits have that are timed beside it.
    """

    def __init__(self, threads: int | None) -> None:
        self._stack = _photographs()
        self._threads = threads
        # Start threads and load late imports first.
        self._fit()

    def _fit(self) -> None:
        impasto.fit_sbrdf(self._stack, pooling="pixel", threads=self._threads)

    def beside(self, fit: Callable[[], T], megapixels: float) -> tuple[T, Timing]:
        """Run a fit, a short one several times: its result, and one timing.

        The timing of a short fit is the fastest of its runs: in the others another process had the
        processor and evicted the caches.
        """
        before = self._side()
        marks = [_clocks()]
        while marks[-1][0] - marks[0][0] < ENOUGH:
            result = fit()
            marks.append(_clocks())
        beside = (before + self._side()) / 2.0
        cpu, wall = np.diff(marks, axis=0).min(axis=0) / megapixels
        runs = len(marks) - 1
        return result, Timing(float(cpu), float(wall), float(beside[0]), float(beside[1]), runs)

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
    made, _ = available(Sizes(painting=EDGE, paintings=1), 0, None)
    stack: Stack = made["own model"]()[0].stack
    return stack


def _clocks() -> NDArray[np.float64]:
    return np.array([time.process_time(), time.perf_counter()])
