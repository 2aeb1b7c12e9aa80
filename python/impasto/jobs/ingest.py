"""Photographs of any kind as one store, in which all observations of a tile lie together."""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.memory import DEFAULT_MEMORY
from impasto._internal.pools import Stop, beside
from impasto._internal.recycling import Recycled, recycling
from impasto.errors import ArgumentError, ResumeMismatchError
from impasto.io.files import atomic_together
from impasto.io.folders import new_folder
from impasto.io.results.zarr_arrays import METADATA, ZarrArray, need_zarr
from impasto.io.results.zarr_store import group_metadata, zarr_arrays
from impasto.io.session.stored import SAMPLES, arrays_of_store
from impasto.jobs.folder import checked_store
from impasto.jobs.grid import (
    MOST,
    STEP,
    Footprint,
    Grid,
    Tile,
    bytes_of,
    checked_tile,
    in_words,
    less_words,
)
from impasto.jobs.photographs import (
    Photographs,
    check_source,
    checked_reading,
    open_photographs,
)
from impasto.jobs.pipeline import pipelined
from impasto.stack import Stack

COPIES = 5
"""A tile of samples is in memory so often, at most: the one that is read, as codes and as samples,
and three that are written or wait for it."""
WRITERS = 2
"""Tiles that are written at a time: one is made and copied while the disk flushes the other."""


def ingest(
    source: str | os.PathLike[str] | Stack | Photographs,
    out: str | os.PathLike[str],
    *,
    memory: str | int = DEFAULT_MEMORY,
    tile: int | None = None,
    reading: Mapping[str, Any] | None = None,
    progress: bool | ProgressCallback = False,
) -> Path:
    """Write photographs into a Zarr store, in which all observations of a tile lie together.

    A fit of tiles then reads one file for each, whatever the photographs were: hundreds of them,
    JPEG or PNG, which have no windows, or compressed TIFF. Every file of photographs is decoded
    once for as many rows as fit into the memory. The store holds what :func:`impasto.read_stack`
    returns, without loss: ``samples (obs, band, y, x)`` in shards of a tile, with chunks of about
    a megabyte or of 128 x 128 pixels, each with a checksum (crc32c) and not compressed; the mask;
    the numbers of rig, bands and scale; and the SHA-256 of the files that were read. ``read_stack``
    reads it, whole or a region; so does :func:`impasto.run`.

    Parameters
    ----------
    source
        What :func:`impasto.read_stack` takes, a :class:`Stack`, whose samples may be a memory
        map, or a :class:`impasto.jobs.Photographs`.
    out
        The store to make: a name that ends in ``.zarr``, which does not exist yet.
    memory
        Bytes, or a text such as ``"4GiB"``, for samples; the program and its libraries come on top.
    tile
        Rows and columns of a tile; default: as ``memory`` allows, at most 1024.
    reading
        Options of :func:`impasto.read_stack` for a path, as for :func:`impasto.run`. A tone curve
        that is to be estimated is that of 1024 x 1024 pixels in the middle, unless all photographs
        fit into half of ``memory``.
    progress
        True: a bar on stderr; or a callable ``(done, total)`` in tiles.

    Returns
    -------
    Path
        The store. It appears when it is whole; an interrupted call leaves nothing.

    Raises
    ------
    ArgumentError
        A value that cannot be used, ``out`` that exists, or memory for less than a tile of 64 x 64
        pixels.
    ResumeMismatchError
        A photograph changed while it was read.
    CorruptInputError
        A damaged photograph.
    MissingExtraError
        zarr is not installed.
    """
    target = checked_store(out, kind="")
    if target.exists():
        raise ArgumentError(f"out: {target} exists; give another name")
    need_zarr()
    check_source(source, "impasto.ingest")
    budget = bytes_of(memory)
    given = checked_reading(reading)
    photographs = open_photographs(
        source if isinstance(source, Stack | Photographs) else Path(source),
        given,
        budget // 2,
        None,
    )
    if tile is None:
        tile = _tile_for(budget // 2, photographs.pixel)
    height, width = photographs.size
    grid = Grid(height, width, min(checked_tile(tile), -(-max(height, width) // STEP) * STEP))
    stop = Stop()
    with (
        reporting(progress, "tiles", whole=True) as report,
        new_folder(target) as folder,
        beside(lambda: photographs.hashed(lambda done, total: stop.check()), stop) as hashes,
        # Closed before the folder goes: no tile is written into it any more.
        closing(_written(folder, photographs, grid)) as corners,
    ):
        for count in range(1, len(grid) + 1):
            corner = next(corners)
            if hashes.done():
                hashes.result()  # what cannot be hashed need not be written to its end
            if report is not None:
                report(count, len(grid))
        _describe(folder, corner, grid, hashes.result())
        if changed := photographs.changed():
            raise ResumeMismatchError(
                f"source: {changed[0]} has changed while it was read; ingest once more"
            )
    return target


def _written(folder: Path, photographs: Photographs, grid: Grid) -> Generator[Stack, None, None]:
    """Write every tile, and give a pixel of it."""
    masked: set[bool] = set()
    memory = Recycled()

    def read(tile: Tile) -> Stack:
        with recycling(memory):
            return photographs.window(*grid.window(tile))

    def check(_: Tile, stack: Stack) -> Stack:
        masked.add(stack.mask is not None)
        if len(masked) > 1:
            raise ArgumentError("source: has a mask in some of its windows only")
        return stack

    def encode(_: Tile, stack: Stack) -> Stack:
        return stack  # it becomes a file while that is written

    def write(tile: Tile, stack: Stack) -> Stack:
        atomic_together(
            {
                folder / array.path(*tile): array.pieces(plane, *tile)
                for array, plane in _maps(stack, grid)
            }
        )
        return stack[:1, :1]

    return pipelined(list(grid), read, check, encode, write, writers=WRITERS)


def _maps(stack: Stack, grid: Grid) -> Iterator[tuple[ZarrArray, Any]]:
    """The samples, and the mask if there is one, with how they are stored."""
    planes = {SAMPLES: stack.samples} | ({} if stack.mask is None else {"mask": stack.mask})
    for name, plane in planes.items():
        shape = (*plane.shape[:-2], grid.rows, grid.columns)
        yield ZarrArray(name, shape, plane.dtype, grid.tile), plane


def _describe(folder: Path, stack: Stack, grid: Grid, inputs: Sequence[Mapping[str, Any]]) -> None:
    """Write what is no map, and the metadata of all arrays."""
    files_read = [
        [str(one.get("file", "")), str(one.get("bytes", "")), _checksum(one)] for one in inputs
    ]
    arrays = {**arrays_of_store(stack), "inputs": np.array(files_read)}
    others = zarr_arrays(arrays, (), None)
    maps = [array for array, _ in _maps(stack, grid)]
    files: dict[str, bytes | memoryview] = {}
    for array in others:
        files |= array.files(arrays[array.name])
    files |= {array.metadata_path: array.metadata for array in maps}
    files[METADATA] = group_metadata(arrays, sorted([*others, *maps], key=lambda one: one.name))
    atomic_together({folder / name: data for name, data in files.items()})


def _checksum(entry: Mapping[str, Any]) -> str:
    """SHA-256; of a tile of another store its own kind of checksum."""
    return str(entry.get("sha256") or f"crc32c:{entry.get('crc32c', '')}")


def _tile_for(memory: int, pixel: Footprint) -> int:
    side = min(math.isqrt(memory // (COPIES * pixel.samples)), MOST)
    if side < STEP:
        raise ArgumentError(
            f"memory: a tile of {STEP} x {STEP} pixels of these photographs needs "
            f"{in_words(2 * COPIES * pixel.samples * STEP**2)}, found {in_words(2 * memory)}"
            + less_words(lambda smaller: smaller <= side)
        )
    return side // STEP * STEP
