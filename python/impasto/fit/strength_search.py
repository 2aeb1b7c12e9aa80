"""Strengths of lamps by medians of ratios, in semi-calibrated photometric stereo.

The freedoms that photographs leave open [@cho2020semicalibrated] are in
:mod:`impasto.fit.gauge`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto.errors import ArgumentError
from impasto.fit.gauge import fall_off, log_cosine, log_elevation
from impasto.fit.held_out import HeldOut, log_ratios
from impasto.rig import Rig

UNKNOWNS = 6
"""Of a pixel: normal (2), brightness, ambient light, and one lobe's strength and width. The factor
of a lamp is estimated from the mean of the bands, so that more bands add no samples."""
FEWEST = UNKNOWNS + 1
"""With fewer lights, strengths and surfaces cannot be separated."""
ROUNDS = 12
OUTLIER = math.log(2.0)
"""A fit of lobes finds no other lamp's factor while one lamp is off by more than this."""
HELPS = 0.01
"""Share by which rounds of medians must lower the trimmed error: on a gilded icon they do by 4 to
9 %, on simulated paintings with a free gauge by 0.6 % at most (``python
benches/python/strength_errors.py``), while strengths drift along what is not determined."""
_STILL = 0.005
_RELAXATION = 1.5
"""The fitted surface absorbs part of a wrong strength, so each round finds only a fraction of the
remaining error. Over-relaxation by less than 2 cannot diverge where this fraction is 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Rounds:
    """Where rounds ended.

    ``log`` ``(obs,)`` are the logarithms of the factors, median 0, 0 where not ``known``; ``step``
    is the last step.
    """

    log: NDArray[np.float64]
    known: NDArray[np.bool_]
    step: NDArray[np.float64]

    @property
    def converged(self) -> bool:
        """Whether the last step was short for every lamp."""
        return bool(np.abs(self.step).max() < _STILL)


class Medians:
    """Rounds of medians: the surface under some strengths, then the strengths that it leaves.

    Medians of sample / predicted sample count dim photographs and highlights that no lobe describes
    as least squares do not. They move slowly, because the surface follows a wrong strength: bundle
    adjustment says where to start.

    Parameters
    ----------
    test
        The sample of pixels.
    rig
        The lights as given.
    lobes, threads
        As for :func:`impasto.fit_sbrdf`.
    """

    def __init__(self, test: HeldOut, rig: Rig, lobes: int, threads: int | None) -> None:
        self._test, self._rig = test, rig
        self._lobes, self._threads = lobes, threads

    def known(self) -> NDArray[np.bool_]:
        """``(obs,)`` lamps that some pixel determines.

        Raises
        ------
        ArgumentError
            Lamps or pixels are too few for strengths.
        """
        return np.asarray(np.isfinite(self._left(np.zeros(len(self._rig)))[0]))

    def rounds(
        self, start: NDArray[np.float64], most: int, report: Callable[[], None], *, held: bool
    ) -> Rounds:
        """Strengths after rounds that end where a step is short.

        Where the gauge is ``held``, the mean normal and the fall-off with elevation stay as they
        are under the given strengths, but for lamps that are far off.
        """
        lights = self._rig.directions
        elevation = log_elevation(lights)
        usual = np.abs(start) <= OUTLIER
        origin = np.where(usual, 0.0, start)
        first = self._left(origin)[1] if held else np.zeros(3)
        log, known, step = start, usual, np.zeros(len(start))
        for _ in range(most):
            report()
            left, normal = self._left(log)
            known = np.isfinite(left)
            new = log + _RELAXATION * np.where(known, left, 0.0)
            if held:
                new += log_cosine(lights, normal) - log_cosine(lights, first)
                new -= fall_off(new - origin, elevation, known & usual, FEWEST)
            new = np.where(known, new - np.median(new[known]), 0.0)
            step, log = new - log, new
            if np.abs(step).max() < _STILL:
                break
        return Rounds(log, known, np.where(known, step, 0.0))

    def _left(self, log: NDArray[np.float64]) -> tuple[Any, Any]:
        """Logarithms of the factors that remain after a fit, and its mean normal."""
        lit = self._test.lit(scaled(self._rig, np.exp(log)))
        found = self._test.surface(lit, self._lobes)
        pixels = int(found.fine.sum())
        _check_enough(pixels, len(log))
        shown = found.shown(lit.rig, self._threads).mean(axis=1)
        left = log_ratios(
            self._test.samples[:, found.fine], shown[:, found.fine], lit.rig.intensities
        )
        lamps = int(np.isfinite(left).sum())
        if lamps < FEWEST:
            raise ArgumentError(
                f"stack: strengths need at least {FEWEST} lights that pixels determine, "
                f"found {lamps}"
            )
        _check_enough(pixels, lamps)
        return left - np.nanmedian(left), found.mean_normal


def scaled(rig: Rig, factor: NDArray[np.float64]) -> Rig:
    """The rig with intensities times ``factor``."""
    lights = [
        replace(light, intensity=light.intensity * float(by))
        for light, by in zip(rig.lights, factor, strict=True)
    ]
    return rig.with_lights(lights)


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
