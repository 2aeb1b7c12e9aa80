"""Steps that Python cannot interrupt, taken where Ctrl-C need not wait for them.

Python looks for Ctrl-C between its own steps, and a sort of megapixels, the decoding of a large
photograph or the flush of a disk is one step each. The numerics look for it themselves, but in
calls on few samples.
"""

from __future__ import annotations

import atexit
import contextvars
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import share_threads
from impasto._internal.casts import contiguous
from impasto._internal.pools import Pool
from impasto._internal.threads import start

Given = ParamSpec("Given")
Item = TypeVar("Item")
Found = TypeVar("Found")

HEARTBEAT = 0.05
"""Seconds after which a wait begins anew: there are systems whose waits no signal ends."""
BRIEF = 1 << 16
"""Samples that are copied sooner than a thread is started."""


def wait_for(step: Callable[Given, Found], *args: Given.args, **options: Given.kwargs) -> Found:
    """``step(*args, **options)`` on a thread of its own, which Ctrl-C leaves to itself at once.

    The step then goes on to its end with nobody to read what it finds: it must neither write to
    what others hold nor call the numerics, which listen to the thread that was asked for them. A
    program that ends waits for it. Where no thread can be started, the caller's takes the step.

    Returns
    -------
    Any
        What the step returns; what it raises is raised here.
    """
    if threading.get_ident() != threading.main_thread().ident:
        return step(*args, **options)  # signals come to the main thread only
    outcome: Future[Found] = Future()
    context = contextvars.copy_context()  # numpy's error state among others
    ended = False

    def work() -> None:
        nonlocal ended
        try:
            outcome.set_result(context.run(step, *args, **options))
        except BaseException as error:
            outcome.set_exception(error)
        finally:
            ended = True
            _UNDER_WAY.discard(outcome)

    _UNDER_WAY.add(outcome)
    try:
        start(work)
    except MemoryError:
        _UNDER_WAY.discard(outcome)
        return step(*args, **options)
    while True:
        try:
            return outcome.result(HEARTBEAT)
        except TimeoutError:
            over = ended
            if outcome.done():
                # At the last moment; or its own error.
                return outcome.result()
            if over:  # without memory to say what it found
                raise MemoryError from None


def wait_for_each(
    step: Callable[[Item], Found],
    items: Sequence[Item],
    threads: int,
    after: Callable[[], object] | None = None,
) -> list[Found]:
    """``step`` of every item, on at most so many threads at once; Ctrl-C leaves them to themselves.

    Unlike those of :func:`wait_for` the steps may call the numerics, which then do not hear of
    Ctrl-C: it is for steps as short as the fit of a small sample. After Ctrl-C, or an error of one
    of them, those that have begun go on to their end, and no other begins. The steps share the
    threads (:func:`~impasto._internal.calls.thread_count`). On one thread, or where none can be
    started, the caller takes all steps. ``after`` is called by the caller after each of them.

    Returns
    -------
    list
        What the steps return, in the order of the items; of what they raise, the first is raised.
    """
    found: list[Found] = []

    def add(one: Found) -> None:
        found.append(one)
        if after is not None:
            after()

    if threads < 2 or len(items) < 2:
        for item in items:
            add(step(item))
        return found
    workers = min(threads, len(items))
    pool = Pool(workers)
    try:
        handed = [_handed(pool, workers, step, item) for item in items]
        for item, one in zip(items, handed, strict=True):
            add(step(item) if one is None else one.awaited())
        return found
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _handed(
    pool: Pool, workers: int, step: Callable[[Item], Found], item: Item
) -> _Handed[Found] | None:
    """The step on one of the pool's threads; None where the system gives none."""
    context = contextvars.copy_context()  # numpy's error state among others
    context.run(share_threads, workers)
    with suppress(MemoryError):
        return _Handed(pool, lambda: context.run(step, item))
    return None


class _Handed(Generic[Found]):
    """A step that a thread of a pool takes."""

    def __init__(self, pool: Pool, step: Callable[[], Found]) -> None:
        self._outcome: Future[Found] = Future()
        self._ended = False
        _UNDER_WAY.add(self._outcome)
        try:
            task = pool.submit(self._take, step)
        except BaseException:
            _UNDER_WAY.discard(self._outcome)
            raise
        task.add_done_callback(self._forget)

    def _take(self, step: Callable[[], Found]) -> None:
        try:
            self._outcome.set_result(step())
        except BaseException as error:
            self._outcome.set_exception(error)
        finally:
            self._ended = True

    def _forget(self, _: Future[None]) -> None:
        """It has ended, or never begins."""
        _UNDER_WAY.discard(self._outcome)

    def awaited(self) -> Found:
        """What the step returns; what it raises is raised here."""
        while True:
            try:
                return self._outcome.result(HEARTBEAT)
            except TimeoutError:
                over = self._ended
                if self._outcome.done():
                    # At the last moment; or its own error.
                    return self._outcome.result()
                if over:  # without memory to say what it found
                    raise MemoryError from None


_UNDER_WAY: set[Future[Any]] = set()


@atexit.register
def _wait_for_all() -> None:
    wait(list(_UNDER_WAY))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_UNDER_WAY.clear)


def floats(values: ArrayLike) -> NDArray[np.float32]:
    """An array in single precision as of :func:`contiguous`; borrowed if it is that already."""
    found = np.asarray(values)
    if found.ndim and found.dtype == np.float32 and found.flags.c_contiguous:
        return found
    return wait_for(contiguous, found, np.float32)
