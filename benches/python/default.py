"""What the default of ``fit_sbrdf`` costs: processor time beside lobes per pixel alone.

    python benches/python/default.py [--size 1024] [--only STACK] [--record]

Each call runs on one thread in a process of its own; times are processor seconds, the least of two.
``pixel`` is ``pooling="pixel", refine=False``; ``rig`` is ``refine_rig`` alone, which the default
contains, as it does the choice, the relief and what the model leaves. What is learned comes from a
sample, so that a larger painting takes no longer for it.
"""

from __future__ import annotations

import argparse
import json
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


def measured(name: str, size: int, way: str) -> dict[str, Any]:
    """Processor seconds of one call, in this process, and what it chose."""
    stack = photographs(name, size)
    begin = time.process_time()
    found: Any
    if way == "rig":
        found = impasto.refine_rig(stack, threads=1)
    elif way == "pixel":
        found = impasto.fit_sbrdf(stack, pooling="pixel", refine=False, threads=1)
    else:
        found = impasto.fit_sbrdf(stack, threads=1)
    seconds = time.process_time() - begin
    _, _, height, width = stack.shape
    chosen = "-" if way != "default" else str(found.chosen.best)
    return {"seconds": seconds, "chosen": chosen, "megapixels": height * width / 1e6}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--only", choices=[*SIMULATED, ICON])
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--call", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.call:
        print(json.dumps(measured(options.call[0], options.size, options.call[1])))
        return
    rows = []
    for name in [options.only] if options.only else [*SIMULATED, ICON]:
        found: dict[str, dict[str, Any]] = {}
        for _ in range(REPEATS):
            for way in ("pixel", "rig", "default"):
                command = [sys.executable, str(Path(__file__)), "--size", str(options.size)]
                done = subprocess.run(
                    [*command, "--call", name, way], capture_output=True, text=True, check=True
                )
                one = json.loads(done.stdout)
                best = found.setdefault(way, one)
                best["seconds"] = min(best["seconds"], one["seconds"])
        pixel, rig, default = (found[way]["seconds"] for way in ("pixel", "rig", "default"))
        rows.append(
            {
                "stack": name,
                "Mpx": float(np.round(found["default"]["megapixels"], 3)),
                "pixel s": pixel,
                "rig s": rig,
                "default s": default,
                "default / pixel": default / pixel,
                "chosen": found["default"]["chosen"],
            }
        )
    show("Processor seconds, one thread", rows)
    if options.record:
        write(
            "default.json",
            {"run": run_info("python benches/python/default.py --record"), "rows": rows},
        )


if __name__ == "__main__":
    main()
