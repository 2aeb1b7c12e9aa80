"""A whole stack in a Zarr store, where all observations of a tile lie together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, offset
from impasto.errors import ArgumentError, CorruptInputError
from impasto.io.results.maps import STACK, no_photographs
from impasto.io.results.zarr_arrays import METADATA, ZarrArray, need_zarr
from impasto.io.results.zarr_store import contents, is_usual, read_array, read_window
from impasto.io.session.archive import arrays_beside_samples, refuse_options, stack_of_arrays
from impasto.io.session.frames import check_region
from impasto.io.sources import Source
from impasto.rig import Rig
from impasto.stack import Stack

SUFFIX = ".zarr"
SAMPLES = "samples"


def is_stack(path: Path) -> bool:
    """Whether a store that can be read holds photographs."""
    if path.suffix.lower() != SUFFIX or not path.is_dir():
        return False
    return str(contents(path)[0].get("kind")) == STACK


class StoredStack:
    """An open store: its arrays by name, none of which has been read.

    Raises
    ------
    CorruptInputError
        A store that is damaged or holds something else.
    FileNotFoundError
        There is none.
    MissingExtraError
        zarr is not installed.
    """

    def __init__(self, path: Path) -> None:
        self._text, arrays = contents(path)
        need_zarr()
        self._arrays = {array.name: array for array in arrays}
        self._path = path
        found = str(self._text.get("kind", "something else"))
        if found != STACK:
            raise CorruptInputError(path, no_photographs(found))
        samples = self._arrays.get(SAMPLES)
        if samples is None or samples.tile is None or len(samples.shape) != 4 or 0 in samples.shape:
            raise CorruptInputError(path, "has no array 'samples' (obs, band, y, x) in tiles")
        mask = self._arrays.get("mask", samples)
        if mask.shape[-2:] != samples.shape[-2:]:
            raise CorruptInputError(path, f"has a mask {mask.shape} for {samples.shape}")

    @property
    def samples(self) -> ZarrArray:
        """How the samples are stored."""
        return self._arrays[SAMPLES]

    @property
    def tile(self) -> int:
        """Rows and columns of a tile."""
        return int(self.samples.tile or 1)

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the photographs."""
        height, width = self.samples.shape[2:]
        return height, width

    @property
    def inputs(self) -> list[str]:
        """The files that the store was made of, as they were called; none of a stack in memory."""
        rows = np.atleast_2d(self._text.get("inputs", np.empty((0, 1), np.str_)))
        return [str(row[0]) for row in rows if len(row)]

    def files(self, window: Window | None = None) -> list[Path]:
        """Every file of the store, or those from which a window is read."""
        names = [METADATA]
        for array in self._arrays.values():
            names.append(array.metadata_path)
            if window is None or array.tile is None:
                names += [name for name, _ in array.paths()]
            else:
                names += [array.path(*tile) for tile in array.tiles(*window)]
        return [self._path / name for name in sorted(names)]

    def tile_entry(self, file: Path, *, compare: bool = False) -> dict[str, Any] | None:
        """Name, size and checksum of the file of a tile, for those who must know it again.

        The checksum is one of the CRC-32C of its chunks (``crc32c``): they stand in the file, and
        whoever reads a chunk compares them, so that the numbers need not be read for it. None of
        other files of the store.

        Parameters
        ----------
        compare
            Whether the numbers of a tile are read all the same, and compared.

        Raises
        ------
        CorruptInputError
            A tile is not as it was written.
        """
        if file not in self._tiles:
            return None
        array, tile = self._tiles[file]
        found = array.checksums(self._path, *tile, compare=compare)
        return {"file": file.as_posix(), "bytes": file.stat().st_size, "crc32c": found}

    @cached_property
    def _tiles(self) -> dict[Path, tuple[ZarrArray, tuple[int, int]]]:
        """The files of maps that are laid out as this version does it."""
        return {
            self._path / name: (array, tile)
            for array in self._arrays.values()
            if is_usual(self._path, array)
            for name, tile in array.paths()
        }

    def damage(self) -> Iterator[CorruptInputError]:
        """What is not as it was written of the arrays that are not in tiles of this version."""
        tiled = {array.name for array, _ in self._tiles.values()}
        for name, array in self._arrays.items():
            if name not in tiled:
                try:
                    read_array(self._path, array)
                except CorruptInputError as error:
                    yield error

    def mask(self, rows: slice, columns: slice) -> NDArray[np.bool_] | None:
        """A window of the mask; None where there is none."""
        if "mask" not in self._arrays:
            return None
        return np.asarray(read_window(self._path, self._arrays["mask"], rows, columns), np.bool_)

    def read(self, window: Window | None, stride: int = 1) -> dict[str, NDArray[Any]]:
        """Every array; of the samples and the mask a window alone, all of it if there is none.

        ``stride``: every so many rows and columns of these.
        """
        found = dict(self._text)
        height, width = self.size
        rows, columns = window or (slice(0, height), slice(0, width))
        for name, array in self._arrays.items():
            if array.tile is None:
                found[name] = read_array(self._path, array)
            else:
                found[name] = read_window(self._path, array, rows, columns, stride)
        return found


class StoredObservation(Source):
    """One observation of a store as a source of windows."""

    def __init__(self, path: Path, index: int) -> None:
        self._stored = StoredStack(path)
        self._name = str(path)
        count = self._stored.samples.shape[0]
        if not 0 <= index < count:
            raise ArgumentError(f"index: {path} holds {count} observations, found {index}")
        self._index = index

    @property
    def name(self) -> str:
        """See :class:`Source`."""
        return self._name

    @property
    def shape(self) -> tuple[int, int, int]:
        """See :class:`Source`."""
        _, bands, height, width = self._stored.samples.shape
        return bands, height, width

    @property
    def dtype(self) -> np.dtype[Any]:
        """See :class:`Source`."""
        return self._stored.samples.dtype

    @property
    def grid(self) -> tuple[int, int]:
        """A chunk, which holds all observations."""
        side = self._stored.samples.inner
        return side, side

    def close(self) -> None:
        """See :class:`Source`; no file is open."""

    def _read(self, top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        part = slice(top, bottom), slice(left, right)
        samples = read_window(Path(self._name), self._stored.samples, *part)
        return np.ascontiguousarray(samples[self._index])


def read_stored(path: Path, given: Mapping[str, Any], region: Sequence[int] | None) -> Stack:
    """The stack of a store that :func:`impasto.ingest` made, or a region of it.

    Of a region only the chunks that it touches are read. ``given`` are options for photographs,
    None where nobody said any: a finished stack takes none.
    """
    refuse_options(path, given)
    stored = StoredStack(path)
    area = check_region(region, stored.size)
    if area is None:
        return stack_of_arrays(stored.read(None), path, None, stored.files())
    top, left, height, width = area
    window = slice(top, top + height), slice(left, left + width)
    part = offset(window, stored.size)
    return stack_of_arrays(stored.read(window), path, part, stored.files(window))


def thinned_stored(path: Path, window: Window, stride: int) -> Stack:
    """Every so many rows and columns of a window of a store; it lies where the window does."""
    stored = StoredStack(path)
    part = offset(window, stored.size)
    return stack_of_arrays(stored.read(window, stride), path, part, stored.files(window))


def arrays_of_store(stack: Stack) -> dict[str, NDArray[Any]]:
    """What a store holds that is neither samples nor mask, from any part of the photographs."""
    whole = stack._replace(rig=Rig(stack.rig, origin=(0.0, 0.0)))
    arrays = arrays_beside_samples(whole)
    arrays.pop("mask", None)
    return {"kind": np.array(STACK), **arrays}
