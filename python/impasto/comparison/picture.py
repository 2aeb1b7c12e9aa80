"""One picture of a comparison: before, after, the three maps, and what changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from impasto.comparison.entries import ClusterExtent, Quantity
from impasto.comparison.overview import Overview
from impasto.comparison.text import statuses
from impasto.pictures import (
    Panel,
    Picture,
    colour_panel,
    contact_sheet,
    ramp_panel,
)

WHITE_SHARE = 0.995
"""The quantile of both paintings that is shown as white."""
MARKS = {
    "normal": (86, 156, 214),
    "colour": (230, 159, 80),
    "gloss": (120, 190, 140),
}
"""Colours of what changed; where several did, their mean."""
STILL = (52, 52, 56)
LARGEST_DECIBEL = 20.0
"""Ends of the scale of gloss at most: a factor of 10 in beta."""


def comparison_picture(
    overview: Overview,
    names: tuple[str, str],
    quantities: Sequence[Quantity],
    compared: Mapping[str, int],
    illuminant: str,
    extent: ClusterExtent,
) -> Picture:
    """``(y, x, 3)`` uint8."""
    rows = {one.name: one for one in quantities}
    both = np.concatenate([overview.before, overview.after])
    known = both[np.isfinite(both)]
    white = float(np.quantile(known, WHITE_SHARE)) if known.size else 1.0
    white = max(white, 1e-6)
    panels = [
        colour_panel(overview.before, "Before", white=white),
        colour_panel(overview.after, "After", note="on the pixels of before", white=white),
        _marks(overview, rows, extent),
        ramp_panel(
            overview.angle[0], "Normal", unit=_least(rows["normal"], "degrees"), low=0.0,
            scale=float(np.degrees(1.0)),
        ),
    ]  # fmt: skip
    if np.isfinite(overview.delta_e).any():
        panels.append(
            ramp_panel(overview.delta_e[0], "Colour", unit=_least(rows["colour"], "dE00"), low=0.0)
        )
    if rows["gloss"].tested:
        panels.append(_gloss(overview.log_beta_ratio[0]))
    title = f"{_short(names[0])} → {_short(names[1])}"
    return contact_sheet(
        panels, title=title, subtitle=f"{statuses(compared)}  ·  colours {illuminant}", columns=3
    )


def _marks(overview: Overview, rows: Mapping[str, Quantity], extent: ClusterExtent) -> Panel:
    """Shares of changed pixels as mixtures of flat colours; the legend gives them for the whole."""
    shares = np.nan_to_num(overview.changed)
    total = shares.sum(axis=0)
    colours = np.array(list(MARKS.values()), np.float64)
    mean = np.tensordot(shares, colours, axes=(0, 0)) / np.maximum(total, 1e-9)[..., None]
    mixed = np.clip(total, 0.0, 1.0)[..., None]
    picture = mixed * mean + (1.0 - mixed) * np.array(STILL)
    seen = overview.compared[0] > 0.0
    board = _board(seen.shape)
    classes = tuple(
        (f"{name} {100 * rows[name].significant:.1f} %", colour)
        for name, colour in MARKS.items()
        if rows[name].tested
    )
    codes = np.rint(np.where(seen[..., None], picture, board)).astype(np.uint8)
    note = ""
    if math.isfinite(extent.critical):
        many = f"{extent.found} areas" if extent.found != 1 else "1 area"
        note = f"{many} of {extent.critical:g} pixels or more"
    return Panel("Changed significantly", codes, note=note, classes=classes)


def _board(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """The checkerboard that stands for unknown pixels in all panels."""
    rows, columns = np.indices(shape) // 8
    return np.where((rows + columns) % 2 == 0, 58.0, 74.0)[..., None]


def _gloss(logarithm: NDArray[np.float32]) -> Panel:
    """The ratio of beta in decibels, about zero."""
    decibel = 20.0 / np.log(10.0) * logarithm
    known = decibel[np.isfinite(decibel)]
    end = float(np.clip(np.quantile(np.abs(known), 0.99), 1.0, LARGEST_DECIBEL))
    return ramp_panel(
        decibel, "Gloss", unit="beta after / before, dB; 0: as before", low=-end, high=end
    )


def _least(row: Quantity, unit: str) -> str:
    if not np.isfinite(row.detectable):
        return unit
    return f"{unit}; significant from about {row.detectable:.2g}"


def _short(name: str) -> str:
    return name if len(name) <= 48 else f"…{name[-47:]}"
