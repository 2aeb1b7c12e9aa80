"""What Python and its loader say in other words where memory is short becomes MemoryError."""

from __future__ import annotations

import _thread
import threading
from typing import Any

import pytest

from impasto import MissingExtraError
from impasto._internal import extras
from impasto._internal.pools import Pool


@pytest.mark.parametrize(
    "error",
    [
        ImportError("libz.so: failed to map segment from shared object"),
        ImportError("dlopen: cannot allocate memory in static TLS block"),
        SystemError("error return without exception set"),
    ],
)
def test_a_library_that_has_no_room_is_not_missing(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load(_: str) -> None:
        raise error

    monkeypatch.setattr(extras, "import_module", load)
    with pytest.raises(MemoryError, match="no memory to load zarr"):
        extras.need("zarr", "scale", "a store")


def test_a_library_that_is_there_and_broken_is_not_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(_: str) -> None:
        raise ImportError("undefined symbol: PyFoo")

    monkeypatch.setattr(extras, "import_module", load)
    with pytest.raises(MissingExtraError, match=r"installed and cannot be loaded \(undefined"):
        extras.need("zarr", "scale", "a store")
    with pytest.raises(MissingExtraError, match="which is not installed"):
        extras.need("a_library_of_nobody", "scale", "a store")


@pytest.mark.parametrize("way", ["refused", "ended"])
def test_a_pool_without_room_for_a_thread(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system refuses a thread, or gives one that ends before it begins."""
    begin = _thread.start_new_thread

    def fails(work: Any, given: Any) -> int:
        if way == "refused":
            raise RuntimeError("can't start new thread")
        return begin(lambda *_: None, given)

    ready = threading.Event()
    with Pool(2) as pool:
        first = pool.submit(ready.wait, 10.0)
        monkeypatch.setattr(_thread, "start_new_thread", fails)
        with pytest.raises(MemoryError, match="no further thread"):
            pool.submit(ready.wait, 10.0)
        monkeypatch.undo()
        second = pool.submit(threading.get_ident)
        assert second.result(10.0) != threading.get_ident()
        ready.set()
        assert first.result(10.0)
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(print)


def test_a_pool_does_all_that_is_handed_over_by_as_many_threads_as_it_has() -> None:
    threads: set[int] = set()
    both = threading.Barrier(2)

    def meet(number: int) -> int:
        threads.add(threading.get_ident())
        both.wait(10.0)
        return number

    with Pool(2) as pool:
        assert list(pool.map(meet, range(8))) == list(range(8))
    assert len(threads) == 2
    assert threading.get_ident() not in threads


def test_a_pool_says_what_went_wrong_and_leaves_the_rest() -> None:
    began, gate = threading.Event(), threading.Event()

    def fail() -> None:
        began.set()
        gate.wait(10.0)
        raise OSError("full")

    with Pool(1) as pool:
        failed, left = pool.submit(fail), pool.submit(print)
        assert began.wait(10.0)
        pool.shutdown(wait=False, cancel_futures=True)
        gate.set()
    with pytest.raises(OSError, match="full"):
        failed.result()
    assert left.cancelled()
