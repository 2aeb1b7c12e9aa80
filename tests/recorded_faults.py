"""The record of faults, ``benches/results/faults.json``: one table for each program that looks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

RECORD = Path(__file__).resolve().parents[1] / "benches" / "results" / "faults.json"


ALL = "all"
"""Stands for every seed."""


def recorded(table: str, rows: list[dict[str, Any]], command: str) -> None:
    """Put rows into a table of the record, with the command that made them.

    Rows are known by their first entry; those that were not made anew stay, each with its command.
    """
    content = json.loads(RECORD.read_text(encoding="utf-8"))
    name = next(iter(rows[0]))
    known = {row[name]: row for row in content.get(table, ()) if name in row}
    made = {row[name]: row | {"command": command} for row in rows}
    content[table] = list((known | made).values())
    RECORD.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def fuzzed(rows: list[dict[str, Any]], seed: int, first: int) -> None:
    """Add the cases of readers to those of all seeds, of which no case counts twice.

    A run of a seed and a first number that is there takes its place. The table ``fuzzing`` has a
    row for each seed and one for all.
    """
    content = json.loads(RECORD.read_text(encoding="utf-8"))
    runs = content.setdefault("cases", {})
    for row in rows:
        key = f"{seed} {first} {row['reader']}"
        runs[key] = {"cases": row["cases"], "faults": row["faults"]}
    seeds: dict[str, dict[str, Any]] = {}
    for key, run in runs.items():
        seed_of, _, reader = key.split(" ")
        for name in (f"seed {seed_of}", ALL):
            at = seeds.setdefault(name, {"run": name, "readers": set(), "cases": 0, "faults": 0})
            at["readers"].add(reader)
            at["cases"] += run["cases"]
            at["faults"] += run["faults"]
    total = seeds.pop(ALL)
    content["fuzzing"] = [
        row | {"readers": len(row["readers"])} for row in (*seeds.values(), total)
    ]
    RECORD.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
