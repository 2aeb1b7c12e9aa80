"""The shots of a ball-joint rig: settings for pairs of light and view, in an order of short travel.

The pairs of the third paper [@snel] are those of ``impasto.simulate.rig("snel-lafortune")``: 690
that are packed around the mirror direction (figure 6), 3 degrees apart at least, and 80 for the
normals. Every so many shots, and wherever the lamp has moved, the rig goes to a reference pose: its
photographs show a lamp that drifts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import is_whole, length_mm
from impasto.capture.ball_joint import JOINTS, BallJointRig, Setting, in_plane
from impasto.capture.devices import Pose
from impasto.capture.shots import Shot, ShotPlan, exposed, exposures_of, unit_vector
from impasto.capture.travelling_salesman import length_of, nearest_neighbour, two_opt
from impasto.errors import ArgumentError, GeometryError
from impasto.io import LightFile, write_lights
from impasto.rig import Rig

Floats = NDArray[np.float64]

EVERY = 50
"""Shots between two reference poses."""
LAMP_CHANGE = 2.0 * math.pi
"""What moving the lamp costs: as much as a whole turn of a joint, for a hand moves it."""
CHOICES = 2
"""Settings of a pair that the order may choose from."""
REFERENCE = math.radians(45.0)
"""Angle between lamp and camera in a reference pose: beside the highlight of a flat painting."""


@dataclass(frozen=True, eq=False)
class BallJointShot:
    """One photograph to make.

    Attributes
    ----------
    name
        ``shot_001`` and so on for pairs, ``reference_01`` for reference poses.
    pair
        Number of the pair of light and view; None for a reference pose.
    setting
        How the rig stands.
    light, view
        ``(3,)`` unit vectors in the frame of the painting, from this setting.
    """

    name: str
    pair: int | None
    setting: Setting
    light: Floats
    view: Floats


@dataclass(frozen=True, eq=False)
class BallJointPlan:
    """All shots in their order.

    Attributes
    ----------
    rig
        The mechanism.
    shots
        With the reference poses among them.
    travel
        Radians that the joint or camera that turns farthest turns in all, lamp changes included as
        whole turns; without reference poses.
    travel_as_listed
        The same in the order of the pairs, each in the setting nearest to rest.
    lamp_changes
        How often the lamp is moved.
    """

    rig: BallJointRig
    shots: tuple[BallJointShot, ...]
    travel: float
    travel_as_listed: float
    lamp_changes: int

    @property
    def pairs(self) -> list[BallJointShot]:
        """The shots without the reference poses."""
        return [shot for shot in self.shots if shot.pair is not None]


def plan_ball_joint_shots(
    pairs: Rig, rig: BallJointRig | None = None, *, every: int = EVERY
) -> BallJointPlan:
    """Settings and order for pairs of light and view.

    Parameters
    ----------
    pairs
        Lights and views, such as ``simulate.rig("snel-lafortune")``.
    rig
        The mechanism; default: :class:`BallJointRig`'s.
    every
        Shots between two reference poses; 0: none.

    Raises
    ------
    ArgumentError
        A direction behind the painting, or a number that is none.
    GeometryError
        A pair that the rig cannot reach, with its number and the nearest setting.
    """
    if not is_whole(every) or every < 0:
        raise ArgumentError(f"every: expected a whole number of shots, or 0, found {every!r}")
    rig = BallJointRig() if rig is None else rig
    places: list[Setting] = []
    groups: list[int] = []
    listed: list[int] = []
    for number, (light, view) in enumerate(zip(pairs.directions, pairs.views, strict=True)):
        try:
            found = rig.settings(light, view)[:CHOICES]
        except (ArgumentError, GeometryError) as error:
            raise type(error)(f"pair {number}: {error}") from error
        listed.append(len(places))
        places += found
        groups += [number] * len(found)
    costs, start = _costs(rig, places)
    tour = two_opt(costs, nearest_neighbour(costs, groups, start), start)
    ordered = [(groups[place], places[place]) for place in tour]
    changes = sum(one.lamp != other.lamp for (_, one), (_, other) in pairwise(ordered))
    return BallJointPlan(
        rig, tuple(_with_references(rig, ordered, every)), length_of(costs, tour, start),
        length_of(costs, listed, start), changes,
    )  # fmt: skip


def ball_joint_plan(
    plan: BallJointPlan,
    *,
    exposure_s: float | Sequence[float] = 0.01,
    darks: int = 3,
    distance_mm: float | None = None,
) -> ShotPlan:
    """The shots as :func:`impasto.capture.run` takes them, reference poses among them.

    Lamps are the places of the lamp, in the frame of the room; each shot has the angles of the
    joints ``pan``, ``tilt``, ``roll`` and ``camera``, and the directions to lamp and eye that they
    give in the frame of the painting.

    Parameters
    ----------
    plan
        From :func:`plan_ball_joint_shots`.
    exposure_s
        Exposure time in seconds; several: an exposure bracket of each pair, as for
        :func:`plan_shots`.
    darks
        How many dark frames, at the beginning.
    distance_mm
        From the middle of the painting to the lamp; None: far away.

    Raises
    ------
    ArgumentError
        Numbers that are none.
    """
    if not is_whole(darks) or darks < 0:
        raise ArgumentError(f"darks: expected a whole number from 0 on, found {darks!r}")
    if distance_mm is not None:
        length_mm(distance_mm, "distance_mm")
    exposures = exposures_of(exposure_s)
    shots = [Shot(f"dark_{n:03}", "dark", None, exposures[-1]) for n in range(1, darks + 1)]
    for one in plan.shots:
        angles = dict(zip(JOINTS, one.setting.angles.tolist(), strict=True))
        pose = Pose(unit_vector(one.view), unit_vector(one.light), angles)
        if one.pair is None:
            seconds = exposures[-2:][0]
            shots.append(Shot(one.name, "reference", one.setting.lamp + 1, seconds, pose))
        else:
            shots += exposed(one.name, "photograph", one.setting.lamp + 1, exposures, pose)
    directions = np.array([in_plane(angle) for angle in plan.rig.lamps])
    positions = None if distance_mm is None else distance_mm * directions
    return ShotPlan(tuple(shots), directions, positions)


def write_ball_joint_lights(path: str | Path, plan: BallJointPlan) -> None:
    """Write the light file of the pairs' photographs, for ``impasto align`` and ``impasto fit``."""
    shots = sorted(plan.pairs, key=lambda shot: shot.name)
    lights, views = (np.array([getattr(shot, key) for shot in shots]) for key in ("light", "view"))
    names = tuple(shot.name for shot in shots)
    file = LightFile(Path(path), "csv", names, lights, np.ones(len(shots)), views=views)
    write_lights(path, file)


def reference_setting(rig: BallJointRig, lamp: int) -> Setting:
    """The painting as near to rest as the limits allow, the camera beside a lamp.

    Raises
    ------
    GeometryError
        No angle of the camera is far enough from this lamp.
    """
    low, high = rig.limits.T
    pan, tilt, roll = np.clip(0.0, low[:3], high[:3]).tolist()
    angle = rig.lamps[lamp]
    apart = max(REFERENCE, rig.separation)
    # The side that is nearer to the front.
    for camera in sorted((angle - apart, angle + apart), key=abs):
        if rig.camera[0] <= camera <= rig.camera[1]:
            return Setting(pan, tilt, roll, camera, lamp)
    raise GeometryError(
        f"camera: no angle within its limits is {math.degrees(apart):.0f} degrees from the lamp at "
        f"{math.degrees(angle):.0f}, for a reference pose; give every=0"
    )


def _costs(rig: BallJointRig, places: list[Setting]) -> tuple[Floats, Floats]:
    """Costs from place to place, and from rest: the angle of what turns farthest."""
    angles = np.array([one.angles for one in places])
    lamps = np.array([one.lamp for one in places])
    costs = np.zeros((len(places), len(places)))
    for joint in angles.T:
        np.maximum(costs, np.abs(joint[:, None] - joint[None]), out=costs)
    costs += LAMP_CHANGE * (lamps[:, None] != lamps[None])
    low, high = rig.limits.T
    return costs, np.abs(angles - np.clip(0.0, low, high)).max(axis=1)


def _with_references(
    rig: BallJointRig, ordered: list[tuple[int, Setting]], every: int
) -> list[BallJointShot]:
    shots: list[BallJointShot] = []
    digits = max(3, len(str(len(ordered))))
    since, lamp, references = every, -1, 0

    def refer(place: int) -> None:
        nonlocal references
        references += 1
        own = reference_setting(rig, place)
        shots.append(BallJointShot(f"reference_{references:02}", None, own, *rig.directions(own)))

    for number, (pair, setting) in enumerate(ordered, 1):
        if every and (since >= every or setting.lamp != lamp):
            refer(setting.lamp)
            since = 0
        lamp, since = setting.lamp, since + 1
        shots.append(
            BallJointShot(f"shot_{number:0{digits}}", pair, setting, *rig.directions(setting))
        )
    if every:
        refer(lamp)
    return shots
