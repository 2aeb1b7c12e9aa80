"""Where the processor time of a tile of a job goes.

    python benches/python/job_stages.py [--record]

One tile of 1024 x 1024 pixels of 16 tiled TIFFs in six bands of 16 bits, half precision: every step
alone, in milliseconds of a processor; the least of five, of a fit with lobes the lesser of two.
``reading``: *hashes* are the SHA-256 of what the tile has of the photographs; the same tile of the
store that ``impasto.ingest`` makes of them is known by checksums in its file. ``tiles``: a row for
every fit, by a model that is learned from the tile. *Encoding* contains the smaller scale, half
precision and statistics, and gives files in memory. What is written goes to the disk; the
photographs are in the system's cache.

``files`` and ``store``: what share of all steps a fit is, from files, which learning reads once
more, and from the store, of which learning copies a ninth. Steps run one after another, so that
other programs on the machine change a share less than the time of a whole job (``job_pace.py``).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jobs import BANDS, LIGHTS, STEREO, photographs
from record import run_info, show, write

import impasto
from impasto._internal.recycling import Recycled, recycling
from impasto.fit.saved import maps_of
from impasto.io.files import atomic_together
from impasto.io.json_lines import crc_of
from impasto.io.results.precision import to_store
from impasto.io.results.zarr_store import same_arrays
from impasto.jobs.assembly import files_of_tile
from impasto.jobs.grid import Grid
from impasto.jobs.levels import half_scale
from impasto.jobs.photographs import Photographs, open_photographs
from impasto.jobs.tiles import fitted
from impasto.report import file_entry

TILE, ROUNDS = 1024, 5
FITS: dict[str, dict[str, Any]] = {
    "stereo": STEREO,
    "one lobe": {"pooling": "painting"},
    "own lobes": {"pooling": "pixel"},
}
BEFORE = {
    "files": ("hashes", "reading", "reading"),
    "store": ("hashes, store", "reading, store", "a ninth of it, store"),
}
AFTER = ("encoding ms", "checksums ms", "writing ms")


def least(work: Callable[[], Any], rounds: int = ROUNDS) -> tuple[float, Any]:
    """Milliseconds of a processor, and what is found."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        found = work()
        times.append(time.process_time() - start)
    return 1e3 * min(times), found


def reading(folder: Path, source: Photographs, grid: Grid) -> list[dict[str, Any]]:
    """What it takes until the photographs of a tile are there."""
    names = [folder / f"light{index:02}.tif" for index in range(LIGHTS)]
    store = impasto.ingest(folder / "dirs.lp", folder / "stack.zarr", tile=TILE)
    stored = open_photographs(store, {}, 1, None)
    window = grid.window((0, 0))
    memory = Recycled()

    def window_of(photographs: Photographs) -> impasto.Stack:
        with recycling(memory):  # as the second pass of a job does
            return photographs.window(*window)

    part = TILE**2 / (source.size[0] * source.size[1])
    steps: dict[str, tuple[Callable[[], Any], float]] = {
        "hashes": (lambda: [file_entry(name) for name in names], part),
        "reading": (lambda: window_of(source), 1.0),
        "hashes, store": (stored.inputs, part),
        "reading, store": (lambda: window_of(stored), 1.0),
        "a ninth of it, store": (lambda: stored.thinned(*window, 3), 1.0),
    }
    return [{"step": name, "ms": least(work)[0] * share} for name, (work, share) in steps.items()]


def of_a_tile(folder: Path, stack: impasto.Stack, grid: Grid, fit: str) -> dict[str, Any]:
    """What it takes from the photographs of a tile to its files on the disk."""
    model = impasto.learn_sbrdf(stack, **FITS[fit])
    rounds = ROUNDS if fit == "stereo" else 2
    ms, result = least(lambda: fitted(model, stack, grid, (0, 0), 1), rounds)
    row: dict[str, Any] = {"fit": fit, "ms": ms}
    row["smaller scale ms"], small = least(lambda: half_scale(result, grid))
    arrays = result.arrays()
    maps = {name: arrays[name] for name in maps_of(result)} | small
    for name in same_arrays(maps):
        del maps[name]
    row["half precision ms"], _ = least(
        lambda: [to_store(name, maps[name], "half") for name in maps]
    )
    row["encoding ms"], (files, _) = least(lambda: files_of_tile(grid, (0, 0), result, "half"))
    row["checksums ms"], _ = least(lambda: [crc_of(data) for data in files.values()])
    named = {folder / fit / name: data for name, data in files.items()}
    row["writing ms"], _ = least(lambda: atomic_together(named))
    return row


def measured(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """The steps before the fit, those from there on for every fit, and its share of all."""
    photographs(4.2, folder, BANDS)
    # Of no memory, so that windows are read from the files.
    source = open_photographs(folder / "dirs.lp", {}, 1, None)
    grid = Grid(*source.size, TILE)
    before = reading(folder, source, grid)
    stack = source.window(*grid.window((0, 0)))
    ms = {row["step"]: row["ms"] for row in before}
    tiles = []
    for fit in FITS:
        row = of_a_tile(folder, stack, grid, fit)
        after = sum(row[step] for step in AFTER)
        for way, steps in BEFORE.items():
            row[way] = row["ms"] / (row["ms"] + after + sum(ms[step] for step in steps))
        tiles.append(row)
    return {"reading": before, "tiles": tiles}


def sentences(before: list[dict[str, Any]], tiles: list[dict[str, Any]]) -> dict[str, str]:
    """What the numbers say, for documentation."""
    ms = {row["step"]: row["ms"] for row in before}
    stereo, lobes = (
        next(row for row in tiles if row["fit"] == fit) for fit in ("stereo", "own lobes")
    )
    times = {
        "hashes": ms["hashes"] / stereo["ms"],
        "reading": ms["reading"] / stereo["ms"],
        "encoding": stereo["encoding ms"] / stereo["ms"],
    }
    return {
        "share": (
            f"With lobes per pixel the fit is {100.0 * lobes['files']:.0f} % of these steps from "
            f"files and {100.0 * lobes['store']:.0f} % from a store."
        ),
        "copies": (
            "No job of photometric stereo comes near the pace of the fit in memory: one tile "
            f"computes for {1e-3 * stereo['ms']:.2f} s on the 200 MB of a megapixel. One SHA-256 "
            f"of them takes {times['hashes']:.1f} times as long, one copy out of the system's "
            f"cache with the bands taken apart {times['reading']:.1f} times, and its maps as files "
            f"of a store {times['encoding']:.1f} times."
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = measured(Path(name))
    for what, rows in found.items():
        show(f"A tile of a job: {what}", rows)
    if options.record:
        run = run_info("benches/python/job_stages.py --record")
        said = sentences(found["reading"], found["tiles"])
        write("job_stages.json", {"run": run, **found, "sentences": said})


if __name__ == "__main__":
    main()
