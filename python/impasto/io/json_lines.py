"""Journals: lines of JSON, each with a checksum of its own, so that a change is found.

A line is appended, and reaches the disk, after what it tells of did. What is torn off at the end of
the file was not finished: it is left out by readers, and cut off before the next line is written.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from impasto._internal.damage import DAMAGE
from impasto._internal.regular import content_of
from impasto.errors import CorruptInputError
from impasto.io.files import as_problem_of, sync_folder, sync_handle

CHECK = "crc"
"""Name of the checksum of a line, CRC-32 of what stands before it, closed by a brace."""


def crc_of(data: bytes | memoryview) -> str:
    """CRC-32 in eight hexadecimal digits."""
    return f"{zlib.crc32(data):08x}"


def sealed_line(content: Mapping[str, Any]) -> bytes:
    """One line with its checksum."""
    text = json.dumps(content, sort_keys=True)
    # Last, whatever the order of the names.
    return f'{text[:-1]}, "{CHECK}": "{crc_of(text.encode())}"}}\n'.encode()


def opened_line(line: bytes) -> dict[str, Any]:
    """What a line says, if it is as it was written.

    Raises
    ------
    ValueError, KeyError
        It is not.
    """
    content: dict[str, Any] = json.loads(line)
    del content[CHECK]
    if sealed_line(content) != line:
        raise ValueError("the checksum of the line does not agree")
    return content


def read_lines(path: Path, take: Callable[[dict[str, Any], bytes], None], advice: str = "") -> int:
    """Give the content of each whole line, and the line itself, to ``take``, in their order.

    Returns
    -------
    int
        Bytes of the file up to the end of its last whole line.

    Raises
    ------
    CorruptInputError
        A line that is not as it was written, or that ``take`` refuses; with its number, and
        ``advice`` after it. Or no file has this name, but a pipe, a folder or a device.
    FileNotFoundError
        There is no file.
    """
    data = content_of(path)
    whole = data[: data.rfind(b"\n") + 1]
    for number, line in enumerate(whole.splitlines(keepends=True), start=1):
        try:
            take(opened_line(line), line)
        except DAMAGE as error:
            raise CorruptInputError(path, f"is damaged in line {number}{advice}") from error
    return len(whole)


class JournalFile:
    """A journal that is being written; its file is open until :meth:`close`."""

    def __init__(self, path: Path, length: int, first: Mapping[str, Any]) -> None:
        """Go on after ``length`` bytes of whole lines, or begin with the line ``first``."""
        self.path = path
        self._length = length
        with as_problem_of(path):
            # Unbuffered: what a full disk refuses is not tried once more by the end of the file.
            self._file = path.open("ab", buffering=0)
        try:
            with as_problem_of(path):
                self._file.truncate(length)
                if not length:
                    self.append(first)
                sync_folder(path.parent)
        except BaseException:
            self._file.close()
            raise

    def append(self, content: Mapping[str, Any]) -> None:
        """Write one line; it is on the disk when this returns."""
        line = memoryview(sealed_line(content))
        with as_problem_of(self.path):
            # Whoever goes on after an error does not do so behind a torn line.
            self._file.truncate(self._length)
            left = line
            while left:
                left = left[self._file.write(left) :]
            self._length += len(line)
            sync_handle(self._file.fileno())

    def close(self) -> None:
        """Give the file back."""
        with as_problem_of(self.path):
            self._file.close()
