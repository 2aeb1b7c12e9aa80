"""What the default of ``fit_sbrdf`` costs: processor time beside lobes per pixel alone.

    python benches/python/default.py [--size 1024] [--only STACK] [--record]

Each call runs in a process of its own; times are processor seconds on one thread, the least of two,
or in ``threads`` seconds of a clock on one thread and on two, which need two idle cores; BLAS has
one thread.
``pixel`` is ``pooling="pixel", refine=False``; ``rig`` is ``refine_rig`` alone, which the default
contains, as it does the choice, the relief and what the model leaves. What is learned comes from a
sample, so that a larger painting takes no longer for it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from record import data_folder, run_info, show, write
from rigs import dome

import impasto
from impasto import simulate

REPEATS = 2
SIMULATED = {
    "simulated, satin, 24 lamps": ("satin", 24),
}
ICON = "icon, 72 lamps"


def photographs(name: str, size: int) -> impasto.Stack:
    """The stack of a name; simulated ones as large as asked."""
    if name == ICON:
        return impasto.read_stack(data_folder() / "icon_rti" / "dirs.lp")
    varnish, lamps = SIMULATED[name]
    painting = simulate.painting(0, (size, size), varnish=varnish, pitch_mm=102.4 / size)
    lights = [impasto.DistantLight((*one,), 0.5) for one in dome(lamps).tolist()]
    rig = impasto.Rig(lights, pitch_mm=painting.pitch_mm)
    return simulate.capture(painting, rig, "rgb", encoding="srgb", bits=8, exposure=0.5).stack


def measured(name: str, size: int, way: str, threads: int) -> dict[str, Any]:
    """Seconds of one call, in this process, and what it chose."""
    stack = photographs(name, size)
    begin, processor = time.perf_counter(), time.process_time()
    found: Any
    if way == "rig":
        found = impasto.refine_rig(stack, threads=threads)
    elif way == "pixel":
        found = impasto.fit_sbrdf(stack, pooling="pixel", refine=False, threads=threads)
    else:
        found = impasto.fit_sbrdf(stack, threads=threads)
    seconds = {"processor": time.process_time() - processor, "clock": time.perf_counter() - begin}
    _, _, height, width = stack.shape
    chosen = "-" if way != "default" else str(found.chosen.best)
    return seconds | {"chosen": chosen, "megapixels": height * width / 1e6}


WAYS = (("pixel", 1), ("pixel", 2), ("rig", 1), ("default", 1), ("default", 2))
"""Calls, and their threads."""


def least(name: str, size: int, way: str, threads: int) -> dict[str, Any]:
    """The same in processes of their own: the least of their times."""
    command = [sys.executable, str(Path(__file__)), "--size", str(size), "--call", name, way]
    found: dict[str, Any] = {}
    for _ in range(REPEATS):
        done = subprocess.run(
            [*command, str(threads)], capture_output=True, text=True, check=True,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        one = json.loads(done.stdout)
        for clock in ("processor", "clock"):
            one[clock] = min(one[clock], found.get(clock, one[clock]))
        found = one
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--only", choices=[*SIMULATED, ICON])
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--call", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.call:
        name, way, threads = options.call
        print(json.dumps(measured(name, options.size, way, int(threads))))
        return
    rows, threads = [], []
    for name in [options.only] if options.only else [*SIMULATED, ICON]:
        found = {call: least(name, options.size, *call) for call in WAYS}
        pixel, rig, default = (found[way, 1]["processor"] for way in ("pixel", "rig", "default"))
        rows.append(
            {
                "stack": name,
                "Mpx": float(np.round(found["default", 1]["megapixels"], 3)),
                "pixel s": pixel,
                "rig s": rig,
                "default s": default,
                "default / pixel": default / pixel,
                "chosen": found["default", 1]["chosen"],
            }
        )
        for way in ("pixel", "default"):
            one, two = (found[way, count]["clock"] for count in (1, 2))
            threads.append(
                {"stack": name, "call": way, "one s": one, "two s": two, "times": one / two}
            )
    show("Processor seconds, one thread", rows)
    show("Seconds on one thread, and on two", threads)
    if options.record:
        run = run_info("python benches/python/default.py --record")
        write("default.json", {"run": run, "rows": rows, "threads": threads})


if __name__ == "__main__":
    main()
