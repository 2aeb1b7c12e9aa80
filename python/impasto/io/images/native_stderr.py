"""Capture the messages of C libraries about a damaged file, which only go to stderr."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

_STDERR = 2
NO_MEMORY = (
    b"[Ii]nsufficient memory|[Oo]ut of memory|[Nn]o space for|bad_alloc|unknown exception"
    b"|(?:[Ff]ailed|[Uu]nable|[Cc]annot) to allocate"
)
"""What libraries say of memory that runs out; OpenCV knows the exception of C++ by no name."""
_LOCK = Lock()
"""The descriptor is shared by the whole process: one decoder at a time."""


@contextmanager
def captured_lines(pattern: bytes) -> Iterator[list[str]]:
    """Collect the lines of the block's C code on stderr that hold ``pattern``.

    The list is filled when the block ends. All other output, of this thread or of others, goes
    to stderr.

    Parameters
    ----------
    pattern
        Regular expression of a part of a line.
    """
    found: list[str] = []
    with _LOCK, tempfile.TemporaryFile() as file:
        try:
            before = os.dup(_STDERR)
        except OSError:  # stderr is closed: there is nothing to give back
            before = -1
        os.dup2(file.fileno(), _STDERR)
        try:
            yield found
        finally:
            if before < 0:
                os.close(_STDERR)
            else:
                os.dup2(before, _STDERR)
                os.close(before)
            file.seek(0)
            lines = re.compile(rb"[^\n]*(?:" + pattern + rb")[^\n]*\n?")
            text = file.read()
            found += [line.decode("utf-8", "replace").strip() for line in lines.findall(text)]
            with suppress(OSError):
                os.write(_STDERR, lines.sub(b"", text))
