"""The merged painting in a store, tile by tile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.fit.result import Sbrdf
from impasto.fit.saved import maps_of
from impasto.fit.stored import StoredSbrdf
from impasto.io.files import atomic_together
from impasto.io.folders import new_folder
from impasto.io.results.multiscales import multiscales_of, with_dims
from impasto.io.results.zarr_arrays import METADATA, ZarrArray
from impasto.io.results.zarr_store import EMPTY_GROUP, group_metadata, zarr_arrays
from impasto.jobs.grid import Grid, Tile
from impasto.jobs.levels import write_levels
from impasto.jobs.tiles import map_array
from impasto.merge.blend import Mosaic
from impasto.merge.report import MergeReport

NOTES = "merge"
REPORT = f"{NOTES}/report.json"
"""What :class:`MergeReport` says, in the store."""


def write_store(
    target: Path,
    mosaic: Mosaic,
    grid: Grid,
    report: MergeReport,
    done: Callable[[int], None],
) -> None:
    """Make a store that appears whole or not at all; ``done`` is called after every tile."""
    with new_folder(target) as folder:
        described: dict[str, ZarrArray] = {}
        numbers: dict[str, NDArray[Any]] = {}
        for count, tile in enumerate(grid):
            maps, numbers = _split(mosaic.part(*grid.window(tile)), mosaic)
            described = described or {
                name: map_array(name, plane, grid) for name, plane in maps.items()
            }
            _write_tile(folder, described, maps, tile)
            done(count + 1)
        _finish(folder, described, numbers, report)


def _split(part: Sbrdf, mosaic: Mosaic) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """Maps, and all else, which is that of the whole painting."""
    whole = replace(part, rig=mosaic.rig)
    names = maps_of(whole)
    arrays = {name: np.asarray(array) for name, array in whole._saved().items()}
    maps = {name: array for name, array in arrays.items() if name in names}
    numbers = {name: array for name, array in arrays.items() if name not in names}
    return maps, {"kind": np.array(part.kind()), **numbers}


def _write_tile(
    folder: Path, described: dict[str, ZarrArray], maps: dict[str, NDArray[Any]], tile: Tile
) -> None:
    atomic_together(
        {
            folder / described[name].path(*tile): described[name].encoded(plane, *tile)
            for name, plane in sorted(maps.items())
        }
    )


def _finish(
    folder: Path,
    described: dict[str, ZarrArray],
    numbers: dict[str, NDArray[Any]],
    report: MergeReport,
) -> None:
    """What is no map, the smaller scales, and the file that says what there is."""
    others = zarr_arrays(numbers, (), None)
    files = {f"{NOTES}/{METADATA}": EMPTY_GROUP, REPORT: report.to_json().encode()}
    for array in others:
        files |= dict(array.files(numbers[array.name]))
    files |= {one.metadata_path: one.metadata for one in map(with_dims, described.values())}
    atomic_together({folder / name: data for name, data in files.items()})
    every = sorted([*others, *described.values()], key=lambda one: one.name)
    text = {name: array for name, array in numbers.items() if array.dtype.kind == "U"}
    tiles = StoredSbrdf(folder, text, every, {})
    levels, _ = write_levels(folder, tiles)
    multiscales = multiscales_of(every, levels, tiles.pitch_mm)
    last = group_metadata(numbers, every, levels, multiscales)
    atomic_together({folder / METADATA: last})
