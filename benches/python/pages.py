"""Sets the tables of documentation pages from benches/results.

    python benches/python/pages.py

A table stands between ``<!-- table: FILE KEY; column = Heading; ... -->`` and ``<!-- end -->``:
rows of benches/results/FILE.json under KEY, the named columns, numbers to three digits or fewer.
``errors`` is no file: its tables join several (``errors_by_rig.py``).
Sentences stand between ``<!-- sentences: FILE KEY -->`` and ``<!-- end -->``: what is under
``sentences``.
``tests/test_pages.py`` holds the pages to the files.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import errors_by_rig

ROOT = Path(__file__).resolve().parents[2]
TABLE = re.compile(r"(<!-- table: (\S+) (\S+?);(.*?) -->\n).*?(<!-- end -->)", re.DOTALL)

SENTENCES = re.compile(r"(<!-- sentences: (\S+) (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def set_tables(page: Path) -> None:
    """Write a page's tables anew."""
    page.write_text(with_tables(page.read_text(encoding="utf-8")), encoding="utf-8")


def with_tables(text: str) -> str:
    """The page with its tables and sentences as benches/results has them."""
    text = SENTENCES.sub(lambda found: found[1] + _sentences(*found.group(2, 3)) + found[4], text)
    return TABLE.sub(lambda found: found[1] + _table(*found.group(2, 3, 4)) + found[5], text)


def _content(file: str) -> Any:
    if file == "errors":
        return errors_by_rig.tables()
    return json.loads((ROOT / "benches" / "results" / f"{file}.json").read_text("utf-8"))


def _sentences(file: str, key: str) -> str:
    # A sentence that a record has no rows for is left out.
    return f"\n{_content(file)['sentences'].get(key, '')}\n\n"


def _table(file: str, key: str, columns: str) -> str:
    content = _content(file)
    if file == "study" and key not in content:
        # As a sentence is, that a record has no rows for.
        return "\n"
    pairs = [column.strip().rpartition("=")[::2] for column in columns.split(";")]
    heads = {name.strip(): heading.strip() for name, heading in pairs}
    lines = [" | ".join(heads.values())]
    rows = content[key]
    # Words to the left, numbers to the right.
    words = [all(isinstance(row[name], str) for row in rows) for name in heads]
    lines.append(" | ".join(":--" if word else "--:" for word in words))
    lines += [" | ".join(_cell(row[name]) for name in heads) for row in rows]
    return "\n" + "".join(f"| {line} |\n" for line in lines) + "\n"


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return _number(value) if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    """Three digits of large numbers, two of small ones, one of what is next to nothing."""
    size = abs(value)
    if size < 5e-4:
        return f"{value:.1g}"
    return f"{value:.1f}" if size >= 10 else f"{value:.2f}" if size >= 0.1 else f"{value:.2g}"


if __name__ == "__main__":
    for page in sorted((ROOT / "docs").glob("*.md")):
        set_tables(page)
