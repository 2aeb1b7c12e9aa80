"""The excess of a search's final cost over the least cost of a pixel, in float64 from the paper.

A fit without rounds of reweighting searches on the mean of the bands: for the normal and log gamma
of eq. 1 of the six-band paper, with the best non-negative diffuse colour, strength and ambient
light (variable projection). The weights do not depend on the lobe, so all such fits minimise the
same cost, whatever their steps: the weight is one over the larger of the sample and a tenth of the
pixel's mean, and is reduced where photometric stereo predicts more light than the sample (shadow).
A clipped sample counts as full scale. This module computes that cost in plain numpy and minimises
it by MINPACK.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from impasto.effort import Effort, Precision
from impasto.fit.lobes import LobeSbrdf
from impasto.fit.normals import Normals, fit_normals
from impasto.stack import Stack
from study import fits
from study.minpack import START, RigTable, base_of, tilted
from study.subsets import TooFewError

Array: TypeAlias = NDArray[np.float64]

PRECISIONS: tuple[Precision, ...] = ("single", "double")
"""Precisions of a search. ``"polished"`` is a matter of the last round; here is none."""
STEPS = (1, 2, 3, 4, 6, 10, 30)
"""Largest numbers of steps of a search; the last one is a thorough search."""
BAD = 0.01
"""Excess above which a pixel is in a bad basin or has run out of steps.

Of the study's two thousand pixels, thorough searches end within 5e-4 but for one at 3e-3; where
steps run out, a few are off by tenths. A hundredth separates the two. It is also small: with 48
samples and six unknowns, an unknown that is off by one standard deviation costs a 42nd."""
WIDTHS = (5e-4, 1.25)
"""Range of half-widths of our search, rad."""
FAR = 1e3
"""Limit of the tangent of a tilt."""
FLOOR = 0.1
"""Share of a pixel's mean sample below which the noise is taken as constant."""
SHADE = 0.03
"""Share of a pixel's colour that is added to samples before they are compared with stereo's."""
TOLERANCES: dict[str, Any] = {"method": "lm", "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
"""Tolerances of MINPACK, finer than single precision resolves."""


@dataclass(frozen=True, eq=False)
class Target:
    """The cost function of one pixel's search.

    Attributes
    ----------
    sight
        Of the rig.
    samples
        ``(obs,)`` mean of the bands.
    root
        ``(obs,)`` roots of the weights.
    """

    sight: RigTable
    samples: Array
    root: Array

    def left(self, normal: Array, gamma: float) -> Array:
        """``(obs,)`` weighted residuals for a unit normal, with the best colours."""
        from scipy.optimize import nnls

        shapes = (self.sight.diffuse(normal), self.sight.gloss(normal, gamma))
        columns = np.stack([*shapes, np.ones_like(self.samples)], axis=1) * self.root[:, None]
        light = self.samples * self.root
        return np.asarray(columns @ nnls(columns, light)[0] - light)

    def cost(self, normal: Array, gamma: float) -> float:
        """Weighted sum of squares; infinite without a lobe."""
        if not (np.isfinite(gamma) and gamma > 0.0):
            return np.inf
        left = self.left(normal / np.linalg.norm(normal), gamma)
        return float(left @ left)

    def least(self, normal: Array, gamma: float) -> float:
        """Final cost of MINPACK from these parameters."""
        from scipy.optimize import least_squares

        base = base_of(normal / np.linalg.norm(normal))
        narrow, wide = np.log(WIDTHS)

        def residuals(unknowns: Array) -> Array:
            # The cost must stay finite far outside the range of the parameters.
            unknowns = np.clip(np.nan_to_num(unknowns), -FAR, FAR)
            gamma = np.exp(np.clip(unknowns[2], narrow, wide))
            return self.left(tilted(base, unknowns[:2]), gamma)

        found: Any = least_squares(residuals, [0.0, 0.0, np.log(gamma)], **TOLERANCES)
        return 2.0 * float(found.cost)


@dataclass(frozen=True, eq=False)
class LeastCosts:
    """The cost functions of a painting's pixels, and the least cost found.

    Attributes
    ----------
    targets
        One per pixel.
    costs
        ``(pixel,)``; infinite where our thorough searches find no lobe.
    """

    targets: list[Target]
    costs: Array

    def excess(self, fitted: LobeSbrdf) -> Array:
        """``(pixel,)`` relative excess of a fit's cost over the least.

        NaN where the fit has no lobe or the least is unknown: fits omit a lobe whose highlight no
        photograph shows.
        """
        ends = zip(self.targets, _normals(fitted), _widths(fitted), strict=True)
        own = np.array([target.cost(normal, gamma) for target, normal, gamma in ends])
        known = np.isfinite(own) & np.isfinite(self.costs)
        return np.where(known, own, np.nan) / np.where(known, self.costs, 1.0) - 1.0


def least_costs_of(stack: Stack, threads: int | None = None) -> LeastCosts:
    """The least cost of every pixel that is known, from two starts.

    MINPACK goes on where our most thorough searches end, in single or in double precision, from
    the better of the two; and it starts where the peer of :mod:`study.minpack` does, at
    the normal of photometric stereo. Whichever ends lower.

    Parameters
    ----------
    stack
        Photographs under distant lights.
    threads
        None means every allowed core; the result is the same.

    Raises
    ------
    ImportError
        SciPy is not installed.
    """
    stereo = fit_normals(stack, threads=threads)
    targets = _targets(stack, stereo)
    fitted = [
        fits.search(stack, threads, effort=effort_of(precision, STEPS[-1]))
        for precision in PRECISIONS
    ]
    places = [zip(_normals(one), _widths(one), strict=True) for one in fitted]
    costs = []
    for target, first, *ends in zip(targets, _normals(stereo), *places, strict=True):
        cost, best = min(((target.cost(*end), end) for end in ends), key=lambda found: found[0])
        known = np.isfinite(cost)
        goals = [target.least(*start) for start in ((first, START), best)] if known else [np.nan]
        costs.append(min(cost, *goals))
    return LeastCosts(targets, np.array(costs))


def effort_of(precision: Precision, steps: int) -> Effort:
    """A search alone, by multistart."""
    return Effort(rounds=0, iterations=steps, start="multistart", precision=precision)


def summary(shares: Iterable[Array]) -> dict[str, float]:
    """Of the pixels ``(pixel,)`` of some paintings together: ``median``, ``p99``, ``bad``.

    ``bad`` is the share of the pixels with a lobe that end more than :data:`BAD` above the least.

    Raises
    ------
    TooFewError
        None has a lobe.
    """
    every = np.concatenate(list(shares))
    known = every[np.isfinite(every)]
    if not known.size:
        raise TooFewError(f"0 of {every.size} pixels have a lobe")
    median, p99 = np.percentile(known, (50.0, 99.0))
    return {"median": float(median), "p99": float(p99), "bad": float((known > BAD).mean())}


def _targets(stack: Stack, stereo: Normals) -> list[Target]:
    light = np.array([stack.linear(i) for i in range(len(stack.rig))], np.float64)
    if stack.saturation is not None:
        full = (stack.saturation - stack.black) * stack.scale
        light = np.minimum(light, full[:, None, None])
    light = light.reshape(*light.shape[:2], -1)
    sight = RigTable.of(stack.rig)
    albedo = stereo.albedo.astype(np.float64).mean(axis=0).ravel()
    targets = []
    pixels = zip(np.moveaxis(light, 2, 0), _normals(stereo), albedo, strict=True)
    for samples, normal, colour in pixels:
        grey = samples.mean(axis=1)
        weight = 1.0 / np.maximum(grey, FLOOR * samples.mean())
        shown = np.maximum(colour * (sight.diffuse(normal) + SHADE), 1e-30)
        lit = (grey + SHADE * colour) / shown
        weight *= np.minimum(np.maximum(lit, 0.0), 1.0) ** 3
        targets.append(Target(sight, grey, np.sqrt(weight)))
    return targets


def _normals(maps: LobeSbrdf | Normals) -> Array:
    """``(pixel, 3)``."""
    return np.asarray(maps.normal.reshape(3, -1).T, np.float64)


def _widths(fitted: LobeSbrdf) -> Array:
    """``(pixel,)`` half-width of the lobe, NaN where there is none."""
    return np.where(fitted.lobes == 1, fitted.gamma[0], np.nan).ravel().astype(np.float64)
