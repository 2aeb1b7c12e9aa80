"""Steps and precision, bad pixels by strategy, shares of the machine's limits: the solver alone.

    python benches/python/kernels.py [--record]

Runs `cargo bench --bench fits -- study`, which says more about what is measured, and records
benches/results/kernels.json. One thread, processor time, the least of three rounds; with `--record`
instructions, too (`benches/python/instructions.py`).
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from instructions import counted
from record import ROOT, run_info, show, write

KINDS = {"steps": "steps", "strategy": "strategies", "limit": "limits", "kernel": "kernels"}


def measured() -> dict[str, list[dict[str, Any]]]:
    """Rows by kind."""
    command = ["cargo", "bench", "-q", "-p", "impasto-benches", "--bench", "fits", "--", "study"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in KINDS.values()}
    for line in done.stdout.splitlines():
        row = json.loads(line)
        found[KINDS[row.pop("kind")]].append(row)
    return found


def sentences(found: dict[str, list[dict[str, Any]]]) -> dict[str, str]:
    """What the numbers say, for documentation."""
    steps = {(row["precision"], row["steps"]): row for row in found["steps"]}
    most = max(row["steps"] for row in found["steps"])
    single, double, polished = (steps[name, most] for name in ("f32", "f64", "f32, polished"))
    ways = {row["strategy"]: row for row in found["strategies"]}
    ours, once = ways["one at a time"], ways["all at once, starts: 1"]
    again = ways["all at once, starts: 8"]
    return {
        "precision": (
            f"With {most} steps single precision ends {single['excess_p99']:.1g} above the least "
            f"cost (the 99th percentile), and {single['bounds_p99']:.1g} of a Cramér-Rao bound off "
            f"in the width; double precision takes {double['ns'] / single['ns']:.1f} times as "
            f"long, and single precision polished by three steps of double "
            f"{polished['ns'] / single['ns']:.1f} times."
        ),
        "strategies": (
            f"Three lobes at once end in a wrong basin at {once['bad']:.1f} % of the pixels, from "
            f"the best of eight starts at {again['bad']:.1f} % in "
            f"{again['us'] / once['us']:.1f} times the time; one lobe after the other at "
            f"{ours['bad']:.1f} % in {ours['us'] / once['us']:.1f} times the time."
        ),
    }


def main() -> None:
    found = measured()
    for title, rows in found.items():
        show(title, rows)
    if "--record" in sys.argv[1:]:
        found["instructions"] = counted()
        info = run_info("python benches/python/kernels.py --record")
        write("kernels.json", {"run": info} | found | {"sentences": sentences(found)})


if __name__ == "__main__":
    main()
