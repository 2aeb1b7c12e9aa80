"""Where an extra of the package is not installed its name is told, before any work is done."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

import impasto
from impasto._internal.extras import need
from impasto.cli import main
from impasto.pictures.plots import lobe_plot


def test_an_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    need("sys", "none", "everything")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    words = r"a figure needs matplotlib, which is not installed: pip install 'impasto\[plot\]'"
    with pytest.raises(impasto.MissingExtraError, match=words) as refusal:
        need("matplotlib", "plot", "a figure")
    assert isinstance(refusal.value, ImportError)


def test_a_plot_without_matplotlib_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    surface: Any = None
    with pytest.raises(impasto.MissingExtraError, match="lobe_plot needs matplotlib"):
        lobe_plot(surface, 0, 0)


def test_a_study_without_matplotlib_ends_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    out = tmp_path / "study"
    assert main(["study", "nowhere.lp", "--out", str(out)]) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("impasto: the figure of a study")
    assert "--no-figure" in captured.err
    assert "pip install 'impasto[plot]'" in " ".join(captured.err.split())
    assert captured.out == ""
    assert not out.exists()
