"""Steps that Python cannot interrupt, taken where Ctrl-C need not wait for them.

Python looks for Ctrl-C between its own steps, and a sort of megapixels, the decoding of a large
photograph or the flush of a disk is one step each. The numerics look for it themselves.
"""

from __future__ import annotations

import _thread
import atexit
import contextvars
import os
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Given = ParamSpec("Given")
Found = TypeVar("Found")

HEARTBEAT = 0.05
"""Seconds after which a wait begins anew: there are systems whose waits no signal ends."""


def wait_for(step: Callable[Given, Found], *args: Given.args, **options: Given.kwargs) -> Found:
    """``step(*args, **options)`` on a thread of its own, which Ctrl-C leaves to itself at once.

    The step then goes on to its end with nobody to read what it finds: it must neither write to
    what others hold nor call the numerics, which listen to the thread that was asked for them. A
    program that ends waits for it. Where no thread can be started, the caller's takes the step.

    The thread is none of ``threading``: the ``start`` of those waits for ever where memory ends
    while the new thread is set up (python/cpython#140746).

    Returns
    -------
    Any
        What the step returns; what it raises is raised here.
    """
    if threading.get_ident() != threading.main_thread().ident:
        return step(*args, **options)  # signals come to the main thread only
    outcome: Future[Found] = Future()
    context = contextvars.copy_context()  # numpy's error state among others
    begun = ended = False

    def work(_: _Alive) -> None:
        nonlocal begun, ended
        begun = True
        try:
            outcome.set_result(context.run(step, *args, **options))
        except BaseException as error:
            outcome.set_exception(error)
        finally:
            ended = True
            _UNDER_WAY.discard(outcome)

    token = _Alive()
    alive = weakref.ref(token)
    _UNDER_WAY.add(outcome)
    try:
        _thread.start_new_thread(work, (token,))
    except RuntimeError:  # the system has no memory for its stack
        _UNDER_WAY.discard(outcome)
        return step(*args, **options)
    del token
    while True:
        try:
            return outcome.result(HEARTBEAT)
        except TimeoutError:
            over = ended or alive() is None
            if outcome.done():
                # At the last moment; or its own error.
                return outcome.result()
            if over:
                break
    # The thread had no memory to begin with, or none to say what it found.
    _UNDER_WAY.discard(outcome)
    if begun:
        raise MemoryError
    return step(*args, **options)


class _Alive:
    """Only a thread holds it: gone when the thread is, however that ended."""


_UNDER_WAY: set[Future[Any]] = set()


@atexit.register
def _wait_for_all() -> None:
    wait(list(_UNDER_WAY))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_UNDER_WAY.clear)


def floats(values: ArrayLike) -> NDArray[np.float32]:
    """An array in single precision, C-contiguous; borrowed if it is that already.

    A number alone becomes ``(1,)``.
    """
    found = np.asarray(values)
    if found.ndim and found.dtype == np.float32 and found.flags.c_contiguous:
        return found
    return wait_for(np.ascontiguousarray, found, dtype=np.float32)
