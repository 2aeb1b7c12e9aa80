"""Benchmarks are run by hand: that they load is all that a test can ask of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "benches" / "python"
SCRIPTS = sorted(
    path.stem
    for path in FOLDER.glob("*.py")
    if not path.stem.startswith("test_") and path.stem != "conftest"
)


def test_every_script_finds_what_it_imports() -> None:
    assert "fits" in SCRIPTS
    code = f"import sys; sys.path.insert(0, {str(FOLDER)!r}); import {', '.join(SCRIPTS)}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_recorded_study_starts() -> None:
    """As a folder, from anywhere: it finds its package and the scripts beside it."""
    command = [sys.executable, str(FOLDER.parent / "study"), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--record" in done.stdout
