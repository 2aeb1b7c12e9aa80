"""Memory that is used again: by one array at a time."""

from __future__ import annotations

import gc
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from impasto._internal.recycling import LARGE, Recycled, empty, recycling

SIDE = 1536  # 9 MB of float32: more than LARGE


def address(array: NDArray[Any]) -> int:
    return int(array.__array_interface__["data"][0])


def test_memory_comes_back_when_the_last_view_is_gone() -> None:
    memory = Recycled()
    first = memory.empty((SIDE, SIDE), np.float32)
    first[...] = 3
    place, view = address(first), first[5:, ::7].T
    del first
    gc.collect()
    other = memory.empty((SIDE, SIDE), np.float32)
    assert address(other) != place
    other[...] = 4
    assert (view == 3).all()
    del view
    gc.collect()
    again = memory.empty((SIDE, SIDE - 1), np.uint16)  # smaller, of another kind
    assert address(again) == place
    assert again.shape == (SIDE, SIDE - 1)
    assert again.dtype == np.uint16
    again[...] = 1
    assert (other == 4).all()


def test_no_more_is_kept_than_was_in_use() -> None:
    """Windows that grow: each takes the place of the one before, whose memory is let go."""
    memory = Recycled()
    for rows in (SIDE, SIDE + 1, SIDE + 2):
        memory.empty((rows, SIDE), np.float32)[...] = 0
        gc.collect()
        assert memory.free == [rows * SIDE * 4]


def test_memory_that_comes_back_from_a_collection_of_garbage_waits_for_nothing() -> None:
    """Arrays in cycles come back at any line, also at those that look for free memory."""
    memory = Recycled()

    def work() -> None:
        for _ in range(2000):
            cycle: list[Any] = [memory.empty((LARGE,), np.uint8)]
            cycle.append(cycle)

    before = gc.get_threshold()
    gc.set_threshold(1, 1, 1)
    try:
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        thread.join(60.0)
        assert not thread.is_alive()
    finally:
        gc.set_threshold(*before)


def test_threads_share_no_memory() -> None:
    memory = Recycled()

    def work(number: int) -> bool:
        with recycling(memory):
            mine = empty((SIDE, SIDE), np.float32)
        mine[...] = number
        return bool((mine == number).all())

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(24)))


@pytest.mark.parametrize("shape", [(), (0, 5), (LARGE // 8 - 1,)])
def test_small_arrays_are_their_own(shape: tuple[int, ...]) -> None:
    memory = Recycled()
    with recycling(memory):
        found = empty(shape, np.float64)
    assert found.shape == shape
    assert found.base is None
    assert empty((3,), np.uint8).base is None  # outside of the block
