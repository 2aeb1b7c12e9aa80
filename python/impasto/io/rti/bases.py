"""Functions of the light's direction whose sum is the picture: what RTI files store planes of.

Polynomial texture maps [@malzbender2001polynomial], hemispherical harmonics
[@gautron2004hemispherical], real spherical harmonics, and Gaussian radial functions
[@ponchio2018compact]. Few lights, never pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.checks import numbers, one_of
from impasto.errors import ArgumentError

Floats = NDArray[np.float64]
Kind = Literal["ptm", "hsh", "sh", "rbf"]
"""``ptm``: polynomial; ``hsh``, ``sh``: harmonics of the hemisphere and the sphere; ``rbf``:
Gaussians about the photographs' lights."""

LOWEST = 0.01
"""Radians above the horizon below which hemispherical harmonics do not change."""
FAINT = 0.001
"""Radial functions of less weight are left out."""


@dataclass(frozen=True)
class Basis:
    """The functions of one file.

    Parameters
    ----------
    kind
        Which functions.
    terms
        How many; ptm has 6, hsh 4 or 9, sh 9, rbf one per light.
    lights
        ``(light, 3)`` directions of the photographs, for ``rbf``.
    sigma
        Width of the radial functions, in the distance of unit vectors; for ``rbf``.
    """

    kind: Kind
    terms: int
    lights: Floats | None = None
    sigma: float = 0.0

    def __post_init__(self) -> None:
        one_of(self.kind, get_args(Kind), "kind")
        allowed = {"ptm": {6}, "hsh": {4, 9}, "sh": {9}}.get(self.kind)
        if allowed is not None and self.terms not in allowed:
            expected = " or ".join(map(str, sorted(allowed)))
            raise ArgumentError(f"terms: {self.kind} has {expected}, found {self.terms}")
        if self.kind == "rbf" and (self.lights is None or len(self.lights) != self.terms):
            raise ArgumentError("lights: radial functions need one direction per term")
        if self.kind == "rbf" and not self.sigma > 0.0:
            raise ArgumentError(f"sigma: expected a positive width, found {self.sigma!r}")

    def values(self, lights: ArrayLike) -> Floats:
        """The functions at directions.

        Parameters
        ----------
        lights
            ``(light, 3)`` or ``(3,)`` directions towards the light: x right, y up, z towards the
            viewer. Their length does not matter.

        Returns
        -------
        ndarray
            ``(light, terms)``.

        Raises
        ------
        ArgumentError
            No directions in front of the picture.
        """
        at = unit_directions(lights)
        x, y, z = at.T
        if self.kind == "ptm":
            return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        if self.kind == "hsh":
            return hemispherical_harmonics(at)[:, : self.terms]
        if self.kind == "sh":
            return _spherical_harmonics(x, y, z)
        return self._radial(at)

    def _radial(self, at: Floats) -> Floats:
        assert self.lights is not None
        squared = np.square(at[:, None] - self.lights[None]).sum(axis=2)
        # The nearest light keeps a weight however narrow the functions are.
        squared -= squared.min(axis=1, keepdims=True)
        weights = np.exp(-squared / self.sigma**2)
        weights /= weights.sum(axis=1, keepdims=True)
        weights[weights < FAINT] = 0.0
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def unit_directions(lights: ArrayLike) -> Floats:
    """``(light, 3)`` unit vectors in front of the picture.

    Raises
    ------
    ArgumentError
        Another shape, a vector of length 0, or a light behind the picture.
    """
    found = numbers(lights, "lights", "directions (light, 3)")
    found = found[None] if found.ndim == 1 else found
    if found.ndim != 2 or found.shape[1] != 3 or not len(found):
        raise ArgumentError(f"lights: expected directions (light, 3), found shape {found.shape}")
    lengths = np.linalg.norm(found, axis=1, keepdims=True)
    if not (np.isfinite(lengths) & (lengths > 0)).all():
        raise ArgumentError("lights: a direction has no length, or is not finite")
    unit = found / lengths
    if (unit[:, 2] < 0.0).any():
        raise ArgumentError("lights: a light stands behind the picture (z < 0)")
    return np.asarray(unit)


def hemispherical_harmonics(at: Floats) -> Floats:
    """The nine of up to second order, in the order of files [@gautron2004hemispherical]."""
    c = np.maximum(at[:, 2], np.sin(LOWEST))
    phi = np.arctan2(at[:, 1], at[:, 0])
    s = np.sqrt(c - c * c)
    pi = np.pi
    return np.stack(
        [
            np.full_like(c, np.sqrt(1 / (2 * pi))),
            np.sqrt(6 / pi) * s * np.cos(phi),
            np.sqrt(3 / (2 * pi)) * (2 * c - 1),
            np.sqrt(6 / pi) * s * np.sin(phi),
            np.sqrt(30 / pi) * (c * c - c) * np.cos(2 * phi),
            np.sqrt(30 / pi) * (2 * c - 1) * s * np.cos(phi),
            np.sqrt(5 / (2 * pi)) * (6 * c * c - 6 * c + 1),
            np.sqrt(30 / pi) * (2 * c - 1) * s * np.sin(phi),
            np.sqrt(30 / pi) * (c * c - c) * np.sin(2 * phi),
        ],
        axis=1,
    )


def _spherical_harmonics(x: Floats, y: Floats, z: Floats) -> Floats:
    """Nine real harmonics; those of first order in the order y, z, x."""
    pi = np.pi
    return np.stack(
        [
            np.full_like(x, np.sqrt(1 / (4 * pi))),
            *(np.sqrt(3 / (4 * pi)) * one for one in (y, z, x)),
            np.sqrt(15 / (4 * pi)) * x * y,
            np.sqrt(15 / (4 * pi)) * y * z,
            np.sqrt(5 / (16 * pi)) * (3 * z * z - 1),
            np.sqrt(15 / (4 * pi)) * x * z,
            np.sqrt(15 / (16 * pi)) * (x * x - y * y),
        ],
        axis=1,
    )
