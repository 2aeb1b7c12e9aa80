"""Tables of the documentation are those of the recorded runs."""

from __future__ import annotations

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
