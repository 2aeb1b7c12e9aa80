"""Threads that begin, or say that they cannot.

``start`` of a thread of ``threading`` waits for ever where memory ends while the new thread is set
up (python/cpython#140746); so does ``submit`` of the pools of the standard library.
"""

from __future__ import annotations

import _thread
import weakref
from collections.abc import Callable

HEARTBEAT = 0.05
"""Seconds after which it is looked whether a thread that has not begun is still there."""


def start(work: Callable[[], object]) -> None:
    """Do this on a thread of its own, which has begun with it when this returns.

    ``work`` raises nothing: there is nobody to hear of it. A program that ends does not wait for
    the thread.

    Raises
    ------
    MemoryError
        The system gives no further thread, or one without memory to begin; nothing was done.
    """
    begun = _thread.allocate_lock()
    begun.acquire()

    def run(_: _Alive) -> None:
        begun.release()
        work()

    token = _Alive()
    alive = weakref.ref(token)
    try:
        _thread.start_new_thread(run, (token,))
    except RuntimeError as error:  # the system has no memory for its stack
        raise MemoryError(NO_THREAD) from error
    del token
    while not begun.acquire(timeout=HEARTBEAT):
        if alive() is None and not begun.acquire(blocking=False):
            raise MemoryError(NO_THREAD)


class _Alive:
    """Only a thread holds it: gone when the thread is, however that ended."""


NO_THREAD = "the system gives no further thread"
