"""A tile of a map as the bytes of its file: the shard of the codec ``sharding_indexed`` of Zarr v3.

Inner chunks lie in it row by row, each followed by its CRC-32C; at the end stands an index of their
places and lengths with a CRC-32C of its own. The zarr library makes the same chunks, and reads what
is made here; it takes eight times as long for a tile of 12 MB, which was most of what a job cost
beside photometric stereo. The checksum is that of the library which zarr uses, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ABSENT = 2**64 - 1
"""Place and length of an inner chunk that a shard does not hold."""
CHECKSUM = 4
"""Bytes of a CRC-32C."""


def shard_of(part: NDArray[Any], tile: int, inner: int, fill: Any) -> memoryview:
    """The file of a tile.

    Parameters
    ----------
    part
        Numbers ``(..., y, x)`` of the tile, fewer than ``tile`` rows and columns at the edge of the
        map. Their byte order is kept; stores say little.
    tile, inner
        Rows and columns of the tile and of its chunks.
    fill
        What a chunk holds beyond the edge. Chunks that lie there as a whole are absent.
    """
    layout = _Layout(part, tile, inner, fill)
    file = np.empty(layout.end + layout.index_bytes, np.uint8)
    for number in range(layout.count):
        start = number * layout.chunk_bytes
        layout.fill_chunk(file[start : start + layout.chunk_bytes], number)
    layout.fill_index(file[layout.end :])
    return file.data


def shard_pieces(part: NDArray[Any], tile: int, inner: int, fill: Any) -> Iterator[memoryview]:
    """The same file, chunk after chunk: a large one need not be in memory, nor leave the cache.

    Each piece is gone when the next one is asked for.
    """
    layout = _Layout(part, tile, inner, fill)
    chunk = np.empty(layout.chunk_bytes, np.uint8)
    for number in range(layout.count):
        layout.fill_chunk(chunk, number)
        yield chunk.data
    index = np.empty(layout.index_bytes, np.uint8)
    layout.fill_index(index)
    yield index.data


class _Layout:
    """Where the chunks of a tile lie in its file."""

    def __init__(self, part: NDArray[Any], tile: int, inner: int, fill: Any) -> None:
        *leading, height, width = part.shape
        self._part, self._inner, self._fill = part, inner, fill
        self._shape = *leading, inner, inner
        self._across = tile // inner
        self._grid = -(-height // inner), -(-width // inner)
        self.count = math.prod(self._grid)
        self._size = math.prod(self._shape) * part.dtype.itemsize
        self.chunk_bytes = self._size + CHECKSUM
        self.end = self.count * self.chunk_bytes
        self.index_bytes = 16 * self._across**2 + CHECKSUM

    def fill_chunk(self, into: NDArray[np.uint8], number: int) -> None:
        """The numbers of a chunk, counted row by row, and their checksum."""
        inner = self._inner
        row, column = divmod(number, self._grid[1])
        held = self._part[
            ...,
            row * inner : (row + 1) * inner,
            column * inner : (column + 1) * inner,
        ]
        chunk = into[: self._size].view(self._part.dtype).reshape(self._shape)
        if held.shape != chunk.shape:
            chunk[...] = self._fill
        chunk[..., : held.shape[-2], : held.shape[-1]] = held
        _check(into)

    def fill_index(self, into: NDArray[np.uint8]) -> None:
        """Place and length of every chunk, and their checksum."""
        rows, columns = self._grid
        index = np.full((self._across, self._across, 2), ABSENT, "<u8")
        places = self.chunk_bytes * np.arange(self.count, dtype="<u8").reshape(rows, columns)
        index[:rows, :columns, 0] = places
        index[:rows, :columns, 1] = self.chunk_bytes
        into[:-CHECKSUM] = index.reshape(-1).view(np.uint8)
        _check(into)


def missing_chunks(path: Path, across: int, rows: slice, columns: slice) -> int:
    """How many inner chunks a shard does not hold.

    Other readers take what is missing for fill values, without a word.

    Parameters
    ----------
    path
        The file.
    across
        Chunks along a side of the tile.
    rows, columns
        The chunks that count.
    """
    index_bytes = 16 * across * across
    size = path.stat().st_size
    if size < index_bytes + CHECKSUM:
        return across * across
    with path.open("rb") as file:
        file.seek(-index_bytes - CHECKSUM, 2)
        index = np.frombuffer(file.read(index_bytes), "<u8").reshape(across, across, 2)
    places, lengths = np.moveaxis(index[rows, columns], -1, 0)
    lost = (places == ABSENT) | (lengths == ABSENT) | (places > size) | (lengths > size)
    return int(np.count_nonzero(lost))


def crc32c(data: NDArray[np.uint8]) -> int:
    """The checksum of some bytes."""
    import google_crc32c

    return int(google_crc32c.value(data))


def _check(file: NDArray[np.uint8]) -> None:
    """Put the checksum of all bytes but the last four into these."""
    file[-CHECKSUM:] = np.array([crc32c(file[:-CHECKSUM])], "<u4").view(np.uint8)
