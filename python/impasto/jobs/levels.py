"""The painting at smaller scales: maps of 2, 4, 8 ... pixels as one, beside the tiles of a store.

A smaller map is what pictures need, and looks from afar as the painting does (``reduce=`` of
:func:`impasto.render`): the mean colour of what is known, normals of unit length, and lobes that
their scatter has widened. Half the scale is made of every tile while it is in memory, in tiles of
half the size; each further one of the one before, until a single tile holds all.
Variances add, so that this is what a step from the painting itself gives, up to terms of the square
of the scatter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import Window, squares
from impasto.fit.result import Sbrdf
from impasto.fit.stored import StoredSbrdf, maps_of_level, surface_of_level
from impasto.io.files import atomic_together
from impasto.io.json_lines import crc_of
from impasto.io.results.multiscales import with_dims
from impasto.io.results.precision import Precision, to_store
from impasto.io.results.zarr_arrays import METADATA, ZarrArray
from impasto.io.results.zarr_store import EMPTY_GROUP, Levels, read_window
from impasto.jobs.grid import Grid
from impasto.lighting import reduced
from impasto.surface import Surface

BLOCK = 256
"""Rows and columns of a smaller map that are made at a time, an even number."""
HALF_SCALE = "levels/2/"
"""Begins the names of the maps at half the scale."""


def half_scale(
    result: Sbrdf, grid: Grid, threads: int | None = None
) -> dict[str, NDArray[np.float32]]:
    """The maps of a tile at half its scale by their names in the store; none of a single tile."""
    if len(grid) == 1 or 0 in (grid.half.rows, grid.half.columns):
        return {}
    surface = result.surface()
    rows, columns = surface.shape
    # What fills no group is left out: of a single row nothing is left but the names of its maps.
    small, _ = reduced(surface, None, 2 if min(rows, columns) > 1 else 1, threads)
    return {
        f"{HALF_SCALE}{name}": plane[..., : rows // 2, : columns // 2]
        for name, plane in maps_of_level(small).items()
    }


def write_levels(
    folder: Path,
    stored: StoredSbrdf,
    half: list[ZarrArray],
    precision: Precision,
    threads: int | None = None,
) -> tuple[Levels, dict[str, str]]:
    """Make the smaller maps of a store from those of half the scale.

    Parameters
    ----------
    folder
        The store.
    stored
        The same, whose tiles are whole.
    half
        The maps of half the scale; none of a painting that a tile holds.
    precision
        That of the maps.
    threads
        None means every allowed core.

    Returns
    -------
    tuple
        The maps by factor, and CRC-32 in hexadecimal digits of every new file by its name.
    """
    if not half:
        return {}, {}
    template = stored[:1, :1].surface()
    levels: Levels = {2: sorted(half, key=lambda array: array.name)}
    crcs: dict[str, str] = {}
    size, factor = half[0].shape[-2:], 2
    while max(size) > stored.tile:
        size, factor = (size[0] // 2, size[1] // 2), 2 * factor
        if 0 in size:
            break
        above = _reader(folder, levels[factor // 2], template)
        levels[factor], files = _level(folder, above, size, factor, stored.tile, precision, threads)
        crcs |= files
    groups = {f"levels/{METADATA}": EMPTY_GROUP}
    groups |= {f"levels/{factor}/{METADATA}": EMPTY_GROUP for factor in levels}
    return levels, crcs | _written(folder, groups)


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
    precision: Precision,
    threads: int | None,
) -> tuple[list[ZarrArray], dict[str, str]]:
    """Every file of the maps at one scale: a shard is made of those of the scale before."""
    arrays: dict[str, ZarrArray] = {}
    crcs: dict[str, str] = {}
    for row, column in np.ndindex(-(-size[0] // tile), -(-size[1] // tile)):
        window = (
            slice(row * tile, min((row + 1) * tile, size[0])),
            slice(column * tile, min((column + 1) * tile, size[1])),
        )
        maps = {
            name: to_store(name, plane, precision)
            for name, plane in _shard(above, window, f"levels/{factor}/", threads).items()
        }
        if not arrays:
            arrays = {
                name: with_dims(ZarrArray(name, (*plane.shape[:-2], *size), plane.dtype, tile))
                for name, plane in maps.items()
            }
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
    above: Callable[[slice, slice], Surface], window: Window, prefix: str, threads: int | None
) -> dict[str, NDArray[np.float32]]:
    """A part of all maps, from twice as many rows and columns of the scale before."""
    found: dict[str, NDArray[np.float32]] = {}
    rows, columns = window
    size = rows.stop - rows.start, columns.stop - columns.start
    for down, across in squares(size, BLOCK):
        surface = above(
            slice(2 * (rows.start + down.start), 2 * (rows.start + down.stop)),
            slice(2 * (columns.start + across.start), 2 * (columns.start + across.stop)),
        )
        small, _ = reduced(surface, None, 2, threads)
        for name, plane in maps_of_level(small).items():
            if prefix + name not in found:
                found[prefix + name] = np.empty((*plane.shape[:-2], *size), np.float32)
            found[prefix + name][..., down, across] = plane
    return found


def _written(folder: Path, files: Mapping[str, bytes | memoryview]) -> dict[str, str]:
    atomic_together({folder / name: data for name, data in files.items()})
    return {name: crc_of(data) for name, data in files.items()}
