"""Where the time of lobes per pixel goes: passes over a pixel's photographs, by what they are for.

    python benches/python/passes.py [--effort standard] [--operations] [--record]

Every data set of the study that has one view is fitted once on one thread, with ``pooling="pixel"``
and the rig as it is. A pass computes residuals and slopes, or the weights, of all photographs of a
pixel. *Rest* is what is no pass: photometric stereo, decoding, predicted errors, maps and Python.

``--operations`` (needed for ``--record``) builds the extension once more, with numbers that count
what is done with them (Cargo feature ``operations``; a fused multiply-add is one), and fits the
same again: operations per pass and photograph of a pixel, and their rate as a share of the roof of
the machine [@williams2009roofline]. This is what independent fused multiply-adds of one thread
reach in single precision (``cargo bench -p impasto-benches --bench fits -- limits``), each one
operation; photographs of a tile stay in the cache.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from record import ROOT, data_folder, run_info, show, write

import impasto
from impasto.fit import lobes
from study.data_sets import FULL, available
from study.materials import MODELS

DATA = ("own model", *MODELS, "icon")
TARGET = ROOT / "target" / "operations"
COUNTING = """
import importlib.util, os, runpy, sys

library, script, *arguments = sys.argv[1:]
found = importlib.util.spec_from_file_location("impasto._core", library)
sys.modules["impasto._core"] = module = importlib.util.module_from_spec(found)
found.loader.exec_module(module)
sys.argv = [script, *arguments]
sys.path.insert(0, os.path.dirname(script))
runpy.run_path(script, run_name="__main__")
"""
"""Runs a script with another build of the extension."""


@dataclass
class Purpose:
    """What the passes of one purpose took, of all fits of a data set."""

    passes: int = 0
    lanes: int = 0
    seconds: float = 0.0


@dataclass
class Fits:
    """The fits of a data set: passes by purpose, processor seconds and pixels."""

    found: dict[str, Purpose]
    seconds: float
    pixels: int
    photographs: int


def counted(name: str, effort: str) -> Fits:
    """The fits of a data set."""
    made, missing = available(FULL, 0, data_folder())
    if name in missing:
        raise SystemExit(f"{name}: {missing[name]}")
    found: dict[str, Purpose] = {}
    core = lobes._core.fit_lobes

    def counting(*arguments: Any) -> Any:
        answer = core(*arguments)
        for purpose, lanes, useful, seconds in answer[1]:
            sum_of = found.setdefault(purpose, Purpose())
            sum_of.passes += useful
            sum_of.lanes += lanes
            sum_of.seconds += seconds
        return answer

    seconds, pixels, photographs = 0.0, 0, 0
    paintings = made[name]()
    lobes._core.fit_lobes = counting
    try:
        for part in paintings:
            begin = time.process_time()
            impasto.fit_sbrdf(part.stack, pooling="pixel", refine=False, effort=effort, threads=1)
            seconds += time.process_time() - begin
            photographs, _, height, width = part.stack.shape
            pixels += height * width
    finally:
        lobes._core.fit_lobes = core
    return Fits(found, seconds, pixels, photographs)


class Operations:
    """Operations by purpose, from a build that counts them, and the roof of this machine."""

    def __init__(self) -> None:
        build = ["cargo", "build", "--release", "--quiet", "--package", "impasto-py"]
        build += ["--no-default-features", "--features", "operations", "--target-dir", str(TARGET)]
        python = {"PYO3_PYTHON": sys.executable}
        subprocess.run(build, cwd=ROOT, env=os.environ | python, check=True)
        names = {"darwin": "lib_core.dylib", "win32": "_core.dll"}
        self._library = TARGET / "release" / names.get(sys.platform, "lib_core.so")
        limits = ["cargo", "bench", "--quiet", "--package", "impasto-benches", "--bench", "fits"]
        command = [*limits, "--", "limits"]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        found = {row["what"]: row["value"] for row in map(json.loads, done.stdout.splitlines())}
        # There, a fused multiply-add is two operations.
        self.roof = 0.5e9 * found["GFLOP/s"]
        """Operations in a second."""

    def of(self, name: str, effort: str) -> dict[str, int]:
        """Operations of a data set's fits, by purpose."""
        script = [str(self._library), str(Path(__file__).resolve())]
        command = [sys.executable, "-c", COUNTING, *script, "--count", name, "--effort", effort]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        found: dict[str, int] = json.loads(done.stdout)
        return found


def rows_of(name: str, effort: str, operations: Operations | None) -> list[dict[str, Any]]:
    """The rows of a data set."""
    fits = counted(name, effort)
    made = {} if operations is None else operations.of(name, effort)
    rows: list[dict[str, Any]] = []
    for purpose, one in fits.found.items():
        if not one.passes:
            continue
        row = {
            "data": name,
            "purpose": purpose,
            "passes": one.passes / fits.pixels,
            "busy": 100.0 * one.passes / max(one.lanes, 1),
            "share": 100.0 * one.seconds / fits.seconds,
        }
        if operations is not None:
            row["operations"] = made[purpose] / (one.passes * fits.photographs)
            row["roof"] = 100.0 * made[purpose] / (one.seconds * operations.roof)
        rows.append(row)
    rest = 100.0 - sum(row["share"] for row in rows)
    rows.append(dict.fromkeys(rows[0]) | {"data": name, "purpose": "rest", "share": rest})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effort", default="standard")
    parser.add_argument("--operations", action="store_true", help="count them, too")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--count", choices=DATA, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.count:
        found = counted(options.count, options.effort).found
        # This build counts operations where others count nanoseconds.
        print(json.dumps({purpose: round(1e9 * one.seconds) for purpose, one in found.items()}))
        return
    if options.record and not options.operations:
        parser.error("--record: the table has operations, add --operations")
    operations = Operations() if options.operations else None
    rows = []
    for name in DATA:
        rows += rows_of(name, options.effort, operations)
        show(f"{name}, {options.effort}", [row for row in rows if row["data"] == name])
    if options.record:
        command = f"python benches/python/passes.py --effort {options.effort} --operations --record"
        roof = None if operations is None else operations.roof
        write("passes.json", {"run": run_info(command), "roof": roof, "rows": rows})


if __name__ == "__main__":
    main()
