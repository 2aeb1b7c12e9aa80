"""The study of time against accuracy, recorded for the documentation.

    python benches/python/study.py [--data DIR] [--out DIR] [--redraw | --presets]

Runs ``impasto study`` (it goes on where it was interrupted), records benches/results/study.json,
draws the figures of docs/accuracy-and-time.md into docs/_static and sets that page's tables.
``--redraw`` runs nothing: it draws and sets them anew from the rows that are recorded.
``--presets`` runs nothing: it says which presets the recorded study calls for, what those of
python/impasto/effort.py are, and whether they keep what they promise; it exits with 1 where they
do not.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import kernel_figures
from pages import set_tables
from record import RESULTS, ROOT, data_folder, write

from impasto.study import presets, run
from impasto.study.figures import draw
from impasto.study.tables import tables
from impasto.study.words import words

REPEATS = 8
"""Turns in which every fit is timed: ratios of the least are to be those of the next run."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--out", type=Path, default=ROOT / "study", help="where runs are kept")
    parser.add_argument("--redraw", action="store_true", help="run nothing: the record, as it is")
    parser.add_argument("--presets", action="store_true", help="run nothing: say and check them")
    options = parser.parse_args()
    if options.presets:
        rows = _recorded()["rows"]
        print(presets.explained(rows))
        sys.exit(not all(check.kept for check in presets.checked(rows)))

    def advance(done: int, total: int, name: str) -> None:
        print(f"{done}/{total} {name}", file=sys.stderr)

    if options.redraw:
        found = _recorded()
    else:
        found = run(options.out, data=options.data, repeats=REPEATS, advance=advance)
    found["run"] = {"command": "python benches/python/study.py"} | found["run"]
    rows = found["rows"]
    write("study.json", found | tables(rows) | {"words": words(rows)})
    static = ROOT / "docs" / "_static"
    for path in draw(found, static, prefix="study-") + kernel_figures.draw(static):
        print(path.relative_to(ROOT))
    set_tables(ROOT / "docs" / "accuracy-and-time.md")


def _recorded() -> dict[str, Any]:
    content = json.loads((RESULTS / "study.json").read_text("utf-8"))
    return {name: content[name] for name in ("run", "missing", "skipped", "failed", "rows")}


if __name__ == "__main__":
    main()
