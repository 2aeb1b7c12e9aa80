"""Citations, their bibliography and the table of algorithms agree."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
BIBLIOGRAPHY = (DOCS / "references.bib").read_text(encoding="utf-8")
KEYS = re.findall(r"^@\w+\{([^,]+),$", BIBLIOGRAPHY, re.MULTILINE)


def cited() -> dict[str, set[str]]:
    """Files that cite a key: ``[@key]`` in code, ``{cite:p}`key``` on pages."""
    found: dict[str, set[str]] = {}
    code = [*(ROOT / "crates").rglob("*.rs"), *(ROOT / "python").rglob("*.py")]
    for path in code:
        for group in re.findall(r"\[(@[\w-]+(?:[;,]\s*@[\w-]+)*)\]", path.read_text("utf-8")):
            for key in re.findall(r"@([\w-]+)", group):
                found.setdefault(key, set()).add(path.relative_to(ROOT).as_posix())
    for path in DOCS.glob("*.md"):
        for group in re.findall(r"\{cite:\w+\}`([^`]+)`", path.read_text("utf-8")):
            for key in group.split(","):
                found.setdefault(key.strip(), set()).add(path.relative_to(ROOT).as_posix())
    return found


def test_every_citation_stands_in_the_bibliography() -> None:
    assert {key: files for key, files in cited().items() if key not in KEYS} == {}


def test_every_entry_of_the_bibliography_is_cited_once_defined() -> None:
    assert sorted(KEYS) == sorted(set(KEYS))
    assert sorted(set(KEYS) - cited().keys()) == []


def test_the_files_of_the_table_of_algorithms_exist() -> None:
    page = (DOCS / "algorithms.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if re.match(r"\| (?!-|algorithm|model)", line)]
    named = [re.findall(r"`((?:crates|python)/[\w/.-]+)`", row) for row in rows]
    assert len(rows) > 40  # the table was found
    assert [row for row, files in zip(rows, named, strict=True) if not files] == []
    assert [file for files in named for file in files if not (ROOT / file).is_file()] == []
