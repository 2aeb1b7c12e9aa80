"""What a job takes beside the same fit in memory, from files and from a store.

    python benches/python/job_pace.py [--megapixels 4.2] [--record]

A painting in 16 tiled TIFFs of six bands of 16 bits, and in the store that ``impasto.ingest`` makes
of them (not timed here: ``jobs.py --ingest``). ``memory`` is ``fit_sbrdf`` of the stack, which is
there; ``job`` is all of ``impasto.run`` with tiles of 1024, half precision and a budget of 1 GiB,
so that windows are read: hashes, learning, reading, the fit, the store. Seconds of a processor per
megapixel, which other programs on the machine change less than time; each call in a process of its
own that has fitted a few pixels before, so that imports are not counted. The three take turns four
times, and the least of each counts: one call differs from the next by a tenth.
``pace`` is the first over the second, ``beside`` their difference. The photographs are in the
system's cache.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from jobs import BANDS, BUDGET, LIGHTS, STEREO, photographs, piece
from record import run_info, show, write

import impasto
from impasto.io import read_header

FITS: dict[str, dict[str, Any]] = {
    "stereo": STEREO,
    "one lobe, apart": {"pooling": "painting", "joint": False},
    "one lobe": {"pooling": "painting"},
    "own lobes": {"pooling": "pixel"},
}
TURNS = 4
SOURCES = {"files": "dirs.lp", "store": "stack.zarr"}


def seconds(way: str, fit: str, folder: Path) -> float:
    """Of a processor: the fit in memory, or the job of files or of the store, in this process."""
    few = piece(BANDS, 128)
    if way == "memory":
        impasto.fit_sbrdf(few, **FITS[fit])
        stack = impasto.read_stack(folder / "dirs.lp")
        start = time.process_time()
        impasto.fit_sbrdf(stack, **FITS[fit])
        return time.process_time() - start
    impasto.run(few, folder / "few.zarr", tile=64, precision="half", **FITS[fit])
    shutil.rmtree(folder / "few.zarr")
    out = folder / "job.zarr"
    start = time.process_time()
    impasto.run(folder / SOURCES[way], out, memory=BUDGET, tile=1024, precision="half", **FITS[fit])
    found = time.process_time() - start
    shutil.rmtree(out)
    return found


def called(way: str, fit: str, folder: Path) -> float:
    """Seconds per megapixel of a call in a process of its own."""
    side = read_header(folder / "light00.tif").width
    command = [sys.executable, str(Path(__file__)), "--call", way, fit, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(json.loads(done.stdout.splitlines()[-1])) / (side**2 / 1e6)


def measured(megapixels: float, folder: Path) -> list[dict[str, Any]]:
    """A row for every fit and source."""
    photographs(megapixels, folder, BANDS)
    impasto.ingest(folder / "dirs.lp", folder / "stack.zarr", tile=1024)
    rows = []
    for fit in FITS:
        least = dict.fromkeys(("memory", *SOURCES), math.inf)
        for _ in range(TURNS):
            for way in least:
                least[way] = min(least[way], called(way, fit, folder))
        memory = least.pop("memory")
        for way, job in least.items():
            row = {"fit": fit, "source": way, "memory s/Mpx": memory, "job s/Mpx": job}
            rows.append(row | {"beside s/Mpx": job - memory, "pace": memory / job})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=float, default=4.2)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--call", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.call:
        way, fit, folder = options.call
        print(json.dumps(seconds(way, fit, Path(folder))))
        return
    with tempfile.TemporaryDirectory() as name:
        rows = measured(options.megapixels, Path(name))
    show(f"Jobs of {LIGHTS} photographs in {BANDS} bands", rows)
    if options.record:
        run = run_info("benches/python/job_pace.py --record")
        write("job_pace.json", {"run": run, "pace": rows})


if __name__ == "__main__":
    main()
