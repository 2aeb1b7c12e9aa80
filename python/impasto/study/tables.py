"""What a study's rows say, as tables: for the console, for files and for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impasto.effort import PRESETS
from impasto.study import minpack, presets
from impasto.study.front import ERROR, Row, front

SETS = {
    "own model": "simulated, our model",
    "shifted gamma": "measured paints, shifted gamma",
    "ABC": "measured paints, ABC",
    "icon": "gilded icon, photographs",
    "770 views": "770 views, Lafortune",
}
"""Data sets in the words of the tables."""

LADDERS = (
    "effort", "precision", "pixels", "robust", "stereo", "starts", "lobes", "lights", "bits",
    "normals", "views",
)  # fmt: skip
"""Knobs whose settings make a table each."""


def tables(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Every table by its name; numbers stay numbers."""
    made = {
        "summary": _summary(rows),
        "presets": [_line(row, name) for name, row in preset_rows(rows)],
        "front": [_line(row) for row in _best(rows)],
        "halving": _halving(rows),
        "derived": _derived(rows),
        "checks": presets.table(rows),
        "classes": _classes(rows),
        "unbeaten": [_line(row) for row in unbeaten(rows)],
        "peer": [_line(row) for data in SETS for row in _of_set(rows, data, "peer", "sample")],
    }
    for knob in LADDERS:
        made[knob] = [_line(row) for row in of_knob(rows, knob)]
    return {name: table for name, table in made.items() if table}


def of_knob(rows: Sequence[Row], *knobs: str) -> list[Row]:
    """Rows of some knobs."""
    return [row for row in rows if row["knob"] in knobs]


def _of_set(rows: Sequence[Row], data: str, *knobs: str) -> list[Row]:
    return [row for row in of_knob(rows, *knobs) if row["data"] == data]


def fits_of(rows: Sequence[Row], data: str) -> list[Row]:
    """Our own fits of a data set to all its photographs: what its front is made of."""
    knobs = {*presets.FAIR, "normals", "stereo"}
    return [row for row in rows if row["data"] == data and row["knob"] in knobs]


def points(rows: Sequence[Row]) -> list[tuple[float, float]]:
    """CPU seconds per megapixel, and error."""
    return [(row["cost"]["cpu"], row["error"][ERROR]) for row in rows]


def front_of(rows: Sequence[Row], data: str) -> list[Row]:
    """Rows that no other fit of a data set beats in both time and error."""
    fits = fits_of(rows, data)
    return [fits[i] for i in front(points(fits))]


def _best(rows: Sequence[Row]) -> list[Row]:
    return [row for data in SETS for row in front_of(rows, data)]


def preset_rows(rows: Sequence[Row]) -> list[tuple[str, Row]]:
    """Rows that somebody gets by name: poolings, and of pixels' own lobes the presets.

    On pictures of the study's size ``pixels`` makes no difference.
    """
    named = []
    for row in of_knob(rows, "pooling", "effort"):
        if row["knob"] == "pooling":
            named.append((row["setting"], row))
            continue
        for name, preset in PRESETS.items():
            if presets.effort_of(row["options"], preset.pixels) == preset:
                named.append((f"pixels' own, {name}", row))
    order = [*SETS, *(f"pixels' own, {name}" for name in PRESETS)]

    def place(item: tuple[str, Row]) -> tuple[int, int]:
        name, row = item
        return order.index(row["data"]), order.index(name) if name in order else len(order)

    return sorted(named, key=place)


def unbeaten(rows: Sequence[Row]) -> list[Row]:
    """Peers that no fit of ours beats in both time and error."""

    def beaten(peer: Row) -> bool:
        (seconds, error), *_ = points([peer])
        data = peer["data"]
        # MINPACK sees a sample of the pixels: so does the fit that it is compared with.
        sampled = peer["setting"] == minpack.NAME
        rivals = _of_set(rows, data, "sample") if sampled else fits_of(rows, data)
        return any(s <= seconds and e <= error for s, e in points(rivals))

    return [peer for peer in of_knob(rows, "peer") if not beaten(peer)]


def _line(row: Row, name: str | None = None) -> Row:
    error, cost = row["error"], row["cost"]
    return {
        "data": SETS.get(row["data"], row["data"]),
        "setting": name or row["setting"],
        "CPU s": cost["cpu"],
        "wall s": cost["wall"],
        "relative %": 100.0 * error["relative"],
        "dB": error["psnr"],
        "dE00": error["colour"],
        "normal deg": error["normal"],
        "flagged %": 100.0 * error["flagged"],
    }


def _summary(rows: Sequence[Row]) -> list[Row]:
    """What somebody gets by name, over the data sets with one view: a reader decides on it."""
    by_name: dict[str, dict[str, Row]] = {}
    for name, row in preset_rows(rows):
        by_name.setdefault(name, {})[row["data"]] = row
    everywhere = {row["data"] for row in of_knob(rows, "effort")}
    lines = []
    for name, found in by_name.items():
        if not everywhere or found.keys() != everywhere:
            continue
        errors = [row["error"] for row in found.values()]
        angles = [error["normal"] for error in errors if error["normal"] is not None]
        seconds = np.exp(np.mean([np.log(row["cost"]["cpu"]) for row in found.values()]))
        lines.append(
            {
                "setting": name,
                "CPU s": float(seconds),
                # Of the one data set that it is measured on.
                "MB": next((row["memory"] for row in found.values() if "memory" in row), None),
                "relative %": 100.0 * float(np.mean([error["relative"] for error in errors])),
                "dB": float(np.mean([error["psnr"] for error in errors])),
                "dE00": float(np.mean([error["colour"] for error in errors])),
                "normal deg": float(np.mean(angles)) if angles else None,
                "flagged %": 100.0 * float(np.mean([error["flagged"] for error in errors])),
            }
        )
    return sorted(lines, key=lambda line: float(line["CPU s"]))


def _classes(rows: Sequence[Row]) -> list[Row]:
    """What pixels that need fewer lobes save, against those that need most of their data set."""
    lines: list[Row] = []
    for data in SETS:
        some = _of_set(rows, data, "classes")
        most = max((row["cost"]["cpu"] for row in some), default=0.0)
        lines += [
            {
                "data": SETS[data],
                "pixels": row["setting"],
                "share %": 100.0 * row["share"],
                "CPU s": row["cost"]["cpu"],
                "saved %": 100.0 * (1.0 - row["cost"]["cpu"] / most),
            }
            for row in some
        ]
    return lines


def _halving(rows: Sequence[Row]) -> list[Row]:
    """From each preset of pixels' own lobes: the best fit in at most half of its time."""
    lines = []
    for name, row in preset_rows(rows):
        if row["knob"] != "effort":
            continue
        half = 0.5 * row["cost"]["cpu"]
        fast = [r for r in fits_of(rows, row["data"]) if r["cost"]["cpu"] <= half]
        if not fast:
            continue
        other = min(fast, key=lambda r: r["error"][ERROR])
        angle, before = other["error"]["normal"], row["error"]["normal"]
        lines.append(
            {
                "data": SETS[row["data"]],
                "setting": name,
                "half": other["setting"],
                "normal deg": None if angle is None else angle - before,
                "dE00": other["error"]["colour"] - row["error"]["colour"],
                "dB": other["error"]["psnr"] - row["error"]["psnr"],
            }
        )
    return lines


def _derived(rows: Sequence[Row]) -> list[Row]:
    try:
        derived = presets.derived(rows)
    except (StopIteration, IndexError, KeyError):
        return []
    return [{"preset": name} | derived[name].to_dict() for name in PRESETS]


def text(table: Sequence[Row]) -> str:
    """A table for a terminal."""
    heads = list(table[0])
    cells = [heads, *([_cell(row[head]) for head in heads] for row in table)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(heads))]
    words = [isinstance(table[0][head], str) for head in heads]
    return "\n".join(
        "  ".join(
            value.ljust(width) if word else value.rjust(width)
            for value, width, word in zip(line, widths, words, strict=True)
        ).rstrip()
        for line in cells
    )


def markdown(table: Sequence[Row]) -> str:
    """A table for a page."""
    heads = list(table[0])
    rule = [":--" if isinstance(table[0][head], str) else "--:" for head in heads]
    lines = [heads, rule, *([_cell(row[head]) for head in heads] for row in table)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return str(value)
    size = abs(value)
    return f"{value:.1f}" if size >= 10 else f"{value:.2f}" if size >= 0.1 else f"{value:.2g}"
