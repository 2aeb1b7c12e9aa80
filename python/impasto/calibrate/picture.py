"""A picture of what was found: outlines, highlights, and the directions of the lamps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impasto.calibrate.geometry import Array, BallCamera
from impasto.calibrate.lights import BallLights, BallPhotographs
from impasto.pictures import Panel, Picture, contact_sheet
from impasto.pictures.sheet import draw_text

_GREEN, _AMBER, _INK, _LINE = (120, 190, 110), (255, 190, 90), (232, 230, 225), (120, 120, 124)
_SIZE = 600


def balls_picture(
    balls: Sequence[BallPhotographs], found: BallLights, camera: BallCamera | None = None
) -> Picture:
    """``(y, x, 3)``: each ball with its outline and highlights, and a map of the directions.

    The map shows unit directions from the front, with circles at 30 and 60 degrees from the view.
    """
    camera = BallCamera() if camera is None else camera
    panels = [_ball(*pair, camera) for pair in zip(balls, found.outlines, strict=True)]
    for panel, ball, row in zip(panels, balls, found.highlights, strict=True):
        scale = _SIZE / max(ball.pictures.shape[1:])
        for number, one in enumerate(row, 1):
            at = ((one.x + 0.5) * scale, (one.y + 0.5) * scale)
            _cross(panel.picture, at, str(number))
    worst = np.degrees(found.sigma.max())
    return contact_sheet(
        [*panels, directions_panel(found.directions, "from the front: x right, y up")],
        title="Lamps from mirror balls",
        subtitle=f"{found.verdict}; directions within {worst:.2f}°",
        columns=len(panels) + 1,
    )


def _ball(ball: BallPhotographs, outline: object, camera: BallCamera) -> Panel:
    import cv2

    from impasto.calibrate.outline import Outline

    assert isinstance(outline, Outline)
    picture = ball.pictures.max(axis=0)
    root = np.sqrt(np.clip(picture, 0.0, None) / picture.max())
    scale = _SIZE / max(picture.shape)
    grey = np.asarray(cv2.resize(root, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    rgb = np.repeat(np.rint(110.0 * np.clip(grey, 0, 1)).astype(np.uint8)[..., None], 3, axis=2)
    x, y = ball.corner or (0.0, 0.0)
    own = BallCamera(camera.focal_px, (camera.centre[0] - x, camera.centre[1] - y))
    points = np.rint(16.0 * ((own.outline_points(outline.numbers) + 0.5) * scale - 0.5))
    cv2.polylines(rgb, [points.astype(np.int32)], True, _GREEN, 2, cv2.LINE_AA, 4)
    return Panel(ball.name, rgb, f"outline ±{outline.sigma:.2g} pixels")


def _cross(picture: Picture, at: tuple[float, float], name: str) -> None:
    import cv2

    x, y = round(at[0]), round(at[1])
    cv2.line(picture, (x - 5, y), (x + 5, y), _AMBER, 1, cv2.LINE_AA)
    cv2.line(picture, (x, y - 5), (x, y + 5), _AMBER, 1, cv2.LINE_AA)
    draw_text(picture, name, (x + 7, y - 5), 15, _AMBER)


def directions_panel(directions: Array, note: str, sigma: Array | None = None) -> Panel:
    """A map of ``(lamp, 3)`` unit directions from the front, with circles of their errors.

    Circles at 30, 60 and 90 degrees from the view. Lamps without a direction are not shown.
    """
    import cv2

    picture = np.full((_SIZE, _SIZE, 3), 38, dtype=np.uint8)
    middle, reach = _SIZE / 2, 0.46 * _SIZE
    for angle in (30.0, 60.0, 90.0):
        size = round(reach * np.sin(np.radians(angle)))
        cv2.circle(picture, (round(middle), round(middle)), size, _LINE, 1, cv2.LINE_AA)
        draw_text(
            picture, f"{angle:.0f}°", (round(middle) + 4, round(middle) - size + 16), 13, _LINE
        )
    for number in np.flatnonzero(np.isfinite(directions[:, 0])).tolist():
        x, y = directions[number, :2].tolist()
        at = (round(middle + reach * x), round(middle - reach * y))
        if sigma is not None:
            cv2.circle(picture, at, round(2 * reach * sigma[number]), _AMBER, 1, cv2.LINE_AA)
        cv2.circle(picture, at, 4, _AMBER, -1, cv2.LINE_AA)
        draw_text(picture, str(number + 1), (at[0] + 7, at[1] - 5), 15, _INK)
    return Panel("Directions", picture, note)
