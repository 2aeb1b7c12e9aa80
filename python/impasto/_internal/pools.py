"""Threads that take what is handed to them in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures import wait as wait_for_all
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from threading import Event, Lock
from typing import Any, ParamSpec, TypeAlias, TypeVar

from impasto._internal.threads import start

Given = ParamSpec("Given")
Found = TypeVar("Found")
Task: TypeAlias = tuple[Future[Any], Callable[[], Any]]


class Pool(Executor):
    """A pool of threads like that of the standard library, but where memory is short.

    There :meth:`submit` raises ``MemoryError``, and waits for no thread that never begins.

    Parameters
    ----------
    threads
        At most; one is started when none is free for what is handed over.
    """

    def __init__(self, threads: int) -> None:
        self._most = threads
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self._ended: list[Future[None]] = []
        self._free = 0
        self._closed = False
        self._lock = Lock()

    def submit(
        self, fn: Callable[Given, Found], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Found]:
        """Hand something to the next thread that is free.

        Raises
        ------
        MemoryError
            The system gives no thread; nothing was handed over.
        RuntimeError
            The pool is shut down.
        """
        future: Future[Found] = Future()
        with self._lock:
            if self._closed:
                raise RuntimeError("the pool is shut down")
            if self._free:
                self._free -= 1
            elif len(self._ended) < self._most:
                ended: Future[None] = Future()
                start(lambda: self._work(ended))
                self._ended.append(ended)
            self._tasks.put((future, lambda: fn(*args, **kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take nothing more; threads end with what was handed over.

        Parameters
        ----------
        wait
            Whether to wait for that.
        cancel_futures
            Whether what no thread has begun is not done.
        """
        with self._lock:
            self._closed = True
            while cancel_futures:
                try:
                    task = self._tasks.get_nowait()
                except Empty:
                    break
                if task is not None:
                    task[0].cancel()
            for _ in self._ended:
                self._tasks.put(None)
        if wait:
            wait_for_all(self._ended)

    def _work(self, ended: Future[None]) -> None:
        try:
            while (task := self._tasks.get()) is not None:
                _do(*task)
                del task  # what it holds may be large
                with self._lock:
                    self._free += 1
        finally:
            ended.set_result(None)


def _do(future: Future[Any], act: Callable[[], Any]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    # Without memory to say what was found the thread goes on: others wait for what comes next.
    with suppress(MemoryError):
        try:
            found = act()
        except BaseException as error:
            future.set_exception(error)
        else:
            future.set_result(found)


class Stop:
    """Ends what another thread does, where that looks at it."""

    def __init__(self) -> None:
        self._stopped = Event()

    def set(self) -> None:
        """Nobody waits for what the other thread does any more."""
        self._stopped.set()

    def check(self) -> None:
        """Raise an error, which nobody sees, if that is so."""
        if self._stopped.is_set():
            raise _StoppedError


class _StoppedError(Exception):
    """Nobody waits for what this thread does."""


@contextmanager
def beside(work: Callable[[], Found], stop: Stop) -> Iterator[Future[Found]]:
    """Something on a thread of its own, which looks at ``stop``: an error of the block sets it."""
    with Pool(1) as pool:
        try:
            yield pool.submit(work)
        except BaseException:
            stop.set()
            raise
