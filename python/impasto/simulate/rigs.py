"""The lights of the two papers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impasto.errors import ArgumentError
from impasto.rig import DistantLight, Light, PointLight, Rig

PITCH_MM = 0.2
"""Default width of a simulated pixel."""


def _ring(count: int, elevation: float, start: float = 0.0) -> list[tuple[float, float, float]]:
    azimuth = np.radians(start + 360.0 * np.arange(count) / count)
    high, flat = np.sin(np.radians(elevation)), np.cos(np.radians(elevation))
    return [(float(flat * np.cos(a)), float(flat * np.sin(a)), float(high)) for a in azimuth]


def _rgb_camera() -> list[tuple[float, float, float]]:
    return [(0.0, 0.0, 1.0), *_ring(8, 45.0)]


def _six_band() -> list[tuple[float, float, float]]:
    return [*_ring(8, 45.0), *_ring(8, 67.5, start=22.5)]


RIGS: dict[str, Callable[[], list[tuple[float, float, float]]]] = {
    "tominaga-rgb-camera": _rgb_camera,
    "tominaga-six-band-adaptation": _six_band,
}


def rig(name: str, *, distance_mm: float | None = None, pitch_mm: float = PITCH_MM) -> Rig:
    """The lights of one of the papers, the camera straight above the painting.

    ``"tominaga-rgb-camera"``: 9 lights, first the top one, then 8 at 45 degrees elevation every
    45 degrees, from +x counter-clockwise (Figure 3 of the paper).

    ``"tominaga-six-band-adaptation"``: 16 lights. The paper says only that none is extremely
    raking; here two staggered rings: 8 at 45 degrees every 45, then 8 at 67.5 degrees elevation
    half a step further. The lower ring fixes the normals, the upper one reaches the highlights of
    nearly flat places (their half vectors lean 22.5 and 11.25 degrees).

    Parameters
    ----------
    name
        Which paper.
    distance_mm
        Distance of the lamps from the middle of the painting; None: infinitely far.
    pitch_mm
        Width of a pixel on the painting in mm (needed by near lamps).
    """
    if name not in RIGS:
        raise ArgumentError(f"name: expected one of {sorted(RIGS)}, found {name!r}")
    directions = RIGS[name]()
    lights: list[Light]
    if distance_mm is None:
        lights = [DistantLight(direction) for direction in directions]
    else:
        if not (np.isfinite(distance_mm) and distance_mm > 0):
            raise ArgumentError(f"distance_mm: expected a positive distance, found {distance_mm!r}")
        lights = [
            PointLight((x * distance_mm, y * distance_mm, z * distance_mm))
            for x, y, z in directions
        ]
    return Rig(lights, pitch_mm=pitch_mm)
