"""Lamps: distant ones, of which only a direction counts, and near ones with a place.

World frame: origin in the middle of the painting, x right, y up, z towards the viewer,
millimetres. Directions have unit length and point away from the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from impasto._internal.checks import FARTHEST_MM, LEAST, MOST, number, positive, three_numbers
from impasto.errors import ArgumentError, GeometryError

_NEAREST_MM = 1e-6
"""A light that is nearer lies on the painting."""
ROUNDED = 8 * float(np.finfo(np.float64).eps)
"""Vectors whose lengths differ from 1 by less are unit vectors. Dividing once more would change
last bits, and a rig that is saved and loaded must not change."""


@dataclass(frozen=True, slots=True)
class DistantLight:
    """A light so far away that every pixel sees it from the same direction.

    Parameters
    ----------
    direction
        (x, y, z) from the surface to the light; normalised on entry.
    intensity
        Irradiance at normal incidence relative to the light under which a white board reads 1.0.
    radius
        Angular radius in radians of a lamp with a size, at most pi/4: in pictures its shadows are
        soft and its highlights as wide as it is. Fits take every light for a point. Default: 0.
    """

    direction: tuple[float, float, float]
    intensity: float = 1.0
    radius: float = 0.0

    @classmethod
    def from_angles(cls, azimuth: float, elevation: float, intensity: float = 1.0) -> DistantLight:
        """A light by its angles in radians.

        Parameters
        ----------
        azimuth
            0 is right, pi/2 up, pi left, 3 pi/2 (or -pi/2) down.
        elevation
            0 grazes the painting, pi/2 stands straight in front of it.
        intensity
            As in the class.

        Raises
        ------
        ArgumentError
            No finite number, or an elevation beyond pi/2: degrees, as a rule.

        Examples
        --------
        >>> from math import radians
        >>> from impasto import DistantLight
        >>> light = DistantLight.from_angles(radians(90), radians(45))  # from above
        """
        angles = []
        for name, angle in (("azimuth", azimuth), ("elevation", elevation)):
            radians = number(angle, name, "an angle in radians")
            if not math.isfinite(radians):
                raise ArgumentError(f"{name}: expected an angle in radians, found {radians:g}")
            angles.append(radians)
        around, up = angles
        for name, angle, most in (("azimuth", around, 2 * math.pi), ("elevation", up, math.pi / 2)):
            # A rounding error beyond the limit is accepted.
            if abs(angle) > most + 1e-6:
                raise ArgumentError(
                    f"{name}: expected radians of at most {most:.4g}, found {angle:g}; "
                    "math.radians converts degrees"
                )
        across = math.cos(up)
        return cls((across * math.cos(around), across * math.sin(around), math.sin(up)), intensity)

    def __post_init__(self) -> None:
        vector = three_numbers(self.direction, "direction")
        length = math.hypot(*vector)
        if length < 1e-6:
            raise GeometryError(
                f"direction: a light direction needs a length above 0, found {self.direction}"
            )
        if abs(length - 1.0) >= ROUNDED:
            vector = [along / length for along in vector]
        object.__setattr__(self, "direction", tuple(vector))
        _check_intensity(self.intensity)
        _check_radius(self.radius, math.pi / 4, "radians, at most pi/4")


@dataclass(frozen=True, slots=True)
class PointLight:
    """A light near the painting: its direction differs from pixel to pixel.

    Parameters
    ----------
    position
        (x, y, z) in mm, origin in the middle of the painting.
    intensity
        Irradiance at the origin, at normal incidence, relative to a white board reading 1.0.
    falloff
        Whether the samples still carry the 1/r^2 fall-off. False after flat-fielding by a white
        board (eq. 3 of the RGB-camera paper), which cancels it.
    radius
        Radius in mm of a lamp with a size, at most half its distance: a disc that faces the middle
        of the painting; see :class:`DistantLight`. Default: 0.
    """

    position: tuple[float, float, float]
    intensity: float = 1.0
    falloff: bool = True
    radius: float = 0.0

    def __post_init__(self) -> None:
        vector = three_numbers(self.position, "position")
        far = math.hypot(*vector)
        if far < _NEAREST_MM:
            raise GeometryError(
                f"position: a point light cannot be on the painting, found {self.position}"
            )
        object.__setattr__(self, "position", tuple(vector))
        _check_intensity(self.intensity)
        _check_radius(self.radius, far / 2, f"mm, at most half the distance of {far:g} mm")

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit direction from the middle of the painting."""
        x, y, z = self.position
        length = float(np.linalg.norm(self.position))
        return (x / length, y / length, z / length)

    def seen_from(self, x: float, y: float) -> PointLight:
        """The same light where ``(x, y, 0)`` is the origin: the middle of a part of the painting.

        Its intensity is the irradiance there.
        """
        right, up, front = self.position
        there = (right - x, up - y, front)
        here, far = math.hypot(*self.position), math.hypot(*there)
        # A lamp that lies there has no distance: refused below, in words.
        ratio = (here / far) ** 2 if self.falloff and far > 0.0 else 1.0
        radius = min(self.radius, far / 2)
        return _point_light(there, far, self.intensity * ratio, self.falloff, radius)


def _point_light(
    position: tuple[float, float, float],
    far: float,
    intensity: float,
    falloff: bool,
    radius: float,
) -> PointLight:
    """A light ``far`` mm away; searches make them by the ten thousand, and checks take longest."""
    if not (_NEAREST_MM <= far <= FARTHEST_MM and LEAST <= intensity <= MOST):
        return PointLight(position, intensity, falloff, radius)  # or what is wrong, in words
    light, set_ = object.__new__(PointLight), object.__setattr__
    set_(light, "position", position)
    set_(light, "intensity", intensity)
    set_(light, "falloff", falloff)
    set_(light, "radius", radius)
    return light


Light: TypeAlias = DistantLight | PointLight


def near_lamp(
    position: tuple[float, float, float], intensity: float, falloff: bool, angular_radius: float
) -> PointLight:
    """A lamp at a place in mm, as large as it seems from the middle of the painting, in radians.

    No near lamp is wider than it is far.
    """
    far = math.hypot(*position)
    radius = min(math.tan(min(angular_radius, math.pi / 4)) * far, far / 2)
    return _point_light(position, far, intensity, falloff, radius)


def _check_radius(radius: Any, largest: float, expected: str) -> None:
    value = number(radius, "radius", expected)
    if not 0.0 <= value <= largest:
        raise GeometryError(f"radius: expected {expected}, found {value:g}")


def _check_intensity(intensity: float) -> None:
    positive(intensity, "intensity", "a positive number")
