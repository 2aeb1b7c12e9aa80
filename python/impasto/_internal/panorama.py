"""A map of radiance over longitude and latitude, computed from what a ray meets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

HEIGHT = 256
"""Rows of the map."""
SAMPLES = 3
"""Rays per texel and axis: edges of windows and of lamps are smooth."""
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Y of linear sRGB."""

Planes = NDArray[np.float64]
Radiance = Callable[[Planes, Planes, Planes], Planes]
"""Linear RGB ``(3, y, x)`` that comes from directions ``x, y, z``."""


def panorama(radiance: Radiance, wall: tuple[float, float, float]) -> NDArray[np.float32]:
    """Radiance ``(3, 256, 512)`` for :class:`impasto.Environment`.

    Parameters
    ----------
    radiance
        What a ray from the middle of the painting meets.
    wall
        Radiance of the wall on which the painting hangs, z <= 0: seen by no pixel unless the room
        is turned.

    Returns
    -------
    Means over texels by solid angle, scaled so that a white board on the wall has Y = 1.
    """
    rows, columns = HEIGHT * SAMPLES, 2 * HEIGHT * SAMPLES
    longitude = (np.arange(columns) + 0.5) / columns * 2.0 * np.pi - np.pi
    latitude = 0.5 * np.pi - (np.arange(rows) + 0.5) / rows * np.pi
    flat, up = np.cos(latitude)[:, None], np.sin(latitude)[:, None]
    x, y, z = -np.sin(longitude) * flat, up + 0.0 * flat * longitude, np.cos(longitude) * flat
    light = radiance(x, y, z)
    light = np.where(z <= 0.0, of_colour(wall), light)
    area = np.broadcast_to(np.abs(flat), z.shape) * (np.pi / rows) * (2.0 * np.pi / columns)
    board = np.sum(light * (np.maximum(z, 0.0) * area), axis=(1, 2))
    light /= np.array(LUMINANCE) @ board
    weighted = (light * area).reshape(3, HEIGHT, SAMPLES, 2 * HEIGHT, SAMPLES).sum(axis=(2, 4))
    areas = area.reshape(HEIGHT, SAMPLES, 2 * HEIGHT, SAMPLES).sum(axis=(1, 3))
    return np.ascontiguousarray(weighted / areas, dtype=np.float32)


def of_colour(colour: tuple[float, float, float]) -> Planes:
    """A colour as planes ``(3, 1, 1)``."""
    return np.array(colour)[:, None, None]
