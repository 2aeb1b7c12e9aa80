"""Captures of a simulated rig with misfires, and captures that are killed.

    python benches/python/capture.py [--record]

770 shots (729 lamps, dark frames, reference shots) of a simulated painting of 96 x 96 pixels, of
which 2 % go wrong by any of 17 faults, for three seeds: what the run found, how many files are no
right photograph of their lamp at the end, and the time, with every file on the disk before the next
one is taken. Then 190 shots, killed 20 times. ``--record`` writes benches/results/capture.json.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from record import ROOT, run_info, show, write

from impasto import capture, simulate
from impasto.capture import hemisphere
from impasto.capture.drivers.faults import random_faults
from impasto.capture.drivers.simulated import SimulatedRig
from impasto.io import LightFile

sys.path.insert(0, str(ROOT / "tests"))

import captures
import killed_captures

LAMPS, SHARE, SEEDS, SIZE = 729, 0.02, (7, 8, 9), (96, 96)
KILLS = 20


def with_misfires(painting: simulate.Painting, seed: int, folder: Path) -> dict[str, Any]:
    directions = hemisphere(LAMPS, np.radians(15.0))
    lights = LightFile(Path("rig.lp"), "lp", None, directions, np.ones(LAMPS))
    plan = capture.plan_shots(lights)
    rig = SimulatedRig(painting, directions, random_faults(len(plan), SHARE, seed), seed)
    start, busy = time.perf_counter(), time.process_time()
    result = capture.run(plan, rig, rig, rig, folder, warm_up_s=0.0)
    seconds, busy = time.perf_counter() - start, time.process_time() - busy
    happened: dict[str, Any] = {}
    for taken in rig.taken:
        happened.setdefault(hashlib.sha256(taken.data).hexdigest(), taken)
    entries = captures.log_of(folder).entries.values()
    wrong = [one.fault for e in entries if (one := happened[e.sha256]).fault is not None]
    start = time.perf_counter()
    checked = capture.check(folder)
    return {
        "seed": seed,
        "shots": len(plan),
        "misfires": len(rig.faults.at),
        "orders": rig._order,
        "right": result.taken,
        "retake list": len(result.retakes),
        "wrong lamp": len(captures.wrong_pairings(folder, rig)),
        "other misfires kept": len(wrong),
        "seconds": seconds,
        "processor seconds": busy,
        "check, seconds": time.perf_counter() - start,
        "check finds": len(checked.retakes),
        "named": dict(
            Counter(
                line["code"]
                for kind in ("tried", "failed")
                for line in captures.lines_of(folder, kind)
            )
        ),
    }


def with_kills(folder: Path) -> dict[str, Any]:
    shots, rng = captures.plan(170), random.Random(20)
    steps = [rng.randint(1, 6 * (len(shots) // KILLS)) for _ in range(KILLS)]
    seen = killed_captures.killed_and_resumed(folder, shots, steps)
    return {
        "shots": len(shots),
        "kills": seen.kills,
        "most lost by one": max(seen.lost),
        "lost in all": sum(seen.lost),
        "right": seen.shots,
        "wrong lamp": seen.wrong,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--record", action="store_true", help="write benches/results/capture.json")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "killed").mkdir()
        # Before any thread is started, which a fork would not take along.
        killed = with_kills(folder / "killed")
        painting = simulate.painting(seed=3, size=SIZE, pitch_mm=0.4)
        rows = [with_misfires(painting, seed, folder / str(seed)) for seed in SEEDS]
    plain = [{key: value for key, value in row.items() if key != "named"} for row in rows]
    show("captures with 2 % misfires", plain)
    for row in rows:
        print(json.dumps(row["named"]))
    show("a capture that is killed", [killed])
    if options.record:
        head = {"run": run_info("python benches/python/capture.py --record")}
        print(f"\nwrote {write('capture.json', head | {'rows': rows, 'killed': [killed]})}")


if __name__ == "__main__":
    main()
