"""A picture of the shots of a ball-joint rig: as figure 6 of the third paper, and the joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.capture.ball_joint_shots import BallJointPlan
from impasto.capture.expected import ExpectedErrors
from impasto.capture.plan_picture import errors_panel
from impasto.pictures import Panel, Picture, Series, colour_ramp, contact_sheet, diagram_panel
from impasto.pictures.diagrams import AMBER, BLUE, GREEN, GROUND, LINE, RED
from impasto.pictures.panels import FAINT
from impasto.pictures.sheet import draw_text

Floats = NDArray[np.float64]

_SIZE = 560
_RINGS = (30, 60, 90, 120)
_MOST = 135.0
"""Degrees from the mirror direction at the edge of the picture."""


def from_mirror(lights: Floats, views: Floats) -> Floats:
    """``(n, 2)``: views about the mirror direction, in degrees (azimuthal equidistant projection).

    Parameters
    ----------
    lights, views
        ``(n, 3)`` unit vectors; the normal is z.

    Returns
    -------
    ndarray
        To the right: towards larger angles in the plane of incidence, away from the lamp; up: out
        of this plane. The distance from the origin is the angle from the mirror direction
        [@snyder1987map].
    """
    mirror = lights * (-1.0, -1.0, 1.0)
    outward = -lights[:, :2]
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    # A lamp along the normal has no plane of incidence.
    ahead = np.where(length > 1e-9, outward / np.maximum(length, 1e-9), (1.0, 0.0))
    sine, cosine = np.linalg.norm(mirror[:, :2], axis=1), mirror[:, 2]
    along = np.column_stack([ahead * cosine[:, None], -sine])
    across = np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))])
    x, y, z = (np.einsum("ij,ij->i", views, axis) for axis in (along, across, mirror))
    around = np.hypot(x, y)
    angle = np.degrees(np.arctan2(around, z))
    scale = angle / np.maximum(around, 1e-12)
    return np.stack([x * scale, y * scale], axis=1)


def ball_joint_picture(plan: BallJointPlan, errors: ExpectedErrors) -> Picture:
    """``(y, x, 3)``: views about the mirror direction, joints in order, and the least errors.

    Parameters
    ----------
    plan
        The shots.
    errors
        What they allow (:func:`impasto.capture.expected_errors`).
    """
    travel, listed = np.degrees([plan.travel, plan.travel_as_listed])
    return contact_sheet(
        [_views(plan), _joints(plan), errors_panel(None, errors)],
        title="Shots of a ball-joint rig",
        subtitle=f"{len(plan.pairs)} pairs, {len(plan.shots) - len(plan.pairs)} reference poses; "
        f"travel {travel:.0f} degrees, {listed:.0f} as listed; "
        f"moves of the lamp: {plan.lamp_changes}",
        columns=3,
        width=_SIZE,
    )


def _views(plan: BallJointPlan) -> Panel:
    import cv2

    picture = np.full((_SIZE, _SIZE, 3), GROUND, dtype=np.uint8)
    middle, scale = _SIZE / 2, 0.5 * _SIZE / _MOST
    for ring in _RINGS:
        cv2.circle(picture, (round(middle),) * 2, round(ring * scale), LINE, 1, cv2.LINE_AA)
        place = (round(middle) + 5, round(middle - ring * scale) + 15)
        draw_text(picture, f"{ring}°", place, 13, FAINT)
    lights, views = (np.array([getattr(s, key) for s in plan.pairs]) for key in ("light", "view"))
    places = from_mirror(lights, views)
    incidence = np.degrees(np.arccos(np.clip(lights[:, 2], -1.0, 1.0)))
    colours = colour_ramp()[np.clip(incidence / 75.0 * 255.0, 60, 255).astype(int)]
    for (right, up), colour in zip(places.tolist(), colours.tolist(), strict=True):
        at = np.rint(16.0 * np.array([middle + right * scale, middle - up * scale])).astype(int)
        cv2.circle(picture, (int(at[0]), int(at[1])), 48, colour, -1, cv2.LINE_AA, 4)
    note = "right: away from the lamp; bright: it is low"
    return Panel("Camera from the mirror direction", picture, note)


def _joints(plan: BallJointPlan) -> Panel:
    degrees = np.degrees([shot.setting.angles for shot in plan.shots])
    number = np.arange(len(degrees))
    series = [
        Series(name, np.stack([number, degrees[:, joint]], axis=1), colour)
        for joint, (name, colour) in enumerate(
            (("pan", AMBER), ("tilt", GREEN), ("roll", BLUE), ("camera", RED))
        )
    ]
    return diagram_panel(
        series, "Angles in order, degrees", x=(0.0, max(len(degrees) - 1.0, 1.0)),
        y=(-180.0, 180.0), axis=("first shot", f"shot {len(degrees)}"), size=(_SIZE, _SIZE),
    )  # fmt: skip
