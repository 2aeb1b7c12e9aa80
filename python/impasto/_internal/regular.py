"""A regular file, read at any place; everything else that a path may name is refused at once."""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError, CorruptInputError

Opened = TypeVar("Opened", bound=io.FileIO)
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)
_NARROW = 4
"""A row of which less than a quarter is wanted is read alone."""
_AT_ONCE = 1 << 24
"""Bytes that are read together where only some are wanted."""


class Handle(io.FileIO):
    """Remembers that the system did not give what was asked for.

    Libraries that read by it may take that for damage, or leave out what they could not read.
    """

    failure: OSError | None = None

    def read(self, size: int | None = -1, /) -> bytes:  # noqa: D102
        try:
            return super().read(size)
        except OSError as error:
            self.failure = error
            raise

    def readinto(self, buffer: Any, /) -> int:  # noqa: D102
        try:
            return super().readinto(buffer)
        except OSError as error:
            self.failure = error
            raise


class RegularFile:
    """An open file; positions can be read from several threads.

    Plain reads, no memory map: a map whose file shrinks or whose disk fails ends the process.

    Raises
    ------
    ArgumentError
        There is none, or the path names a folder, a pipe or a device.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            found = _opened(path, Handle)
        except OSError as error:
            raise unreadable(path, error) from error
        if isinstance(found, str):
            raise _no_file(path, found)
        self.handle = found
        self.size = os.fstat(self.handle.fileno()).st_size
        self._lock = Lock()

    def content(self) -> bytes:
        """The whole file."""
        return self.at(0, self.size)

    def at(self, offset: int, count: int) -> bytes:
        """``count`` bytes from ``offset`` on."""
        if offset < 0 or count < 0 or offset + count > self.size:
            raise self._truncated()
        with self._lock:
            try:
                self.handle.seek(offset)
                found = self.handle.read(count)
                while len(found) < count:  # the system reads 2 GiB at most at once
                    more = self.handle.read(count - len(found))
                    if not more:
                        raise self._truncated()
                    found += more
            except OSError as error:
                raise unreadable(self.path, error) from error
        return found

    def rows(self, offset: int, stride: int, count: int, length: int) -> NDArray[np.uint8]:
        """``(count, length)`` bytes: of each row of ``stride`` bytes the first ``length``."""
        found = np.empty((count, length), np.uint8)
        if length == stride:
            self.fill(offset, found.reshape(-1))
        elif length * _NARROW < stride:
            for index, row in enumerate(found):
                self.fill(offset + index * stride, row)
        else:
            block = max(1, _AT_ONCE // stride)
            for first in range(0, count, block):
                rows = found[first : first + block]
                whole = np.empty((len(rows) - 1) * stride + length, np.uint8)
                self.fill(offset + first * stride, whole)
                rows[:] = np.lib.stride_tricks.as_strided(whole, rows.shape, (stride, 1))
        return found

    @contextmanager
    def given_to_a_library(self) -> Iterator[None]:
        """A block in which a library reads by the handle.

        Raises
        ------
        ArgumentError
            The system did not give all that was asked for, whatever the library made of it.
        """
        try:
            yield
        finally:
            if self.handle.failure is not None:
                raise unreadable(self.path, self.handle.failure) from self.handle.failure

    def close(self) -> None:
        """Close the file."""
        self.handle.close()

    def fill(self, offset: int, target: NDArray[np.uint8]) -> None:
        """Bytes from ``offset`` on, as many as the target has: contiguous, filled by this."""
        view, at = target.data, 0
        with self._lock:
            try:
                self.handle.seek(offset)
                while at < len(view):
                    got = self.handle.readinto(view[at:])
                    if not got:
                        raise self._truncated()
                    at += got
            except OSError as error:
                raise unreadable(self.path, error) from error

    def _truncated(self) -> CorruptInputError:
        return CorruptInputError(
            self.path,
            "is truncated: the file ends inside the pixels; copy it again from the camera",
        )


def unreadable(path: Path, error: OSError) -> ArgumentError:
    """The error of a file that the system does not give."""
    return ArgumentError(f"{path}: cannot be read ({error.strerror or error})")


def check_regular(path: Path) -> None:
    """Refuse a path that names something else than a file, without opening it.

    Whether there is anything at all is left to whoever opens it.

    Raises
    ------
    ArgumentError
        A folder, a pipe, a device or a socket, or a name that no file can have.
    """
    if (kind := kind_of(path)) is not None:
        raise _no_file(path, kind)


def content_of(path: Path) -> bytes:
    """All of a file that impasto wrote itself, such as a note of a job.

    Raises
    ------
    CorruptInputError
        Something else has its name: a folder, a pipe, a device or a socket.
    OSError
        The system does not give it, or there is none.
    """
    found = _opened(path, io.FileIO)
    if isinstance(found, str):
        raise CorruptInputError(path, f"is {found}, not a file; remove it")
    with found:
        return found.readall()


def kind_of(path: Path) -> str | None:
    """What a path names that is no file, in words; None: a file, or nothing."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return None
    except ValueError as error:
        raise ArgumentError(f"{path}: is no name of a file: it contains a NUL character") from error
    return words_of(mode)


def _opened(path: Path, of: Callable[..., Opened]) -> Opened | str:
    """The file, opened by this class, or in words what else the path names."""
    if (kind := kind_of(path)) is not None:
        return kind
    # Whatever takes the place of the file in between is opened without waiting for a writer.
    extra = getattr(os, "O_NONBLOCK", 0)
    handle = of(path, "rb", opener=lambda name, flags: os.open(name, flags | extra))
    if (kind := words_of(os.fstat(handle.fileno()).st_mode)) is not None:
        handle.close()
        return kind
    return handle


def words_of(mode: int) -> str | None:
    """What something with this mode is, in words; None: a file."""
    return next((words for has_kind, words in _KINDS if has_kind(mode)), None)


def _no_file(path: Path, kind: str) -> ArgumentError:
    return ArgumentError(f"{path}: is {kind}, not a file; give the name of a file")
