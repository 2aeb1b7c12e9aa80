"""Semi-calibrated photometric stereo [@cho2020semicalibrated], accelerated [@anderson1965].

It estimates the strengths of lamps that were not measured, by alternation with Anderson
acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, refractive_index
from impasto.errors import ArgumentError
from impasto.fit.lobes import fit_lobes, lobe_count
from impasto.fit.normals import fit_normals
from impasto.fit.subsample import subsampled_to
from impasto.rig import Light, Rig
from impasto.stack import Stack, checked_stack
from impasto.status import Status
from impasto.surface import Surface

UNKNOWNS = 6
"""Of a pixel: normal (2), brightness, ambient light, and one lobe's strength and width. The factor
of a lamp is estimated from the mean of the bands, so that more bands add no samples."""
FEWEST = UNKNOWNS + 1
"""With fewer lights, strengths and surfaces cannot be separated."""

_PIXELS = 10_000
_ROUNDS = 12
_STILL = 0.005
_CHANGED, _FEW = 0.01, 0.1
"""A few lamps that still change by more than one per cent do no harm: on the icon, where they are 4
of 72, twelve more rounds change the normals by less than 0.1 degrees (median)."""
_RELAXATION = 1.5
"""The fitted surface absorbs part of a wrong strength, so each round finds only a fraction of the
remaining error. Over-relaxation by less than 2 cannot diverge where this fraction is 0 to 1."""
_MEMORY = 3
"""Rounds that the acceleration uses: it removes as many slow modes at once."""
_RIDGE = 1e-3
"""Differences between rounds below this share of their mean square are noise."""
_MATTE_ROUNDS = 6
_OUTLIER = np.log(2.0)
"""A fit of lobes finds no other lamp's factor while one lamp is off by more than this."""
_CLEAR = 0.1
"""A shorter step does not change which lamps are outliers."""
_NAMED = 8
"""Photographs that a message lists by their numbers."""
_DIM = 0.2
"""Share of a pixel's mean light below which shadows affect a sample more than the lamp does."""


@dataclass(frozen=True, eq=False, repr=False)
class Strengths:
    """Strengths of the lamps of a stack.

    Attributes
    ----------
    factor
        ``(obs,)`` float64: the strength of each light relative to its ``intensity``; the median
        is 1. NaN where no pixel determines it: the photograph is black or missing wherever its lamp
        should show.
    rig
        The lights with these strengths as intensities. A lamp without a factor keeps the intensity
        that was given.
    stack
        The photographs with these lights: what to fit.
    converged
        Whether the last step, extrapolated from the rounds before it, changed every factor by less
        than 0.5 %. The remaining error is then mostly that of the model, and it is larger with
        fewer lamps. On simulated paintings with log-normal strengths (0.3) the worst lamp was off
        by 1 to 10 % of 24 lamps, 5 to 23 % of twelve, and 12 to 45 % of seven to nine; with even
        lamps by 0.5 to 2 %. Where it is False, see ``change``: a few lamps that have not converged
        do little harm. If they are more than a tenth, give more ``rounds``, or call
        :func:`fit_strengths` again with ``stack``, which continues from there.
    change
        ``(obs,)`` relative change of each factor in the last round: 0.01 is one per cent. NaN where
        no pixel determines the factor.
    """

    factor: NDArray[np.float64]
    rig: Rig
    stack: Stack
    converged: bool
    change: NDArray[np.float64]

    def at(self, lights: ArrayLike | Sequence[Light] | Rig) -> Rig:
        """Other lights with the strengths that lamps in their directions gave.

        A thin-plate spline over the stereographic coordinates ``(x, y) / (1 + z)`` of the
        directions interpolates the logarithms of the factors; it is clipped to the range of the
        factors. Plain x and y would squeeze low lamps together, so that one odd lamp near the
        rim bends the spline far beyond its neighbours. This predicts a strength that depends on
        the place of the lamp (an arm of a dome, a distance that varied), not one that flickers.

        Parameters
        ----------
        lights
            ``(obs, 3)`` directions, a sequence of lights, or a :class:`~impasto.Rig`.

        Returns
        -------
        Rig
            The same lights, their intensities times the interpolated factors.
        """
        rig = Rig(lights)
        known = np.isfinite(self.factor)
        log = np.log(self.factor[known])
        places = _stereographic(self.rig.directions[known])
        found = _thin_plate(places, log, _stereographic(rig.directions))
        return _scaled(rig, np.exp(np.clip(found, log.min(), log.max())))

    def __repr__(self) -> str:
        low, high = np.nanmin(self.factor), np.nanmax(self.factor)
        return f"<Strengths of {len(self.rig)} lights, {low:.2f} to {high:.2f}{self.state}>"

    @property
    def state(self) -> str:
        """What is in doubt: lamps without a factor, and how much the others still changed.

        Empty if every lamp has a factor and the search converged.
        """
        return self._changing + self._unknown

    @property
    def _unknown(self) -> str:
        these = np.flatnonzero(np.isnan(self.factor))
        if len(these) == 0:
            return ""
        numbers = ", ".join(map(str, these[:_NAMED])) + (", ..." if len(these) > _NAMED else "")
        return (
            f", {len(these)} of which no pixel determines (photographs {numbers}: black or missing "
            "where their lamps should show): leave them out"
        )

    @property
    def _changing(self) -> str:
        if self.converged:
            return ""
        size = np.abs(self.change[np.isfinite(self.change)])
        many = int((size > _CHANGED).sum())
        most = f"{100 * size.max():.1f} %"
        if many == 0:
            return f", which the last round still changed by up to {most}: they have converged"
        few = many <= _FEW * len(size)
        return (
            f", {many} of which the last round still changed by more than {100 * _CHANGED:g} % "
            f"(up to {most}): "
            + (
                "the others have converged"
                if few
                else "fit_strengths(lamps.stack) continues from here"
            )
        )


def fit_strengths(
    stack: Stack,
    *,
    lobes: int = 2,
    index: float = 1.45,
    rounds: int = _ROUNDS,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Strengths:
    """Estimate the strength of each photograph's light where it was not measured.

    Lamps of a dome differ, the distance of a lamp held by hand varies, and exposures are changed.
    The strength of a light is the factor that all pixels of its photograph have in common, relative
    to what the surface should show. Two steps alternate: the surface is fitted under the current
    lamps (lobes of each pixel's own, :func:`fit_sbrdf` with ``pooling="pixel"``), then the factor
    of each lamp is the median of sample / predicted sample over the pixels that it lights without
    clipping. About 10,000 pixels spread over the painting are used. The error shrinks slowly where
    the surface absorbs it (a tilt absorbs strengths that grow to one side), so each step is
    extrapolated from the last rounds (Anderson acceleration). The search ends when such a step is
    short. Lamps that are off by more than a factor of two are found first, with a matte surface.

    Photographs of a white board measure the same directly and more accurately (``white=`` of
    :func:`~impasto.read_stack`): here every error of the surface model under a light goes into its
    factor, and on a painting without relief a tilt absorbs strengths that grow to one side.

    Parameters
    ----------
    stack
        At least 7 photographs, better 24: see ``converged``.
    lobes, index
        As for :func:`fit_sbrdf`.
    rounds
        The most rounds, at least 1; one takes about as long as a fit of 10,000 pixels.
    threads
        None means every allowed core; the result does not depend on it.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Returns
    -------
    Strengths
        Fit its ``stack``.

    Raises
    ------
    ArgumentError
        Fewer than 7 lights, or fewer than 7 that any pixel determines; or so few pixels that can be
        fitted that, with one lobe each, the unknowns are as many as the samples: fewer than seven
        pixels under seven lights, fewer than two under twelve or more.

    Notes
    -----
    Semi-calibrated photometric stereo (Cho, Matsushita, Tai and Kweon, CVPR 2016) by alternation,
    with highlights in the model and medians instead of sums; accelerated as by Anderson (JACM 12,
    1965).
    """
    checked_stack(stack)
    lobes, index = lobe_count(lobes), refractive_index(index)
    if not (is_whole(rounds) and rounds >= 1):
        raise ArgumentError(f"rounds: expected a number from 1 on, found {rounds!r}")
    count = len(stack.rig)
    if count < FEWEST:
        raise ArgumentError(
            f"stack: strengths need at least {FEWEST} lights, found {count}; "
            "photograph a white board under each light (white=)"
        )
    few = subsampled_to(stack, _PIXELS)
    samples = np.array([few.linear(photograph) for photograph in range(count)]).mean(axis=1)

    def matte(lit: Stack) -> tuple[Any, Any]:
        found = fit_normals(lit, threads=threads)
        surface = Surface(found.normal, found.albedo, index=index, origin=lit.rig.origin)
        return found.status, surface.predict(lit.rig, threads=threads)

    def glossy(lit: Stack) -> tuple[Any, Any]:
        found = fit_lobes(
            lit,
            fit_normals(lit, threads=threads),
            lobes=lobes,
            ambient=True,
            index=index,
            threads=threads,
            progress=False,
        )
        return found.status, found.predict(threads=threads)

    def remaining(fit: Callable[[Stack], tuple[Any, Any]], log: NDArray[np.float64]) -> Any:
        """The logarithms of the factors that remain after a fit under some strengths."""
        lit = few._replace(rig=_scaled(few.rig, np.exp(log)))
        status, expected = fit(lit)
        fine = status < Status.DARK
        _check_enough(int(fine.sum()), count)
        left = _ratios(samples[:, fine], expected.mean(axis=1)[:, fine], lit.rig.intensities)
        lamps = int(np.isfinite(left).sum())
        if lamps < FEWEST:
            raise ArgumentError(
                f"stack: strengths need at least {FEWEST} lights that pixels determine, "
                f"found {lamps}"
            )
        _check_enough(int(fine.sum()), lamps)
        return left - np.nanmedian(left)

    search = _Search(np.zeros(count), relaxation=1.0)
    for _ in range(_MATTE_ROUNDS):
        if np.abs(search.move(remaining(matte, search.log))).max() < _CLEAR:
            break
    outliers = np.abs(search.log) > _OUTLIER
    search = _Search(np.where(outliers, search.log, 0.0), relaxation=_RELAXATION)
    step, converged = np.zeros(count), False
    with reporting(progress, "strengths") as report:
        for done in range(rounds):
            if report is not None:
                report(done, rounds)
            step = search.move(remaining(glossy, search.log))
            converged = bool(np.abs(step).max() < _STILL)
            if converged:
                break
        if report is not None:
            report(rounds, rounds)
    factor: NDArray[np.float64] = np.where(search.known, np.exp(search.log), np.nan)
    factor /= np.nanmedian(factor)
    rig = _scaled(stack.rig, np.where(search.known, factor, 1.0))
    return Strengths(
        factor=factor,
        rig=rig,
        stack=stack._replace(rig=rig),
        converged=converged,
        change=np.where(search.known, np.expm1(step), np.nan),
    )


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


def _ratios(
    samples: NDArray[Any], expected: NDArray[Any], intensities: NDArray[np.float64]
) -> NDArray[np.float64]:
    """``(obs,)`` logarithms of the lamps' factors; NaN where no pixel determines one."""
    even = expected / intensities[:, None]
    dim = _DIM * even.mean(axis=0)
    log = np.full(len(samples), np.nan)
    for photograph, (sample, one) in enumerate(zip(samples, expected, strict=True)):
        usable = np.isfinite(sample) & (sample > 0.0) & (even[photograph] > dim)
        if usable.any():
            log[photograph] = float(np.median(np.log(sample[usable] / one[usable])))
    return log


def _scaled(rig: Rig, factor: NDArray[np.float64]) -> Rig:
    """The rig with intensities times ``factor``."""
    lights = [
        replace(light, intensity=light.intensity * float(by))
        for light, by in zip(rig.lights, factor, strict=True)
    ]
    return rig.with_lights(lights)


def _stereographic(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(n, 2)`` stereographic coordinates: a hemisphere becomes the unit disc, angles stay."""
    height = np.maximum(1.0 + directions[:, 2:], np.finfo(np.float32).eps)
    return np.asarray(directions[:, :2] / height)


def _thin_plate(
    places: NDArray[np.float64], values: NDArray[np.float64], others: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Thin-plate spline through ``values`` at other places: ``sum w r^2 log r`` plus a plane."""

    def bend(of: NDArray[np.float64]) -> NDArray[np.float64]:
        square = ((of[:, None] - places) ** 2).sum(axis=2)
        return np.asarray(0.5 * square * np.log(np.where(square > 0.0, square, 1.0)))

    def plane(of: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([np.ones(len(of)), of])

    corner = np.zeros((3, 3))
    system = np.block([[bend(places), plane(places)], [plane(places).T, corner]])
    # Least squares: two lights in one direction have the mean of their strengths.
    weights = np.linalg.lstsq(system, np.concatenate([values, np.zeros(3)]), rcond=None)[0]
    return np.asarray(np.hstack([bend(others), plane(others)]) @ weights)
