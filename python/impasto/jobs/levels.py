"""The painting at smaller scales: maps of 2, 4, 8 ... pixels as one, beside the tiles of a store.

A smaller map is what pictures need, and looks from afar as the painting does (``reduce=`` of
:func:`impasto.render`): the mean colour of what is known, normals of unit length, and lobes that
their scatter has widened. Each scale is made of the one before, until a single tile holds all.
Variances add, so that this is what a step from the painting itself gives, up to terms of the square
of the scatter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window
from impasto.fit.stored import StoredSbrdf, maps_of_level, surface_of_level
from impasto.io.files import atomic_together
from impasto.io.results.multiscales import with_dims
from impasto.io.results.zarr_arrays import METADATA, ZarrArray
from impasto.io.results.zarr_store import EMPTY_GROUP, Levels, read_window
from impasto.jobs.journal import crc_of
from impasto.lighting import reduced
from impasto.surface import Surface

BLOCK = 256
"""Rows and columns of a smaller map that are made at a time, an even number."""


def write_levels(folder: Path, stored: StoredSbrdf) -> tuple[Levels, dict[str, str]]:
    """Make all smaller maps of a store whose tiles are whole.

    Returns
    -------
    tuple
        The maps by factor, and CRC-32 in hexadecimal digits of every file by its name.
    """
    template = stored[:1, :1].surface()
    levels: Levels = {}
    crcs: dict[str, str] = {}
    size, factor = stored.shape, 1

    def painting(rows: slice, columns: slice) -> Surface:
        return stored.visible(rows, columns).surface()

    above: Callable[[slice, slice], Surface] = painting
    while max(size) > stored.tile:
        size, factor = (size[0] // 2, size[1] // 2), 2 * factor
        if 0 in size:
            break
        arrays, files = _level(folder, above, size, factor, stored.tile)
        levels[factor] = arrays
        crcs |= files
        above = _reader(folder, arrays, template)
    if levels:
        groups = {f"levels/{METADATA}": EMPTY_GROUP}
        groups |= {f"levels/{factor}/{METADATA}": EMPTY_GROUP for factor in levels}
        crcs |= _written(folder, groups)
    return levels, crcs


def _reader(
    folder: Path, arrays: list[ZarrArray], template: Surface
) -> Callable[[slice, slice], Surface]:
    """Reads windows of a smaller map as a surface."""

    def read(rows: slice, columns: slice) -> Surface:
        maps = {
            one.name.rsplit("/", 1)[1]: read_window(folder, one, rows, columns) for one in arrays
        }
        return surface_of_level(maps, template)

    return read


def _level(
    folder: Path,
    above: Callable[[slice, slice], Surface],
    size: tuple[int, int],
    factor: int,
    tile: int,
) -> tuple[list[ZarrArray], dict[str, str]]:
    """Every file of the maps at one scale: a shard is made of those of the scale before."""
    arrays: dict[str, ZarrArray] = {}
    crcs: dict[str, str] = {}
    for row, column in np.ndindex(-(-size[0] // tile), -(-size[1] // tile)):
        window = (
            slice(row * tile, min((row + 1) * tile, size[0])),
            slice(column * tile, min((column + 1) * tile, size[1])),
        )
        maps = _shard(above, window)
        if not arrays:
            arrays = {name: _array(name, plane, size, factor, tile) for name, plane in maps.items()}
            crcs |= _written(folder, {a.metadata_path: a.metadata for a in arrays.values()})
        crcs |= _written(
            folder,
            {
                arrays[name].path(row, column): arrays[name].encoded(plane, row, column)
                for name, plane in maps.items()
            },
        )
    return sorted(arrays.values(), key=lambda array: array.name), crcs


def _shard(
    above: Callable[[slice, slice], Surface], window: Window
) -> dict[str, NDArray[np.float32]]:
    """A part of all maps, from twice as many rows and columns of the scale before."""
    found: dict[str, NDArray[np.float32]] = {}
    rows, columns = window
    size = rows.stop - rows.start, columns.stop - columns.start
    for down, across in _blocks(size):
        surface = above(
            slice(2 * (rows.start + down.start), 2 * (rows.start + down.stop)),
            slice(2 * (columns.start + across.start), 2 * (columns.start + across.stop)),
        )
        small, _ = reduced(surface, None, 2)
        for name, plane in maps_of_level(small).items():
            if name not in found:
                found[name] = np.empty((*plane.shape[:-2], *size), np.float32)
            found[name][..., down, across] = plane
    return found


def _blocks(size: tuple[int, int]) -> Iterator[Window]:
    for top in range(0, size[0], BLOCK):
        for left in range(0, size[1], BLOCK):
            yield slice(top, min(top + BLOCK, size[0])), slice(left, min(left + BLOCK, size[1]))


def _array(
    name: str, plane: NDArray[Any], size: tuple[int, int], factor: int, tile: int
) -> ZarrArray:
    shape = (*plane.shape[:-2], *size)
    return with_dims(ZarrArray(f"levels/{factor}/{name}", shape, plane.dtype, tile))


def _written(folder: Path, files: dict[str, bytes]) -> dict[str, str]:
    atomic_together({folder / name: data for name, data in files.items()})
    return {name: crc_of(data) for name, data in files.items()}
