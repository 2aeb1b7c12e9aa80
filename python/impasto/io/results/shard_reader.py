"""A window of a map out of the files of its tiles, each chunk compared with its checksum.

The layout is that of :mod:`~impasto.io.results.shards`. The zarr library reads it as well; for a
tile of 100 MB, which a job reads whole, it takes three times the processor time of this.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.regular import RegularFile
from impasto._internal.windows import Window, overlap
from impasto.errors import CorruptInputError
from impasto.io.results.shards import ABSENT, CHECKSUM, crc32c


@dataclass(frozen=True)
class ShardLayout:
    """How the numbers of a tile lie in its file.

    Attributes
    ----------
    leading
        The axes before rows and columns.
    dtype
        Of a number.
    tile, inner
        Rows and columns of the tile and of its chunks.
    """

    leading: tuple[int, ...]
    dtype: np.dtype[Any]
    tile: int
    inner: int

    @property
    def _chunk(self) -> tuple[int, ...]:
        return *self.leading, self.inner, self.inner

    @property
    def _bytes(self) -> int:
        return math.prod(self._chunk) * self.dtype.itemsize

    @property
    def _across(self) -> int:
        return self.tile // self.inner

    def read(self, path: Path, window: Window, out: NDArray[Any], stride: int = 1) -> None:
        """Fill what ``out (..., y, x)`` has of the tile.

        Parameters
        ----------
        path
            The file.
        window
            Rows and columns of the map, counted from those of the tile: it may reach beyond.
        out
            For every so many rows and columns of the window, from its first on.

        Raises
        ------
        CorruptInputError
            A chunk that the window touches is missing, or its checksum does not agree.
        """
        stored = np.empty(self._bytes + CHECKSUM, np.uint8)
        # Bytes above 1 are no truth values.
        dtype = np.dtype(np.uint8) if self.dtype.kind == "b" else self.dtype.newbyteorder("<")
        chunk = stored[: self._bytes].view(dtype).reshape(self._chunk)
        every = slice(0, self.tile), slice(0, self.tile)
        with closing(RegularFile(path)) as file:
            for place, at in self._places(file, overlap(window, every)):
                file.fill(at, stored)
                if crc32c(stored[:-CHECKSUM]) != int(stored[-CHECKSUM:].view("<u4")[0]):
                    raise CorruptInputError(path, "is damaged: the checksum of a chunk is another")
                pairs = [_steps(*sides, stride) for sides in zip(place, window, strict=True)]
                taken, into = zip(*pairs, strict=True)
                if self.dtype.kind == "b":
                    np.not_equal(chunk[..., *taken], 0, out=out[..., *into])
                else:
                    out[..., *into] = chunk[..., *taken]

    def checksums(self, path: Path, window: Window, *, compare: bool) -> str:
        """SHA-256, in hexadecimal digits, of the CRC-32C of the chunks that a window touches.

        Parameters
        ----------
        compare
            Whether the chunks are read, too; else only what the file says of them, which
            :meth:`read` compares.

        Raises
        ------
        CorruptInputError
            A chunk is missing, or its checksum does not agree.
        """
        found, one = hashlib.sha256(), np.empty(CHECKSUM, np.uint8)
        stored = np.empty(self._bytes + CHECKSUM if compare else 0, np.uint8)
        with closing(RegularFile(path)) as file:
            for _, at in self._places(file, window):
                if compare:
                    file.fill(at, stored)
                    one[:] = np.array([crc32c(stored[:-CHECKSUM])], "<u4").view(np.uint8)
                else:
                    file.fill(at + self._bytes, one)
                found.update(one.data)
        return found.hexdigest()

    def _places(self, file: RegularFile, window: Window) -> Iterator[tuple[Window, int]]:
        """Every chunk that a window of the tile touches, and where it begins in the file."""
        index = self._index(file)
        rows, columns = (
            range(side.start // self.inner, -(-side.stop // self.inner)) for side in window
        )
        for row in rows:
            for column in columns:
                start, length = (int(number) for number in index[row, column])
                if ABSENT in (start, length):
                    raise CorruptInputError(file.path, "is truncated: it lacks chunks")
                if length != self._bytes + CHECKSUM or start + length > file.size:
                    raise CorruptInputError(file.path, "is damaged: a chunk has another place")
                place = (
                    slice(row * self.inner, (row + 1) * self.inner),
                    slice(column * self.inner, (column + 1) * self.inner),
                )
                yield place, start

    def _index(self, file: RegularFile) -> NDArray[np.uint64]:
        size = 16 * self._across**2
        if file.size < size + CHECKSUM:
            raise CorruptInputError(file.path, "is truncated: it lacks chunks")
        found = np.empty(size + CHECKSUM, np.uint8)
        file.fill(file.size - len(found), found)
        if crc32c(found[:size]) != int(found[size:].view("<u4")[0]):
            raise CorruptInputError(file.path, "is damaged: the checksum of its index is another")
        return found[:size].view("<u8").reshape(self._across, self._across, 2)


def _steps(chunk: slice, window: slice, stride: int) -> tuple[slice, slice]:
    """Which rows of a chunk are every so many of a window, and which of these they are."""
    start, stop = max(chunk.start, window.start), min(chunk.stop, window.stop)
    first = -(-(start - window.start) // stride)
    end = -(-(stop - window.start) // stride)
    at = window.start + first * stride - chunk.start
    return slice(at, stop - chunk.start, stride), slice(first, end)
