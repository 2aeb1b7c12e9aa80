"""What ran where: a file of one line per run, so that an interrupted study goes on."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impasto import _core
from impasto.errors import ArgumentError, CorruptInputError

SCHEMA = 1
RUNS = "runs.jsonl"


def run_info() -> dict[str, Any]:
    """Machine and versions; the commit where the package runs from a checkout."""
    return {
        "commit": _commit(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "simd": _core.build_info()["simd"],
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "impasto": _core.build_info()["version"],
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _commit() -> str | None:
    here = Path(__file__).resolve().parent

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", *arguments], cwd=here, capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        top = git("rev-parse", "--show-toplevel")
        # An installed package may lie inside somebody else's repository.
        if not top or not (Path(top) / "crates" / "impasto").is_dir():
            return None
        measured = ("--", f"{top}/crates", f"{top}/python")
        changed = "+" if git("status", "-s", "-uno", *measured) else ""
        return git("log", "-1", "--format=%h", *measured) + changed
    except OSError:
        return None


class Journal:
    """The runs of one study in a folder, one JSON object a line, what they have in common first.

    Parameters
    ----------
    folder
        Made if it is not there.
    head
        What the runs have in common: under ``run`` what ran where.
    terms
        Names of what must be the same under ``run`` for a study to go on. None: the folder holds a
        study, which is only read.
    """

    def __init__(
        self, folder: Path, head: dict[str, Any] | None = None, terms: Sequence[str] = ()
    ) -> None:
        self.path = folder / RUNS
        self.runs: dict[tuple[str, str, str], dict[str, Any]] = {}
        head = None if head is None else {"schema": SCHEMA} | head
        if head is not None and not self.path.exists():
            folder.mkdir(parents=True, exist_ok=True)
            self.path.write_text(json.dumps(head) + "\n", encoding="utf-8")
        first, *runs = list(self._lines()) or [{}]
        self.head = first
        if first.get("schema") != SCHEMA:
            raise CorruptInputError(self.path, "is no journal of a study that this version knows")
        if head is not None:
            for term in terms:
                was, now = first["run"].get(term), head["run"][term]
                if was != now:
                    raise ArgumentError(
                        f"out: {self.path} holds runs of another study ({term} {was!r}, now "
                        f"{now!r}); choose another folder or remove that file"
                    )
            # A last line that was cut off by an interruption is written anew.
            whole = [json.dumps(line) for line in (first, *runs)]
            self.path.write_text("\n".join(whole) + "\n", encoding="utf-8")
        self.runs = {key_of(run): run for run in runs}

    def found(self) -> dict[str, Any]:
        """``run``, ``missing``, ``skipped`` (settings and why), ``rows``."""
        rows = list(self.runs.values())
        skipped = sorted({f"{r['setting']}: {r['skipped']}" for r in rows if "skipped" in r})
        measured = [row for row in rows if "skipped" not in row]
        return {
            "run": self.head["run"],
            "missing": self.head["missing"],
            "skipped": skipped,
            "rows": measured,
        }

    def _lines(self) -> Iterator[dict[str, Any]]:
        lines = self.path.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines):
            try:
                yield json.loads(line)
            except json.JSONDecodeError as error:
                if number == len(lines) - 1:
                    return
                raise CorruptInputError(self.path, f"line {number + 1} is no JSON") from error

    def add(self, run: dict[str, Any]) -> None:
        """Note a run; it is on the disk when this returns."""
        self.runs[key_of(run)] = run
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(run) + "\n")


def key_of(run: dict[str, Any]) -> tuple[str, str, str]:
    """Data set, knob and setting."""
    return run["data"], run["knob"], run["setting"]
