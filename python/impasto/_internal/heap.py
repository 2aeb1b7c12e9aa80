"""What glibc's malloc keeps of memory that nobody has any more."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable
from functools import cache


def give_back() -> None:
    """Give the system what the heaps of all threads have free; a millisecond or some.

    glibc keeps it for the thread that had it. Of a job's reader, encoder and writer each has a heap
    of its own, so that its peak grew with the number of tiles. One heap for all (``M_ARENA_MAX``)
    keeps it, too, but its threads wait for each other: of lobes per pixel a job took a sixth
    longer. No effect outside glibc.
    """
    if (trim := _malloc_trim()) is not None:
        trim(0)


@cache
def _malloc_trim() -> Callable[[int], int] | None:
    if platform.libc_ver()[0] != "glibc":
        return None
    trim: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    return trim
