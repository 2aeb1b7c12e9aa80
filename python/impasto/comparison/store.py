"""Maps of a comparison in a store, written tile by tile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.io.files import atomic_together
from impasto.io.folders import new_folder
from impasto.io.results.zarr_arrays import METADATA, ZarrArray
from impasto.io.results.zarr_store import group_metadata, zarr_arrays
from impasto.jobs.grid import Grid, Tile

Maps = Mapping[str, NDArray[Any]]


def write_store(
    target: Path,
    grid: Grid,
    tiles: Iterator[tuple[Tile, Maps]],
    numbers: Callable[[], Maps],
    kind: str,
) -> None:
    """Make a store that appears whole or not at all.

    Parameters
    ----------
    target
        Its name; nothing is there.
    grid
        How the maps are cut.
    tiles
        The maps ``(y, x)`` of every tile of the grid.
    numbers
        Called after the last tile: all that is no map.
    kind
        What the store says it holds.
    """
    with new_folder(target) as folder:
        arrays: dict[str, ZarrArray] = {}
        for (row, column), maps in tiles:
            files = {}
            for name, plane in maps.items():
                one = arrays.setdefault(
                    name, ZarrArray(name, (grid.rows, grid.columns), plane.dtype, grid.tile)
                )
                files[folder / one.path(row, column)] = one.encoded(plane, row, column)
            atomic_together(files)
        others = {"kind": np.array(kind), **numbers()}
        files = {}
        stored = [*arrays.values()]
        for array in zarr_arrays(others, (), None):
            files |= {folder / name: data for name, data in array.files(others[array.name])}
            stored.append(array)
        files |= {folder / one.metadata_path: one.metadata for one in arrays.values()}
        atomic_together(files)
        described = sorted(stored, key=lambda one: one.name)
        atomic_together({folder / METADATA: group_metadata(others, described)})
