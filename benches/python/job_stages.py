"""Where the processor time of a tile of a job goes.

    python benches/python/job_stages.py [--record]

One tile of 1024 x 1024 pixels of 16 tiled TIFFs in six bands of 16 bits, photometric stereo by
least squares, half precision: every step alone, in the order of a job, in milliseconds of a
processor; the least of five. *Hashes* are the SHA-256 of what the tile has of the photographs;
the same tile of the store that ``impasto.ingest`` makes of them is known by checksums in its file.
Fits with lobes, of a model that is learned from the tile, run twice. *All of encoding*, of the maps
of photometric stereo, contains the two steps before it, statistics, and the files in memory. What
is written goes to the disk; the photographs are in the system's cache.

``paces``: what share of these steps a fit is, from files, which learning reads once more, and from
the store, of which learning copies a ninth. Steps run one after another, so that other
programs on the machine change a share less than the time of a whole job (``job_pace.py``).
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
LOBES: dict[str, dict[str, Any]] = {
    "one lobe": {"pooling": "painting"},
    "own lobes": {"pooling": "pixel"},
}
AFTER = ("all of encoding", "checksums", "writing")
BESIDE = {
    "files": ("hashes", "reading", "reading", *AFTER),
    "store": ("hashes, store", "reading, store", "a ninth of it, store", *AFTER),
}


def measured(folder: Path) -> list[dict[str, Any]]:
    """The steps of one tile."""
    photographs(4.2, folder, BANDS)
    # Of no memory, so that windows are read from the files.
    source = open_photographs(folder / "dirs.lp", {}, 1, None)
    grid = Grid(*source.size, TILE)
    window = grid.window((0, 0))
    model = impasto.learn_sbrdf(source.window(*window), **STEREO)
    rows: list[dict[str, Any]] = []

    def step(name: str, work: Callable[[], Any], share: float = 1.0, rounds: int = ROUNDS) -> Any:
        times = []
        for _ in range(rounds):
            start = time.process_time()
            found = work()
            times.append(time.process_time() - start)
        rows.append({"step": name, "ms": 1e3 * min(times) * share})
        return found

    names = [folder / f"light{index:02}.tif" for index in range(LIGHTS)]
    part = TILE**2 / (source.size[0] * source.size[1])
    step("hashes", lambda: [file_entry(name) for name in names], part)
    memory = Recycled()

    def window_of(photographs: Photographs) -> impasto.Stack:
        with recycling(memory):  # as the second pass of a job does
            return photographs.window(*window)

    stack = step("reading", lambda: window_of(source))
    store = impasto.ingest(folder / "dirs.lp", folder / "stack.zarr", tile=TILE)
    stored = open_photographs(store, {}, 1, None)
    step("hashes, store", stored.inputs, part)
    step("reading, store", lambda: window_of(stored))
    step("a ninth of it, store", lambda: stored.thinned(*window, 3))
    result = step("fit", lambda: fitted(model, stack, grid, (0, 0), 1))
    small = step("smaller scale", lambda: half_scale(result, grid))
    arrays = result.arrays()
    maps = {name: arrays[name] for name in maps_of(result)} | small
    for name in same_arrays(maps):
        del maps[name]
    step("half precision", lambda: [to_store(name, maps[name], "half") for name in maps])
    files, _ = step("all of encoding", lambda: files_of_tile(grid, (0, 0), result, "half"))
    step("checksums", lambda: [crc_of(data) for data in files.values()])
    target = folder / "store"
    step("writing", lambda: atomic_together({target / name: files[name] for name in files}))
    for name, options in LOBES.items():
        lobes = impasto.learn_sbrdf(stack, **options)
        step(f"fit, {name}", lambda lobes=lobes: fitted(lobes, stack, grid, (0, 0), 1), rounds=2)
    return rows


def paces(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What share of a job each fit is."""
    ms = {row["step"]: row["ms"] for row in rows}
    found = []
    for fit, name in {"stereo": "fit", **{fit: f"fit, {fit}" for fit in LOBES}}.items():
        beside = {way: sum(ms[step] for step in steps) for way, steps in BESIDE.items()}
        shares = {way: ms[name] / (ms[name] + beside[way]) for way in BESIDE}
        found.append({"fit": fit, "ms": ms[name], **shares})
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = measured(Path(name))
    show("A tile of a job", rows)
    show("Share of the fit", paces(rows))
    if options.record:
        run = run_info("benches/python/job_stages.py --record")
        write("job_stages.json", {"run": run, "stages": rows, "paces": paces(rows)})


if __name__ == "__main__":
    main()
