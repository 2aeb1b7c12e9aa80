"""Tables of the documentation are those of the recorded runs."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benches" / "python"))
import pages

WITH_TABLES = [
    page
    for page in sorted((pages.ROOT / "docs").glob("*.md"))
    if pages.TABLE.search(page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize("page", WITH_TABLES, ids=lambda page: page.stem)
def test_the_tables_of_a_page_are_the_recorded_ones(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == pages.with_tables(text), "run python benches/python/pages.py"


def test_the_accuracy_page_has_its_tables() -> None:
    assert "accuracy" in [page.stem for page in WITH_TABLES]


def test_the_words_about_time_are_true_of_the_recorded_run() -> None:
    """What docs/accuracy-and-time.md says between its tables."""
    recorded = json.loads((pages.ROOT / "benches/results/study.json").read_text("utf-8"))
    by_data: dict[str, dict[str, dict[str, float]]] = {}
    for row in recorded["presets"]:
        by_data.setdefault(row["data"], {})[row["setting"]] = row
    views = {row["setting"]: row["dB"] for row in recorded["views"]}
    del by_data["770 views, Lafortune"]
    for data, rows in by_data.items():
        own = {name: rows[f"pixels' own, {name}"] for name in ("draft", "standard", "reference")}
        assert own["standard"]["dB"] > rows["one lobe"]["dB"]
        assert 0.15 < own["draft"]["CPU s"] / own["standard"]["CPU s"] < 0.45
        assert abs(own["reference"]["dB"] - own["standard"]["dB"]) < 0.5
        if data.startswith("measured"):
            assert 2 < own["standard"]["dB"] - own["draft"]["dB"] < 5
            assert 1.5 < own["draft"]["normal deg"] / own["standard"]["normal deg"] < 2.5
        if "icon" in data:
            assert own["draft"]["dB"] > own["standard"]["dB"] - 0.2
        else:
            assert own["standard"]["dB"] - rows["one lobe"]["dB"] > 4.5
    loss = {name: views["all"] - decibels for name, decibels in views.items()}
    kept = {175: 1, 70: 7, 35: 13}
    assert {count: round(loss[f"{count} random"]) for count in kept} == kept
    assert loss["18 random"] > 30
    assert min(loss[f"{count} spread"] for count in (70, 175, 350)) > loss["70 random"]
    effort = {(row["data"], row["setting"]): row["relative %"] for row in recorded["effort"]}
    for data in by_data:
        assert effort[data, "2 rounds, 4 steps"] < 1.03 * effort[data, "2 rounds, 30 steps"]


def test_the_words_about_accuracy_are_true_of_the_recorded_run() -> None:
    """What docs/accuracy.md says below its tables, sentence by sentence."""
    recorded = json.loads((pages.ROOT / "benches/results/accuracy.json").read_text("utf-8"))
    six, rgb = (
        {row["case"]: row for row in recorded[f"tominaga-{system}"]}
        for system in ("six-band-adaptation", "rgb-camera")
    )
    distant, tails = "lamps at 0.5 m taken for distant", "a lobe with long tails (GGX)"
    curves = {case for case in six if "read as" in case}
    for rows in (six, rgb):
        for case in rows.keys() - curves - {distant, tails}:
            for error in (rows[case]["beta %"], rows[case]["gamma %"]):
                assert error is None or abs(error) < 0.5, case
        linear, usual = rows["8-bit linear"], rows["satin varnish, as photographed"]
        assert 0.1 < linear["dE00 D65"] - usual["dE00 D65"] < 0.5
        assert rows["patches of all three"]["verdict"] == "mixed"
        assert rows[tails]["verdict"] == "mixed"
        assert -55 < rows[tails]["beta %"] < -40
        assert 30 < rows[tails]["gamma %"] < 55
        assert rows[tails]["normal deg"] < 0.6
    assert round(max(rows[case]["beta %"] for rows in (six, rgb) for case in curves)) == 7
    assert [round(rows[distant]["normal deg"], 1) for rows in (six, rgb)] == [1.4, 2.4]
    assert round(rgb[distant]["beta %"], 1) == 2.5


def test_the_words_about_lobes_of_every_pixel_are_true_of_the_recorded_run() -> None:
    recorded = json.loads((pages.ROOT / "benches/results/lobes.json").read_text("utf-8"))
    for table in ("normals", "materials"):
        rows = {row["method"]: row for row in recorded[table]}
        for error in ("median deg", "mean deg", "p95 deg"):
            assert rows["fit_sbrdf, pixel"][error] < rows["robust"][error], (table, error)
            if table == "normals":
                assert rows["fit_sbrdf, painting"][error] < rows["robust"][error], error
    assert rows["fit_sbrdf, pixel"]["worse than robust on"] == 0


def test_the_words_about_the_lamps_of_the_icon_are_true_of_the_recorded_run() -> None:
    recorded = json.loads((pages.ROOT / "benches/results/lamps.json").read_text("utf-8"))
    score = {(row["method"], row["lamps"]): row["mean dB"] for row in recorded["rows"]}
    fitted = {(row["method"], row["lamps"]): row["fitted dB"] for row in recorded["rows"]}
    own = "impasto, up to two lobes per pixel"
    given, shown = score[own, "as given"], score[own, "fitted and shown"]
    assert shown - given > 2.0
    assert shown > 32.5
    # "Most of what two lobes could not describe": a factor of two in squares is 3 dB.
    assert fitted[own, "fitted"] - fitted[own, "as given"] > 3.0
