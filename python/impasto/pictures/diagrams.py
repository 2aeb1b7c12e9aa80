"""Diagrams without axes of their own program: lines and dots, bars, and needle maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto.errors import ArgumentError
from impasto.pictures.panels import FAINT, INK, Panel, Picture
from impasto.pictures.sheet import draw_text

Colour = tuple[int, int, int]
Range = tuple[float, float]

GROUND = (38, 38, 41)
LINE = (86, 86, 90)
AMBER: Colour = (232, 161, 90)
RED: Colour = (226, 96, 84)
GREEN: Colour = (120, 190, 110)
BLUE: Colour = (96, 148, 226)

LEGEND = 18
"""Pixels from one line of the legend to the next."""


@dataclass(frozen=True, eq=False)
class Series:
    """One line, or the dots, of a diagram.

    Parameters
    ----------
    name
        For the legend; empty: none.
    points
        ``(n, 2)``: x and y, in order of x for a line.
    colour
        8-bit sRGB.
    dots
        Whether every point is a dot; else a line joins them.
    """

    name: str
    points: ArrayLike
    colour: Colour = INK
    dots: bool = False


def diagram_panel(
    series: Sequence[Series],
    title: str,
    *,
    x: Range,
    y: Range,
    note: str = "",
    axis: tuple[str, str] | None = None,
    size: tuple[int, int] = (460, 460),
) -> Panel:
    """Lines and dots over two linear axes, with a legend.

    Parameters
    ----------
    series
        What is drawn, the first at the bottom.
    title, note, axis
        See :class:`Panel`.
    x, y
        Values at the ends of the axes. Horizontal lines divide y into four parts.
    size
        ``(y, x)`` of the picture in pixels.
    """
    import cv2

    if not (x[1] > x[0] and y[1] > y[0]):
        raise ArgumentError(f"x, y: expected ranges that rise, found {x} and {y}")
    rows, columns = size
    picture = np.empty((rows, columns, 3), dtype=np.uint8)
    picture[:] = GROUND
    left, top, base = 44, 14, rows - 10
    scale = np.array([(columns - left - 12) / (x[1] - x[0]), (top - base) / (y[1] - y[0])])
    for value in np.linspace(y[0], y[1], 5).tolist():
        at = round(base + (value - y[0]) * float(scale[1]))
        picture[at, left:] = LINE
        draw_text(picture, f"{value:.3g}", (left - 8, at + 5), 13, FAINT, right=True)

    def pixels(points: ArrayLike) -> NDArray[np.int32]:
        values = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        values = values[np.isfinite(values).all(axis=1)]
        place = (values - (x[0], y[0])) * scale + (left, base)
        reach = 4.0 * max(size)
        return np.asarray(np.rint(16.0 * np.clip(place, -reach, reach)), dtype=np.int32)

    for one in series:
        places = pixels(one.points)
        if one.dots:
            for column, row in places.tolist():
                cv2.circle(picture, (column, row), 40, one.colour, -1, cv2.LINE_AA, 4)
        elif len(places) > 1:
            cv2.polylines(picture, [places], False, one.colour, 2, cv2.LINE_AA, 4)
    for number, one in enumerate(one for one in series if one.name):
        draw_text(picture, one.name, (left + 10, top + 18 + number * LEGEND), 13, one.colour)
    return Panel(title, picture, note, axis=axis)


def bar_panel(
    bars: Sequence[tuple[str, float, Colour]],
    title: str,
    *,
    note: str = "",
    size: tuple[int, int] = (460, 460),
) -> Panel:
    """Quantities side by side: name, value from 0 on, colour; the highest fills the picture."""
    rows, columns = size
    picture = np.empty((rows, columns, 3), dtype=np.uint8)
    picture[:] = GROUND
    base, highest = rows - 34, max(value for _, value, _ in bars)
    step = columns / len(bars)
    for number, (name, value, colour) in enumerate(bars):
        left, right = round((number + 0.2) * step), round((number + 0.8) * step)
        top = base - round((rows - 80) * value / highest) if highest > 0.0 else base
        picture[top:base, left:right] = colour
        draw_text(picture, f"{value:.3g}", (left, top - 8), 15, INK, room=right - left)
        draw_text(picture, name, (left, base + 22), 15, FAINT, room=right - left)
    picture[base] = LINE
    return Panel(title, picture, note)


def needle_panel(
    normal: ArrayLike, title: str, *, note: str = "", needles: int = 24, gain: float = 2.0
) -> Panel:
    """A needle map: the normals ``(3, y, x)`` of a grid of points, seen from the front.

    Parameters
    ----------
    normal
        Unit vectors; NaN where unknown.
    title, note
        See :class:`Panel`.
    needles
        Needles along the longer side.
    gain
        Length of the needle of a normal that lies in the plane, in distances between needles.
    """
    import cv2

    planes = np.asarray(normal, dtype=np.float64)
    if planes.ndim != 3 or len(planes) != 3:
        raise ArgumentError(f"normal: expected (3, y, x), found shape {planes.shape}")
    height, width = planes.shape[1:]
    step = max(height, width) / needles
    cell = 460.0 / max(height, width)
    rows, columns = max(1, round(height * cell)), max(1, round(width * cell))
    picture: Picture = np.empty((rows, columns, 3), dtype=np.uint8)
    picture[:] = GROUND
    for y in np.arange(step / 2, height, step).tolist():
        for x in np.arange(step / 2, width, step).tolist():
            tilt_x, tilt_y, up = planes[:, int(y), int(x)].tolist()
            if not np.isfinite(up):
                continue
            foot = np.array([x, y]) * cell
            tip = foot + np.array([tilt_x, -tilt_y]) * gain * step * cell
            start, end = (np.rint(16.0 * at).astype(int).tolist() for at in (foot, tip))
            cv2.line(picture, start, end, INK, 1, cv2.LINE_AA, 4)
            cv2.circle(picture, start, 24, AMBER, -1, cv2.LINE_AA, 4)
    return Panel(title, picture, note)
