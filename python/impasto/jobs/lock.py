"""One job at a time in a folder."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from impasto._internal.regular import words_of
from impasto.errors import ArgumentError, CorruptInputError, ImpastoError
from impasto.io.files import as_problem_of

LOCK = "lock"
LONGEST = 300
"""Bytes of a lock that are read: the number of a process and the name of a machine."""
TRIES, PAUSE = 10, 0.05
"""Times, and seconds between them, that a lock is tried: :func:`holder` may have it for a moment.
"""


class Holder(NamedTuple):
    """A process that holds a lock: its number, 0 where that is not known, and its machine.

    The machine is None where it is this one, or not known.
    """

    process: int
    machine: str | None

    def __str__(self) -> str:
        where = f" on {self.machine}" if self.machine else ""
        return f"process {self.process or 'unknown'}{where}"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; it ends with the process, however that ends.

    Raises
    ------
    ArgumentError
        Another process holds it.
    CorruptInputError
        A pipe, a device or a socket has its name.
    ImpastoError
        The system has no such locks.
    """
    try:
        import fcntl
    except ImportError as error:
        raise ImpastoError("jobs need locks of POSIX systems, which this one has not") from error
    path, owner = folder / LOCK, os.getpid()
    with as_problem_of(path):
        handle = _opened(path, os.O_RDWR | os.O_CREAT)
    try:
        for last in (*[False] * TRIES, True):
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as error:
                if last:
                    raise ArgumentError(
                        f"out: {folder.parent} is in use by another job, {_written_in(handle)}; "
                        "wait for it, or end it and resume"
                    ) from error
                time.sleep(PAUSE)
            except OSError as error:
                raise ImpastoError(
                    f"out: the file system of {folder.parent} has no locks ({error.strerror}); "
                    "give a folder of a local disk"
                ) from error
        if not path.exists() or not os.path.samestat(os.fstat(handle), path.stat()):
            raise ArgumentError(f"out: another job has just ended in {folder.parent}; try again")
        try:
            with as_problem_of(path):
                os.truncate(handle, 0)
                os.pwrite(handle, f"{os.getpid()}\n{socket.gethostname()}\n".encode(), 0)
        except OSError:  # a full disk
            path.unlink(missing_ok=True)
            raise
        yield
    finally:
        # A process that was forked meanwhile has the lock, too, and may live on.
        if os.getpid() == owner:
            with suppress(OSError):
                fcntl.flock(handle, fcntl.LOCK_UN)
        os.close(handle)


def _opened(path: Path, flags: int) -> int:
    """The file of a lock; a pipe of its name is not waited for, a link not followed."""
    handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    if (kind := words_of(os.fstat(handle).st_mode)) is not None:
        os.close(handle)
        raise CorruptInputError(path, f"is {kind}, not a file; remove it")
    return handle


def _written_in(handle: int) -> Holder:
    """What a process has written into its lock."""
    lines = os.pread(handle, LONGEST, 0).decode(errors="replace").splitlines()
    number, machine = (*(line.strip() for line in lines), "", "")[:2]
    other = machine not in {"", socket.gethostname()}
    return Holder(int(number) if number.isdecimal() else 0, machine if other else None)


def release(folder: Path) -> None:
    """Remove the lock file of a finished store, if it is there.

    This is the last step of a process, after the store has got its name. Where it fails, the next
    call of that name does it.
    """
    with as_problem_of(folder / LOCK):
        (folder / LOCK).unlink(missing_ok=True)


def holder(folder: Path) -> Holder | None:
    """Who holds the lock of a folder; None if nobody does, or there are no locks here.

    Raises
    ------
    CorruptInputError
        A pipe, a folder, a device or a socket has the name of the lock.
    """
    try:
        import fcntl
    except ImportError:
        return None
    try:
        handle = _opened(folder / LOCK, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _written_in(handle)
    except OSError:  # nor on this file system
        return None
    finally:
        os.close(handle)
    return None
