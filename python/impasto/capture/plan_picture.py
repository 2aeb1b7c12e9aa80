"""A picture of a plan: where lamps stand, and what they will tell."""

from __future__ import annotations

import numpy as np

from impasto.capture.expected import ExpectedErrors, Floats
from impasto.pictures import Panel, Picture, contact_sheet
from impasto.pictures.diagrams import AMBER, GREEN, GROUND, LINE
from impasto.pictures.panels import FAINT, INK
from impasto.pictures.sheet import draw_text

_SIZE = 560


def plan_picture(
    directions: Floats, added: Floats, before: ExpectedErrors | None, after: ExpectedErrors
) -> Picture:
    """``(y, x, 3)``: the lamps from the front, and the least errors before and after.

    Parameters
    ----------
    directions, added
        ``(n, 3)`` lamps that are there, and lamps to add.
    before, after
        What these allow, without and with the added ones.
    """
    return contact_sheet(
        [_map(directions, added), errors_panel(before, after)],
        title="Plan of a capture",
        subtitle=f"{len(directions)} lamps, {len(added)} added",
        columns=2,
    )


def _map(directions: Floats, added: Floats) -> Panel:
    import cv2

    picture = np.full((_SIZE, _SIZE, 3), GROUND, dtype=np.uint8)
    middle, reach = _SIZE / 2, 0.44 * _SIZE
    for elevation in (60, 30, 0):
        size = round(reach * np.cos(np.radians(elevation)))
        cv2.circle(picture, (round(middle), round(middle)), size, LINE, 1, cv2.LINE_AA)
        place = (round(middle) + 6, round(middle) - size + 16)
        draw_text(picture, f"{elevation}°", place, 13, FAINT)
    for places, colour, first in ((directions, AMBER, 1), (added, GREEN, len(directions) + 1)):
        for number, (x, y, _) in enumerate(places.tolist(), first):
            at = (round(middle + reach * x), round(middle - reach * y))
            cv2.circle(picture, at, 5, colour, -1, cv2.LINE_AA)
            if len(directions) + len(added) <= 40:
                draw_text(picture, str(number), (at[0] + 8, at[1] - 6), 14, INK)
    note = "amber: there, green: added" if len(added) else "x right, y up"
    return Panel("Lamps from the front", picture, note)


def errors_panel(before: ExpectedErrors | None, after: ExpectedErrors) -> Panel:
    """A table of the least errors, before and after; None: there is no before."""
    picture = np.full((_SIZE, _SIZE, 3), GROUND, dtype=np.uint8)
    columns = [after] if before is None else [before, after]
    for column, name in enumerate(["now"] if before is None else ["before", "after"]):
        draw_text(picture, name, (300 + 120 * column, 48), 16, FAINT)
    rows = [
        ("normal, degrees", [np.degrees(one.normal) for one in columns]),
        ("normal, worst tilt", [np.degrees(one.worst_normal) for one in columns]),
        ("reflectance, %", [100 * one.albedo for one in columns]),
        (f"beta, % of {after.pixels} pixels", [100 * one.beta for one in columns]),
        (f"gamma, % of {after.pixels} pixels", [100 * one.gamma for one in columns]),
        ("condition number", [one.condition for one in columns]),
        ("samples in the light, %", [100 * one.lit for one in columns]),
    ]
    for number, (name, values) in enumerate(rows):
        line = 96 + 46 * number
        draw_text(picture, name, (30, line), 17, INK)
        for column, value in enumerate(values):
            text = f"{value:.3g}" if np.isfinite(value) else "unknown"
            draw_text(
                picture, text, (300 + 120 * column, line), 17, AMBER if column == 0 else GREEN
            )
    return Panel("Least errors", picture, "Cramér-Rao bounds")
