"""Panels of figures, one per data set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impasto._internal.wording import counted
from impasto.effort import Effort
from impasto.study.pareto_front import knee, pareto_front
from study import minpack
from study.candidates import ERROR, Row
from study.excess_cost import BAD
from study.tables import (
    SETS,
    fits_of,
    front_of,
    of_knob,
    points,
    preset_rows,
    searched_in,
)

# Okabe and Ito 2008: told apart by colour-blind readers, and in grey by their lightness.
BLUE, ORANGE, GREEN, BLACK = "#0072b2", "#d55e00", "#009e73", "#202020"
GREY, FAINT = "#707070", "#b8b8b8"
SHADES = ("#a9cfe6", "#56a0d0", "#0072b2", "#003a5c")
OURS = "ours, MINPACK's pixels"
BY = {
    "l1": (-9, 3), "rank": (-21, -2), "huber": (5, 6), "cauchy": (6, -1), "tukey": (6, -8),
    "robust": (3, -10), "threshold": (-14, -12), "trimmed": (1, -10),
}  # fmt: skip
"""Offsets of labels from their points, in typographic points."""
BESIDE = {
    "wiener": (7, -1), "linear-model": (-14, 7),
    "root-polynomial": (6, -10), "radial-basis": (-32, 7),
}  # fmt: skip
"""The same for estimators."""
LOOKS = {"random": ("s--", ORANGE), "spread": ("o-", BLUE), "best": ("D:", GREEN)}
"""Line styles of the selections of photographs."""
SEARCHES = {"single": ("o-", BLUE), "double": ("s--", ORANGE)}
"""Line styles of the precisions of a search, as in the figure of the solver alone."""
FILLS = {"p99": None, "median": "white"}
"""Fill of the marks of the 99th percentile and of the median."""
MARKS: dict[str, tuple[str, str]] = {
    "one lobe, as the papers have it": ("d", "white"),
    "one lobe": ("D", "white"),
    "Lafortune": ("s", "white"),
    "lobes per pixel, draft": ("v", BLUE),
    "lobes per pixel, standard": ("o", BLUE),
    "lobes per pixel, reference": ("^", BLUE),
}
"""Marks of defaults and presets, and their fill."""
PEERS: dict[str, str] = {
    "PTM": "s", "HSH": "X", "RBF, normalised Gaussian": "P", "RBF, thin plate": "p",
    minpack.NAME: "*",
}  # fmt: skip
"""Marks of other methods."""


def dress(axes: Any, data: str, across: str, up: str) -> None:
    """Title, axes, grid."""
    axes.set_title(SETS.get(data, data))
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.grid(color="#e6e6e6", lw=0.6)
    axes.set_axisbelow(True)


def plain(axis: Any) -> None:
    """Label the axis with plain numbers instead of powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    low, high = sorted(axis.get_view_interval())
    subs = (1.0, 2.0, 5.0) if high / low < 100.0 else (1.0,)
    few = MaxNLocator(5, steps=[1.0, 2.0, 2.5, 5.0, 10.0])
    axis.set_major_locator(few if high / low < 4.0 else LogLocator(subs=subs))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def logarithmic(axes: Any) -> None:
    """Both axes, with plain numbers."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain(axes.xaxis)
    plain(axes.yaxis)


def front(axes: Any, found: Row, data: str) -> None:
    """Error against time: all fits, their front, its knee, the presets, and peers."""
    rows = found["rows"]
    every = zip(*_percent(fits_of(rows, data)), strict=True)
    axes.scatter(*every, s=7, color=FAINT, lw=0, label="every fit of ours")
    corners = _percent(front_of(rows, data))
    axes.plot(*zip(*corners, strict=True), color=BLUE, lw=1.3, zorder=2, label="front")
    for name, row in preset_rows(rows):
        if row["data"] == data:
            _named(axes, name, _percent([row])[0])
    place = knee(corners)
    # A front that lies above its chord has no knee.
    if 0 < place < len(corners) - 1:
        axes.plot(*corners[place], "o", ms=11, mfc="none", mec=BLUE, mew=1.0, ls="", label="knee")
    for row in of_knob(rows, "peer"):
        if row["data"] == data:
            mark = PEERS.get(row["setting"], "s")
            size = 8 if mark == "*" else 5.5
            at = _percent([row])[0]
            axes.plot(*at, mark, ms=size, color=ORANGE, mew=0, ls="", label=row["setting"])
    for row in of_knob(rows, "sample"):
        if row["data"] == data:
            axes.plot(*_percent([row])[0], "*", ms=8, mfc="white", mec=BLUE, ls="", label=OURS)
    dress(axes, data, "CPU seconds per megapixel", "error of relighting, %")
    logarithmic(axes)
    axes.margins(x=0.12, y=0.12)


def _named(axes: Any, name: str, at: tuple[float, float]) -> None:
    mark, fill = MARKS[name]
    axes.plot(*at, mark, ms=5, mfc=fill, mec=BLUE, mew=1.0, ls="", zorder=3, label=name)


def _percent(rows: Sequence[Row]) -> list[tuple[float, float]]:
    return [(seconds, 100.0 * error) for seconds, error in points(rows)]


def note(axes: Any, words: str, at: tuple[float, float], colour: str, by: tuple[int, int]) -> None:
    """A label beside a point."""
    axes.annotate(
        words, at, xytext=by, textcoords="offset points", color=colour, fontsize=7,
        annotation_clip=False,
    )  # fmt: skip


def normals(axes: Any, found: Row, data: str) -> None:
    """Degrees against microseconds per pixel: photometric stereo, and the joint fit."""
    rows = [row for row in found["rows"] if row["data"] == data]
    for row in of_knob(rows, "normals"):
        at = (row["cost"]["cpu"], row["error"]["normal"])
        axes.plot(*at, "o", ms=4, color=BLACK)
        note(axes, row["setting"], at, BLACK, BY.get(row["setting"], (5, 2)))
    for name, row in preset_rows(rows):
        # The fit of the papers does not change the normals of photometric stereo.
        if row["options"].get("joint", True):
            _named(axes, name, (row["cost"]["cpu"], row["error"]["normal"]))
    dress(axes, data, "CPU microseconds per pixel", "error of the normals, degrees")
    logarithmic(axes)
    axes.margins(x=0.2, y=0.22)


def _curve(axes: Any, rows: Sequence[Row], up: Any, style: str, colour: str, label: str) -> Any:
    ordered = sorted(rows, key=lambda row: row["number"])
    places = [row["number"] for row in ordered]
    heights = [up(row) for row in ordered]
    return axes.plot(places, heights, style, ms=4, color=colour, lw=1.2, label=label)[0]


def lights(axes: Any, found: Row, data: str) -> None:
    """Error against the number of lights, chosen in several ways."""
    rows = [row for row in of_knob(found["rows"], "lights") if row["data"] == data]
    truth = rows[0]["error"]["normal"] is not None

    def error(row: Row) -> float:
        found: Row = row["error"]
        return float(found["normal"] if truth else 100.0 * found[ERROR])

    for choice, (style, colour) in LOOKS.items():
        some = [row for row in rows if row["setting"].endswith((choice, "all"))]
        # All lights alone are no selection.
        if len(some) > 1:
            _curve(axes, some, error, style, colour, choice)
    painting = [row for row in rows if row["setting"].endswith("one lobe")]
    if painting:
        _curve(axes, painting, error, "^-.", GREY, "one lobe, spread")
    bound = [row for row in rows if "bound" in row and row["setting"].endswith(("spread", "all"))]
    if len(bound) > 1:
        _curve(axes, bound, lambda row: row["bound"], ":", BLACK, "Cramér-Rao, spread")
    up = "error of the normals, degrees" if truth else "error of relighting, %"
    dress(axes, data, "lights", up)
    logarithmic(axes)


def steps(axes: Any, found: Row, data: str) -> None:
    """Error against the steps that a search may take, a line for every number of rounds."""
    rows = [row for row in of_knob(found["rows"], "effort") if row["data"] == data]
    by_rounds: dict[int, list[Row]] = {}
    for row in rows:
        effort = Effort(**row["options"]["effort"])
        if effort.start == "multistart" and effort.colour_iterations is None:
            by_rounds.setdefault(effort.rounds, []).append(row | {"number": effort.iterations})
    # One hue from light to dark for an ordered quantity.
    for shade, (rounds, some) in zip(SHADES, sorted(by_rounds.items()), strict=False):
        label = counted(rounds, "round")
        _curve(axes, some, lambda row: 100.0 * row["error"][ERROR], "o-", shade, label)
    dress(axes, data, "steps of a search, at most", "error of relighting, %")
    logarithmic(axes)
    low, high = axes.get_ylim()
    # A range of at least a factor of 1.5, so that small differences look small.
    stretch = max(1.0, (1.5 * low / high) ** 0.5)
    axes.set_ylim(low / stretch, high * stretch)
    plain(axes.yaxis)


def excess(axes: Any, found: Row, data: str) -> None:
    """Cost above the least against the steps that a search may take, in either precision."""
    rows = [row for row in of_knob(found["rows"], "search") if row["data"] == data]
    axes.axhline(BAD, color=FAINT, lw=0.8)
    note(axes, "a hundredth", (max(row["number"] for row in rows), BAD), GREY, (-44, 4))
    for precision, (style, colour) in SEARCHES.items():
        some = [row for row in rows if searched_in(row) == precision]
        for what, fill in FILLS.items():
            up = lambda row, what=what: row["excess"][what]  # noqa: E731
            line = _curve(axes, some, up, style, colour, f"{precision}, {what}")
            line.set_markerfacecolor(fill or colour)
    dress(axes, data, "steps of a search, at most", "cost above the least")
    logarithmic(axes)


def views(axes: Any, found: Row, data: str) -> None:
    """Decibels lost with photographs left out, of a rig of hundreds of views."""
    rows = [row for row in of_knob(found["rows"], "views") if row["data"] == data]
    full = max(rows, key=lambda row: row["number"])
    for choice, (style, colour) in LOOKS.items():
        some = [row for row in rows if row["setting"].endswith(choice)]
        loss = lambda row: full["error"]["psnr"] - row["error"]["psnr"]  # noqa: E731
        if some:
            _curve(axes, [*some, full], loss, style, colour, choice)
    axes.axhline(1.0, color=FAINT, lw=0.8)
    low, high = full["number"] / 100.0, full["number"] / 40.0
    axes.axvspan(low, high, color="#f0f0f0", lw=0)
    note(axes, "claimed: 1 dB at 1/100 to 1/40", (low, 1.0), "#606060", (2, 4))
    dress(axes, data, "photographs", "decibels lost")
    axes.set_xscale("log")
    plain(axes.xaxis)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))


def reflectance(axes: Any, found: Row, data: str) -> None:
    """Colour difference against nanoseconds per pixel: estimators by name, and their front."""
    rows = [row for row in of_knob(found["rows"], "reflectance") if row["data"] == data]
    ours = [row for row in rows if row["options"]]
    places = [(1e3 * row["cost"]["cpu"], row["error"]["colour"]) for row in ours]
    corners = [places[i] for i in pareto_front(places)]
    axes.plot(*zip(*corners, strict=True), color=BLUE, lw=1.3, zorder=2, label="front")
    axes.plot(*zip(*places, strict=True), "o", ms=5, color=BLUE, ls="", label="estimators of ours")
    for row, at in zip(ours, places, strict=True):
        note(axes, row["setting"], at, BLUE, BESIDE.get(row["setting"], (5, 2)))
    for row in rows:
        if not row["options"]:
            at = (1e3 * row["cost"]["cpu"], row["error"]["colour"])
            axes.plot(*at, "s", ms=5, color=ORANGE, mew=0, ls="", label=row["setting"])
    dress(axes, data, "CPU ns per pixel", "mean ΔE00 of the pigments")
    logarithmic(axes)
    axes.margins(x=0.25, y=0.2)
