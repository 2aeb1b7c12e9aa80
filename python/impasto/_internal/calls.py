"""What calls have in common: ``threads=``, ``progress=``, and the parameters of another call."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from inspect import signature
from typing import Any, ParamSpec, TypeAlias, TypeVar

from impasto._internal.checks import is_whole
from impasto.errors import ArgumentError

ProgressCallback: TypeAlias = Callable[[int, int], object]
"""Called with (done, total), in tiles unless a call says otherwise.

At most about twenty times a second; by a call on few samples once, at its end.
"""

MOST_THREADS = 64

_SHARED = ContextVar("_SHARED", default=1)
"""How many steps share the threads of a call: they are taken side by side."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


def with_parameters_of(
    other: Callable[_P, object],
) -> Callable[[Callable[..., _R]], Callable[_P, _R]]:
    """Decorate a function that hands all its arguments on to another one.

    Type checkers, ``help()`` and the documentation show the other's parameters and defaults, so
    that they are written down once.
    """

    def decorated(function: Any) -> Callable[_P, _R]:
        own = function.__annotations__["return"]
        function.__signature__ = signature(other).replace(return_annotation=own)
        function.__annotations__ = {**other.__annotations__, "return": own}
        shown: Callable[_P, _R] = function
        return shown

    return decorated


def thread_count(threads: int | None) -> int:
    """How many threads a call may use.

    The argument, else ``IMPASTO_NUM_THREADS``, else ``RAYON_NUM_THREADS``, else every core that
    this process is allowed to run on. Results do not depend on it: a request for more than
    :data:`MOST_THREADS` on a smaller machine, which would only stand in its own way, gets those.
    Steps that are taken side by side have one each where there are not two for each of them; else
    all have all, and take turns: one pool serves all calls of as many threads.
    """
    count, steps = _thread_count(threads), _SHARED.get()
    return count if steps == 1 or count >= 2 * steps else 1


def share_threads(steps: int) -> None:
    """In this context, so many steps side by side share the threads."""
    _SHARED.set(_SHARED.get() * steps)


def _thread_count(threads: int | None) -> int:
    if threads is not None:
        if not (is_whole(threads) and threads >= 1):
            raise ArgumentError(f"threads: expected a positive number or None, found {threads!r}")
        return _limited(int(threads))
    for variable in ("IMPASTO_NUM_THREADS", "RAYON_NUM_THREADS"):
        text = os.environ.get(variable, "")
        if text:
            if not text.isdecimal() or int(text) < 1:
                raise ArgumentError(f"{variable}: expected a positive number, found {text!r}")
            return _limited(int(text))
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _limited(threads: int) -> int:
    if threads <= MOST_THREADS:  # most calls; the number of cores is read from a file
        return threads
    return min(threads, max(MOST_THREADS, os.cpu_count() or 1))


@contextmanager
def reporting(
    progress: bool | ProgressCallback, description: str, *, whole: bool = False
) -> Iterator[ProgressCallback | None]:
    """The callback that ``progress=`` asks for: none, a bar on stderr, or the caller's own.

    A bar is gone when the block ends, however it ends. It says how much time is left where the
    first total counts the ``whole`` work.
    """
    check_progress(progress)
    if progress is False or progress is None:
        yield None
    elif callable(progress):
        yield progress
    else:
        with _bar(description, whole) as update:
            yield update


def check_progress(progress: bool | ProgressCallback | None) -> None:
    """Refuse what is neither True, False nor a callable; None counts as False."""
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise ArgumentError(
            f"progress: expected True, False or a callable (done, total), found {progress!r}"
        )


@contextmanager
def _bar(description: str, whole: bool) -> Iterator[ProgressCallback]:
    """A bar on stderr that starts with the first call and is gone at the end; none in a log."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    from impasto._internal.bars import Remaining

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), Remaining())
    display = Progress(*columns, console=console, transient=True)
    task = display.add_task(description, total=None, whole=whole)

    def update(done: int, total: int) -> None:
        if not display.live.is_started:
            display.start()
        display.update(task, completed=done, total=total)

    try:
        yield update
    finally:
        display.stop()
