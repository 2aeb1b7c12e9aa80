"""Tables for the console and for benches/results."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import impasto

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benches" / "results"

# Scripts that are run by name find the recorded study, the package `study`, beside their folder.
sys.path.insert(1, str(ROOT / "benches"))


def data_folder() -> Path:
    """Real photographs and spectra: ``IMPASTO_DATA``, or beside the checkout."""
    return Path(os.environ.get("IMPASTO_DATA", ROOT.parent / "shared" / "data"))


def run_info(command: str) -> dict[str, Any]:
    """What ran where. The commit is the last that changed what is measured, ``+``: and more."""

    def git(*arguments: str) -> str:
        try:
            done = subprocess.run(
                ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
            )
        except FileNotFoundError:  # a machine for measurements may have no git
            return ""
        return done.stdout.strip()

    measured = ("--", "crates", "python")
    changed = "+" if git("status", "-s", "-uno", *measured) else ""
    return {
        "command": command,
        "commit": git("log", "-1", "--format=%h", *measured) + changed,
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "simd": impasto._core.build_info()["simd"],
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "impasto": impasto.__version__,
    }


def show(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print rows of equal keys as a table."""
    cells = [[str(key) for key in rows[0]]]
    cells += [
        [f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows
    ]
    widths = [max(len(line[column]) for line in cells) for column in range(len(cells[0]))]
    print(f"\n{title}")
    for line in cells:
        first, *rest = (text.rjust(width) for text, width in zip(line, widths, strict=True))
        print("  ".join([first.strip().ljust(widths[0]), *rest]))


def write(name: str, content: Mapping[str, Any]) -> Path:
    """Write benches/results/``name``."""
    target = RESULTS / name
    target.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return target
