"""The second pass of a job: tiles are read, fitted and written one after another."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.windows import within
from impasto.fit.learning import LearnedModel
from impasto.fit.result import Sbrdf
from impasto.fit.saved import maps_of
from impasto.io.files import as_problem_of, atomic_bytes, atomic_together
from impasto.io.npz import npz_bytes, read_npz
from impasto.io.results.multiscales import with_dims
from impasto.io.results.precision import Precision, to_store
from impasto.io.results.zarr_arrays import ZarrArray
from impasto.io.results.zarr_store import same_arrays
from impasto.jobs.grid import Grid, Tile
from impasto.jobs.journal import Journal, TileEntry, crc_of
from impasto.jobs.levels import HALF_SCALE, half_scale
from impasto.jobs.photographs import Photographs
from impasto.rig import Rig
from impasto.stack import Stack

NUMBERS = "numbers.npz"
"""What is not a map, the same for every tile with an estimated pixel; and maps without pixels."""
MAP = "map:"
"""Begins the names of these."""
SAME = "same:"
"""Begins the names of maps that are others, whose names these are."""
KNOWN = "estimated"
"""Whether the tile that the numbers are from has an estimated pixel."""
PACE = "pace.jsonl"
"""Pixels and seconds of every tile, for those who look on; gone when the job is done."""


@dataclass(frozen=True)
class WrittenTile:
    """A tile all of whose maps are on the disk.

    Attributes
    ----------
    entry
        Its line of the journal.
    numbers
        What is not a map, as :class:`TileLog` keeps it; None where nobody asked for it.
    """

    entry: TileEntry
    numbers: dict[str, NDArray[Any]] | None


class TileLog:
    """Takes down what is on the disk: numbers that are no maps, the journal, the pace.

    One process has it, wherever tiles are written.

    Parameters
    ----------
    notes
        The folder for what is not a map.
    grid
        The tiles.
    journal
        Gets a line for every tile.
    report
        Called after every tile with the number of those in the journal.
    """

    def __init__(
        self, notes: Path, grid: Grid, journal: Journal, report: Callable[[int], object]
    ) -> None:
        self._notes = notes
        self._grid = grid
        self._journal = journal
        self._report = report
        path = notes / NUMBERS
        self._known = bool(read_npz(path)[KNOWN]) if path.exists() else None
        self._last = time.monotonic()

    @property
    def wants_numbers(self) -> bool:
        """Whether there are none yet of a tile that has an estimated pixel."""
        return not self._known

    def add(self, tile: Tile, written: WrittenTile) -> None:
        """A tile all of whose files are on the disk."""
        self._keep(written.numbers)
        self._journal.add(tile, written.entry)
        before, self._last = self._last, time.monotonic()
        seconds = round(self._last - before, 6)
        _add_pace(self._notes / PACE, {"pixels": self._grid.pixels(tile), "seconds": seconds})

    def report(self) -> None:
        """Say how many tiles there are."""
        self._report(len(self._journal.entries.tiles))

    def _keep(self, numbers: Mapping[str, NDArray[Any]] | None) -> None:
        """The numbers of the first tile, or of the first that has an estimated pixel."""
        if numbers is None:
            assert not self.wants_numbers
            return
        known = bool(numbers[KNOWN])
        if self._known is None or (known and not self._known):
            data = npz_bytes(numbers)
            self._journal.announce(crc_of(data))
            atomic_bytes(self._notes / NUMBERS, data)
            self._known = known


def write_tile(
    folder: Path,
    grid: Grid,
    tile: Tile,
    result: Sbrdf,
    precision: Precision,
    *,
    numbers: bool = True,
) -> WrittenTile:
    """Every map of a tile, each in a file of its own that is on the disk when this returns.

    Those of half the scale are made of it, too, while the maps are in memory.

    Parameters
    ----------
    folder
        The store, which is not whole yet.
    precision
        That of the maps.
    numbers
        Whether what is not a map is returned, too.
    """
    maps, others = split_result(result)
    same = same_arrays(maps)
    estimated = int(result.estimated.sum())
    stored = {
        name: to_store(name, plane, precision)
        for name, plane in sorted((maps | half_scale(result, grid)).items())
        if name not in same
    }
    files = {}
    for name, plane in stored.items():
        array = map_array(name, plane, grid)
        if 0 not in plane.shape:
            files[array.path(*tile)] = array.encoded(plane, *tile)
    atomic_together({folder / name: data for name, data in files.items()})
    entry = TileEntry(estimated, {name: crc_of(data) for name, data in files.items()})
    if not numbers:
        return WrittenTile(entry, None)
    none = {f"{MAP}{name}": plane[..., :0, :0] for name, plane in stored.items()}
    shared = {f"{SAME}{name}": np.array(other) for name, other in same.items()}
    return WrittenTile(entry, {**others, **none, **shared, KNOWN: np.array(estimated > 0)})


def arrays_of_tiles(numbers: Mapping[str, NDArray[Any]], grid: Grid) -> list[ZarrArray]:
    """How all maps are stored, those of half the scale too, from what a tile has left of them."""
    own = {
        name.removeprefix(MAP): map_array(name.removeprefix(MAP), plane, grid)
        for name, plane in numbers.items()
        if name.startswith(MAP)
    }
    same = [
        replace(own[str(other)], name=name.removeprefix(SAME), same_as=str(other))
        for name, other in numbers.items()
        if name.startswith(SAME)
    ]
    return [*own.values(), *same]


def no_maps(numbers: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """What is not a map of what a tile has left."""
    return {
        name: array
        for name, array in numbers.items()
        if not name.startswith((MAP, SAME)) and name != KNOWN
    }


def map_array(name: str, plane: NDArray[Any], grid: Grid) -> ZarrArray:
    """How a map is stored, from its part ``(..., y, x)`` in any tile."""
    place = grid.half if name.startswith(HALF_SCALE) else grid
    shape = (*plane.shape[:-2], place.rows, place.columns)
    return with_dims(ZarrArray(name, shape, plane.dtype, place.tile))


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
    part = within(grid.window(tile), grid.window(tile, model.halo))
    return model.apply(stack, *part, threads=threads)


def fit_tiles(
    photographs: Photographs,
    model: LearnedModel,
    folder: Path,
    grid: Grid,
    tiles: Sequence[Tile],
    log: TileLog,
    *,
    precision: Precision,
    threads: int | None,
) -> None:
    """Fit the tiles in their order; meanwhile the next is read and the last one written."""

    def read(tile: Tile) -> Stack:
        return photographs.window(*grid.window(tile, model.halo))

    def write(tile: Tile, result: Sbrdf) -> None:
        log.add(tile, write_tile(folder, grid, tile, result, precision, numbers=log.wants_numbers))

    # Leaving them waits for what they are at: a tile that is being written is finished.
    with (
        ThreadPoolExecutor(1, "impasto-reader") as reader,
        ThreadPoolExecutor(1, "impasto-writer") as writer,
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
                log.report()
            behind = writer.submit(write, tile, result)
        if behind is not None:
            behind.result()
            log.report()


def _add_pace(path: Path, entry: Mapping[str, Any]) -> None:
    with as_problem_of(path), path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry, sort_keys=True) + "\n")
