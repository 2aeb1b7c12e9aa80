"""A museum gallery as light: a room of plain surfaces, computed, not photographed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impasto._internal.panorama import of_colour, panorama

LEFT, RIGHT, FLOOR, CEILING, BACK = -4.0, 5.0, -1.6, 3.0, 9.0
"""The room in metres from the middle of the painting, which hangs on the wall z = 0."""

WALL = (0.20, 0.19, 0.18)
PARQUET = (0.085, 0.055, 0.035)
PLASTER = (0.34, 0.34, 0.33)
LAYLIGHT = (1.9, 1.95, 2.0)
WINDOW = (5.0, 6.0, 7.4)
FRAME = (0.06, 0.05, 0.045)
PICTURES = (0.05, 0.045, 0.04)
DOORWAY = (0.025, 0.022, 0.02)
SPOT = (420.0, 330.0, 225.0)
"""Radiance in linear RGB: only ratios matter."""

SPOTS = ((-1.25, 2.75, 2.6), (1.55, 2.75, 2.3))
"""Lamps on a track below the ceiling, m."""
SPOT_RADIUS = np.radians(1.15)
"""Their angular radius; beyond it the reflector's rim is dim."""


@lru_cache(maxsize=1)
def gallery() -> NDArray[np.float32]:
    """Radiance ``(3, 256, 512)`` over longitude and latitude, for :class:`impasto.Environment`.

    A luminous ceiling, a window with bars on the painting's left, a doorway and dark pictures on
    the wall opposite, two warm track spots. Scaled so that a white board on the wall has Y = 1.
    """
    return panorama(_radiance, WALL)


def _radiance(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What a ray from the middle of the painting meets: the nearest of five planes."""
    with np.errstate(divide="ignore", invalid="ignore"):
        side = np.where(x < 0.0, LEFT, RIGHT) / x
        level = np.where(y < 0.0, FLOOR, CEILING) / y
        back = np.where(z > 0.0, BACK / z, np.inf)
    distance = np.minimum(np.minimum(side, level), back)
    px, py, pz = distance * x, distance * y, distance * z
    # Surfaces are darker towards the corners, where less light reaches them.
    corner = np.clip(np.minimum(py - FLOOR, CEILING - py) / 1.2, 0.0, 1.0)
    light = of_colour(WALL) * (0.7 + 0.3 * corner)
    on_floor, on_ceiling = (level <= distance) & (y < 0.0), (level <= distance) & (y > 0.0)
    boards = 0.9 + 0.1 * np.sin(2.0 * np.pi * px / 0.14) ** 2
    light = np.where(on_floor, of_colour(PARQUET) * boards, light)
    light = np.where(on_ceiling, of_colour(PLASTER), light)
    glass = on_ceiling & (np.abs(px - 0.4) < 2.6) & (pz > 2.2) & (pz < 7.6)
    bars = (np.abs((pz - 2.2) % 1.35) < 0.06) | (np.abs((px + 2.2) % 1.3) < 0.06)
    light = np.where(glass, np.where(bars, of_colour(FRAME), of_colour(LAYLIGHT)), light)
    on_left = (side <= np.minimum(level, back)) & (x < 0.0)
    opening = on_left & (pz > 2.0) & (pz < 4.4) & (py > -0.7) & (py < 2.3)
    panes = (np.abs((pz - 2.0) % 0.8) < 0.05) | (np.abs((py + 0.7) % 1.0) < 0.05)
    # Brighter above, where the sky is.
    sky = of_colour(WINDOW) * (0.55 + 0.45 * np.clip((py + 0.7) / 3.0, 0.0, 1.0))
    light = np.where(opening, np.where(panes, of_colour(FRAME), sky), light)
    opposite = (back <= np.minimum(level, side)) & (z > 0.0)
    door = opposite & (np.abs(px - 0.6) < 0.8) & (py < 0.9)
    hung = opposite & (np.abs(py) < 0.6) & (np.abs(np.abs(px - 0.6) - 2.4) < 0.8)
    light = np.where(hung, of_colour(PICTURES), light)
    light = np.where(door, of_colour(DOORWAY), light)
    for place in SPOTS:
        direction = np.array(place) / np.linalg.norm(place)
        cosine = np.clip(x * direction[0] + y * direction[1] + z * direction[2], -1.0, 1.0)
        inside = cosine > np.cos(SPOT_RADIUS)
        light = np.where(inside, of_colour(SPOT), light)
    return np.ascontiguousarray(light)
