"""Instructions per fit, lanes against MINPACK, where the machine is too busy for clocks.

    python benches/python/instructions.py [PROBLEM ...]

Runs the Rust benchmark under valgrind, which knows AVX2 (8 lanes), not AVX-512 (16): what the
widest registers save is not in these numbers. What either side shares (making the data) is counted
alone and taken off.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from record import ROOT, show

PROBLEMS = ("torrance-sparrow", "unprojected", "lafortune-1", "lafortune-3")


def binary() -> str:
    """The benchmark, built."""
    command = ["cargo", "bench", "-q", "-p", "impasto-benches", "--bench", "fits", "--no-run"]
    command += ["--message-format=json"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    built = [json.loads(line) for line in done.stdout.splitlines()]
    found = [each["executable"] for each in built if each.get("executable")]
    return str(found[-1])


def count(program: str, side: str, problem: str) -> tuple[int, list[int]]:
    """Instructions, and how many fits either side makes of it."""
    command = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]
    command += [program, "count", side, problem]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    counted = re.search(r"I\s+refs:\s+([\d,]+)", done.stderr)
    if counted is None:
        raise RuntimeError(f"valgrind says nothing of instructions:\n{done.stderr}")
    return int(counted[1].replace(",", "")), [int(word) for word in done.stdout.split()]


def counted(problems: Sequence[str] = PROBLEMS) -> list[dict[str, Any]]:
    """Instructions per fit of either side; nothing where valgrind is not installed."""
    if shutil.which("valgrind") is None:
        return []
    program = binary()
    rows: list[dict[str, Any]] = []
    for problem in problems:
        shared, fits = count(program, "neither", problem)
        lanes, minpack = (
            (count(program, side, problem)[0] - shared) / made
            for side, made in zip(("lanes", "minpack"), fits, strict=True)
        )
        row = {"lanes": lanes, "minpack": minpack, "ratio": minpack / lanes}
        rows.append({"problem": problem} | row)
    return rows


def main() -> None:
    rows = counted(sys.argv[1:] or PROBLEMS)
    if not rows:
        sys.exit("instructions: valgrind is not installed")
    show("Instructions per fit", rows)


if __name__ == "__main__":
    main()
