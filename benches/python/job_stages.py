"""Where the processor time of a tile of a job goes.

    python benches/python/job_stages.py [--record]

One tile of 1024 x 1024 pixels of 16 tiled TIFFs in six bands of 16 bits, photometric stereo by
least squares, half precision: every step alone, in the order of a job, in milliseconds of a
processor; the least of five. *Hashes* are the SHA-256 of what the tile has of the photographs.
*All of encoding* contains the two steps before it, statistics, and the files in memory. What is
written goes to the disk; the photographs are in the system's cache.
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
from impasto.fit.saved import maps_of
from impasto.io.files import atomic_together
from impasto.io.json_lines import crc_of
from impasto.io.results.precision import to_store
from impasto.io.results.zarr_store import same_arrays
from impasto.jobs.assembly import files_of_tile
from impasto.jobs.grid import Grid
from impasto.jobs.levels import half_scale
from impasto.jobs.photographs import open_photographs
from impasto.jobs.tiles import fitted
from impasto.report import file_entry

TILE, ROUNDS = 1024, 5


def measured(folder: Path) -> list[dict[str, Any]]:
    """The steps of one tile."""
    photographs(4.2, folder, BANDS)
    # Of no memory, so that windows are read from the files.
    source = open_photographs(folder / "dirs.lp", {}, 1, None)
    grid = Grid(*source.size, TILE)
    window = grid.window((0, 0))
    model = impasto.learn_sbrdf(source.window(*window), **STEREO)
    rows: list[dict[str, Any]] = []

    def step(name: str, work: Callable[[], Any], share: float = 1.0) -> Any:
        times = []
        for _ in range(ROUNDS):
            start = time.process_time()
            found = work()
            times.append(time.process_time() - start)
        rows.append({"step": name, "ms": 1e3 * min(times) * share})
        return found

    names = [folder / f"light{index:02}.tif" for index in range(LIGHTS)]
    part = TILE**2 / (source.size[0] * source.size[1])
    step("hashes", lambda: [file_entry(name) for name in names], part)
    stack = step("reading", lambda: source.window(*window))
    result = step("fit", lambda: fitted(model, stack, grid, (0, 0), 1))
    small = step("smaller scale", lambda: half_scale(result, grid))
    arrays = result._saved()
    maps = {name: arrays[name] for name in maps_of(result)} | small
    for name in same_arrays(maps):
        del maps[name]
    step("half precision", lambda: [to_store(name, maps[name], "half") for name in maps])
    files, _ = step("all of encoding", lambda: files_of_tile(grid, (0, 0), result, "half"))
    step("checksums", lambda: [crc_of(data) for data in files.values()])
    target = folder / "store"
    step("writing", lambda: atomic_together({target / name: files[name] for name in files}))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = measured(Path(name))
    show("A tile of a job", rows)
    if options.record:
        run = run_info("benches/python/job_stages.py --record")
        write("job_stages.json", {"run": run, "stages": rows})


if __name__ == "__main__":
    main()
