"""Semi-calibrated photometric stereo [@cho2020semicalibrated], accelerated [@anderson1965].

It estimates the strengths of lamps that were not measured, by alternation with Anderson
acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, one_of, refractive_index
from impasto._internal.thin_plate import over_directions
from impasto.errors import ArgumentError
from impasto.fit.coordinate_search import coordinate_search
from impasto.fit.held_out import Comparison, Errors, HeldOut, fold_count
from impasto.fit.lobes import fit_lobes, lobe_count
from impasto.fit.normals import fit_normals
from impasto.fit.strength_search import (
    FEWEST,
    ROUNDS,
    Alternation,
    Found,
    scaled,
)
from impasto.fit.strength_search import gauge as gauge_of
from impasto.fit.subsample import subsampled_to
from impasto.rig import Light, Rig
from impasto.stack import Stack, checked_stack
from impasto.surface import Surface

Gauge = Literal["auto", "held", "free"]
"""What is held while strengths are estimated."""

_PIXELS = 10_000
_TESTED = 1000
"""Pixels of the test on photographs held out."""
_FOLDS = 3
_FALL, _ERRORS = 0.02, 2.0
"""The trimmed error must fall by this share, and the gain exceed so many standard errors."""
_DETERMINED = 0.1
"""The same share where photographs determine tilt and fall-off: gloss lowers it by a fifth and
more (simulated paintings, strengths 0.5 to 1.5), matte paint and a gilded icon by up to 5 %."""
_PASSES, _FIRST, _LATER = 6, 0.01, 0.002
"""Searches of tilt and fall-off, each followed by rounds, and by how much the first and each later
one must help."""
_STEPS = np.array([0.04, 0.04, 0.1])
_FARTHEST = np.array([0.5, 0.5, 1.5])
"""Tilts in radians and the exponent of the fall-off: steps and limits of their search."""
_CHANGED, _FEW = 0.01, 0.1
"""A few lamps that still change by more than one per cent do no harm: on the icon, where they are 4
of 72, twelve more rounds change the normals by less than 0.1 degrees (median)."""
_NAMED = 8
"""Photographs that a message lists by their numbers."""


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
    gauge
        What was found. ``"given"``: other strengths do not predict photographs that were held out
        better, every factor is 1. ``"held"``: strengths, with the mean normal and the fall-off with
        elevation as the given lamps say. ``"determined"``: gloss determined these as well.
        ``"free"``: nothing was held and nothing tested.
    held_out
        The gain by strengths on photographs that were held out; None if there was no test.
    """

    factor: NDArray[np.float64]
    rig: Rig
    stack: Stack
    converged: bool
    change: NDArray[np.float64]
    gauge: str = "free"
    held_out: Comparison | None = None

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
        found = over_directions(self.rig.directions[known], log, rig.directions)
        return scaled(rig, np.exp(found))

    def __repr__(self) -> str:
        low, high = np.nanmin(self.factor), np.nanmax(self.factor)
        return f"<Strengths of {len(self.rig)} lights, {low:.2f} to {high:.2f}{self.state}>"

    @property
    def state(self) -> str:
        """What is in doubt: whether others help, lamps without a factor, how much still changed.

        Empty if every lamp has a factor and the search converged.
        """
        return self._untouched + self._changing + self._unknown

    @property
    def _untouched(self) -> str:
        if self.gauge != "given":
            return ""
        if self.held_out is None:
            return ", as given: too few lights to hold any out"
        return f", as given: others do not predict photographs held out better ({self.held_out})"

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
    gauge: Gauge = "auto",
    lobes: int = 2,
    index: float = 1.45,
    rounds: int = ROUNDS,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Strengths:
    """Estimate the strength of each photograph's light where it was not measured.

    Lamps of a dome differ, the distance of a lamp held by hand varies, and exposures are changed.
    The strength of a light is the factor that all pixels of its photograph have in common, relative
    to what the surface should show. Two steps alternate: the surface is fitted under the current
    lamps (lobes of each pixel's own, :func:`fit_sbrdf` with ``pooling="pixel"``), then the factor
    of each lamp is the median of sample / predicted sample over the pixels that it lights without
    clipping. About 10,000 pixels spread over the painting are used. Lamps that are off by more than
    a factor of two are found first, with a matte surface.

    Photographs of a matte, nearly flat painting do not separate strengths from a tilt of all its
    normals, nor from a fall-off with the elevation of lamps. By default these are held as the given
    lamps say, unless gloss determines them; and strengths are accepted only if they predict
    photographs that were held out better, by more than their scatter (``gauge``).

    Photographs of a white board measure the same directly and more accurately (``white=`` of
    :func:`~impasto.read_stack`): here every error of the surface model under a light goes into its
    factor, and on a painting without relief a tilt absorbs strengths that grow to one side.

    Parameters
    ----------
    stack
        At least 7 photographs, better 24: see ``converged``.
    gauge
        What is held. ``"auto"`` (default): the mean normal and the fall-off with elevation;
        strengths are accepted if, in three folds, surfaces fitted under them predict photographs
        that were held out better: the trimmed mean of the coded errors falls by 2 % or more, and
        the mean gain in dB exceeds twice its standard error. The strength of each photograph held
        out is its own median of sample / predicted sample, or else that of its neighbours
        (:meth:`Strengths.at`). Then tilt and fall-off are searched with the former, and kept if
        they lower the error by a tenth. ``"held"``: the same without any test. ``"free"``: nothing
        is held or tested; each step is extrapolated from the last rounds.
    lobes, index
        As for :func:`fit_sbrdf`.
    rounds
        The most rounds, at least 1; one takes about as long as a fit of 10,000 pixels. The tests of
        ``"auto"`` take about as long as the rounds.
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
    with highlights in the model and medians instead of sums; ``"free"`` is accelerated as by
    Anderson (JACM 12, 1965).
    """
    checked_stack(stack)
    one_of(gauge, get_args(Gauge), "gauge")
    lobes, index = lobe_count(lobes), refractive_index(index)
    if not (is_whole(rounds) and rounds >= 1):
        raise ArgumentError(f"rounds: expected a number from 1 on, found {rounds!r}")
    count = len(stack.rig)
    if count < FEWEST:
        raise ArgumentError(
            f"stack: strengths need at least {FEWEST} lights, found {count}; "
            "photograph a white board under each light (white=)"
        )
    return strengths_of(
        stack,
        gauge,
        lobes=lobes,
        index=index,
        rounds=rounds,
        threads=threads,
        progress=progress,
    )


def strengths_of(
    stack: Stack,
    gauge: Gauge,
    *,
    lobes: int = 2,
    index: float,
    rounds: int = ROUNDS,
    threads: int | None,
    progress: bool | ProgressCallback = False,
) -> Strengths:
    """:func:`fit_strengths` of checked arguments.

    The surfaces are under a varnish where that predicts photographs held out better.
    """
    count = len(stack.rig)
    folds = fold_count(count, FEWEST, _FOLDS) if gauge == "auto" else 0
    test = HeldOut(stack, _TESTED, index=index, threads=threads)
    if folds:
        test = test.suited(stack.rig, folds)
    few = subsampled_to(stack, _PIXELS)
    samples = np.array([few.linear(photograph) for photograph in range(count)]).mean(axis=1)

    def matte(lit: Stack) -> tuple[Any, Any, Any]:
        found = fit_normals(lit, threads=threads)
        surface = Surface(found.normal, found.albedo, index=index, origin=lit.rig.origin)
        return found.status, found.normal, surface.predict(lit.rig, threads=threads)

    def glossy(lit: Stack) -> tuple[Any, Any, Any]:
        found = fit_lobes(
            lit,
            fit_normals(lit, threads=threads),
            lobes=lobes,
            ambient=True,
            coated=test.coated,
            index=index,
            threads=threads,
            progress=False,
        )
        return found.status, found.normal, found.predict(threads=threads)

    alternation = Alternation(few, samples, glossy, matte)
    start = alternation.outliers()
    total = rounds * (folds + 1)
    with reporting(progress, "strengths") as report:
        passed = 0

        def tick() -> None:
            nonlocal passed
            if report is not None:
                report(passed, total)
            passed += 1

        if gauge == "free":
            found, held_out, how = alternation.free(start, rounds, tick), None, "free"
        else:
            found, held_out, how = alternation.held(start, rounds, tick), None, "held"
        if gauge == "auto":
            trial = _Trial(test, stack.rig, glossy, lobes, folds, rounds, tick)
            gains = trial.gains(start)
            held_out = next((one for one in gains if one.better(_FALL, _ERRORS)), None)
            how = "given" if held_out is None else "held"
            if held_out is None and gains:
                held_out = gains[0]
            if how == "held":
                moved = found
                for pass_ in range(_PASSES):
                    log = trial.gauge(moved, first=pass_ == 0)
                    if log is None:
                        break
                    moved = alternation.held(log, rounds)
                if trial.better(moved, found):
                    how, found = "determined", moved
        if report is not None:
            report(total, total)
    factor: NDArray[np.float64] = np.where(found.known, np.exp(found.log), np.nan)
    factor /= np.nanmedian(factor)
    if how == "given":
        factor = np.where(found.known, 1.0, np.nan)
    rig = scaled(stack.rig, np.where(found.known, factor, 1.0))
    return Strengths(
        factor=factor,
        rig=rig,
        stack=stack._replace(rig=rig),
        converged=found.converged or how == "given",
        change=np.where(found.known, np.expm1(found.step), np.nan),
        gauge=how,
        held_out=held_out,
    )


class _Trial:
    """What photographs held out say about strengths."""

    def __init__(
        self,
        test: HeldOut,
        rig: Rig,
        glossy: Callable[[Stack], tuple[Any, Any, Any]],
        lobes: int,
        folds: int,
        rounds: int,
        tick: Callable[[], None],
    ) -> None:
        self._test, self._rig, self._glossy = test, rig, glossy
        self._lobes, self._folds, self._rounds, self._tick = lobes, folds, rounds, tick

    def gains(self, start: NDArray[np.float64]) -> list[Comparison]:
        """Gains by strengths estimated from the other photographs; none with too few lights.

        The first where each photograph held out has a strength of its own, the second where it has
        that of its neighbours: :meth:`Strengths.at`.
        """
        if not self._folds:
            return []
        lit = self._test.lit(self._rig)
        count, stacks = len(self._rig), []
        for fold in range(self._folds):
            held = np.arange(fold, count, self._folds)
            seen = np.setdiff1d(np.arange(count), held)
            part = Alternation(lit.take(seen), self._test.samples[seen], self._glossy)
            try:
                found = part.held(start[seen], self._rounds, self._tick)
            except ArgumentError:  # too few pixels or lamps without these photographs
                return []
            log, towards = np.log(found.factor), self._rig.directions
            factor = np.ones(count)
            factor[seen] = found.factor
            factor[held] = np.exp(over_directions(towards[seen], log, towards[held]))
            stacks.append(lit._replace(rig=scaled(lit.rig, factor)))
        before = self._test.errors_of([lit] * self._folds, self._lobes)
        after = self._test.errors_of(stacks, self._lobes)
        return [one.than(other) for one, other in zip(after, before, strict=True)]

    def gauge(self, found: Found, *, first: bool) -> NDArray[np.float64] | None:
        """Factors' logarithms with the tilt and fall-off that lower the error, or None.

        Two folds: three numbers of the whole painting are chosen.
        """
        lights = self._rig.directions

        def log(freedoms: NDArray[np.float64]) -> NDArray[np.float64]:
            return found.log + gauge_of(lights, found.normal, freedoms)

        def errors(freedoms: NDArray[np.float64]) -> Errors:
            return self._errors(log(freedoms), found.known)

        best, _ = coordinate_search(
            lambda freedoms: errors(freedoms).trim,
            np.zeros(3),
            _STEPS if first else 0.25 * _STEPS,
            low=-_FARTHEST,
            high=_FARTHEST,
        )
        gain = errors(best).than(errors(np.zeros(3)))
        return log(best) if gain.fall > (_FIRST if first else _LATER) else None

    def better(self, moved: Found, found: Found) -> bool:
        """Whether gloss determines the tilt and fall-off that were moved."""
        after, before = (self._errors(one.log, one.known) for one in (moved, found))
        return after.than(before).better(_DETERMINED, _ERRORS)

    def _errors(self, log: NDArray[np.float64], known: NDArray[np.bool_]) -> Errors:
        factor = np.where(known, np.exp(log), 1.0)
        return self._test.errors(scaled(self._rig, factor), 2, self._lobes)
