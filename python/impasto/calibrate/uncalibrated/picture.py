"""A picture of lamps found without balls: their map, and from where photographs are lit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.picture import directions_panel
from impasto.calibrate.uncalibrated.patches import Array
from impasto.calibrate.uncalibrated.result import PanelLights
from impasto.pictures import Panel, Picture, contact_sheet

_AMBER = (255, 190, 90)
_WIDTH = 600


def panel_lights_picture(
    found: PanelLights, photographs: dict[int, NDArray[np.float32]]
) -> Picture:
    """``(y, x, 3)``: some photographs with the direction of their light, and a map of all lamps.

    Whoever sees that a photograph is lit from the other side knows that hills were taken for
    hollows.

    Parameters
    ----------
    found
        What :func:`impasto.calibrate.lights_from_panel` returned.
    photographs
        ``(band, y, x)`` linear light of some lamps that are known, by number from 0.
    """
    panels = [_lit(found, number, light) for number, light in photographs.items()]
    count = int(found.known.sum())
    worst = np.degrees(float(np.nanmax(found.sigma)))
    return contact_sheet(
        [*panels, directions_panel(found.directions, "circles: two deviations", found.sigma)],
        title="Lamps from photographs of the painting",
        subtitle=f"{count} of {len(found.known)} lamps, within {worst:.1f}° if they are equally "
        "strong and the painting faces the camera",
        columns=len(panels) + 1,
    )


def _lit(found: PanelLights, number: int, light: NDArray[np.float32]) -> Panel:
    import cv2

    grey = np.clip(np.nan_to_num(light.mean(axis=0)), 0.0, None)
    scale = _WIDTH / max(grey.shape)
    grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    bright = float(np.percentile(grey, 99)) or 1.0
    shown = np.rint(200.0 * np.sqrt(np.clip(grey / bright, 0.0, 1.0))).astype(np.uint8)
    picture = np.ascontiguousarray(np.repeat(shown[..., None], 3, axis=2))
    across: Array = found.directions[number, :2] * (1.0, -1.0)
    across = across / max(float(np.hypot(*across)), np.finfo(float).tiny)
    middle = np.array([grey.shape[1], grey.shape[0]]) / 2
    reach = 0.42 * min(grey.shape)
    start, end = np.rint(middle + reach * across), np.rint(middle + 0.45 * reach * across)
    points = [tuple(int(value) for value in point) for point in (start, end)]
    cv2.arrowedLine(picture, points[0], points[1], _AMBER, 3, cv2.LINE_AA, 0, 0.2)
    return Panel(found.names[number], picture, "the arrow is the light")
