"""The second pass of a job: tiles are read, fitted and written one after another."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.fit.learning import LearnedModel
from impasto.fit.result import Sbrdf
from impasto.fit.saved import maps_of
from impasto.io.files import as_problem_of, atomic_together
from impasto.io.npz import read_npz, write_npz
from impasto.io.results.zarr_arrays import ZarrArray
from impasto.jobs.grid import Grid, Tile
from impasto.jobs.journal import Journal, TileEntry, crc_of
from impasto.jobs.photographs import Photographs
from impasto.rig import Rig
from impasto.stack import Stack

NUMBERS = "numbers.npz"
"""What is not a map, the same for every tile with an estimated pixel; and maps without pixels."""
MAP = "map:"
"""Begins the names of these."""
KNOWN = "estimated"
"""Whether the tile that the numbers are from has an estimated pixel."""
PACE = "pace.jsonl"
"""Pixels and seconds of every tile, for those who look on; gone when the job is done."""


class TileWriter:
    """Writes the maps of tiles into the arrays of a store.

    Parameters
    ----------
    folder
        The store, which is not whole yet.
    notes
        The folder for what is not a map.
    grid
        The tiles.
    """

    def __init__(self, folder: Path, notes: Path, grid: Grid) -> None:
        self._folder = folder
        self._notes = notes
        self._grid = grid
        self._arrays: dict[str, ZarrArray] = {}
        self._kept: bool | None = None

    def write(self, tile: Tile, result: Sbrdf) -> TileEntry:
        """Every map of a tile, each in a file of its own that is on the disk when this returns."""
        maps, numbers = split_result(result)
        estimated = int(result.estimated.sum())
        self._keep(maps, numbers, known=estimated > 0)
        files = {}
        for name, plane in sorted(maps.items()):
            array = self._array(name, plane)
            files[array.path(*tile)] = array.encoded(plane, *tile)
        atomic_together({self._folder / name: data for name, data in files.items()})
        return TileEntry(estimated, {name: crc_of(data) for name, data in files.items()})

    def _keep(
        self, maps: Mapping[str, NDArray[Any]], numbers: Mapping[str, NDArray[Any]], *, known: bool
    ) -> None:
        """The numbers of the first tile, or of the first that has an estimated pixel."""
        path = self._notes / NUMBERS
        if self._kept is None and path.exists():
            self._kept = bool(read_npz(path)[KNOWN])
        if self._kept is None or (known and not self._kept):
            none = {f"{MAP}{name}": plane[..., :0, :0] for name, plane in maps.items()}
            write_npz(path, {**numbers, **none, KNOWN: np.array(known)})
            self._kept = known

    def _array(self, name: str, plane: NDArray[Any]) -> ZarrArray:
        if name not in self._arrays:
            self._arrays[name] = map_array(name, plane, self._grid)
        return self._arrays[name]


def map_array(name: str, plane: NDArray[Any], grid: Grid) -> ZarrArray:
    """How a map is stored, from its part ``(..., y, x)`` in any tile."""
    shape = (*plane.shape[:-2], grid.rows, grid.columns)
    return ZarrArray(name, shape, plane.dtype, grid.tile)


def split_result(result: Sbrdf) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """The maps of a tile, and all else, which is that of the whole painting."""
    whole = replace(result, rig=Rig(result.rig, origin=(0.0, 0.0)))
    names = maps_of(whole)
    arrays = whole._saved()
    maps = {name: np.asarray(array) for name, array in arrays.items() if name in names}
    numbers = {name: np.asarray(array) for name, array in arrays.items() if name not in names}
    return maps, {"kind": np.array(result.kind()), **numbers}


def fitted(model: LearnedModel, stack: Stack, grid: Grid, tile: Tile, threads: int | None) -> Sbrdf:
    """The result of a tile, from its photographs and those of the border around it."""
    inner, wide = grid.window(tile), grid.window(tile, model.halo)
    rows, columns = (
        slice(part.start - around.start, part.stop - around.start)
        for part, around in zip(inner, wide, strict=True)
    )
    return model.apply(stack, rows, columns, threads=threads)


def fit_tiles(
    photographs: Photographs,
    model: LearnedModel,
    grid: Grid,
    tiles: Sequence[Tile],
    writer: TileWriter,
    journal: Journal,
    pace: Path,
    *,
    threads: int | None,
    report: Callable[[int], object],
) -> None:
    """Fit the tiles in their order; meanwhile the next is read and the last one written.

    Parameters
    ----------
    pace
        A file to which the seconds since the tile before are added for every tile.
    report
        Called after every tile with the number of those in the journal.
    """

    def read(tile: Tile) -> Stack:
        return photographs.window(*grid.window(tile, model.halo))

    last = time.monotonic()

    def write(tile: Tile, result: Sbrdf) -> None:
        nonlocal last
        journal.add(tile, writer.write(tile, result))
        before, last = last, time.monotonic()
        _add_pace(pace, {"pixels": grid.pixels(tile), "seconds": round(last - before, 6)})

    # Leaving them waits for what they are at: a tile that is being written is finished.
    with (
        ThreadPoolExecutor(1, "impasto-reader") as reader,
        ThreadPoolExecutor(1, "impasto-writer") as scribe,
    ):
        ahead = reader.submit(read, tiles[0]) if tiles else None
        behind: Future[None] | None = None
        for index, tile in enumerate(tiles):
            assert ahead is not None
            stack = ahead.result()
            ahead = reader.submit(read, tiles[index + 1]) if index + 1 < len(tiles) else None
            result = fitted(model, stack, grid, tile, threads)
            del stack
            if behind is not None:
                behind.result()
                report(len(journal.entries.tiles))
            behind = scribe.submit(write, tile, result)
        if behind is not None:
            behind.result()
            report(len(journal.entries.tiles))


def _add_pace(path: Path, entry: Mapping[str, Any]) -> None:
    with as_problem_of(path), path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry, sort_keys=True) + "\n")
