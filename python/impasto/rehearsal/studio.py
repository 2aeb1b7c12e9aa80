"""A studio in numbers: a camera with a lens above a plane, lamps near it, and what lies there.

Frame of the painting: mm from its middle, x right, y up, z towards the camera. The photographs are
made by inverse mapping: each pixel looks along its ray, which OpenCV frees from the distortion of
the lens, and sees what is where the ray meets the plane or a ball.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Reflectances: TypeAlias = Callable[[Floats, Floats], Floats]
"""Reflectance ``(band, y, x)`` of what lies at x and y ``(y, x)`` in mm."""

BETWEEN = 2
"""Rays per pixel along each axis."""


@dataclass(frozen=True)
class StudioCamera:
    """A pinhole camera with Brown's distortion that looks at the middle of the plane.

    Parameters
    ----------
    size
        Rows and columns of its photographs.
    focal_px
        Focal length in pixels.
    distance_mm
        From the middle of the plane.
    tilt, azimuth, roll
        Radians between its axis and the normal of the plane, towards which side (0: right), and
        about its axis.
    distortion
        k1, k2, p1 and p2.
    """

    size: tuple[int, int]
    focal_px: float
    distance_mm: float
    tilt: float = 0.0
    azimuth: float = 0.0
    roll: float = 0.0
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def matrix(self) -> Floats:
        """``(3, 3)``: from directions to pixels."""
        return _matrix(self.size, self.focal_px)

    @property
    def axes(self) -> Floats:
        """``(3, 3)``: right, down and forward of the camera as rows."""
        sine = np.sin(self.tilt)
        back = np.array(
            [sine * np.cos(self.azimuth), sine * np.sin(self.azimuth), np.cos(self.tilt)]
        )
        up = np.array([0.0, 1.0, 0.0]) - back[1] * back
        up /= np.linalg.norm(up)
        right = np.cross(up, back)
        cosine, sine = np.cos(self.roll), np.sin(self.roll)
        return np.stack([cosine * right + sine * up, sine * right - cosine * up, -back])

    @property
    def place(self) -> Floats:
        """``(3,)``: where it stands, in mm."""
        return np.asarray(-self.distance_mm * self.axes[2])

    def rays(self) -> list[Floats]:
        """Directions ``(3, y, x)``, one array for each ray of a pixel."""
        offsets = (np.arange(BETWEEN) + 0.5) / BETWEEN - 0.5
        return [self._directions(across, down) for down in offsets for across in offsets]

    def _directions(self, across: float, down: float) -> Floats:
        seen = _behind_the_lens(self.size, self.focal_px, self.distortion, across, down)
        found: Floats = (self.axes.T @ seen).reshape(3, *self.size)
        return found

    def pixels(self, points: Floats) -> Floats:
        """``(n, 2)`` columns and rows that show points ``(n, 3)`` in mm."""
        seen = (np.asarray(points, np.float64) - self.place) @ self.axes.T
        still, lens = np.zeros(3), np.asarray(self.distortion)
        found, _ = cv2.projectPoints(seen, still, still, self.matrix, lens)
        return np.asarray(found[:, 0], np.float64)

    def dimming(self) -> Floats:
        """``(y, x)``: the fourth power of the cosine off the axis, of a simple lens."""
        directions = self._directions(0.0, 0.0)
        cosine = (self.axes[2] @ directions.reshape(3, -1)).reshape(self.size)
        return np.asarray((cosine / np.linalg.norm(directions, axis=0)) ** 4)


def _matrix(size: tuple[int, int], focal_px: float) -> Floats:
    rows, columns = size
    middle = ((columns - 1) / 2, (rows - 1) / 2)
    return np.array([[focal_px, 0, middle[0]], [0, focal_px, middle[1]], [0, 0, 1]])


@lru_cache(maxsize=BETWEEN**2 + 1)
def _behind_the_lens(
    size: tuple[int, int],
    focal_px: float,
    distortion: tuple[float, float, float, float],
    across: float,
    down: float,
) -> Floats:
    """``(3, pixels)``: directions in the frame of the camera, the same wherever it stands.

    ``across`` and ``down``: from the middle of each pixel.
    """
    rows, columns = np.mgrid[: size[0], : size[1]].astype(np.float64)
    points = np.stack([columns + across, rows + down], axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(points, _matrix(size, focal_px), np.asarray(distortion))[:, 0].T
    found: Floats = np.concatenate([ideal, np.ones((1, ideal.shape[1]))])
    found.flags.writeable = False
    return found


@dataclass(frozen=True)
class MirrorBall:
    """A mirror ball on the plane: its middle's x and y and its radius in mm."""

    x: float
    y: float
    radius: float

    def seen(self, place: Floats, rays: Floats, lamp: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """Which rays meet it, and what light ``(y, x)`` they see: a lamp 2 degrees wide, blurred.

        The rest of the room is dark.
        """
        unit = rays / np.linalg.norm(rays, axis=0)
        middle = np.array([self.x, self.y, self.radius])
        towards = middle - place
        along = np.tensordot(towards, unit, 1)
        inside = along**2 - towards @ towards + self.radius**2
        hit = inside > 0.0
        there = along[hit] - np.sqrt(inside[hit])
        point = place[:, None] + there * unit[:, hit]
        normal = (point - middle[:, None]) / self.radius
        seen = unit[:, hit]
        mirrored = seen - 2.0 * (seen * normal).sum(axis=0) * normal
        to_lamp = lamp[:, None] - point
        to_lamp /= np.linalg.norm(to_lamp, axis=0)
        sine = np.linalg.norm(np.cross(mirrored, to_lamp, axis=0), axis=0)
        facing = (mirrored * to_lamp).sum(axis=0) > 0.0
        light = np.zeros(hit.shape)
        light[hit] = DARK + np.where(facing, LAMP * np.exp(-0.5 * (sine / SPREAD) ** 2), 0.0)
        return hit, light


DARK, LAMP, SPREAD = 0.01, 30.0, np.radians(1.0)
"""Light of a mirrored room and of a mirrored lamp, whose edge is soft (radians)."""


@dataclass(frozen=True)
class Lamp:
    """A lamp near the plane: position ``(3,)`` in mm and irradiance at the middle, facing it."""

    position: Floats
    strength: float

    def irradiance(self, x: Floats, y: Floats) -> Floats:
        """Of the plane, with the cosine of incidence and the inverse square of the distance."""
        far = np.linalg.norm(self.position)
        across, up, high = self.position
        distance = np.sqrt((across - x) ** 2 + (up - y) ** 2 + high**2)
        return np.asarray(self.strength * (far / distance) ** 2 * high / distance)


class Surface(Protocol):
    """What rays meet in place of the plane."""

    def met(self, place: Floats, rays: Floats) -> tuple[Floats, Floats]:
        """Places x and y ``(y, x)`` in mm where rays ``(3, y, x)`` from a place meet it."""
        ...


class Studio:
    """A camera above a plane, or above a painting whose relief it sees askew."""

    def __init__(self, camera: StudioCamera, relief: Surface | None = None) -> None:
        self.camera, self.relief = camera, relief

    @cached_property
    def _seen(self) -> list[tuple[Floats, Floats, Floats]]:
        """Rays, and where they meet the plane or the relief."""
        place = self.camera.place
        found = []
        for rays in self.camera.rays():
            if self.relief is not None:
                found.append((rays, *self.relief.met(place, rays)))
                continue
            reach = -place[2] / rays[2]
            found.append((rays, place[0] + reach * rays[0], place[1] + reach * rays[1]))
        return found

    @cached_property
    def _dimming(self) -> Floats:
        return self.camera.dimming()

    def light(
        self,
        lamp: Lamp,
        matte: Reflectances,
        *,
        glossy: Reflectances | None = None,
        balls: tuple[MirrorBall, ...] = (),
    ) -> Floats:
        """What the sensor receives, ``(band, y, x)``.

        Parameters
        ----------
        matte
            What lies on the plane and reflects alike into all directions.
        glossy
            Light, not reflectance, of what lies there besides; NaN where it does not.
        balls
            On the plane.
        """
        total: Floats | None = None
        for rays, x, y in self._seen:
            light = lamp.irradiance(x, y) * matte(x, y)
            if glossy is not None:
                own = glossy(x, y)
                light = np.where(np.isnan(own), light, lamp.strength * own)
            for ball in balls:
                hit, mirrored = ball.seen(self.camera.place, rays, lamp.position)
                light = np.where(hit, lamp.strength * mirrored, light)
            total = light if total is None else total + light
        assert total is not None
        return total * self._dimming / len(self._seen)
