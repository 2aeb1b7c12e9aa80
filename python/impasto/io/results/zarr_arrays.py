"""Arrays of a Zarr v3 store as the bytes of their files.

Maps ``(..., y, x)`` are cut into square tiles. A tile is a shard, one file; it holds small inner
chunks that can be read alone, each with a checksum (crc32c). Nothing is compressed: noise hardly
shrinks. The files are made in memory, so that whoever writes them decides where and how safely:
shards by :mod:`~impasto.io.results.shards`, all else by the zarr library.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.extras import need
from impasto._internal.windows import Window, within
from impasto.io.results.shard_reader import ShardLayout
from impasto.io.results.shards import missing_chunks, shard_of, shard_pieces

TILE = 1024
"""Rows and columns of a tile, if nobody says otherwise: 4 MiB of a map in single precision."""
CHUNK = 1 << 20
"""Bytes of an inner chunk, about. The zarr library takes some 0.2 ms of processor time for each,
whatever its size: with chunks of 128 x 128 pixels that was more than photometric stereo takes."""
INNER = 128
"""Rows and columns of an inner chunk at least, unless the tile is smaller: of many planes a detail
reads more than a megabyte."""
LEAST_INNER = 32
"""Fewest rows and columns of an inner chunk where no divisor of the tile is near."""
METADATA = "zarr.json"
"""The file that describes an array or a group."""


def need_zarr() -> None:
    """Refuse a store where zarr is not installed.

    Raises
    ------
    MissingExtraError
        It names the extra to install.
    """
    need("zarr", "scale", "a .zarr result")


def inner_of(tile: int, pixel: int) -> int:
    """Rows and columns of the inner chunks of a tile: a divisor of it.

    Parameters
    ----------
    tile
        Rows and columns of the tile.
    pixel
        Bytes of a pixel in all planes.
    """
    most = max(INNER, math.isqrt(CHUNK // max(pixel, 1)))
    if tile <= most:
        return tile
    divisors = (size for size in range(most, LEAST_INNER - 1, -1) if tile % size == 0)
    return next(divisors, tile)


def fill_of(dtype: np.dtype[Any]) -> Any:
    """What other readers see where a file is lost: no number, or the largest code."""
    if dtype.kind == "f":
        return float("nan")
    return False if dtype.kind == "b" else int(np.iinfo(dtype).max)


@dataclass(frozen=True)
class ZarrArray:
    """One array of a store.

    Attributes
    ----------
    name
        Of its folder.
    shape
        Of the whole array.
    dtype
        bool, integers or floating-point numbers.
    tile
        Rows and columns of the shards of a map; None: one chunk holds the array.
    dims
        Names of its dimensions for other readers; none if empty.
    same_as
        Another array of the store, whose files hold the same numbers; empty: it has its own.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    tile: int | None = None
    dims: tuple[str, ...] = ()
    same_as: str = ""

    @property
    def folder(self) -> str:
        """Where its files lie in the store."""
        return self.same_as or self.name

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of tiles; (1, 1) without."""
        if self.tile is None:
            return 1, 1
        height, width = self.shape[-2:]
        return -(-height // self.tile), -(-width // self.tile)

    @property
    def inner(self) -> int:
        """Rows and columns of the chunks of a tile."""
        assert self.tile is not None
        return inner_of(self.tile, math.prod(self.shape[:-2]) * self.dtype.itemsize)

    def window(self, row: int, column: int) -> tuple[slice, slice]:
        """Rows and columns of a tile."""
        assert self.tile is not None
        rows, columns = (
            slice(at * self.tile, min((at + 1) * self.tile, size))
            for at, size in zip((row, column), self.shape[-2:], strict=True)
        )
        return rows, columns

    def path(self, row: int = 0, column: int = 0) -> str:
        """The file of a tile, or of the only chunk, in the store."""
        if self.tile is None:
            return "/".join([self.folder, "c", *("0" for _ in self.shape)])
        leading = ["0"] * (len(self.shape) - 2)
        return "/".join([self.folder, "c", *leading, str(row), str(column)])

    def paths(self) -> Iterator[tuple[str, tuple[int, int]]]:
        """Every file of the array's numbers, with the row and column of its tile."""
        if self.tile is None and 0 in self.shape:
            return
        rows, columns = self.grid
        for row in range(rows):
            for column in range(columns):
                yield self.path(row, column), (row, column)

    @property
    def _encoder(self) -> _Encoder:
        return _encoder(self.shape, self.dtype, self.tile, self.dims)

    @property
    def metadata_path(self) -> str:
        """The file that describes the array."""
        return f"{self.folder}/{METADATA}"

    @property
    def metadata(self) -> bytes:
        """What is in that file."""
        return bytes(self._encoder.files[f"array/{METADATA}"].to_bytes())

    def encoded(self, part: NDArray[Any], row: int = 0, column: int = 0) -> bytes | memoryview:
        """The file of a tile, or of the only chunk, that holds these numbers."""
        if self.tile is None:
            return self._encoder.written(f"array{self.path().removeprefix(self.folder)}", part)
        numbers = self._of_tile(part, row, column)
        return shard_of(numbers, self.tile, self.inner, fill_of(self.dtype))

    def pieces(self, part: NDArray[Any], row: int, column: int) -> Iterator[memoryview]:
        """The same of a tile, piece by piece, each of which is gone with the next."""
        assert self.tile is not None
        numbers = self._of_tile(part, row, column)
        return shard_pieces(numbers, self.tile, self.inner, fill_of(self.dtype))

    def _of_tile(self, part: NDArray[Any], row: int, column: int) -> NDArray[Any]:
        """The numbers of a tile as they are stored."""
        window = self.window(row, column)
        assert part.shape[-2:] == tuple(one.stop - one.start for one in window)
        return np.asarray(part, self.dtype.newbyteorder("<"))

    def files(self, values: NDArray[Any]) -> Iterator[tuple[str, bytes | memoryview]]:
        """Every file of the array with its bytes."""
        yield self.metadata_path, self.metadata
        for path, (row, column) in self.paths():
            part = values if self.tile is None else values[(..., *self.window(row, column))]
            yield path, self.encoded(part, row, column)

    def tiles(self, rows: slice, columns: slice) -> Iterator[tuple[int, int]]:
        """Row and column of every tile that a window of the map touches."""
        assert self.tile is not None
        for row in range(rows.start // self.tile, -(-rows.stop // self.tile)):
            for column in range(columns.start // self.tile, -(-columns.stop // self.tile)):
                yield row, column

    def filled(self, store: Path, part: Window, out: NDArray[Any], stride: int = 1) -> None:
        """Fill ``out`` with every so many rows and columns of a window of the map, tile by tile.

        Raises
        ------
        CorruptInputError
            A chunk of the window is missing, or its checksum does not agree.
        """
        for tile in self.tiles(*part):
            place = self.window(*tile)
            self._layout.read(store / self.path(*tile), within(part, place), out, stride)

    def checksums(self, store: Path, row: int, column: int, *, compare: bool) -> str:
        """One checksum of those of all chunks of a tile; see :class:`ShardLayout`."""
        there = self.window(row, column)
        file = store / self.path(row, column)
        return self._layout.checksums(file, within(there, there), compare=compare)

    @property
    def _layout(self) -> ShardLayout:
        assert self.tile is not None
        return ShardLayout(self.shape[:-2], self.dtype, self.tile, self.inner)

    def missing_chunks(
        self, path: Path, row: int, column: int, within: tuple[slice, slice] | None = None
    ) -> int:
        """How many inner chunks of a tile its file does not hold.

        ``within``: a window of the map; only chunks that it touches count.
        """
        assert self.tile is not None
        inner = self.inner
        tile = self.window(row, column)
        rows, columns = (
            slice(
                (max(part.start, around.start) - part.start) // inner,
                -(-(min(part.stop, around.stop) - part.start) // inner),
            )
            for part, around in zip(tile, within or tile, strict=True)
        )
        return missing_chunks(path, self.tile // inner, rows, columns)


@dataclass(frozen=True)
class _Encoder:
    """An array in memory that makes the files of all arrays of its shape and type.

    Attributes
    ----------
    files
        What zarr has written, by name.
    array
        The array of zarr, called ``array``.
    lock
        One thread at a time.
    """

    files: dict[str, Any]
    array: Any
    lock: threading.Lock

    def written(self, name: str, values: NDArray[Any]) -> bytes:
        """The file that holds all values of the array."""
        with self.lock:
            self.array[...] = values
            return bytes(self.files.pop(name).to_bytes())


@lru_cache(maxsize=64)
def _encoder(
    shape: tuple[int, ...], dtype: np.dtype[Any], tile: int | None, dims: tuple[str, ...]
) -> _Encoder:
    need_zarr()
    import zarr
    from zarr.codecs import Crc32cCodec
    from zarr.storage import MemoryStore

    chunks: tuple[int, ...] = tuple(max(1, size) for size in shape)
    shards = None
    if tile is not None:
        leading = shape[:-2]
        inner = inner_of(tile, math.prod(leading) * dtype.itemsize)
        chunks, shards = (*leading, inner, inner), (*leading, tile, tile)
    files: dict[str, Any] = {}
    array = zarr.create_array(
        MemoryStore(files),
        name="array",
        shape=shape,
        dtype=dtype,
        chunks=chunks,
        shards=shards,
        filters=None,
        compressors=Crc32cCodec(),
        fill_value=fill_of(dtype),
        dimension_names=dims or None,
        zarr_format=3,
        config={"write_empty_chunks": True},
    )
    return _Encoder(files, array, threading.Lock())


def snapped(size: int) -> int:
    """Rows and columns of the tiles of a small picture: as many inner chunks as it needs."""
    return min(TILE, math.ceil(size / INNER) * INNER)
