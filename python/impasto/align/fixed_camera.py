"""Marks of a camera that stood still: one view for all photographs, and which of them moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impasto.align.detection import FoundMarks
from impasto.align.layout import Layout
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

LARGEST_MOVE = 0.25
"""Pixels: half of the alignment error that the third paper allows [@snel]."""
CERTAIN = 4.0
"""Standard errors from which a move is none of the errors of marks."""
LEAST = 3
"""Marks that tell a move from the error of a mark."""


def common_marks(marks: Sequence[FoundMarks], layout: Layout) -> FoundMarks:
    """Medians of the marks over all photographs.

    Raises
    ------
    ArgumentError
        Markers that no photograph shows.
    """
    places: dict[str, list[Floats]] = {}
    for one in marks:
        for name, pixel in zip(one.names, one.pixels, strict=True):
            places.setdefault(name, []).append(pixel)
    missing = [name for name in layout.places if name not in places] if not layout.points else []
    if missing:
        raise ArgumentError(f"markers: {', '.join(missing)} not found in any photograph")
    names = tuple(places)
    pixels = np.array([np.median(places[name], axis=0) for name in names])
    return FoundMarks(names, pixels.reshape(-1, 2), {})


def move_of(own: FoundMarks, common: FoundMarks) -> tuple[float, float] | None:
    """How far a photograph moved against the others: the median move of its marks.

    Parameters
    ----------
    own, common
        Its marks, and those of all photographs.

    Returns
    -------
    tuple
        Columns and rows in pixels; None with fewer than three marks, or where the move is within
        a quarter of a pixel or within its errors: four standard errors of a median of normally
        distributed errors, whose standard deviation is estimated from median absolute deviations.
    """
    places = dict(zip(common.names, common.pixels, strict=True))
    if len(own.names) < LEAST:
        return None
    apart = own.pixels - np.array([places[name] for name in own.names])
    move = np.median(apart, axis=0)
    scatter = 1.4826 * np.median(np.abs(apart - move), axis=0)
    error = float(np.hypot(*scatter)) * np.sqrt(np.pi / (2 * len(apart)))
    if np.hypot(*move) <= max(LARGEST_MOVE, CERTAIN * error):
        return None
    return float(move[0]), float(move[1])
