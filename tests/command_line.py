"""What tests of the command line have in common."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from impasto import simulate
from impasto.cli import main
from impasto.io import write_stack

ROWS, COLUMNS = 32, 40


def photographs(folder: Path) -> Path:
    """Nine RGB photographs in one file."""
    path = folder / "painting.npz"
    capture = simulate.default_capture("tominaga-rgb-camera", size=(ROWS, COLUMNS))
    write_stack(path, capture.stack)
    return path


def complaint(words: Sequence[str], code: int, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a refused command says; there is no traceback, and no data."""
    assert main(words) == code
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    assert captured.out == ""
    return next(line for line in captured.err.splitlines() if line.startswith("impasto:"))
