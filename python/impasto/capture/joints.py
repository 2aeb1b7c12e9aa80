"""Whether a stage can take the poses of a plan, before the first photograph."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impasto.capture.ball_joint import JOINTS, in_plane, rotation
from impasto.capture.devices import Pose, Stage, Vector
from impasto.capture.shots import Shot, ShotPlan, unit_vector
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]

SAME = math.radians(0.1)
"""Between a direction of the plan and that of its joints: the limit of :func:`wrong_pose`, too."""


def check_stage(plan: ShotPlan, stage: Stage) -> None:
    """Refuse a plan that says what means nothing to a stage, or not all that it has to know.

    Of a ball joint, directions that a shot states are compared with those of its angles.

    Raises
    ------
    ArgumentError
        A joint that the stage does not have, one without an angle, a direction that contradicts
        the angles; with the shot.
    """
    known = stage.joints
    if strange := [name for name in plan.joints() if name not in known]:
        shot = next(one for one in plan if strange[0] in one.pose.angles)
        has = f"only {', '.join(known)}" if known else "none: it does not move"
        raise ArgumentError(
            f"stage: the plan sets the joints {', '.join(strange)} (first in shot {shot.name!r}), "
            f"but this stage has {has}; give the stage of the plan, or leave these angles out"
        )
    for shot in plan:
        if shot.kind == "dark" and not shot.pose.angles:
            continue
        if lacking := [name for name in known if name not in shot.pose.angles]:
            raise ArgumentError(
                f"stage: shot {shot.name!r} has no angle of the joint {lacking[0]}, which this "
                f"stage sets; write angles with {', '.join(known)} in the plan"
            )
        if set(known) == set(JOINTS) and shot.lamp is not None:
            _check_directions(plan, shot)


def directions_of(pose: Pose, lamp: Floats) -> tuple[Vector, Vector]:
    """Of a ball-joint rig: to lamp and camera in the frame of the painting.

    Parameters
    ----------
    pose
        With the angles pan, tilt, roll and camera.
    lamp
        ``(3,)`` unit vector to the lamp in the frame of the room.
    """
    pan, tilt, roll, camera = (pose.angles[name] for name in JOINTS)
    turn = rotation(pan, tilt, roll)
    return unit_vector(turn.T @ lamp), unit_vector(turn.T @ in_plane(camera))


def _check_directions(plan: ShotPlan, shot: Shot) -> None:
    assert shot.lamp is not None
    found = directions_of(shot.pose, plan.directions[shot.lamp - 1])
    for name, own, stated in zip(
        ("light", "view"), found, (shot.pose.light, shot.pose.view), strict=True
    ):
        if stated is None:
            raise ArgumentError(
                f"stage: shot {shot.name!r} has angles, but no {name}, the direction that they "
                f"give in the frame of the painting: {', '.join(f'{x:.4f}' for x in own)}"
            )
        off = 2.0 * math.asin(min(1.0, float(np.linalg.norm(np.subtract(own, stated))) / 2.0))
        if off > SAME:
            raise ArgumentError(
                f"stage: {name} of shot {shot.name!r} is {math.degrees(off):.2f} degrees off the "
                "direction that its angles give; write the plan by impasto capture ball-joint, or "
                "correct one of them"
            )
