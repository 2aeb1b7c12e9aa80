"""A tile of a map as the bytes of its file: the shard of the codec ``sharding_indexed`` of Zarr v3.

Inner chunks lie in it row by row, each followed by its CRC-32C; at the end stands an index of their
places and lengths with a CRC-32C of its own. The zarr library makes the same chunks, and reads what
is made here; it takes eight times as long for a tile of 12 MB, which was most of what a job cost
beside photometric stereo. The checksum is that of the library which zarr uses, too.
"""

from __future__ import annotations

import math
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
    *leading, height, width = part.shape
    across = tile // inner
    rows, columns = -(-height // inner), -(-width // inner)
    size = math.prod(leading) * inner * inner * part.dtype.itemsize
    index = np.full((across, across, 2), ABSENT, "<u8")
    places = (size + CHECKSUM) * np.arange(rows * columns, dtype="<u8").reshape(rows, columns)
    index[:rows, :columns, 0] = places
    index[:rows, :columns, 1] = size + CHECKSUM
    end = rows * columns * (size + CHECKSUM)
    file = np.empty(end + index.nbytes + CHECKSUM, np.uint8)
    for (row, column), place in np.ndenumerate(places):
        held = part[
            ...,
            row * inner : (row + 1) * inner,
            column * inner : (column + 1) * inner,
        ]
        start = int(place)
        chunk = file[start : start + size].view(part.dtype).reshape(*leading, inner, inner)
        if held.shape != chunk.shape:
            chunk[...] = fill
        chunk[..., : held.shape[-2], : held.shape[-1]] = held
        _check(file, start, start + size)
    file[end : end + index.nbytes] = index.reshape(-1).view(np.uint8)
    _check(file, end, end + index.nbytes)
    return file.data


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


def _check(file: NDArray[np.uint8], start: int, stop: int) -> None:
    """Put the checksum of some bytes behind them."""
    import google_crc32c

    found = np.array([google_crc32c.value(file[start:stop])], "<u4")
    file[stop : stop + CHECKSUM] = found.view(np.uint8)
