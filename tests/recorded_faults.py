"""The record of faults, ``benches/results/faults.json``: one table for each program that looks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

RECORD = Path(__file__).resolve().parents[1] / "benches" / "results" / "faults.json"


def recorded(table: str, rows: list[dict[str, Any]], command: str) -> None:
    """Put rows into a table of the record, with the command that made them.

    Rows are known by their first entry; those that were not made anew stay.
    """
    content = json.loads(RECORD.read_text(encoding="utf-8"))
    name = next(iter(rows[0]))
    known = {row[name]: row for row in content.get(table, ()) if name in row}
    content[table] = list((known | {row[name]: row for row in rows}).values())
    content["run"][table] = command
    RECORD.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
