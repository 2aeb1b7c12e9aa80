"""The figures: vector and PNG, readable in print and by colour-blind readers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from study import panels
from study.tables import of_knob

DPI = 150
STYLE = {
    "font.size": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#808080",
    "axes.linewidth": 0.7,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "legend.labelspacing": 0.6,
    "axes.labelcolor": "#303030",
    "xtick.color": "#606060",
    "ytick.color": "#606060",
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "svg.fonttype": "none",
    # Constant ids of clip paths: the same figure gives the same file.
    "svg.hashsalt": "impasto",
}

LETTER = 0.065
"""Width of a letter of the legend, inches."""

Panel = Callable[[Any, dict[str, Any], str], None]
FIGURES: dict[str, tuple[tuple[str, ...], Panel]] = {
    "front": (("pooling",), panels.front),
    "normals": (("normals",), panels.normals),
    "lights": (("lights",), panels.lights),
    "steps": (("effort",), panels.steps),
    "views": (("views",), panels.views),
    "excess": (("search",), panels.excess),
    "reflectance": (("reflectance",), panels.reflectance),
}
"""Name of the file: its knobs, and the function that draws one panel."""


def draw(found: dict[str, Any], out: Path, *, prefix: str = "") -> list[Path]:
    """Draw every figure that a study has rows for.

    Parameters
    ----------
    found
        What :func:`study.run` returned.
    out
        A folder that is there.
    prefix
        What the files' names begin with.

    Returns
    -------
    list
        Paths of SVG and PNG files.
    """
    written = []
    for name, (knobs, panel) in FIGURES.items():
        rows = of_knob(found["rows"], *knobs)
        if name == "normals":
            rows = [row for row in rows if row["error"]["normal"] is not None]
        sets = list(dict.fromkeys(row["data"] for row in rows))
        if sets:

            def paint(axes: list[Any], panel: Panel = panel, sets: list[str] = sets) -> None:
                for place, data in zip(axes, sets, strict=True):
                    panel(place, found, data)

            written += save(out / f"{prefix}{name}", len(sets), paint)
    return written


def save(stem: Path, panels: int, paint: Callable[[list[Any]], None]) -> list[Path]:
    """Write a figure of some panels, two in a row, as SVG and PNG; as wide as a page's text.

    What the panels' marks mean stands once, in the place that an odd number of panels leaves free,
    else below them.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    # No date: the same figure is the same file.
    formats: dict[str, dict[str, Any]] = {".svg": {"metadata": {"Date": None}}, ".png": {}}
    columns = min(panels, 2)
    rows = -(-panels // columns)
    written = []
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.4 * columns if columns > 1 else 4.6, 2.7 * rows + 0.3))
        figure.set_layout_engine("constrained")
        axes = [figure.add_subplot(rows, columns, place + 1) for place in range(panels)]
        paint(axes)
        _explain(figure, axes, rows * columns)
        for suffix, more in formats.items():
            path = stem.with_name(stem.name + suffix)
            figure.savefig(path, dpi=DPI, **more)
            written.append(path)
    return written


def _explain(figure: Any, axes: list[Any], places: int) -> None:
    """One legend for the labels of all panels."""
    known: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            known.setdefault(label, handle)
    if not known:
        return
    marks = (list(known.values()), list(known))
    if places > len(axes):
        free = figure.add_subplot(axes[0].get_gridspec()[places - 1])
        free.axis("off")
        free.legend(*marks, loc="center left", frameon=False, fontsize=8)
    else:
        # As many columns as the longest words leave room for, a mark beside each.
        width = LETTER * (max(map(len, known)) + 6)
        columns = int(min(4, max(1, figure.get_figwidth() // width)))
        figure.legend(*marks, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
