"""Tables of the documentation are those of the recorded runs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pages
import pytest

from study.report import HEADS, TITLES, page_of
from study.sentences import SENTENCES, paragraphs
from study.tables import tables

WITH_TABLES = [
    page
    for page in sorted((pages.ROOT / "docs").glob("*.md"))
    if pages.TABLE.search(page.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize("page", WITH_TABLES, ids=lambda page: page.stem)
def test_the_tables_of_a_page_are_the_recorded_ones(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == pages.with_tables(text), "run python benches/python/pages.py"


def test_what_is_not_nothing_is_not_shown_as_nothing() -> None:
    numbers = (0.0, 3.8e-6, -4.6e-4, 5.1e-4, 0.0123, 0.123, 1.0, -12.34)
    said = ["0", "4e-06", "-0.0005", "0.00051", "0.012", "0.12", "1.00", "-12.3"]
    assert [pages._cell(number) for number in numbers] == said


def test_the_accuracy_page_has_its_tables() -> None:
    assert "accuracy" in [page.stem for page in WITH_TABLES]


def _rounded(value: Any) -> Any:
    """Numbers to 12 digits: numpy's logarithms and sums end differently on other processors.

    Each is off by a few roundings of double precision, 2e-16, in means of a few dozen numbers.
    """
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def test_the_page_about_time_says_what_was_measured() -> None:
    """Tables and sentences of the record are those of its own rows, and the page has them all."""
    recorded = json.loads((pages.ROOT / "benches/results/study.json").read_text("utf-8"))
    said = paragraphs(recorded["rows"])
    assert recorded["sentences"] == said
    for name, table in tables(recorded["rows"]).items():
        assert _rounded(recorded[name]) == _rounded(json.loads(json.dumps(table))), name
    whole = (pages.ROOT / "benches/results/study.md").read_text("utf-8")
    assert whole == page_of(recorded), "run python benches/study --redraw"
    page = (pages.ROOT / "docs/accuracy-and-time.md").read_text("utf-8")
    for name, paragraph in said.items():
        assert f"<!-- sentences: study {name} -->\n\n{paragraph}\n" in page


def test_sentences_of_records_are_those_of_their_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # which one of them sets
    import cluster
    import merge

    makers = {"merge": (merge.sentences, "rows"), "cluster": (cluster.sentences, "wrapper")}
    for name, (sentences, rows) in makers.items():
        recorded = json.loads((pages.ROOT / f"benches/results/{name}.json").read_text("utf-8"))
        assert recorded["sentences"] == sentences(recorded[rows]), name


def test_the_page_about_time_names_what_a_study_makes() -> None:
    """What a record has no rows for is left out: a name that is mistyped would be, too."""
    page = (pages.ROOT / "docs/accuracy-and-time.md").read_text("utf-8")
    named = {found[3] for found in pages.TABLE.finditer(page) if found[2] == "study"}
    assert {"reflectance", "summary"} <= named <= TITLES.keys()
    said = {found[3] for found in pages.SENTENCES.finditer(page) if found[2] == "study"}
    assert said == {sentence.__name__ for sentence in SENTENCES} == HEADS.keys()


def test_no_number_of_the_page_about_time_is_typed_by_hand() -> None:
    """Between what is generated no figure has a unit of time, error or share."""
    page = (pages.ROOT / "docs/accuracy-and-time.md").read_text("utf-8")
    prose = pages.SENTENCES.sub("", pages.TABLE.sub("", page))
    assert re.findall(r"\d[\d.]* ?(?:dB|%|°|s\b|times)", prose) == []
