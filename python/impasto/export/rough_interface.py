"""What a rough dielectric interface reflects in all, as ``roughplastic`` of Mitsuba 3 tabulates it.

Beckmann facets that are visible from the incident direction [@walter2007microfacet], each with
Fresnel's reflectance; light that other facets catch on its way out is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_COSINES = np.maximum(np.linspace(0.0, 1.0, 64), 1e-6)
_TURNS = 48
_TILTS = 96
_WIDEST = 4.0
"""Slopes beyond so many widths have exp(-16) of the facets."""


@dataclass(frozen=True, eq=False)
class RoughInterface:
    """Tables of one width and one index.

    Attributes
    ----------
    reflected
        Of light from outside, at 64 cosines from 0 to 1.
    inside
        The mean of diffuse light from inside.
    """

    reflected: Floats
    inside: float

    def crossing(self, cosine: Floats) -> Floats:
        """The share of light from outside, at a cosine, that passes."""
        return 1.0 - np.interp(cosine, _COSINES, self.reflected)


@lru_cache(maxsize=16)
def rough_interface(alpha: float, index: float) -> RoughInterface:
    """The tables of an interface of Beckmann facets of a width."""
    inner = _reflected(alpha, 1.0 / index)
    # Mitsuba's own rule: the plain mean of its 64 entries, 1.6 % below the integral.
    mean = 2.0 * np.mean(inner * _COSINES)
    return RoughInterface(_reflected(alpha, index), float(mean))


def fresnel(cosine: Floats, index: float) -> Floats:
    """Reflectance of a smooth dielectric, unpolarised; total beyond the critical angle."""
    squared = 1.0 - (1.0 - np.square(cosine)) / index**2
    total = squared <= 0.0
    inner = np.sqrt(np.where(total, 0.0, squared))
    across = (cosine - index * inner) / np.maximum(cosine + index * inner, 1e-12)
    along = (index * cosine - inner) / np.maximum(index * cosine + inner, 1e-12)
    return np.where(total, 1.0, 0.5 * (np.square(across) + np.square(along)))


def smith_beckmann(cosine: Floats, alpha: float) -> Floats:
    """Smith's shadowing of one direction, the rational fit of Walter et al. (2007)."""
    sine = np.sqrt(np.maximum(1.0 - np.square(cosine), 1e-12))
    slope = np.maximum(cosine, 0.0) / (alpha * sine)
    fit = (3.535 * slope + 2.181 * slope**2) / (1.0 + 2.276 * slope + 2.577 * slope**2)
    return np.where(slope < 1.6, fit, 1.0)


def _reflected(alpha: float, index: float) -> Floats:
    """Midpoint rule over the facets' slopes, in units of alpha, and their azimuths."""
    slope = (np.arange(_TILTS) + 0.5) / _TILTS * _WIDEST
    turn = (np.arange(_TURNS) + 0.5) / _TURNS * 2.0 * np.pi
    cosine = 1.0 / np.sqrt(1.0 + np.square(alpha * slope))
    sine = alpha * slope * cosine
    # Facets per projected area: D cos dm is exp(-slope^2) of the plane of slopes, over pi.
    share = np.exp(-np.square(slope)) * slope * (_WIDEST / _TILTS) * (2.0 / _TURNS)
    facet_x, facet_z = np.outer(sine, np.cos(turn)), np.repeat(cosine[:, None], _TURNS, axis=1)
    found = np.empty_like(_COSINES)
    for place, z in enumerate(_COSINES):
        along = np.sqrt(1.0 - z * z) * facet_x + z * facet_z
        out = 2.0 * along * facet_z - z
        seen = (along > 0.0) & (out > 0.0)
        masked = smith_beckmann(np.asarray(z), alpha) * smith_beckmann(np.maximum(out, 0.0), alpha)
        light = fresnel(np.maximum(along, 0.0), index) * masked * along / (facet_z * z)
        found[place] = np.sum(np.where(seen, light, 0.0) * share[:, None])
    return np.clip(found, 0.0, 1.0)
