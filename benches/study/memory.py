"""Peak memory of a fit beyond the photographs, measured in a separate process."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from impasto.stack import Stack

PICTURES = (800_000, 5_000_000)
"""Samples per band of two pictures: the difference of their peaks is due to the picture."""

Fit = Callable[[Stack, int | None], Any]


def per_megapixel(fit: Fit, stack: Stack, threads: int | None) -> float | None:
    """Megabytes per megapixel; None where the system does not report it (Linux does).

    The resident set, including the threads' working memory. Freed memory that the allocator would
    keep is not counted, because it differs from run to run.
    """
    edges = [math.isqrt(samples // len(stack.rig)) for samples in PICTURES]
    peaks = []
    for edge in edges:
        # A new process each, because a fit could reuse memory that an earlier one has freed.
        with _returning(), ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            peaks.append(pool.submit(peak, fit, stack, edge, threads).result())
    small, large = peaks
    if small is None or large is None:
        return None
    return (large - small) / ((edges[1] ** 2 - edges[0] ** 2) / 1e6)


def peak(fit: Fit, stack: Stack, edge: int, threads: int | None) -> float | None:
    """Peak megabytes of a fit to the stack, repeated to ``edge`` pixels, above those before it."""
    height, width = stack.shape[2:]
    again = (1, 1, -(-edge // height), -(-edge // width))
    large = stack._replace(samples=np.tile(stack.samples, again)[:, :, :edge, :edge].copy())
    # Start threads and load late imports first.
    fit(stack, threads)
    try:
        # Reset the peak.
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        before = _resident("VmRSS")
        fit(large, threads)
        return _resident("VmHWM") - before
    except OSError:
        return None


@contextmanager
def _returning() -> Iterator[None]:
    """New processes return freed blocks of 64 KiB or more to the system at once (glibc)."""
    names = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, str(1 << 16)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _resident(field: str) -> float:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    (line,) = (line for line in lines if line.startswith(field + ":"))
    return int(line.split()[1]) * 1024 / 1e6
