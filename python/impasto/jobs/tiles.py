"""The second pass of a job: tiles are read, fitted and written one after another."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from impasto._internal.heap import give_back
from impasto._internal.recycling import Recycled, recycling
from impasto._internal.windows import within
from impasto.fit.learning import LearnedModel
from impasto.fit.result import Sbrdf
from impasto.io.files import as_problem_of, atomic_bytes, atomic_together
from impasto.io.json_lines import crc_of
from impasto.io.npz import npz_bytes, read_npz
from impasto.io.results.precision import Precision
from impasto.jobs.assembly import KNOWN, files_of_tile
from impasto.jobs.grid import Grid, Tile
from impasto.jobs.journal import Journal, TileEntry
from impasto.jobs.photographs import Photographs
from impasto.jobs.pipeline import pipelined
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
        Called after every tile with the number of those that are on the disk at least.
    check
        Called with a tile before it is taken down; an error of it leaves the tile out.
    """

    def __init__(
        self,
        notes: Path,
        grid: Grid,
        journal: Journal,
        report: Callable[[int], object],
        check: Callable[[Tile], object] = lambda tile: None,
    ) -> None:
        self._notes = notes
        self._grid = grid
        self._journal = journal
        self._report = report
        self._check = check
        self._reported = len(journal.entries.tiles)
        path = notes / NUMBERS
        self._known = bool(read_npz(path)[KNOWN]) if path.exists() else None
        self._last = time.monotonic()

    @property
    def wants_numbers(self) -> bool:
        """Whether there are none yet of a tile that has an estimated pixel."""
        return not self._known

    def add(self, tile: Tile, written: WrittenTile) -> None:
        """A tile all of whose files are on the disk."""
        self._check(tile)
        self._keep(written.numbers)
        self._journal.add(tile, written.entry)
        before, self._last = self._last, time.monotonic()
        seconds = round(self._last - before, 6)
        _add_pace(self._notes / PACE, {"pixels": self._grid.pixels(tile), "seconds": seconds})

    def report(self) -> None:
        """Say that there is one tile more."""
        self._reported += 1
        self._report(self._reported)

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


@dataclass(frozen=True)
class EncodedTile:
    """A tile all of whose maps are files in memory.

    Attributes
    ----------
    estimated
        How many of its pixels have an estimate.
    files
        What is in each, by its name in the store.
    numbers
        What is not a map.
    """

    estimated: int
    files: Mapping[str, bytes | memoryview]
    numbers: dict[str, NDArray[Any]]

    @classmethod
    def of(
        cls, grid: Grid, tile: Tile, result: Sbrdf, precision: Precision, threads: int | None
    ) -> EncodedTile:
        """Every map of a result in a file of its own, in this precision."""
        files, numbers = files_of_tile(grid, tile, result, precision, threads=threads)
        return cls(int(result.estimated.sum()), files, numbers)

    def write(self, folder: Path, *, numbers: bool = True) -> WrittenTile:
        """All files are on the disk when this returns.

        Parameters
        ----------
        folder
            The store, which is not whole yet.
        numbers
            Whether what is not a map is returned, too.
        """
        atomic_together({folder / name: data for name, data in self.files.items()})
        crcs = {name: crc_of(data) for name, data in self.files.items()}
        give_back()
        return WrittenTile(TileEntry(self.estimated, crcs), self.numbers if numbers else None)


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
    """Fit the tiles in their order, while others are read, encoded and written."""
    memory = Recycled()

    def read(tile: Tile) -> Stack:
        with recycling(memory):
            return photographs.window(*grid.window(tile, model.halo))

    def fit(tile: Tile, stack: Stack) -> Sbrdf:
        return fitted(model, stack, grid, tile, threads)

    def encode(tile: Tile, result: Sbrdf) -> EncodedTile:
        return EncodedTile.of(grid, tile, result, precision, threads)

    def write(tile: Tile, encoded: EncodedTile) -> None:
        log.add(tile, encoded.write(folder, numbers=log.wants_numbers))

    with closing(pipelined(tiles, read, fit, encode, write)) as written:
        for _ in written:
            log.report()


def _add_pace(path: Path, entry: Mapping[str, Any]) -> None:
    with as_problem_of(path), path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry, sort_keys=True) + "\n")
