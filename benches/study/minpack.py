"""One lobe and a free normal per pixel by MINPACK (``scipy.optimize.least_squares``), as a peer.

Eq. 1 of the six-band paper in float64 numpy: normal (two tilts), a diffuse colour per band, beta
and log gamma; all bands at once, clipped samples left out, derivatives by differences, one pixel
after the other. It starts, like our own fit, at the normals of photometric stereo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.fit.normals import fit_normals
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

Array: TypeAlias = NDArray[np.float64]

NAME = "MINPACK (SciPy), one lobe"
STRIDE = 8
"""Stride of the pixels that are fitted, along both axes."""
INDEX = 1.45
START = 0.15
"""Initial half-width of the facets, rad: a satin varnish."""


@dataclass(frozen=True, eq=False)
class RigTable:
    """What depends on the rig alone: ``(obs, 3)`` directions, ``(obs,)`` numbers.

    Attributes
    ----------
    lights, views, half
        Unit vectors away from the surface, and their bisectors.
    v_h
        Cosine between view and bisector.
    fresnel
        Reflectance of the facet that mirrors the light into the view.
    intensities
        Of the lights.
    """

    lights: Array
    views: Array
    half: Array
    v_h: Array
    fresnel: Array
    intensities: Array

    @classmethod
    def of(cls, rig: Rig) -> RigTable:
        """Of distant lights."""
        lights, views = rig.directions, rig.views
        half = lights + views
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        v_h = (views * half).sum(axis=1)
        root = np.sqrt(INDEX**2 - 1.0 + v_h**2)
        fresnel = ((root - v_h) / (root + v_h)) ** 2 / 2.0
        fresnel *= 1.0 + ((v_h * (root + v_h) - 1.0) / (v_h * (root - v_h) + 1.0)) ** 2
        return cls(lights, views, half, v_h, fresnel, rig.intensities)

    def diffuse(self, normal: Array) -> Array:
        """``(obs,)`` radiance of a white diffuse surface with a unit normal."""
        return np.asarray(np.maximum(self.lights @ normal, 0.0) * self.intensities)

    def gloss(self, normal: Array, gamma: float) -> Array:
        """``(obs,)`` radiance of a lobe of strength 1 and half-width ``gamma``, rad."""
        n_l, n_v, n_h = self.lights @ normal, self.views @ normal, self.half @ normal
        phi = np.arccos(np.clip(n_h, -1.0, 1.0))
        facets = np.exp(-np.log(2.0) * (phi / gamma) ** 2)
        n_v = np.maximum(n_v, 1e-3)
        grooves = np.minimum(2.0 * n_h * n_v / self.v_h, 2.0 * n_h * n_l / self.v_h)
        lobe = facets * self.fresnel * np.minimum(1.0, grooves) / n_v
        return np.where(n_l > 0.0, lobe, 0.0) * self.intensities


def radiance(rig: Rig, unknowns: Array, base: Array, bands: int) -> Array:
    """``(obs, band)`` of one pixel; ``base`` ``(3, 3)``: where the normal started, two tangents."""
    sight, normal = RigTable.of(rig), tilted(base, unknowns[:2])
    gloss = unknowns[-2] * sight.gloss(normal, np.exp(unknowns[-1]))
    return np.asarray(sight.diffuse(normal)[:, None] * unknowns[2 : 2 + bands] + gloss[:, None])


@dataclass(frozen=True, eq=False)
class Pixels:
    """What MINPACK found, pixel by pixel."""

    found: list[Array]
    bases: list[Array]
    bands: int
    status: NDArray[np.uint8]

    @property
    def normal(self) -> Array:
        """``(3, y, x)``."""
        unit = [tilted(b, u[:2]) for u, b in zip(self.found, self.bases, strict=True)]
        return np.array(unit).T.reshape(3, *self.status.shape)

    def predict(self, lights: Rig) -> Array:
        """``(obs, band, y, x)``."""
        shown = [
            radiance(lights, unknowns, base, self.bands)
            for unknowns, base in zip(self.found, self.bases, strict=True)
        ]
        return np.moveaxis(np.array(shown), 0, -1).reshape(
            len(lights), self.bands, *self.status.shape
        )


def fit(stack: Stack, threads: int | None) -> Pixels:
    """Every pixel by itself.

    Raises
    ------
    ImportError
        SciPy is not installed.
    """
    from scipy.optimize import least_squares

    stereo = fit_normals(stack, threads=threads)
    bands = stack.shape[1]
    light = np.array([stack.linear(i) for i in range(len(stack.rig))], np.float64)
    light = light.reshape(len(light), bands, -1)
    normals = np.nan_to_num(stereo.normal.reshape(3, -1).astype(np.float64), nan=0.577)
    albedo = np.nan_to_num(stereo.albedo.reshape(bands, -1).astype(np.float64))
    found, bases = [], []
    for pixel in range(light.shape[2]):
        samples, base = light[:, :, pixel], base_of(normals[:, pixel])
        known = np.isfinite(samples)
        peak = 20.0 * samples[known].max(initial=0.0)
        start = np.concatenate([[0.0, 0.0], albedo[:, pixel], [peak, np.log(START)]])

        def residuals(
            unknowns: Array,
            samples: Array = samples,
            known: NDArray[np.bool_] = known,
            base: Array = base,
        ) -> Array:
            # Far outside what means anything a step must still cost something finite.
            unknowns = np.append(unknowns[:-1], np.clip(unknowns[-1], -6.0, 0.5))
            return (radiance(stack.rig, unknowns, base, bands) - samples)[known]

        result: Any = least_squares(residuals, start, method="lm")
        found.append(np.append(result.x[:-1], np.clip(result.x[-1], -6.0, 0.5)))
        bases.append(base)
    status = np.full(stack.shape[2:], Status.FITTED, np.uint8)
    return Pixels(found, bases, bands, status)


def base_of(normal: Array) -> Array:
    """``(3, 3)``: a unit vector and two tangents."""
    across = np.cross(normal, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    return np.array([normal, across, np.cross(normal, across)])


def tilted(base: Array, tilts: Array) -> Array:
    """A unit normal ``(3,)`` after two tilts ``(2,)`` along the tangents of its base."""
    normal = base[0] + tilts @ base[1:]
    return np.asarray(normal / np.linalg.norm(normal))
