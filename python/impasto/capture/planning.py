"""Which lamp to add: forward selection of a D-optimal design [@fedorov1972optimal].

Of all candidates the one that adds most to the logarithm of the determinant of the information is
chosen, then the next. The determinant weighs normal, reflectance and lobe together, whatever their
units.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impasto._internal.checks import is_whole
from impasto.capture.expected import OWN, Floats, Noise, derivatives, tilted
from impasto.errors import ArgumentError
from impasto.rig import FRONTAL, Rig

LOWEST = np.radians(15.0)
"""Elevation of the lowest candidates: below it, relief shades most of itself."""
CANDIDATES = 400


def hemisphere(count: int = CANDIDATES, lowest: float = LOWEST) -> Floats:
    """``(count, 3)`` directions, evenly over the hemisphere.

    A spherical Fibonacci lattice [@gonzalez2010fibonacci].

    Parameters
    ----------
    count
        Of directions.
    lowest
        Elevation of the lowest, radians.
    """
    if not is_whole(count) or count < 1:
        raise ArgumentError(f"count: expected a whole number from 1 on, found {count!r}")
    height = 1.0 - (np.arange(count) + 0.5) / count * (1.0 - np.sin(lowest))
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def better_lights(
    rig: Rig | None,
    count: int,
    *,
    candidates: ArrayLike | None = None,
    view: ArrayLike = FRONTAL,
    beta: float = 12.0,
    gamma: float = 0.12,
    albedo: float = 0.4,
    tilt: float = np.radians(20.0),
    noise: Noise | None = None,
    exposure: float = 1.0,
) -> Floats:
    """Directions of lamps that tell most beside those of a rig.

    Parameters
    ----------
    rig
        The lamps that are there; None: none.
    count
        How many to add.
    candidates
        ``(n, 3)`` directions to choose from; default: 400 over the hemisphere, 15 degrees above the
        painting and more.
    view
        Direction to the camera for the new lamps.
    beta, gamma, albedo, tilt, noise, exposure
        As in :func:`expected_errors`.

    Returns
    -------
    ndarray
        ``(count, 3)`` unit vectors, the best first.

    Raises
    ------
    ArgumentError
        No whole number, or fewer candidates.
    """
    among = hemisphere() if candidates is None else np.asarray(candidates, dtype=np.float64)
    if among.ndim != 2 or among.shape[1:] != (3,) or not np.isfinite(among).all():
        raise ArgumentError(f"candidates: expected finite (n, 3), found shape {among.shape}")
    among = among / np.linalg.norm(among, axis=1, keepdims=True)
    if not is_whole(count) or not 1 <= count <= len(among):
        raise ArgumentError(
            f"count: expected a whole number from 1 to {len(among)} candidates, found {count!r}"
        )
    options: dict[str, Any] = {
        "beta": beta, "gamma": gamma, "albedo": albedo,
        "noise": Noise() if noise is None else noise, "exposure": exposure,
    }  # fmt: skip
    normals = tilted(tilt)
    # A faint prior: with fewer than three lamps nothing is determined.
    size = OWN + 2 if beta > 0.0 else OWN
    information = np.broadcast_to(1e-6 * np.eye(size), (len(normals), size, size)).copy()
    if rig is not None:
        slopes, _ = derivatives(rig, normals, **options)
        information += _sums(slopes[..., :size])
    each, _ = derivatives(Rig(among, views=np.asarray(view)), normals, **options)
    each = each[..., :size]
    chosen: list[int] = []
    for _ in range(count):
        gains = np.array(
            [
                -np.inf if one in chosen else _score(information + _sums(each[:, one : one + 1]))
                for one in range(len(among))
            ]
        )
        chosen.append(int(gains.argmax()))
        information += _sums(each[:, chosen[-1] : chosen[-1] + 1])
    return np.asarray(among[chosen])


def _sums(slopes: Floats) -> Floats:
    return np.asarray(np.einsum("pki,pkj->pij", slopes, slopes))


def _score(information: Floats) -> float:
    """Mean logarithm of the determinant of the pixels' own unknowns, and that of the lobe."""
    own, mixed = information[:, :OWN, :OWN], information[:, :OWN, OWN:]
    found = float(np.linalg.slogdet(own)[1].mean())
    if information.shape[1] > OWN:
        left = information[:, OWN:, OWN:] - np.swapaxes(mixed, 1, 2) @ np.linalg.solve(own, mixed)
        found += float(np.linalg.slogdet(left.mean(axis=0))[1])
    return found
