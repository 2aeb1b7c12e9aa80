"""Steps that Python cannot interrupt, taken where Ctrl-C need not wait for them.

Python looks for Ctrl-C between its own steps, and a sort of megapixels, the decoding of a large
photograph or the flush of a disk is one step each. The numerics look for it themselves.
"""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import ParamSpec, TypeVar

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

    Returns
    -------
    Any
        What the step returns; what it raises is raised here.
    """
    if threading.current_thread() is not threading.main_thread():
        return step(*args, **options)  # signals come to the main thread only
    outcome: Future[Found] = Future()
    context = contextvars.copy_context()  # numpy's error state among others

    def work() -> None:
        try:
            outcome.set_result(context.run(step, *args, **options))
        except BaseException as error:
            outcome.set_exception(error)

    try:
        threading.Thread(target=work, name="impasto-step").start()
    except RuntimeError:  # the system has no memory for its stack
        return step(*args, **options)
    while True:
        try:
            return outcome.result(HEARTBEAT)
        except TimeoutError:
            if outcome.done():
                # At the last moment; or its own error.
                return outcome.result()


def floats(values: ArrayLike) -> NDArray[np.float32]:
    """An array in single precision, C-contiguous; borrowed if it is that already.

    A number alone becomes ``(1,)``.
    """
    found = np.asarray(values)
    if found.ndim and found.dtype == np.float32 and found.flags.c_contiguous:
        return found
    return wait_for(np.ascontiguousarray, found, dtype=np.float32)
