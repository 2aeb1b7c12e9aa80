"""The ball-joint rig of the third paper [@snel]: kinematics of a painting that turns, both ways.

The painting hangs on a ball joint; camera and lamp stay in a horizontal plane through its middle
(figure 5). Three rotations of the joint and the angle of the camera bring any pair of light and
view, as the painting sees it, into that plane: the angle between camera and lamp must be that
between view and light, on the left or on the right of the lamp, and one rotation then turns the
pair into place. Its angles are pan about the vertical, tilt about the horizontal axis, roll about
the normal of the painting (intrinsic y-x-z angles).

At rest, the axes of the painting (x right, y up, z to the viewer) are those of the room. Angles of
lamps and camera are from z to x.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import is_whole, number, numbers
from impasto.errors import ArgumentError, GeometryError

Floats = NDArray[np.float64]
Range = tuple[float, float]

JOINTS = ("pan", "tilt", "roll", "camera")
ROUNDING = 1e-9
"""Radians beyond a limit that are a rounding error."""
ALONG = 1e-7
"""Sine of the angle between light and view below which they are one direction."""
STEPS = 60
STEP = 1e-6
"""Of difference quotients, radians."""
DAMPING = 1e-9


def _degrees(low: float, high: float) -> Range:
    return math.radians(low), math.radians(high)


@dataclass(frozen=True)
class Setting:
    """How a ball-joint rig stands: angles in radians, and the number of the lamp's place."""

    pan: float
    tilt: float
    roll: float
    camera: float
    lamp: int

    @property
    def angles(self) -> Floats:
        """``(4,)``: pan, tilt, roll and camera."""
        return np.array([self.pan, self.tilt, self.roll, self.camera])


@dataclass(frozen=True)
class BallJointRig:
    """What a ball-joint rig can do; the paper names none of these numbers.

    Parameters
    ----------
    lamps
        Angles of the places of the lamp, radians. Default: -45, 0 and 45 degrees.
    pan, tilt, roll, camera
        Lowest and highest angle of each joint and of the camera, radians. Default: 75, 60, 180 and
        100 degrees to either side.
    separation
        Least angle between camera and lamp, radians: nearer, one stands in the light of the other.
        Default: 5 degrees.
    """

    lamps: tuple[float, ...] = field(default_factory=lambda: tuple(np.radians([-45.0, 0.0, 45.0])))
    pan: Range = field(default_factory=lambda: _degrees(-75, 75))
    tilt: Range = field(default_factory=lambda: _degrees(-60, 60))
    roll: Range = field(default_factory=lambda: _degrees(-180, 180))
    camera: Range = field(default_factory=lambda: _degrees(-100, 100))
    separation: float = math.radians(5.0)

    def __post_init__(self) -> None:
        if not self.lamps:
            raise ArgumentError("lamps: expected one place of the lamp or more, found none")
        for index, lamp in enumerate(self.lamps):
            _angle(lamp, f"lamps[{index}]")
        for name in JOINTS:
            low, high = (_angle(limit, name) for limit in getattr(self, name))
            if not low < high:
                raise ArgumentError(
                    f"{name}: expected a lowest angle below the highest, found {low:g}, {high:g}"
                )
        if not 0.0 <= number(self.separation, "separation", "an angle in radians") < math.pi:
            raise ArgumentError(f"separation: expected 0 to pi radians, found {self.separation:g}")

    @property
    def limits(self) -> Floats:
        """``(4, 2)``: lowest and highest pan, tilt, roll and angle of the camera."""
        return np.array([getattr(self, name) for name in JOINTS])

    def directions(self, setting: Setting) -> tuple[Floats, Floats]:
        """Forward kinematics: unit vectors ``(3,)`` to lamp and camera in the painting's frame."""
        if not (is_whole(setting.lamp) and 0 <= setting.lamp < len(self.lamps)):
            raise ArgumentError(
                f"lamp: expected 0 to {len(self.lamps) - 1}, found {setting.lamp!r}"
            )
        turn = rotation(setting.pan, setting.tilt, setting.roll)
        return turn.T @ in_plane(self.lamps[setting.lamp]), turn.T @ in_plane(setting.camera)

    def settings(self, light: ArrayLike, view: ArrayLike) -> list[Setting]:
        """Inverse kinematics: all settings for a pair, two for each place of the lamp.

        Parameters
        ----------
        light, view
            ``(3,)`` directions to lamp and camera in the frame of the painting, in front of it.

        Returns
        -------
        list
            Those within the limits, the one nearest to rest first. Where light and view are one
            direction the painting may turn about it: then the setting without roll.

        Raises
        ------
        ArgumentError
            No directions in front of the painting.
        GeometryError
            None is within the limits; the message names the nearest setting that is.
        """
        own, other = _in_front(light, "light"), _in_front(view, "view")
        found = [one for one in self._all(own, other) if not self._beyond(one)]
        if not found:
            near, off = self.nearest(own, other)
            why = self._beyond(next(iter(self._closest(own, other))))
            said = ", ".join(
                f"{name} {math.degrees(angle):.1f}"
                for name, angle in zip(JOINTS, near.angles.tolist(), strict=True)
            )
            raise GeometryError(
                f"light {_said(own)} and view {_said(other)} cannot be reached: {why}; nearest is "
                f"{said}, lamp at {math.degrees(self.lamps[near.lamp]):.1f} degrees, where they "
                f"are up to {math.degrees(off):.1f} degrees off"
            )
        return sorted(found, key=lambda one: float(np.abs(one.angles[:3]).max()))

    def nearest(self, light: ArrayLike, view: ArrayLike) -> tuple[Setting, float]:
        """The setting within the limits whose directions are nearest to a pair.

        Least squares of the chords to both directions, by Levenberg-Marquardt steps
        [@levenberg1944; @marquardt1963] that are projected to the limits, from each way to reach
        the pair without limits.

        Returns
        -------
        tuple
            The setting, and the larger of the angles by which light and view are off, radians.
        """
        own, other = _in_front(light, "light"), _in_front(view, "view")
        target = np.concatenate([own, other])
        best: tuple[float, Setting] | None = None
        for start in self._all(own, other):
            for low, high in self._sides(start.lamp):
                limits = self.limits
                limits[3] = low, high
                angles = self._projected(start, target, limits)
                setting = _setting(angles, start.lamp)
                cost = float(np.square(self._chords(setting, target)).sum())
                if best is None or cost < best[0] - 1e-12:
                    best = cost, setting
        if best is None:
            raise GeometryError("camera: no angle is far enough from any place of the lamp")
        chords = self._chords(best[1], target).reshape(2, 3)
        off = 2.0 * np.arcsin(np.minimum(np.linalg.norm(chords, axis=1) / 2.0, 1.0))
        return best[1], float(off.max())

    def _all(self, light: Floats, view: Floats) -> Iterator[Setting]:
        """Every setting for unit vectors, whatever the limits."""
        between = math.atan2(float(np.linalg.norm(np.cross(light, view))), float(light @ view))
        for lamp, angle in enumerate(self.lamps):
            if math.sin(between) < ALONG:
                tilt = math.atan2(light[1], light[2])
                ahead = light[1] * math.sin(tilt) + light[2] * math.cos(tilt)
                pan = angle - math.atan2(float(light[0]), float(ahead))
                yield Setting(_wrapped(pan), tilt, 0.0, angle, lamp)
                continue
            for side in (1.0, -1.0):
                camera = angle + side * between
                # The painting turns so that the pair lies in the plane, in this order.
                here = _frame(light, view)
                there = _frame(in_plane(angle), in_plane(camera))
                pan, tilt, roll = joint_angles(there @ here.T)
                yield Setting(pan, tilt, roll, _wrapped(camera), lamp)

    def _closest(self, light: Floats, view: Floats) -> list[Setting]:
        """All settings, the one that is least beyond the limits first."""
        low, high = self.limits.T

        def excess(one: Setting) -> float:
            return float(np.maximum(low - one.angles, one.angles - high).max())

        return sorted(self._all(light, view), key=excess)

    def _beyond(self, setting: Setting) -> str:
        """Which limit a setting breaks; empty for none."""
        low, high = self.limits.T
        angles = setting.angles
        for name, angle, least, most in zip(JOINTS, angles, low, high, strict=True):
            if not least - ROUNDING <= angle <= most + ROUNDING:
                limits = f"{math.degrees(least):.1f} to {math.degrees(most):.1f}"
                return f"{name} would be {math.degrees(angle):.1f}, its limits are {limits} degrees"
        apart = abs(setting.camera - self.lamps[setting.lamp])
        if apart < self.separation - ROUNDING:
            return (
                f"camera and lamp would be {math.degrees(apart):.1f} degrees apart, the least is "
                f"{math.degrees(self.separation):.1f}"
            )
        return ""

    def _sides(self, lamp: int) -> list[Range]:
        """Angles of the camera on the left and on the right of a lamp."""
        low, high = self.camera
        angle = self.lamps[lamp]
        sides = (low, min(high, angle - self.separation)), (max(low, angle + self.separation), high)
        return [side for side in sides if side[0] <= side[1]]

    def _chords(self, setting: Setting, target: Floats) -> Floats:
        """``(6,)``: directions of a setting less those of a pair."""
        return np.concatenate(self.directions(setting)) - target

    def _projected(self, start: Setting, target: Floats, limits: Floats) -> Floats:
        """``(4,)`` angles within limits where the chords are least."""
        low, high = limits.T
        angles = np.clip(start.angles, low, high)

        def chords(at: Floats) -> Floats:
            return self._chords(_setting(at, start.lamp), target)

        damping, left = DAMPING, chords(angles)
        for _ in range(STEPS):
            small = STEP * np.eye(4)
            changes = [chords(angles + one) - chords(angles - one) for one in small]
            slopes = np.stack(changes, axis=1) / (2.0 * STEP)
            gradient = slopes.T @ left
            # A joint that stands at its limit, and would leave it, is held there.
            free = ~(((angles <= low) & (gradient > 0)) | ((angles >= high) & (gradient < 0)))
            if not free.any():
                break
            own = slopes[:, free]
            matrix = own.T @ own + damping * np.eye(int(free.sum()))
            moved = angles.copy()
            moved[free] -= np.linalg.solve(matrix, gradient[free])
            moved = np.clip(moved, low, high)
            now = chords(moved)
            if now @ now < left @ left:
                done = float(np.abs(moved - angles).max()) < 1e-12
                angles, left, damping = moved, now, max(damping / 10.0, DAMPING)
                if done:
                    break
            else:
                damping *= 100.0
                if damping > 1e8:
                    break
        return np.asarray(angles)


def _setting(angles: Floats, lamp: int) -> Setting:
    pan, tilt, roll, camera = angles.tolist()
    return Setting(pan, tilt, roll, camera, lamp)


def rotation(pan: float, tilt: float, roll: float) -> Floats:
    """``(3, 3)``: from the frame of the painting to the room, for angles in radians."""
    (sp, st, sr), (cp, ct, cr) = np.sin([pan, tilt, roll]), np.cos([pan, tilt, roll])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, ct, -st], [0.0, st, ct]])
    about_z = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_y @ about_x @ about_z)


def joint_angles(turn: Floats) -> tuple[float, float, float]:
    """Pan, tilt (-pi/2 to pi/2) and roll of a rotation ``(3, 3)``; without roll at either pole."""
    x, y, z = turn[:, 2].tolist()
    tilt = math.atan2(-y, math.hypot(x, z))
    if math.hypot(x, z) < ALONG:
        return math.atan2(-turn[2, 0], turn[0, 0]), tilt, 0.0
    return math.atan2(x, z), tilt, math.atan2(turn[1, 0], turn[1, 1])


def in_plane(angle: float) -> Floats:
    """``(3,)`` the direction of an angle in the horizontal plane."""
    return np.array([math.sin(angle), 0.0, math.cos(angle)])


def _frame(first: Floats, second: Floats) -> Floats:
    """``(3, 3)`` orthonormal columns: the first direction, across both, and across these."""
    across = np.cross(first, second)
    across = across / np.linalg.norm(across)
    return np.stack([first, across, np.cross(first, across)], axis=1)


def _wrapped(angle: float) -> float:
    """-pi to pi."""
    return math.remainder(angle, 2.0 * math.pi)


def _angle(value: float, name: str) -> float:
    found = number(value, name, "an angle in radians")
    if not abs(found) <= math.pi + ROUNDING:
        raise ArgumentError(
            f"{name}: expected -pi to pi radians, found {value!r}; math.radians converts degrees"
        )
    return found


def _in_front(direction: ArrayLike, name: str) -> Floats:
    vector = numbers(direction, name, "a direction (x, y, z)")
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not (math.isfinite(length) and length > 1e-6):
        raise ArgumentError(f"{name}: expected a direction (x, y, z), found {direction!r}")
    if vector[2] <= 0.0:
        raise ArgumentError(
            f"{name}: {_said(vector)} lies behind the painting (z <= 0), where nothing is seen"
        )
    return np.asarray(vector / length)


def _said(vector: Floats) -> str:
    return "({:.3f}, {:.3f}, {:.3f})".format(*vector.tolist())
