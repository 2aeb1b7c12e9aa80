"""The first minutes of a job: its folder is held from the first moment, photographs are hashed."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from impasto._internal.damage import DAMAGE
from impasto._internal.pools import Stop, beside
from impasto._internal.regular import content_of
from impasto.errors import ArgumentError
from impasto.io.files import as_problem_of
from impasto.jobs.folder import (
    NOTES,
    READING,
    RECORD,
    check_own,
    partial_of,
    remove_unfinished,
)
from impasto.jobs.lock import LOCK, locked
from impasto.jobs.memory import keep_memory
from impasto.jobs.photographs import Photographs

OFTEN = 0.5
"""Seconds after which it is written down how much has been read."""

Done = TypeVar("Done")


class Beginning:
    """The folder of a job, which this process holds; :func:`held` makes it.

    Parameters
    ----------
    target
        The store, as it will be called. A finished one is held by nobody.
    """

    def __init__(self, target: Path) -> None:
        self._target = target
        self._partial = partial_of(target)
        self._notes = self._partial / NOTES
        self._lock = ExitStack()
        self._there = False  # the folder, until it is discarded
        self._holds = False
        self._stop = Stop()
        self._last = float("-inf")

    def take(self) -> None:
        """Make the folder if there is none, and lock it.

        Raises
        ------
        ArgumentError
            Another process holds it, or has just finished the store; the folder has links.
        """
        if self._target.exists():
            return
        check_own(self._partial)
        self._there = True
        try:
            self._notes.mkdir(parents=True, exist_ok=True)
            self._lock.enter_context(locked(self._notes))
            self._holds = True
            if self._target.exists():
                raise ArgumentError(f"out: {self._target} has just been made by another job")
            with as_problem_of(self._notes / READING):
                (self._notes / READING).write_bytes(b"")
        except BaseException:
            self.leave()
            raise

    def anew(self) -> None:
        """Remove what an earlier run has left, which is not to go on."""
        if self._holds and (self._notes / RECORD).exists():
            self.discard()
            self.take()

    def keep_memory(self, memory: int) -> None:
        """Keep the bytes that a job which goes on may take: an error or Ctrl-C may come at once."""
        if self._holds and (self._notes / RECORD).exists():
            keep_memory(self._notes, memory)

    def discard(self) -> None:
        """Remove the folder with all that is in it; the lock ends with it.

        From then on what has its name is of another process.
        """
        remove_unfinished(self._partial)
        self._there = self._holds = False
        self._lock.close()

    def leave(self) -> None:
        """After an error: of a job that has no record yet nothing is left; the lock ends."""
        with suppress(OSError):
            if self._there:
                self._remove_traces()
        self._lock.close()

    def _remove_traces(self) -> None:
        if self._holds:
            (self._notes / READING).unlink(missing_ok=True)
        if not (self._notes / RECORD).exists():
            if self._holds:
                (self._notes / LOCK).unlink(missing_ok=True)
            self._notes.rmdir()  # refuses where anything is in it
            if not self._partial.is_symlink():
                self._partial.rmdir()

    def close(self) -> None:
        """End the lock."""
        self._lock.close()

    def hashes(self, photographs: Photographs) -> list[dict[str, Any]]:
        """Name, size and SHA-256 of what is read; how far that is stands in the folder."""
        found = photographs.hashed(self._report)
        if self._holds:
            with as_problem_of(self._notes / READING):
                (self._notes / READING).unlink(missing_ok=True)
        return found

    def beside(self, work: Callable[[], Done]) -> AbstractContextManager[Future[Done]]:
        """Something on a thread of its own, such as :meth:`hashes`, which an error here ends."""
        return beside(work, self._stop)

    def _report(self, done: int, total: int) -> None:
        self._stop.check()
        now = time.monotonic()
        if self._holds and now - self._last > OFTEN:
            self._last = now
            line = json.dumps({"bytes": done, "of": total}, sort_keys=True)
            path = self._notes / READING
            with as_problem_of(path), path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")


@contextmanager
def held(target: Path) -> Iterator[Beginning]:
    """Hold the folder of a job, so that others see it, until the block ends.

    A block that ends in an error before there is a record leaves nothing behind.

    Raises
    ------
    ArgumentError
        Another process holds it.
    """
    own = Beginning(target)
    own.take()
    try:
        yield own
    except BaseException:
        own.leave()
        raise
    own.close()


def bytes_read(notes: Path) -> tuple[int, int] | None:
    """How many bytes of how many have been hashed; None where nobody reads, or has said so.

    Raises
    ------
    CorruptInputError
        A pipe, a folder, a device or a socket has the name of the file.
    """
    try:
        lines = content_of(notes / READING).splitlines()
    except OSError:
        return None
    for line in reversed(lines):
        with suppress(*DAMAGE):  # the last one is being written
            entry = json.loads(line)
            return int(entry["bytes"]), int(entry["of"])
    return None
