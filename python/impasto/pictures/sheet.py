"""Contact sheets: pictures on one sheet, each with its title and scale."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import ceil
from typing import Any

import numpy as np

from impasto.errors import ArgumentError
from impasto.pictures.panels import BACKGROUND, FAINT, INK, Panel, Picture, colour_ramp


def contact_sheet(
    panels: Sequence[Panel],
    *,
    title: str = "",
    subtitle: str = "",
    columns: int | None = None,
    width: int = 460,
) -> Picture:
    """All panels on one dark-grey sheet, aligned, each with its title and scale.

    Parameters
    ----------
    panels
        At least one. All cells have the shape of the first panel, limited to heights between an
        eighth of the width and four widths.
    title, subtitle
        Heading of the sheet.
    columns
        Pictures per row; default: the number for which the sheet is closest to 16:10.
    width
        Width of a picture on the sheet in pixels.
    """
    if not panels:
        raise ArgumentError("panels: expected at least one picture, found none")
    high, across = panels[0].picture.shape[:2]
    # Without this limit a narrow strip would make cells of any height.
    height = round(width * min(max(high / across, 1.0 / 8.0), 4.0))
    gap, margin, head = 28, 40, 34
    foot = 44 if any(panel.bar or panel.classes or panel.axis for panel in panels) else 16
    cell_w, cell_h = width + gap, head + height + foot
    if columns is None:
        shapes = range(1, len(panels) + 1)
        columns = min(
            shapes, key=lambda n: abs(n * cell_w / (ceil(len(panels) / n) * cell_h) - 1.6)
        )
    rows = ceil(len(panels) / columns)
    top = (96 if subtitle else 76) if title else margin - 8
    sheet = np.empty(
        (top + rows * cell_h + margin - foot // 2, 2 * margin + columns * cell_w - gap, 3),
        dtype=np.uint8,
    )
    sheet[:] = BACKGROUND
    draw_text(sheet, title, (margin, 52), 26, weight=500, room=sheet.shape[1] - 2 * margin)
    if subtitle:
        draw_text(sheet, subtitle, (margin, 78), 15, FAINT, room=sheet.shape[1] - 2 * margin)
    for index, panel in enumerate(panels):
        row, column = divmod(index, columns)
        corner = (margin + column * cell_w, top + row * cell_h)
        _set_panel(sheet, panel, corner, width, height, head)
    return sheet


def _set_panel(
    sheet: Picture, panel: Panel, corner: tuple[int, int], width: int, height: int, head: int
) -> None:
    x, y = corner
    end = draw_text(sheet, panel.title, (x, y + 23), 17, weight=450, room=width)
    draw_text(
        sheet, panel.note, (x + width, y + 23), 13, FAINT, right=True, room=x + width - end - 12
    )
    sheet[y + head : y + head + height, x : x + width] = fitted(panel.picture, width, height)
    below = y + head + height
    if panel.bar is not None:
        ramp = colour_ramp()[np.linspace(0, 255, width).round().astype(np.uint8)]
        sheet[below + 8 : below + 13, x : x + width] = ramp
        draw_text(sheet, panel.bar[0], (x, below + 30), 13, FAINT)
        draw_text(sheet, panel.bar[1], (x + width, below + 30), 13, FAINT, right=True)
    if panel.axis is not None:
        draw_text(sheet, panel.axis[0], (x, below + 18), 13, FAINT)
        draw_text(sheet, panel.axis[1], (x + width, below + 18), 13, FAINT, right=True)
    pen, line = x, below + 21
    for name, colour in panel.classes:
        if pen > x and pen + 16 + _width(name, 13, 400) > x + width:
            pen, line = x, line + 17
        if line > below + 38:  # no room for the rarest classes of a long list
            break
        sheet[line - 10 : line, pen : pen + 10] = colour
        pen = draw_text(sheet, name, (pen + 16, line), 13, FAINT, room=width - 16) + 16


def fitted(picture: Picture, width: int, height: int) -> Picture:
    """The picture scaled to fit ``width`` x ``height``, centred on the sheet's background.

    Shrinking averages pixels; enlarging repeats them, so that each remains visible.
    """
    import cv2

    rows, columns = picture.shape[:2]
    factor = min(width / columns, height / rows)
    size = (max(1, round(columns * factor)), max(1, round(rows * factor)))
    how = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_NEAREST_EXACT
    scaled = np.asarray(cv2.resize(np.ascontiguousarray(picture), size, interpolation=how))
    cell = np.empty((height, width, 3), dtype=np.uint8)
    cell[:] = BACKGROUND
    top, left = (height - size[1]) // 2, (width - size[0]) // 2
    cell[top : top + size[1], left : left + size[0]] = scaled
    return cell


def draw_text(
    sheet: Picture,
    text: str,
    origin: tuple[int, int],
    size: int,
    colour: tuple[int, int, int] = INK,
    *,
    weight: int = 400,
    right: bool = False,
    room: int | None = None,
) -> int:
    """Draw one line at its baseline and return its end in x; a line that is too long is cut."""
    if not text:
        return origin[0]
    import cv2

    face = _face()
    extent = _width(text, size, weight)
    if room is not None and extent > room:
        while text and extent > room:
            text = text[:-1]
            extent = _width(text + "…", size, weight)
        if not text:
            return origin[0]
        text = text.rstrip() + "…"
        extent = _width(text, size, weight)
    start = origin[0] - extent if right else origin[0]
    cv2.putText(sheet, text, (start, origin[1]), colour, face, size, weight)
    return start + extent


def _width(text: str, size: int, weight: int) -> int:
    import cv2

    # The size given here only wraps lines; this one is wide enough for any line.
    box = cv2.getTextSize((100_000, 4 * size), text, (0, 0), _face(), size, weight)
    return int(box[2])


@cache
def _face() -> Any:
    import cv2

    return cv2.FontFace("sans")
