"""The second pass of a job: tiles are read, fitted and written one after another."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from impasto._internal.windows import within
from impasto.fit.learning import LearnedModel
from impasto.fit.result import Sbrdf
from impasto.io.files import as_problem_of, atomic_bytes, atomic_together
from impasto.io.npz import npz_bytes, read_npz
from impasto.io.results.precision import Precision
from impasto.jobs.assembly import KNOWN, files_of_tile
from impasto.jobs.grid import Grid, Tile
from impasto.jobs.journal import Journal, TileEntry, crc_of
from impasto.jobs.photographs import Photographs
from impasto.stack import Stack

NUMBERS = "numbers.npz"
"""What a tile leaves beside its files (:mod:`~impasto.jobs.assembly`)."""
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

    Parameters
    ----------
    folder
        The store, which is not whole yet.
    precision
        That of the maps.
    numbers
        Whether what is not a map is returned, too.
    """
    files, left = files_of_tile(grid, tile, result, precision)
    atomic_together({folder / name: data for name, data in files.items()})
    entry = TileEntry(int(result.estimated.sum()), {n: crc_of(data) for n, data in files.items()})
    return WrittenTile(entry, left if numbers else None)


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
