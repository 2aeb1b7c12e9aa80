"""The heaps of glibc's malloc: one for each thread, unless it is told otherwise."""

from __future__ import annotations

import ctypes
import platform

M_ARENA_MAX = -8
"""The option of ``mallopt`` in ``malloc.h``."""


def share_one_heap() -> None:
    """Threads that begin from now on take their memory from the same heap as the first.

    In a heap of its own each thread keeps what another one could use: the peak of a job, whose
    reader, encoder and writer each have one, grows with the number of its tiles. It holds for the
    whole process, for good: only a program that is ours may ask for it. No effect outside glibc.
    """
    if platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)
