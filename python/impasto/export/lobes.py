"""All lobes of a pixel as the one lobe that a format has: least squares over the facets' tilt.

A Torrance-Sparrow lobe has facets of ``exp(-ln 2 phi^2 / gamma^2)`` at a tilt ``phi``; formats have
the distributions of Beckmann [@beckmann1963scattering] or of GGX [@walter2007microfacet]. The one
of all widths is taken that leaves the least squared difference over the hemisphere of tilts, with
its best strength. A Lafortune lobe in the mirror direction enters with the tilt that it spans.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from impasto.export.source import Map
from impasto.surface import Surface

Distribution = Literal["beckmann", "ggx", "ward"]
Floats = NDArray[np.float64]

ALPHAS = np.geomspace(0.01, 1.0, 160)
"""Widths that are compared: 3 % apart, less than a step of an 8-bit roughness at 0.1."""
_GAMMAS = np.geomspace(1e-3, 2.0, 128)
_TILTS = np.linspace(0.0, np.pi / 3, 1500)
_ROWS = 1 << 14
"""Pixels at a time."""


@dataclass(frozen=True, eq=False)
class OneLobe:
    """One lobe per pixel.

    Attributes
    ----------
    alpha
        ``(y, x)`` width of the distribution; the least of :data:`ALPHAS` where there is no lobe.
    peak
        ``(3, y, x)`` what the facets' distribution reaches at tilt 0, in the units of beta: the
        radiance of the highlight relative to a white board, divided by Fresnel's reflectance.
    index
        Of refraction, for Fresnel's reflectance.
    """

    alpha: Map
    peak: Map
    index: float

    @property
    def head_on(self) -> float:
        """Fresnel's reflectance at normal incidence."""
        return ((self.index - 1.0) / (self.index + 1.0)) ** 2

    @property
    def specular(self) -> Map:
        """``(3, y, x)`` factor on Fresnel's reflectance of a normalised distribution.

        A facet model shows ``pi D F / 4`` of a white board at normal incidence, and ``D`` of tilt 0
        is ``1 / (pi alpha^2)``.
        """
        return np.asarray(np.float32(4.0) * self.alpha**2 * self.peak)


def one_lobe(lit: Surface, distribution: Distribution) -> OneLobe:
    """The lobe of each pixel that is nearest to all of its lobes.

    Parameters
    ----------
    lit
        Lobes grey or of three channels.
    distribution
        Of the format.
    """
    rows, columns = lit.shape
    count = rows * columns
    strengths, widths = _half_vector_lobes(lit)
    alpha = np.full(count, ALPHAS[0], np.float32)
    peak = np.zeros((3, count), np.float32)
    index = lit.index if lit.model == "torrance-sparrow" else 1.45
    if strengths:
        products, squares = _products(distribution)
        for first in range(0, count, _ROWS):
            part = slice(first, min(first + _ROWS, count))
            beta = np.stack([_part(one, part, 3) for one in strengths])
            gamma = np.stack([_part(one, part, 1)[0] for one in widths])
            lobed = np.flatnonzero(((gamma > 0.0) & (beta > 0.0).any(axis=1)).any(axis=0))
            if lobed.size:  # the fit of matte paint has none
                own = beta[..., lobed], gamma[:, lobed]
                chosen, amplitude = _nearest(*own, products, squares)
                at = part.start + lobed
                alpha[at], peak[:, at] = ALPHAS[chosen], amplitude
    return OneLobe(alpha.reshape(rows, columns), peak.reshape(3, rows, columns), float(index))


def shape_of(distribution: Distribution, alpha: Floats, tilt: Floats) -> Floats:
    """The distribution relative to its value at tilt 0."""
    tangent = np.square(np.tan(tilt))
    with np.errstate(over="ignore", under="ignore"):
        if distribution == "ggx":
            return np.asarray(1.0 / np.square(np.square(np.cos(tilt)) * (1.0 + tangent / alpha**2)))
        lobe = np.exp(-tangent / alpha**2)
        return np.asarray(lobe if distribution == "ward" else lobe / np.cos(tilt) ** 4)


@cache
def _products(distribution: Distribution) -> tuple[Floats, Floats]:
    """``(alpha, gamma)`` integrals of target times lobe, and ``(alpha,)`` of target squared."""
    weight = np.sin(_TILTS)
    targets = shape_of(distribution, ALPHAS[:, None], _TILTS)
    with np.errstate(under="ignore"):
        lobes = np.exp(-np.log(2.0) * np.square(_TILTS / _GAMMAS[:, None]))
        return (targets * weight) @ lobes.T, (np.square(targets) * weight).sum(axis=1)


def _nearest(
    beta: Map, gamma: Map, products: Floats, squares: Floats
) -> tuple[NDArray[np.intp], Floats]:
    """Which width, and the strength in each channel; ``beta (lobe, 3, n)``, ``gamma (lobe, n)``."""
    present = np.isfinite(gamma) & (gamma > 0.0) & (beta > 0.0).any(axis=1)
    width = np.where(present, gamma, _GAMMAS[0]).astype(np.float64)
    step = np.log(_GAMMAS[1] / _GAMMAS[0])
    place = np.clip(np.log(width / _GAMMAS[0]) / step, 0.0, len(_GAMMAS) - 1.001)
    low = place.astype(np.intp)
    part = place - low
    strength = np.where(present[:, None], beta, 0.0)
    grey = strength.mean(axis=1)
    if len(gamma) == 1:
        # The width of a single lobe does not depend on its strength: each width is looked up once.
        unique, same = np.unique(width[0], return_index=True, return_inverse=True)[1:]
        low, part, own_grey = low[:, unique], part[:, unique], np.ones((1, len(unique)))
    else:
        same, own_grey = np.arange(width.shape[1]), grey
    # (alpha, lobe, n): what each lobe gives to each target.
    between = products[:, low] * (1.0 - part) + products[:, low + 1] * part
    total = np.einsum("aln,ln->an", between, own_grey)
    chosen = np.argmax(np.square(total) / squares[:, None], axis=0)
    own = np.take_along_axis(between, chosen[None, None, :], axis=0)[0][:, same]
    chosen = chosen[same]
    chosen[~present.any(axis=0)] = 0
    amplitude = np.einsum("lcn,ln->cn", strength, own) / squares[chosen]
    return chosen, amplitude


def _half_vector_lobes(lit: Surface) -> tuple[list[float | Map], list[float | Map]]:
    """Strengths beta and widths gamma of the lobes."""
    if lit.model == "torrance-sparrow":
        return [one.strength for one in lit.lobes], [one.shape[0] for one in lit.lobes]
    head_on = ((1.45 - 1.0) / (1.45 + 1.0)) ** 2
    strengths: list[float | Map] = []
    widths: list[float | Map] = []
    for lobe in lit.lobes:
        cxy, cz, exponent = (np.asarray(one, dtype=np.float32) for one in lobe.shape)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # cos^n(2 phi) of a light at twice the tilt is exp(-2 n phi^2) near the mirror.
            width = np.sqrt(np.log(2.0) / (2.0 * exponent))
            peak = np.asarray(lobe.strength) * np.power(cz, exponent) / head_on
        mirror = (cxy < 0.0) & (cz > 0.0) & np.isfinite(peak)
        strengths.append(np.where(mirror, peak, 0.0).astype(np.float32))
        widths.append(np.broadcast_to(width, lit.shape).astype(np.float32))
    return strengths, widths


def _part(value: float | Map, part: slice, channels: int) -> Map:
    """``(channels, n)`` of a number, a map or a map of three channels."""
    if np.ndim(value) == 0:
        return np.full((channels, part.stop - part.start), value, np.float32)
    plane = np.asarray(value)
    flat = plane.reshape(-1, plane.shape[-2] * plane.shape[-1])[:, part]
    return np.asarray(np.broadcast_to(flat, (channels, flat.shape[1])), dtype=np.float32)
