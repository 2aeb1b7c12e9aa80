"""The errors that photographs of a rig can have at best: Cramer-Rao bounds [@rao1945information].

A pixel has a normal, a diffuse reflectance and, together with all others, the painting's one lobe
(beta, gamma). Derivatives of its samples by these, divided by the noise, make the information
matrix; the covariance of every unbiased estimate is at least its inverse. The lobe is shared by
many pixels: their own unknowns are eliminated (Schur complement), and what is left is summed.
Samples in attached shadow or beyond white are no information. Cast shadows are not foreseen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto._internal.checks import positive
from impasto.bracket import READ_NOISE, SHOT_NOISE
from impasto.errors import ArgumentError
from impasto.rig import Rig
from impasto.surface import Surface

Floats = NDArray[np.float64]

STEP = 2e-3
"""Of difference quotients, in radians and in shares: single precision leaves 2e-5 of them."""
RINGS = ((0.0, 1), (0.35, 6), (0.7, 12), (1.0, 18))
"""Normals about the front: their angles as shares of the largest, and their numbers."""
OWN = 3
"""Unknowns of a pixel: two of its normal, and its reflectance."""


@dataclass(frozen=True)
class Noise:
    """The noise of a sample, relative to a white board.

    Attributes
    ----------
    read
        Standard deviation in the dark.
    shot
        Standard deviation at white that grows with the root of the light.
    """

    read: float = READ_NOISE
    shot: float = SHOT_NOISE

    def sigma(self, light: Floats) -> Floats:
        """Standard deviation of samples of so much light."""
        return np.asarray(np.sqrt(self.read**2 + self.shot**2 * np.maximum(light, 0.0)))


@dataclass(frozen=True, eq=False)
class ExpectedErrors:
    """The least standard deviations that a rig allows.

    Attributes
    ----------
    normal
        Of a pixel's normal, radians along its worse axis: root mean square over all tilts.
    worst_normal
        That of the worst tilt.
    albedo
        Of a pixel's reflectance, relative.
    beta, gamma
        Of the painting's one lobe, relative, from ``pixels`` pixels; infinite where it is not seen.
    pixels
        For the lobe.
    condition
        Condition number of the directions of the lamps.
    lit
        Share of the samples that are neither in shadow nor beyond white.
    """

    normal: float
    worst_normal: float
    albedo: float
    beta: float
    gamma: float
    pixels: int
    condition: float
    lit: float


def expected_errors(
    rig: Rig,
    *,
    beta: float = 12.0,
    gamma: float = 0.12,
    albedo: float = 0.4,
    tilt: float = np.radians(20.0),
    noise: Noise | None = None,
    pixels: int = 10_000,
    exposure: float = 1.0,
) -> ExpectedErrors:
    """What the photographs of a rig can tell at best.

    Parameters
    ----------
    rig
        Lamps and views; near lamps count as seen from the middle of the painting.
    beta, gamma
        The lobe of a varnish: strength, half-width of the facets in radians. Default: satin, which
        reflects as much as a smooth interface, ``beta = ln 2 / (4 gamma^2)``. ``beta`` 0: none.
    albedo
        Diffuse reflectance of the paint.
    tilt
        Largest angle of a normal from the front, radians.
    noise
        Default: 0.1 % of white in the dark, 0.5 % at white.
    pixels
        That share the lobe.
    exposure
        Light of a white board that faces a lamp, relative to what a photograph can hold.

    Raises
    ------
    ArgumentError
        A number that is not positive, or lamps that determine no normal.
    """
    for name, value in (("albedo", albedo), ("tilt", tilt), ("pixels", pixels), ("gamma", gamma)):
        positive(value, name, "a positive number")
    positive(exposure, "exposure", "a positive number")
    if not (np.isfinite(beta) and beta >= 0.0):
        raise ArgumentError(f"beta: expected a number from 0 on, found {beta!r}")
    noise = Noise() if noise is None else noise
    normals = tilted(tilt)
    slopes, known = derivatives(rig, normals, beta, gamma, albedo, noise, exposure)
    information = np.einsum("pki,pkj->pij", slopes, slopes)
    own, mixed = information[:, :OWN, :OWN], information[:, :OWN, OWN:]
    if (known.sum(axis=1) < OWN).any() or np.linalg.cond(own).max() > 1e12:
        raise ArgumentError(
            f"rig: {len(rig)} lamps do not determine the normal of every surface that leans by "
            f"{np.degrees(tilt):.0f} degrees; add lamps from other sides, not all in one plane"
        )
    covariance = np.linalg.inv(own)
    worse = np.sqrt(np.linalg.eigvalsh(covariance[:, :2, :2])[:, -1])
    shared = np.full(2, np.inf)
    if beta > 0.0:
        left = information[:, OWN:, OWN:] - np.swapaxes(mixed, 1, 2) @ covariance @ mixed
        whole = left.mean(axis=0) * pixels
        if np.linalg.cond(whole) < 1e12:
            shared = np.sqrt(np.diag(np.linalg.inv(whole)))
    return ExpectedErrors(
        normal=float(np.sqrt(np.square(worse).mean())),
        worst_normal=float(worse.max()),
        albedo=float(np.sqrt(covariance[:, 2, 2].mean())),
        beta=float(shared[0]),
        gamma=float(shared[1]),
        pixels=int(pixels),
        condition=float(np.linalg.cond(rig.directions)),
        lit=float(known.mean()),
    )


def tilted(tilt: float) -> Floats:
    """``(n, 3)`` unit normals over a cap about the front."""
    found = []
    for share, count in RINGS:
        turn = 2.0 * np.pi * (np.arange(count) + 0.5 * share) / count
        sine, cosine = np.sin(share * tilt), np.cos(share * tilt)
        found += [(sine * np.cos(a), sine * np.sin(a), cosine) for a in turn.tolist()]
    return np.array(found)


def derivatives(
    rig: Rig,
    normals: Floats,
    beta: float,
    gamma: float,
    albedo: float,
    noise: Noise,
    exposure: float,
) -> tuple[Floats, NDArray[np.bool_]]:
    """``(normal, obs, 5)`` derivatives over the noise, and which samples ``(normal, obs)`` count.

    By two angles of the normal, and by relative changes of reflectance, beta and gamma.
    """
    first = np.cross((0.0, 1.0, 0.0), normals)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    surfaces = []
    for sign in (1.0, -1.0):
        step = sign * STEP
        for change in range(OWN + 2):
            lean = normals + step * ((change == 0) * first + (change == 1) * second)
            lean = lean / np.linalg.norm(lean, axis=1, keepdims=True)
            factors = [1.0 + step * (change == number) for number in (2, 3, 4)]
            surfaces.append((lean, *factors))
    surfaces.append((normals, 1.0, 1.0, 1.0))
    light = _light(rig, surfaces, beta, gamma, albedo) * exposure
    count = len(normals)
    planes = light.reshape(len(rig), len(surfaces), count)
    middle = planes[:, -1].T
    known = (middle > 0.0) & (middle < 1.0)
    changes = planes[:, : OWN + 2] - planes[:, OWN + 2 : -1]
    slopes = np.moveaxis(changes, (0, 1, 2), (1, 2, 0)) / (2.0 * STEP)
    slopes = np.where(known[..., None], slopes / noise.sigma(middle)[..., None], 0.0)
    return np.asarray(slopes), known


def _light(
    rig: Rig,
    surfaces: list[tuple[Floats, float, float, float]],
    beta: float,
    gamma: float,
    albedo: float,
) -> Floats:
    """``(obs, pixel)`` samples of all surfaces side by side."""
    normals = np.concatenate([one[0] for one in surfaces])
    counts = [len(one[0]) for one in surfaces]
    per_pixel = [np.repeat([one[index] for one in surfaces], counts) for index in (1, 2, 3)]
    maps = [
        (value * factor).astype(np.float32)[None]
        for value, factor in zip((albedo, beta, gamma), per_pixel, strict=True)
    ]
    plane = normals.T.astype(np.float32)[:, None]
    surface = Surface.torrance_sparrow(plane, maps[0][None], maps[1], maps[2])
    distant = [(x, y, z) for x, y, z in rig.directions.tolist()]
    found = surface.predict(np.array(distant), views=rig.views)
    return np.asarray(found[:, 0, 0], np.float64)
