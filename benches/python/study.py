"""The study of time against accuracy, recorded for the documentation.

    python benches/python/study.py [--data DIR] [--out DIR] [--again | --redraw | --presets]

Runs ``impasto study`` (it goes on where it was interrupted), records benches/results/study.json,
draws the figures of docs/accuracy-and-time.md into docs/_static and sets that page's tables.
``--again`` runs the same study a second time, in a folder of its own, and records beside every row
what that run says of it; it exits with 1 where the two do not agree, and runs nothing where code,
data or machine are not those of the record.
``--redraw`` runs nothing: it draws and sets them anew from the rows that are recorded.
``--presets`` runs nothing: it says which presets the recorded study calls for, what those of
python/impasto/effort.py are, and whether they keep what they promise; it exits with 1 where they
do not.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

# One thread of numpy's products, too: what a second one does depends on who else is there. Before
# numpy is loaded.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import kernel_figures
from pages import set_tables
from record import RESULTS, ROOT, data_folder, write

from impasto.study import agreement, presets, run
from impasto.study.figures import draw
from impasto.study.tables import tables
from impasto.study.words import words

REPEATS = 6
"""Turns of every fit at least, spread over the whole study: half an hour to an hour."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--data", type=Path, default=data_folder())
    parser.add_argument("--out", type=Path, default=ROOT / "study", help="where runs are kept")
    # One of them: a record that is compared with itself would agree.
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--again", action="store_true", help="a second run, beside the recorded")
    mode.add_argument("--redraw", action="store_true", help="run nothing: the record, as it is")
    mode.add_argument("--presets", action="store_true", help="run nothing: say and check them")
    options = parser.parse_args()
    if options.presets:
        rows = _recorded()["rows"]
        print(presets.explained(rows))
        sys.exit(not all(check.kept for check in presets.checked(rows)))

    def advance(done: int, total: int, name: str) -> None:
        print(f"{done}/{total} {name}", file=sys.stderr)

    how: dict[str, Any] = {"data": options.data, "repeats": REPEATS, "threads": 1}
    if options.redraw:
        found = _recorded()
    elif not options.again:
        found = run(options.out, **how, advance=advance)
    else:
        recorded = _recorded()
        found = run(
            options.out.with_name(f"{options.out.name}-again"),
            **how,
            like=recorded["run"],
            advance=advance,
        )
        found = recorded | {"rows": agreement.beside(recorded, found)}
    found["run"] = {"command": "python benches/python/study.py"} | found["run"]
    rows = found["rows"]
    write("study.json", found | tables(rows) | {"words": words(rows)})
    static = ROOT / "docs" / "_static"
    for path in draw(found, static, prefix="study-") + kernel_figures.draw(static):
        print(path.relative_to(ROOT))
    set_tables(ROOT / "docs" / "accuracy-and-time.md")
    if options.again:
        print(words(rows)["again"])
        sys.exit(not agreement.kept(rows))


def _recorded() -> dict[str, Any]:
    content = json.loads((RESULTS / "study.json").read_text("utf-8"))
    return {name: content[name] for name in ("run", "missing", "skipped", "failed", "rows")}


if __name__ == "__main__":
    main()
