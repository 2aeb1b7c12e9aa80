"""Figures of docs/accuracy-and-time.md from the records of the solver: kernels.json, fits.json."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from record import RESULTS

from study.figures import save
from study.panels import BLACK, BLUE, FAINT, GREEN, ORANGE, dress, logarithmic, note, plain

Row = dict[str, Any]


def steps(axes: list[Any]) -> None:
    """Excess cost against steps, and against time."""
    looks = {"f32": ("o-", BLUE), "f32, polished": ("^:", GREEN), "f64": ("s--", ORANGE)}
    for name, (style, colour) in looks.items():
        rows = [row for row in _record("kernels")["steps"] if row["precision"] == name]
        # A logarithmic axis has no place for nothing: what is below rounding stands at its edge.
        excess = [max(row["excess_p99"], 1e-13) for row in rows]
        for ax, across in zip(axes, ("steps", "ns"), strict=True):
            places = [row[across] for row in rows]
            ax.plot(places, excess, style, color=colour, ms=4, lw=1.2, label=name)
    up = "cost above the least (p99)"
    dress(axes[0], "One lobe, 16 samples: steps", "steps of a search, at most", up)
    dress(axes[1], "the same: time", "ns per fit, one thread", up)
    for ax in axes:
        _across(ax)
        ax.set_yscale("log")


def basins(axes: list[Any]) -> None:
    """Bad pixels against time."""
    rows = _record("kernels")["strategies"]
    turns = [row for row in rows if "starts" in row["strategy"]]
    axes[0].plot(*zip(*((r["us"], r["bad"]) for r in turns), strict=True), color=BLACK, lw=0.8)
    for row in rows:
        name = row["strategy"].replace("all at once, starts: 1", "all at once, one start")
        name = name.replace("MINPACK", "MINPACK (Rust)")
        colour = ORANGE if "MINPACK" in name else BLUE if "one at a time" in name else BLACK
        at = (row["us"], row["bad"])
        axes[0].plot(*at, "s" if colour == ORANGE else "o", ms=5, color=colour)
        by = {
            "all at once, f64": (7, -3),
            "all at once, one start": (-14, 8),
            "MINPACK (Rust), all at once": (-95, 7),
        }.get(name, (6, 3))
        if row in turns[1:]:
            name, by = name.rpartition(" ")[2], (-3, -11)
        note(axes[0], name, at, colour, by)
    dress(axes[0], "Three lobes, 100 samples", "µs per pixel, one thread", "bad pixels, %")
    _across(axes[0])
    axes[0].set_yscale("log")
    axes[0].margins(y=0.15)
    plain(axes[0].yaxis)


def roofline(axes: list[Any]) -> None:
    """Operations a second against operations per byte, and the machine's limits."""
    found = _record("kernels")
    limit = {row["what"]: row["value"] for row in found["limits"]}
    kernels = found["kernels"]
    low = min(row["flops_per_byte"] for row in kernels) / 20.0
    high = max(row["flops_per_byte"] for row in kernels) * 60.0
    corner = limit["GFLOP/s"] / limit["GB/s"]
    roof = [(x, min(limit["GFLOP/s"], limit["GB/s"] * x)) for x in (low, corner, high)]
    axes[0].plot(*zip(*roof, strict=True), color=FAINT, lw=1.5)
    note(
        axes[0], f"{limit['GFLOP/s']:.0f} GFLOP/s, one thread", (corner, roof[1][1]), BLACK, (4, 4)
    )
    note(axes[0], f"{limit['GB/s']:.0f} GB/s", roof[0], BLACK, (22, 30))
    for row in kernels:
        at = (row["flops_per_byte"], row["gflops"])
        axes[0].plot(*at, "o", ms=5, color=BLUE)
        # Names of the same model stand on the side where the other's point is not.
        model = row["kernel"].split(",")[0]
        alike = [k["gflops"] for k in kernels if k["kernel"].startswith(model)]
        up = 3 if row["gflops"] == max(alike) else -9
        by = (-88, up) if model == "Lafortune 1" else (6, up)
        note(axes[0], f"{row['kernel']}: {row['share']:.0f} %", at, BLUE, by)
    dress(axes[0], "Share of the machine's limits", "operations per byte", "GFLOP/s")
    logarithmic(axes[0])
    axes[0].set_ylim(top=limit["GFLOP/s"] * 2.0)


def fitters(axes: list[Any]) -> None:
    """How many times as long peers take for the same pixels."""
    found = _record("fits")
    lanes = found["lanes"][0]
    rows = [("MINPACK (Rust)", lanes["ratio"], lanes["ratio"], lanes["ratio"])]
    rows += [(row["peer"], row["ratio"], row["least"], row["most"]) for row in found["peers"]]
    rows.sort(key=lambda row: row[1])
    for place, (name, ratio, least, most) in enumerate(rows):
        axes[0].plot([least, most], [place, place], color=ORANGE, lw=1.2)
        axes[0].plot(ratio, place, "s", ms=5, color=ORANGE)
        note(axes[0], f"{name}: {ratio:.0f}", (most, place), ORANGE, (7, -3))
    axes[0].axvline(1.0, color=BLUE, lw=1.2)
    note(axes[0], "ours", (1.0, len(rows) - 1.0), BLUE, (4, 0))
    dress(axes[0], "One lobe, 16 samples: other fitters", "times as long as ours, same run", "")
    _across(axes[0])
    axes[0].set_xlim(0.7, 300.0 * rows[-1][1])
    axes[0].set_yticks([])
    axes[0].set_ylim(-0.7, len(rows) - 0.3)


def _across(ax: Any) -> None:
    """Logarithmic, with plain numbers, and room for names beside points."""
    ax.set_xscale("log")
    ax.margins(x=0.25)
    plain(ax.xaxis)


FIGURES: dict[str, tuple[str, int, Callable[[list[Any]], None]]] = {
    "precision": ("kernels", 2, steps),
    "basins": ("kernels", 1, basins),
    "roofline": ("kernels", 1, roofline),
    "fitters": ("fits", 1, fitters),
}
"""Name of the file: the record that it shows, its panels, and what draws them."""


def _record(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_text("utf-8"))


def draw(out: Path) -> list[Path]:
    """Every figure that there is a record of."""
    written = []
    for name, (record, panels, panel) in FIGURES.items():
        if (RESULTS / f"{record}.json").is_file():
            written += save(out / f"study-{name}", panels, panel)
    return written
