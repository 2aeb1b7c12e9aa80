"""Tables of a study's rows: for the terminal, for files and for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impasto.effort import PRESETS
from impasto.study.pareto_front import pareto_front
from study import minpack, presets
from study.candidates import ERROR, Row, candidates_of
from study.excess_cost import PRECISIONS

SETS = {
    "own model": "simulated, our model",
    "shifted gamma": "measured paints, shifted gamma",
    "ABC": "measured paints, ABC",
    "icon": "gilded icon, photographs",
    "770 views": "770 views, Lafortune",
    "pigments, RGB": "pigments, RGB camera",
    "pigments, RGB+2": "pigments, RGB through two filters",
    "pigments, 6BP": "pigments, six bandpass filters",
}
"""Names of the data sets in tables."""

KNOBS = (
    "effort", "precision", "pixels", "robust", "stereo", "starts", "lobes", "lights", "bits",
    "normals", "views",
)  # fmt: skip
"""Knobs with a table of their own."""


def tables(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """All tables by name."""
    made = {
        "which": _which(rows),
        "summary": _summary(rows),
        "presets": [_line(row, name) for name, row in preset_rows(rows)],
        "front": [_line(row) for row in _best(rows)],
        "halving": _halving(rows),
        "derived": _derived(rows),
        "checks": presets.table(rows),
        "classes": _classes(rows),
        "excess": _excess(rows),
        "unbeaten": [_line(row) for row in unbeaten(rows)],
        "peer": [_line(row) for data in SETS for row in _of_set(rows, data, "peer", "sample")],
        "reflectance": _reflectance(rows),
    }
    for knob in KNOBS:
        made[knob] = [_line(row) for row in of_knob(rows, knob)]
    return {name: table for name, table in made.items() if table}


def of_knob(rows: Sequence[Row], *knobs: str) -> list[Row]:
    """Rows of some knobs."""
    return [row for row in rows if row["knob"] in knobs]


def _of_set(rows: Sequence[Row], data: str, *knobs: str) -> list[Row]:
    return [row for row in of_knob(rows, *knobs) if row["data"] == data]


def fits_of(rows: Sequence[Row], data: str) -> list[Row]:
    """Our fits to all photographs of a data set: the candidates of its Pareto front."""
    knobs = {*presets.FAIR, "normals", "stereo"}
    return [row for row in rows if row["data"] == data and row["knob"] in knobs]


def points(rows: Sequence[Row]) -> list[tuple[float, float]]:
    """CPU seconds per megapixel, and error."""
    return [(row["cost"]["cpu"], row["error"][ERROR]) for row in rows]


def front_of(rows: Sequence[Row], data: str) -> list[Row]:
    """Rows of a data set on its Pareto front."""
    fits = fits_of(rows, data)
    return [fits[i] for i in pareto_front(points(fits))]


def _best(rows: Sequence[Row]) -> list[Row]:
    return [row for data in SETS for row in front_of(rows, data)]


def preset_rows(rows: Sequence[Row]) -> list[tuple[str, Row]]:
    """Rows of the defaults and of the presets of lobes per pixel.

    On pictures of the study's size ``pixels`` makes no difference.
    """
    named = []
    for row in of_knob(rows, "pooling", "effort"):
        if row["knob"] == "pooling":
            named.append((row["setting"], row))
            continue
        if (name := presets.preset_of(row["options"])) is not None:
            named.append((f"lobes per pixel, {name}", row))
    order = [*SETS, *(f"lobes per pixel, {name}" for name in PRESETS)]

    def place(item: tuple[str, Row]) -> tuple[int, int]:
        name, row = item
        return order.index(row["data"]), order.index(name) if name in order else len(order)

    return sorted(named, key=place)


def unbeaten(rows: Sequence[Row]) -> list[Row]:
    """Peers that no fit of ours beats in both time and error of relighting, of :func:`compared`."""
    return [peer for peer in compared(rows) if not beaten(peer, rows)]


def compared(rows: Sequence[Row]) -> list[Row]:
    """Peers for which a fit of ours was measured on the same pixels."""
    return [peer for peer in of_knob(rows, "peer") if _rivals(peer, rows)]


def _rivals(peer: Row, rows: Sequence[Row]) -> list[Row]:
    """Our fits of the same pixels; MINPACK fits a sample of them."""
    if peer["setting"] == minpack.NAME:
        return _of_set(rows, peer["data"], "sample")
    return fits_of(rows, peer["data"])


def beaten(peer: Row, rows: Sequence[Row], *, wholly: bool = False) -> bool:
    """Whether one fit of ours is at least as fast as a peer and relights at least as well.

    ``wholly``: in decibels and colours as well.
    """

    def measures(row: Row) -> tuple[float, ...]:
        error = row["error"]
        return *points([row])[0], *((-error["psnr"], error["colour"]) if wholly else ())

    theirs = measures(peer)
    return any(
        all(a <= b for a, b in zip(measures(rival), theirs, strict=True))
        for rival in _rivals(peer, rows)
    )


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
    """Defaults and presets, in the mean of the data sets with one view."""
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
                "ask for": presets.call(next(iter(found.values()))["options"]),
                "CPU s": float(seconds),
                # Memory is measured on one data set.
                "MB": next((row["memory"] for row in found.values() if "memory" in row), None),
                "relative %": 100.0 * float(np.mean([error["relative"] for error in errors])),
                "dB": float(np.mean([error["psnr"] for error in errors])),
                "dE00": float(np.mean([error["colour"] for error in errors])),
                "normal deg": float(np.mean(angles)) if angles else None,
                "flagged %": 100.0 * float(np.mean([error["flagged"] for error in errors])),
            }
        )
    return sorted(lines, key=lambda line: float(line["CPU s"]))


SURFACES = {
    "three varnishes, simulated": ("own model",),
    "twelve measured materials": ("shifted gamma", "ABC"),
    "gilded icon, photographs": ("icon",),
}
"""Surfaces of the first table, and their data sets."""


def _which(rows: Sequence[Row]) -> list[Row]:
    """Which fit for which rig and surface: one lobe or lobes per pixel, whichever has more dB."""
    lines: list[Row] = []
    for count in ("6", "9", "all"):
        one = ("lights", f"{count} spread, one lobe") if count != "all" else ("pooling", "one lobe")
        own = ("lights", f"{count} spread" if count != "all" else "all")
        for surface, sets in SURFACES.items():
            fits = [_mean_line(rows, sets, *setting) for setting in (one, own)]
            known = [fit for fit in fits if fit is not None]
            if len(known) == 2:
                best, other = sorted(known, key=lambda fit: -float(fit["dB"]))
                lights = {row["number"] for row in of_knob(rows, "lights") if row["data"] in sets}
                rig = f"{max(lights) if count == 'all' else count} lights"
                line = {"rig": rig, "surface": surface, **best, "dB of the other": other["dB"]}
                lines.append(line)
    views = _mean_line(rows, ("770 views",), "pooling", "Lafortune")
    if views is not None:
        surface = "Lafortune lobes, simulated"
        lines.append({"rig": "770 views", "surface": surface, **views, "dB of the other": None})
    return lines


def _mean_line(rows: Sequence[Row], sets: Sequence[str], knob: str, setting: str) -> Row | None:
    """A setting in the mean of some data sets, seconds in their geometric mean."""
    some = [row for row in of_knob(rows, knob) if row["setting"] == setting and row["data"] in sets]
    if len(some) != len(sets):
        return None
    errors = [row["error"] for row in some]
    angles = [error["normal"] for error in errors if error["normal"] is not None]
    return {
        "ask for": presets.call(some[0]["options"]),
        "CPU s": float(np.exp(np.mean([np.log(row["cost"]["cpu"]) for row in some]))),
        "dB": float(np.mean([error["psnr"] for error in errors])),
        "dE00": float(np.mean([error["colour"] for error in errors])),
        "normal deg": float(np.mean(angles)) if angles else None,
    }


def _classes(rows: Sequence[Row]) -> list[Row]:
    """Time of pixels by number of lobes, and what fewer lobes save."""
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


def _excess(rows: Sequence[Row]) -> list[Row]:
    """Excess of searches over the least cost by steps, in per cent."""
    lines: list[Row] = []
    for data in SETS:
        some = _of_set(rows, data, "search")
        for steps in sorted({row["number"] for row in some}):
            line: Row = {"data": SETS[data], "steps": steps}
            found = {searched_in(row): row["excess"] for row in some if row["number"] == steps}
            for what in ("median", "p99", "bad"):
                for precision in PRECISIONS:
                    share = found[precision][what] if precision in found else None
                    line[f"{what} %, {precision}"] = None if share is None else 100.0 * share
            lines.append(line)
    return lines


def searched_in(row: Row) -> str:
    """The precision of a row of the knob ``search``."""
    return str(row["setting"].partition(",")[0])


def _reflectance(rows: Sequence[Row]) -> list[Row]:
    """Estimators by camera, the cheapest first; a second per megapixel is a microsecond."""
    return [
        {
            "data": SETS[data],
            "setting": row["setting"],
            "CPU ns": 1e3 * row["cost"]["cpu"],
            "wall ns": 1e3 * row["cost"]["wall"],
            "dE00": row["error"]["colour"],
            "dE00 p95": row["error"]["colour_p95"],
            "RMSE %": 100.0 * row["error"]["spectrum"],
        }
        for data in SETS
        for row in sorted(_of_set(rows, data, "reflectance"), key=_seconds)
    ]


def _seconds(row: Row) -> float:
    return float(row["cost"]["cpu"])


def _halving(rows: Sequence[Row]) -> list[Row]:
    """For each preset of lobes per pixel the best fit in at most half its time.

    In the mean of the data sets that presets are taken from.
    """
    found: dict[str, dict[str, Row]] = {}
    everywhere = {row["data"] for row in of_knob(rows, "effort")}
    shared = [row for row in of_knob(rows, "effort", "pooling") if row["data"] in everywhere]
    for row in shared:
        found.setdefault(row["setting"], {})[row["data"]] = row
    candidates = candidates_of(shared)
    lines = []
    for name in PRESETS:
        own = next((r for r in candidates if presets.preset_of(r.options) == name), None)
        fast = [
            candidate
            for candidate in candidates
            if own is not None and candidate.seconds <= 0.5 * own.seconds
        ]
        if own is None or not fast:
            continue
        best = min(fast, key=lambda candidate: candidate.error)

        def less(what: str, half: str = best.setting, whole: str = own.setting) -> float | None:
            one, other = found[half], found[whole]
            pairs = [(one[data]["error"][what], other[data]["error"][what]) for data in one]
            known = [a - b for a, b in pairs if a is not None]
            return float(np.mean(known)) if known else None

        lines.append(
            {
                "setting": f"lobes per pixel, {name}",
                "half": presets.call(best.options),
                "normal deg": less("normal"),
                "dE00": less("colour"),
                "dB": less("psnr"),
                "flagged %": 100.0 * best.flagged,
            }
        )
    return lines


def _derived(rows: Sequence[Row]) -> list[Row]:
    try:
        derived = presets.derived(rows)
    except (KeyError, ValueError):
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
