"""The command of the recorded study.

    python benches/study [--quick] [--data DIR] [--out DIR]
                         [--record | --again | --redraw | --presets]

Measures every setting on every data set and writes study.json, study.md and the figures into the
folder ``--out``. Every run is kept there: after an interruption the same command goes on.
``--quick`` takes few settings and small pictures, in less than two minutes.

``--record`` runs the whole study and records it: study.json and study.md in benches/results,
the figures of docs/accuracy-and-time.md in docs/_static, and the tables of that page.
``--again`` runs the recorded study a second time, in a folder of its own, and records beside every
row what that run found. It exits with 1 if the two disagree, and runs nothing if code, data or
machine are not those of the record.
``--redraw`` runs nothing: it draws the figures and sets the tables from the recorded rows.
``--presets`` runs nothing: it prints the presets that the recorded study calls for, those of
python/impasto/effort.py, and whether they keep what they promise. It exits with 1 if they do not.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# numpy's products on one thread, too: the speed of a second one depends on other programs. This
# has to be set before numpy is loaded.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

if not __package__:
    # Run as a folder: modules are found as those of the package, beside the scripts of benches.
    BENCHES = Path(__file__).resolve().parents[1]
    sys.path[:1] = [str(BENCHES), str(BENCHES / "python")]

from pages import set_tables
from record import RESULTS, ROOT, data_folder
from record import write as record

from impasto.errors import ImpastoError
from study import kernel_figures, presets, repeatability, run, write
from study.figures import draw
from study.report import page_of
from study.sentences import paragraphs
from study.tables import tables, text

REPEATS = 6
"""Timings of every fit at least, spread over the whole study, which takes up to an hour."""
QUICK_REPEATS = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """What the command does; returns its exit code."""
    options = _options(arguments)
    try:
        return _done(options)
    except ImpastoError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


def _done(options: argparse.Namespace) -> int:
    if options.presets:
        rows = _recorded()["rows"]
        print(presets.explained(rows))
        return int(not all(check.kept for check in presets.checked(rows)))
    if options.redraw:
        _record(_recorded())
        return 0
    repeats = QUICK_REPEATS if options.quick else REPEATS
    how: dict[str, Any] = {"data": options.data, "quick": options.quick, "seed": options.seed}
    how |= {
        "threads": options.threads,
        "repeats": repeats if options.repeats is None else options.repeats,
    }
    if options.again:
        recorded = _recorded()
        out = options.out.with_name(f"{options.out.name}-again")
        found = run(out, **how, like=recorded["run"], advance=_advance)
        found = recorded | {"rows": repeatability.beside(recorded, found)}
        _record(found)
        print(paragraphs(found["rows"])["again"])
        return int(not repeatability.kept(found["rows"]))
    found = run(options.out, **how, advance=_advance)
    for path in write(found, options.out, figures=options.figures):
        print(path, file=sys.stderr)
    for name, reason in found["missing"].items():
        print(f"without {name}: {reason}", file=sys.stderr)
    for kind in ("skipped", "failed"):
        for reason in found[kind]:
            print(f"{kind}: {reason}", file=sys.stderr)
    if options.record:
        _record(found)
    elif shown := tables(found["rows"]).get("presets"):
        print(text(shown))
    return int(bool(found["failed"]))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python benches/study", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--quick", action="store_true", help="few settings, small pictures")
    parser.add_argument("--data", type=Path, default=_data(), help="photographs and tables")
    parser.add_argument("--out", type=Path, default=ROOT / "study", help="where runs are kept")
    parser.add_argument("--seed", type=int, default=0, help="of paintings and noise")
    parser.add_argument("--threads", type=int, default=1, help="of the fits")
    parser.add_argument("--repeats", type=int, help="timings of every fit, at least")
    parser.add_argument("--no-figures", dest="figures", action="store_false")
    # One of them: a record that is compared with itself would agree.
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--record", action="store_true", help="record the study for the page")
    mode.add_argument("--again", action="store_true", help="a second run, beside the recorded one")
    mode.add_argument("--redraw", action="store_true", help="run nothing: the record as it is")
    mode.add_argument("--presets", action="store_true", help="run nothing: print and check them")
    options = parser.parse_args(arguments)
    if options.quick and (options.record or options.again):
        parser.error("the quick study is not recorded")
    return options


def _data() -> Path | None:
    """The folder of real data where there is one: otherwise simulated data only."""
    folder = data_folder()
    return folder if folder.is_dir() else None


def _advance(done: int, total: int, name: str) -> None:
    print(f"{done}/{total} {name}", file=sys.stderr)


def _record(found: dict[str, Any]) -> None:
    """The record, the figures and the tables of the page."""
    found["run"] = {"command": "python benches/study --record"} | found["run"]
    rows = found["rows"]
    record("study.json", found | tables(rows) | {"sentences": paragraphs(rows)})
    (RESULTS / "study.md").write_text(page_of(found), encoding="utf-8")
    static = ROOT / "docs" / "_static"
    for path in draw(found, static, prefix="study-") + kernel_figures.draw(static):
        print(path.relative_to(ROOT))
    set_tables(ROOT / "docs" / "accuracy-and-time.md")


def _recorded() -> dict[str, Any]:
    content = json.loads((RESULTS / "study.json").read_text("utf-8"))
    return {name: content[name] for name in ("run", "missing", "skipped", "failed", "rows")}


if __name__ == "__main__":
    sys.exit(main())
