"""Rooms and places as light: plain surfaces, computed, not photographed."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impasto._internal.panorama import Planes, of_colour, panorama
from impasto.gallery import gallery

CANDLE = (1.0, 0.46, 0.11)
"""Linear sRGB of a flame, 1900 K, relative to its red."""
FLAMES = (
    (-0.95, 0.35, 0.55), (-0.86, 0.47, 0.62), (-0.77, 0.35, 0.69),
    (0.80, 0.30, 0.60), (0.88, 0.42, 0.54), (0.97, 0.30, 0.48), (0.1, -0.62, 0.9),
)  # fmt: skip
"""Candles in metres from the middle of the painting: two branches and one on a table."""
FLAME_WIDTH, FLAME_HEIGHT = 0.008, 0.02
"""Half axes of a flame in metres."""


def _box(
    x: Planes, y: Planes, z: Planes, room: tuple[float, float, float, float, float]
) -> tuple[NDArray[np.int8], Planes, Planes, Planes]:
    """What a ray meets first, 0 left, 1 right, 2 floor, 3 ceiling, 4 back, and where."""
    left, right, floor, ceiling, back = room
    with np.errstate(divide="ignore", invalid="ignore"):
        side = np.where(x < 0.0, left, right) / x
        level = np.where(y < 0.0, floor, ceiling) / y
        far = np.where(z > 0.0, back / z, np.inf)
    distance = np.minimum(np.minimum(side, level), far)
    which = np.where(
        side <= np.minimum(level, far),
        np.where(x < 0.0, 0, 1),
        np.where(level <= far, np.where(y < 0.0, 2, 3), 4),
    ).astype(np.int8)
    return which, distance * x, distance * y, distance * z


def _skylight(x: Planes, y: Planes, z: Planes) -> Planes:
    """A hall of 12 x 14 m, 7 m high, whose roof is glass on iron bars; pale walls."""
    which, px, py, pz = _box(x, y, z, (-6.0, 6.0, -1.6, 5.4, 14.0))
    light = of_colour((0.22, 0.21, 0.195)) * (0.45 + 0.55 * np.clip((py + 1.6) / 7.0, 0.0, 1.0))
    light = np.where(which == 2, of_colour((0.10, 0.085, 0.07)), light)
    bars = (np.abs((px + 6.0) % 1.0 - 0.5) > 0.46) | (np.abs(pz % 2.0 - 1.0) > 0.95)
    glass = (which == 3) & (np.abs(px) < 4.5) & (pz > 1.5) & (pz < 12.5)
    light = np.where(which == 3, of_colour((0.3, 0.29, 0.27)), light)
    return np.where(
        glass, np.where(bars, of_colour((0.1, 0.1, 0.1)), of_colour((3.1, 3.3, 3.6))), light
    )


def _window(x: Planes, y: Planes, z: Planes) -> Planes:
    """A room of 5 x 6 m with a tall window to the north on the left; walls give back little."""
    which, _, py, pz = _box(x, y, z, (-2.5, 2.5, -1.4, 2.0, 6.0))
    light = of_colour((0.060, 0.058, 0.055)) * (0.6 + 0.4 * np.clip((py + 1.4) / 3.4, 0.0, 1.0))
    light = np.where(which == 2, of_colour((0.05, 0.036, 0.024)), light)
    light = np.where(which == 1, light * 2.2, light)  # it faces the window
    opening = (which == 0) & (np.abs(pz - 1.5) < 0.65) & (py > -0.5) & (py < 1.7)
    panes = (np.abs(pz - 1.5) < 0.03) | (np.abs((py + 0.5) % 0.55 - 0.275) > 0.25)
    sky = of_colour((4.6, 5.4, 6.6)) * (0.6 + 0.4 * np.clip((py + 0.5) / 2.2, 0.0, 1.0))
    return np.where(opening, np.where(panes, of_colour((0.05, 0.045, 0.04)), sky), light)


def _overcast(x: Planes, y: Planes, z: Planes) -> Planes:
    """CIE's standard overcast sky [@cie-overcast], over ground that reflects a fifth.

    Luminance rises from the horizon to three times as much in the zenith. The ground gets 7/9 pi of
    the zenith's luminance.
    """
    sky = (1.0 + 2.0 * np.maximum(y, 0.0)) / 3.0
    light = np.where(y > 0.0, sky, 0.2 * 7.0 / 9.0) + 0.0 * (x + z)
    return of_colour((0.96, 1.0, 1.06)) * light


def _candles(x: Planes, y: Planes, z: Planes) -> Planes:
    """Seven flames in a room whose walls are almost dark; flames are ellipsoids."""
    which, px, py, pz = _box(x, y, z, (-3.0, 3.0, -1.3, 2.2, 5.0))
    lit = np.zeros_like(px)
    for flame in FLAMES:
        lit += 1.0 / (0.4 + (px - flame[0]) ** 2 + (py - flame[1]) ** 2 + (pz - flame[2]) ** 2)
    light = of_colour(CANDLE) * (0.06 * lit * np.where(which == 2, 0.5, 1.0))
    radii = np.array([FLAME_WIDTH, FLAME_HEIGHT, FLAME_WIDTH])
    for flame in FLAMES:
        # A ray from the middle meets an ellipsoid where the scaled ray passes the unit sphere.
        centre = np.array(flame) / radii
        ray = (x / radii[0], y / radii[1], z / radii[2])
        along = sum(one * value for one, value in zip(ray, centre, strict=True))
        square = sum(one * one for one in ray)
        met = (along > 0.0) & (centre @ centre - along * along / square < 1.0)
        light = np.where(met, 2400.0 * of_colour(CANDLE), light)
    return light


@lru_cache(maxsize=1)
def skylight() -> NDArray[np.float32]:
    """A museum hall under a roof of glass."""
    return panorama(_skylight, (0.2, 0.19, 0.18))


@lru_cache(maxsize=1)
def window() -> NDArray[np.float32]:
    """A dark room with one tall window on the painting's left."""
    return panorama(_window, (0.06, 0.058, 0.055))


@lru_cache(maxsize=1)
def overcast() -> NDArray[np.float32]:
    """An overcast sky over open ground."""
    return panorama(_overcast, (0.2, 0.2, 0.2))


@lru_cache(maxsize=1)
def candles() -> NDArray[np.float32]:
    """A dark room with candles on both sides."""
    return panorama(_candles, (0.02, 0.01, 0.003))


ROOMS: dict[str, Callable[[], NDArray[np.float32]]] = {
    "gallery": gallery,
    "skylight": skylight,
    "window": window,
    "overcast": overcast,
    "candles": candles,
}
"""The environments that impasto contains, radiance ``(3, 256, 512)``, by their names."""
LABELS = {
    "gallery": "Gallery",
    "skylight": "Hall under glass",
    "window": "North window",
    "overcast": "Overcast sky",
    "candles": "Candles",
}
"""Their names on a page."""
