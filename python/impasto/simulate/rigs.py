"""The lights and views of the three papers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import one_of
from impasto.errors import ArgumentError
from impasto.lights import DistantLight, Light, PointLight
from impasto.rig import FRONTAL, Rig

PITCH_MM = 0.2
"""Default width of a simulated pixel."""


Directions = NDArray[np.float64]
"""``(obs, 3)`` unit vectors."""

INCIDENCES = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
"""Degrees from the normal at which the lamp of Snel's rig stands."""

RINGS = ((0, 1), (3, 6), (6, 8), (9, 10), (13, 12), (18, 12), (25, 12), (35, 14))
"""Views about the mirror direction in Snel's rig: degrees from it, and their number."""

LOWEST = 75.0
"""Degrees from the normal beyond which a rectified photograph has too little resolution."""

PER_INCIDENCE = 115


def _direction(angle: ArrayLike, azimuth: ArrayLike) -> Directions:
    """Unit vectors from degrees off the normal and degrees from +x counter-clockwise."""
    a, b = np.broadcast_arrays(np.radians(angle), np.radians(azimuth))
    return np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)


def _about(axis: Directions, angle: float, count: int, start: float = 0.0) -> Directions:
    """``count`` directions ``angle`` degrees from an axis in the plane y = 0."""
    x, _, z = axis
    turn = np.array([[z, 0.0, x], [0.0, 1.0, 0.0], [-x, 0.0, z]])
    return np.asarray(_direction(angle, start + 360.0 * np.arange(count) / count) @ turn.T)


def _frontal(lights: Directions) -> tuple[Directions, Directions]:
    return lights, np.broadcast_to(FRONTAL, lights.shape)


def _rgb_camera() -> tuple[Directions, Directions]:
    ring = _direction(45.0, 45.0 * np.arange(8))
    return _frontal(np.concatenate([[FRONTAL], ring]))


def _six_band() -> tuple[Directions, Directions]:
    azimuth = 45.0 * np.arange(8)
    return _frontal(np.concatenate([_direction(45.0, azimuth), _direction(22.5, azimuth + 22.5)]))


def _snel() -> tuple[Directions, Directions]:
    lights, views = [], []
    for incidence in INCIDENCES:
        light, mirror = _direction([incidence, incidence], [180.0, 0.0])
        dense = [_about(mirror, angle, count, 0.5 * angle) for angle, count in RINGS]
        # The reflection varies little elsewhere: a sparse spiral over the hemisphere.
        turns = np.arange(400)
        cosine = 1.0 - (turns + 0.5) / turns.size * (1.0 - np.cos(np.radians(LOWEST)))
        sparse = _direction(np.degrees(np.arccos(cosine)), 137.50776 * turns)
        sparse = sparse[sparse @ mirror < np.cos(np.radians(RINGS[-1][0] + 5.0))]
        near = np.concatenate(dense)
        # The camera neither grazes the painting nor blocks the lamp.
        near, sparse = (
            v[(v[:, 2] > np.cos(np.radians(LOWEST))) & (v @ light < np.cos(np.radians(5.0)))]
            for v in (near, sparse)
        )
        rest = PER_INCIDENCE - len(near)
        picked = np.linspace(0, len(sparse) - 1, rest).round().astype(int)
        views += [near, sparse[picked]]
        lights.append(np.broadcast_to(light, (PER_INCIDENCE, 3)))
    for azimuth in 22.5 + 45.0 * np.arange(8):
        for incidence in (20.0, 45.0):
            light, mirror = _direction([incidence, incidence], [180.0, 0.0])
            around = np.concatenate([[mirror], _about(mirror, 8.0, 4)])
            a = np.radians(azimuth)
            turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
            lights.append(np.broadcast_to(turn @ light, (5, 3)))
            views.append(around @ turn.T)
    return np.concatenate(lights), np.concatenate(views)


RIGS: dict[str, Callable[[], tuple[Directions, Directions]]] = {
    "snel-lafortune": _snel,
    "tominaga-rgb-camera": _rgb_camera,
    "tominaga-six-band-adaptation": _six_band,
}


def rig(name: str, *, distance_mm: float | None = None, pitch_mm: float = PITCH_MM) -> Rig:
    """The lights and views of the rig of a paper.

    ``"tominaga-rgb-camera"``: 9 lights, first the top one, then 8 at 45 degrees elevation every
    45 degrees, from +x counter-clockwise (Figure 3 of the paper). The camera is straight above.

    ``"tominaga-six-band-adaptation"``: 16 lights. The paper only says that none is at an
    extremely low elevation. Here they form two staggered rings: 8 at 45 degrees elevation every 45
    degrees, then 8 at 67.5 degrees elevation, half a step further. The lower ring determines the
    normals; the upper one reaches the highlights of nearly flat areas (their half vectors lean
    22.5 and 11.25 degrees). The camera is straight above.

    ``"snel-lafortune"``: 690 + 80 pairs of light and view, every observation with its own view.
    The paper (section 2, Figure 6) gives their number, says that they are dense about the mirror
    direction, in steps of 3 degrees, that azimuths of the light were left out together with
    anisotropy, and that 80 more are for the normals; it lists no positions. Here the first 690 are
    six incidences of a lamp in the plane y = 0 (10 to 60 degrees) with 115 views each: rings 0 to
    35 degrees about the mirror direction, the others sparse over the hemisphere down to 75
    degrees. The last 80 are lamps from eight azimuths at 20 and 45 degrees, each seen from the
    mirror direction and from 8 degrees about it.

    Parameters
    ----------
    name
        The name of the paper's system.
    distance_mm
        Distance of the lamps from the middle of the painting; None: infinitely far.
    pitch_mm
        Width of a pixel on the painting in mm (needed by near lamps).
    """
    one_of(name, RIGS, "name")
    directions, views = RIGS[name]()
    lights: list[Light]
    if distance_mm is None:
        lights = [DistantLight((x, y, z)) for x, y, z in directions.tolist()]
    else:
        if not (np.isfinite(distance_mm) and distance_mm > 0):
            raise ArgumentError(f"distance_mm: expected a positive distance, found {distance_mm!r}")
        lights = [
            PointLight((x * distance_mm, y * distance_mm, z * distance_mm))
            for x, y, z in directions.tolist()
        ]
    return Rig(lights, views=views, pitch_mm=pitch_mm)
