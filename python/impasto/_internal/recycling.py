"""Large arrays that take the memory of others that nobody has any more.

The system clears every page of memory that it gives. Where one tile after another is read, that
takes as long as a copy of them all, and what the last tile had is there to be used again.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

LARGE = 1 << 22
"""Bytes of the smallest array that is worth it: numpy asks for large pages from here on."""


class Recycled:
    """The memory of arrays that one after another are of about the same size.

    It keeps no more than was in use at the same time.
    """

    def __init__(self) -> None:
        self._free: list[NDArray[np.uint8]] = []
        # A collection of garbage may give memory back at any line, also where the lock is held.
        self._returned: deque[NDArray[np.uint8]] = deque()
        self._lock = Lock()

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """An array of any content; its memory comes back when it and its views are gone."""
        wanted = np.dtype(dtype)
        size = math.prod(shape) * wanted.itemsize
        if size < LARGE:
            return np.empty(shape, wanted)
        memory = self._taken(size)
        # Every view keeps this object, and nothing else does.
        lent = (ctypes.c_ubyte * size).from_buffer(memory.data)
        weakref.finalize(lent, self._returned.append, memory).atexit = False
        return np.frombuffer(memoryview(lent), wanted).reshape(shape)

    def _taken(self, size: int) -> NDArray[np.uint8]:
        with self._lock:
            self._collect()
            fitting = [index for index, one in enumerate(self._free) if one.nbytes >= size]
            if fitting:
                return self._free.pop(min(fitting, key=lambda index: self._free[index].nbytes))
            # None is large enough: one of them gives way.
            if self._free:
                self._free.pop()
        return np.empty(size, np.uint8)

    @property
    def free(self) -> list[int]:
        """Bytes of every piece of memory that no array has."""
        with self._lock:
            self._collect()
            return [one.nbytes for one in self._free]

    def _collect(self) -> None:
        while self._returned:
            self._free.append(self._returned.popleft())


_CURRENT: ContextVar[Recycled | None] = ContextVar("recycled", default=None)


@contextmanager
def recycling(memory: Recycled) -> Iterator[None]:
    """What :func:`empty` makes in the block, in this thread, takes this memory."""
    token = _CURRENT.set(memory)
    try:
        yield
    finally:
        _CURRENT.reset(token)


def empty(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """As ``numpy.empty``; in a block of :func:`recycling`, of memory that was used before."""
    memory = _CURRENT.get()
    return np.empty(shape, dtype) if memory is None else memory.empty(shape, dtype)
