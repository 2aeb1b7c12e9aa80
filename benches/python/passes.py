"""Where the time of lobes per pixel goes: passes over a pixel's photographs, by what they are for.

    python benches/python/passes.py [--effort standard] [--record]

Every data set of the study that has one view is fitted once on one thread, with ``pooling="pixel"``
and the rig as it is. A pass computes residuals and slopes, or the weights, of all photographs of a
pixel. *Rest* is what is no pass: photometric stereo, decoding, predicted errors, maps and Python.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

from record import data_folder, run_info, show, write

import impasto
from impasto.fit import lobes
from study.data_sets import FULL, available
from study.materials import MODELS

DATA = ("own model", *MODELS, "icon")


@dataclass
class Purpose:
    """What the passes of one purpose took, of all fits of a data set."""

    passes: int = 0
    lanes: int = 0
    seconds: float = 0.0


def counted(name: str, effort: str) -> tuple[dict[str, Purpose], float, int]:
    """Passes by purpose, processor seconds and pixels of a data set's fits."""
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

    seconds, pixels = 0.0, 0
    paintings = made[name]()
    lobes._core.fit_lobes = counting
    try:
        for part in paintings:
            begin = time.process_time()
            impasto.fit_sbrdf(part.stack, pooling="pixel", refine=False, effort=effort, threads=1)
            seconds += time.process_time() - begin
            pixels += part.stack.shape[2] * part.stack.shape[3]
    finally:
        lobes._core.fit_lobes = core
    return found, seconds, pixels


def rows_of(name: str, effort: str) -> list[dict[str, Any]]:
    """The rows of a data set."""
    found, seconds, pixels = counted(name, effort)
    rows: list[dict[str, Any]] = [
        {
            "data": name,
            "purpose": purpose,
            "passes": one.passes / pixels,
            "busy": 100.0 * one.passes / max(one.lanes, 1),
            "share": 100.0 * one.seconds / seconds,
        }
        for purpose, one in found.items()
        if one.passes
    ]
    rest = 100.0 - sum(row["share"] for row in rows)
    rows.append({"data": name, "purpose": "rest", "passes": None, "busy": None, "share": rest})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effort", default="standard")
    parser.add_argument("--record", action="store_true")
    options = parser.parse_args()
    rows = []
    for name in DATA:
        rows += rows_of(name, options.effort)
        show(f"{name}, {options.effort}", [row for row in rows if row["data"] == name])
    if options.record:
        command = f"python benches/python/passes.py --effort {options.effort} --record"
        write("passes.json", {"run": run_info(command), "rows": rows})


if __name__ == "__main__":
    main()
