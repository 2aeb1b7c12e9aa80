"""A picture of what a ColorChecker told: its patches, the sensitivities, the errors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.camera import ChartCamera
from impasto.calibrate.chart import GRID, HALF_SIDE, Array
from impasto.pictures import Panel, Picture, Series, colour_panel, contact_sheet, diagram_panel
from impasto.pictures.diagrams import AMBER, BLUE, GREEN, RED

_SIZE = 460
_AROUND = 1.2
"""Distances between two patches that are shown around the outer ones."""


def chart_picture(linear: NDArray[Any], found: ChartCamera) -> Picture:
    """``(y, x, 3)``: the chart with what was read, sensitivities, and errors of patches left out.

    Parameters
    ----------
    linear
        ``(band, y, x)`` as given to :func:`impasto.calibrate.camera_from_chart`.
    found
        What that returned.
    """
    curves = found.camera.sensitivities / found.camera.sensitivities.max(axis=1, keepdims=True)
    names = found.camera.bands
    colours = [RED, GREEN, BLUE] if len(names) == 3 else [AMBER] * len(names)
    lines = [
        Series(name, np.stack([GRID, curve], axis=1), colour)
        for name, curve, colour in zip(names, curves, colours, strict=True)
    ]
    numbers = np.arange(1, 25)
    dots = [
        Series("a matrix", np.stack([numbers, found.matrix_delta_e], axis=1), AMBER, dots=True),
        Series("estimated reflectance", np.stack([numbers, found.delta_e], axis=1), dots=True),
    ]
    top = 1.25 * float(np.nanmax([found.delta_e, found.matrix_delta_e]))
    chart = _chart(linear, found)
    size = chart.picture.shape[0], chart.picture.shape[1]
    return contact_sheet(
        [
            chart,
            diagram_panel(
                lines, "Sensitivities", x=(GRID[0], GRID[-1]), y=(0.0, 1.5),
                axis=("400 nm", "700"), note="largest = 1", size=size,
            ),
            diagram_panel(
                dots, "Patches left out", x=(0.0, 25.0), y=(0.0, max(top, 1e-6)),
                axis=("dark skin", "black"), note="dE00", size=size,
            ),
        ],
        title="Camera from a ColorChecker",
        subtitle=found.summary(),
        columns=3,
    )  # fmt: skip


def _chart(linear: NDArray[Any], found: ChartCamera) -> Panel:
    import cv2

    places = found.chart.places
    apart = float(np.linalg.norm(places[1] - places[0]))
    low = np.maximum(np.floor(places.min(axis=0) - _AROUND * apart), 0).astype(int)
    high = np.ceil(places.max(axis=0) + _AROUND * apart).astype(int)
    part = np.asarray(linear, dtype=np.float64)[:, low[1] : high[1] + 1, low[0] : high[0] + 1]
    white = found.white[:, None, None] if len(found.white) == 3 else found.white.mean()
    planes = part[:3] / white if len(part) == 3 else np.repeat(part[:1] / white, 3, axis=0)
    panel = colour_panel(planes.astype(np.float32), "Chart")
    scale = _SIZE / max(panel.picture.shape[:2])
    rgb = np.asarray(cv2.resize(panel.picture, None, fx=scale, fy=scale))
    for place, used in zip(places, found.chart.used, strict=True):
        square = _square(found.chart.places, place, apart)
        points = np.rint(16.0 * ((square - low + 0.5) * scale - 0.5)).astype(np.int32)
        cv2.polylines(rgb, [points], True, GREEN if used else RED, 2, cv2.LINE_AA, 4)
    count = int(found.chart.used.sum())
    across, down = 100.0 * found.fit.slope
    return Panel("Chart", rgb, f"{count} of 24 used; light {across:+.1f} %, {down:+.1f} %")


def _square(places: Array, place: Array, apart: float) -> Array:
    """About what is read of a patch."""
    right = (places[5] - places[0]) / np.linalg.norm(places[5] - places[0])
    down = (places[18] - places[0]) / np.linalg.norm(places[18] - places[0])
    reach = HALF_SIDE * apart
    return place + reach * np.array([right + down, down - right, -right - down, right - down])
