"""Alternation of surface and strengths of lamps, with or without the gauge held fixed.

Semi-calibrated photometric stereo [@cho2020semicalibrated] leaves freedoms that photographs of a
nearly flat, matte painting do not determine: ``g_k (n . l_k)`` stays when strengths take what a
tilt of all normals gives (the gauge; of the kind of the bas-relief ambiguity
[@belhumeur1999basrelief]), and a fall-off with the elevation of a lamp passes for the shape of the
reflectance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.fit.held_out import log_ratios
from impasto.rig import Rig
from impasto.stack import Stack
from impasto.status import Status

UNKNOWNS = 6
"""Of a pixel: normal (2), brightness, ambient light, and one lobe's strength and width. The factor
of a lamp is estimated from the mean of the bands, so that more bands add no samples."""
FEWEST = UNKNOWNS + 1
"""With fewer lights, strengths and surfaces cannot be separated."""
ROUNDS = 12
OUTLIER = math.log(2.0)
"""A fit of lobes finds no other lamp's factor while one lamp is off by more than this."""
_STILL = 0.005
_RELAXATION = 1.5
"""The fitted surface absorbs part of a wrong strength, so each round finds only a fraction of the
remaining error. Over-relaxation by less than 2 cannot diverge where this fraction is 0 to 1."""
_MEMORY = 3
"""Rounds that the acceleration uses: it removes as many slow modes at once."""
_RIDGE = 1e-3
"""Differences between rounds below this share of their mean square are noise."""
_MATTE_ROUNDS = 6
_CLEAR = 0.1
"""A shorter step does not change which lamps are outliers."""
_GRAZING = 0.05
"""Cosines below this count as this: the logarithm of a lamp at the horizon has no bound."""

Fit = Callable[[Stack], tuple[Any, Any, Any]]
"""Status ``(y, x)``, normal ``(3, y, x)`` and predicted samples ``(obs, band, y, x)`` of a fit."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Where an alternation ended.

    ``log`` ``(obs,)`` are the logarithms of the factors, median 0, 0 where not ``known``; ``step``
    is the last step; ``normal`` the mean normal of the last fit.
    """

    log: NDArray[np.float64]
    known: NDArray[np.bool_]
    step: NDArray[np.float64]
    normal: NDArray[np.float64]

    @property
    def converged(self) -> bool:
        """Whether the last step was short for every lamp."""
        return bool(np.abs(self.step).max() < _STILL)

    @property
    def factor(self) -> NDArray[np.float64]:
        """``(obs,)`` factors, 1 where nothing is known."""
        return np.asarray(np.where(self.known, np.exp(self.log), 1.0))


class Alternation:
    """Alternation between the surface under some strengths and the strengths that it leaves.

    Parameters
    ----------
    stack
        The sample of pixels with its lights.
    samples
        ``(obs, y, x)`` linear light, mean of the bands.
    glossy, matte
        Fits of the surface; ``matte`` finds lamps that are off by more than a factor of two.
    """

    def __init__(
        self, stack: Stack, samples: NDArray[Any], glossy: Fit, matte: Fit | None = None
    ) -> None:
        self._stack, self._samples = stack, samples
        self._glossy, self._matte = glossy, matte

    def outliers(self) -> NDArray[np.float64]:
        """Logarithms of the factors of lamps that are far off; 0 for the others."""
        search = _Search(np.zeros(len(self._samples)), relaxation=1.0)
        assert self._matte is not None
        for _ in range(_MATTE_ROUNDS):
            left, _ = self._left(self._matte, search.log)
            if np.abs(search.move(left)).max() < _CLEAR:
                break
        return np.where(np.abs(search.log) > OUTLIER, search.log, 0.0)

    def free(
        self, start: NDArray[np.float64], rounds: int, report: Callable[[], None] | None = None
    ) -> Found:
        """Strengths with nothing held, accelerated (Anderson mixing [@anderson1965])."""
        search = _Search(start, relaxation=_RELAXATION)
        step, normal = np.zeros(len(start)), np.zeros(3)
        for _ in range(rounds):
            if report is not None:
                report()
            left, normal = self._left(self._glossy, search.log)
            step = search.move(left)
            if np.abs(step).max() < _STILL:
                break
        return Found(search.log, search.known, step, normal)

    def held(
        self, start: NDArray[np.float64], rounds: int, report: Callable[[], None] | None = None
    ) -> Found:
        """Strengths with the mean normal and the fall-off with elevation held as at the start.

        Damped rounds without acceleration, which would run along what photographs do not determine.
        """
        lights = self._stack.rig.directions
        elevation = log_elevation(lights)
        log, known = start - np.median(start), np.ones(len(start), dtype=np.bool_)
        origin, usual = log, np.abs(log) <= OUTLIER
        step, normal, first = np.zeros(len(start)), np.zeros(3), None
        for _ in range(rounds):
            if report is not None:
                report()
            left, normal = self._left(self._glossy, log)
            known = np.isfinite(left)
            first = normal if first is None else first
            new = log + _RELAXATION * np.where(known, left, 0.0)
            new += log_cosine(lights, normal) - log_cosine(lights, first)
            new -= fall_off(new - origin, elevation, known & usual)
            new = np.where(known, new, 0.0)
            new -= np.where(known, np.median(new[known]), 0.0)
            step, log = new - log, new
            if np.abs(step).max() < _STILL:
                break
        return Found(log, known, step, normal)

    def _left(self, fit: Fit, log: NDArray[np.float64]) -> tuple[Any, Any]:
        """Logarithms of the factors that remain after a fit, and its mean normal."""
        count = len(self._samples)
        lit = self._stack._replace(rig=scaled(self._stack.rig, np.exp(log)))
        status, normal, expected = fit(lit)
        fine = status < Status.DARK
        _check_enough(int(fine.sum()), count)
        left = log_ratios(
            self._samples[:, fine], expected.mean(axis=1)[:, fine], lit.rig.intensities
        )
        lamps = int(np.isfinite(left).sum())
        if lamps < FEWEST:
            raise ArgumentError(
                f"stack: strengths need at least {FEWEST} lights that pixels determine, "
                f"found {lamps}"
            )
        _check_enough(int(fine.sum()), lamps)
        mean = normal[:, fine].mean(axis=1, dtype=np.float64)
        return left - np.nanmedian(left), mean / np.linalg.norm(mean)


def log_cosine(lights: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(obs,)`` logarithm of the cosine of incidence on a plane."""
    return np.log(np.maximum(lights @ normal, _GRAZING))


def log_elevation(lights: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(obs,)`` logarithm of the sine of the elevation above the picture."""
    return log_cosine(lights, np.array([0.0, 0.0, 1.0]))


def gauge(
    lights: NDArray[np.float64], normal: NDArray[np.float64], freedoms: NDArray[np.float64]
) -> NDArray[np.float64]:
    """``(obs,)`` logarithms of factors that photographs of a flat, matte painting leave open.

    Parameters
    ----------
    lights
        ``(obs, 3)`` directions.
    normal
        The mean normal that is tilted.
    freedoms
        Tilt along x and along y in radians, and the exponent of the fall-off with elevation.
    """
    tilted = normal + np.array([freedoms[0], freedoms[1], 0.0])
    tilted = tilted / np.linalg.norm(tilted)
    log = log_cosine(lights, tilted) - log_cosine(lights, normal)
    log += freedoms[2] * log_elevation(lights)
    return np.asarray(log - np.median(log))


def scaled(rig: Rig, factor: NDArray[np.float64]) -> Rig:
    """The rig with intensities times ``factor``."""
    lights = [
        replace(light, intensity=light.intensity * float(by))
        for light, by in zip(rig.lights, factor, strict=True)
    ]
    return rig.with_lights(lights)


def fall_off(
    log: NDArray[np.float64], elevation: NDArray[np.float64], usual: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """The part of ``log`` that is linear in the logarithm of the lamps' elevation."""
    if usual.sum() < FEWEST:
        return np.zeros(len(log))
    plane = np.column_stack([np.ones(len(log)), elevation])
    line = np.linalg.lstsq(plane[usual], log[usual], rcond=None)[0]
    return np.asarray((elevation - elevation[usual].mean()) * line[1])


class _Search:
    """Fixed-point search for the logarithms of strengths, with Anderson acceleration.

    Anderson acceleration (D. G. Anderson, Journal of the ACM 12, 1965) takes the step that would
    end the search if the remainders of the last rounds were linear in the strengths.
    """

    def __init__(self, log: NDArray[np.float64], relaxation: float) -> None:
        self.log = log - np.median(log)
        self.known = np.ones(len(log), dtype=np.bool_)
        self._relaxation = relaxation
        self._rounds: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []

    def move(self, left: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take and return the step for the logarithms that a round ``left``.

        NaN, no pixel determines this factor, takes no step; ``known`` is False there.
        """
        self.known = np.isfinite(left)
        left = np.where(self.known, left, 0.0)
        self._rounds = [*self._rounds[-_MEMORY:], (self.log, left)]
        step = self._relaxation * left
        if len(self._rounds) > 1:
            ways, changes = (np.diff(each, axis=0).T for each in zip(*self._rounds, strict=True))
            # Medians of pixels are noisy: two rounds in one direction must not weigh more than one.
            normal = changes.T @ changes
            normal += _RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal))
            mixed = np.linalg.lstsq(normal, changes.T @ left, rcond=None)[0]
            step = step - (ways + self._relaxation * changes) @ mixed
        before, self.log = self.log, self.log + step
        self.log -= np.median(self.log)
        return self.log - before


def _check_enough(pixels: int, lights: int) -> None:
    """Refuse too few pixels: samples must outnumber unknowns.

    Strengths are determined up to one common factor, so ``pixels * lights`` samples must be more
    than ``pixels * UNKNOWNS + lights - 1`` unknowns.
    """
    enough = math.ceil(lights / (lights - UNKNOWNS))
    if pixels < enough:
        raise ArgumentError(
            f"stack: strengths of {lights} lights need at least {enough} pixels that can be "
            f"fitted, found {pixels or 'none'}"
        )
