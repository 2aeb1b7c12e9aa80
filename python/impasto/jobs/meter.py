"""How many bytes of some files have been read."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from time import monotonic

from impasto._internal.calls import ProgressCallback

OFTEN = 0.05
"""Seconds after which a callback is called again."""


class Meter:
    """Reports the sizes of files that have been read, in bytes, to a callback ``(done, total)``.

    Parameters
    ----------
    callback
        None: nobody asks.
    """

    def __init__(self, callback: ProgressCallback | None) -> None:
        self._callback = callback
        self._sizes: dict[Path, int] = {}
        self._done = self._total = 0
        self._last = float("-inf")

    def begin(self, files: Iterable[Path]) -> None:
        """These are to be read; those that are not there count nothing."""
        self._sizes, self._done = {}, 0
        if self._callback is None:
            return
        for file in files:
            with suppress(OSError):
                if size := file.stat().st_size:
                    self._sizes[file] = size
        self._total = sum(self._sizes.values())
        self._callback(0, self._total)

    def read(self, file: Path) -> None:
        """One of them has been read."""
        if self._callback is not None and (size := self._sizes.pop(file, 0)):
            self._done += size
            now = monotonic()
            if now - self._last >= OFTEN or not self._sizes:
                self._last = now
                self._callback(self._done, self._total)
