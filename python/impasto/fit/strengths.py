"""Strengths of lamps that were not measured: semi-calibrated photometric stereo.

Cho et al. [@cho2020semicalibrated] alternate between surface and strengths. Here bundle adjustment
[@triggs2000bundle] changes both together, rounds of medians of ratios follow, and photographs held
out say what to keep.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import is_whole, one_of, refractive_index
from impasto._internal.thin_plate import over_directions
from impasto.errors import ArgumentError
from impasto.fit.bundle_adjustment import BundleAdjustment, Kind, RigNumbers
from impasto.fit.held_out import Comparison, HeldOut, fold_count
from impasto.fit.lobes import lobe_count
from impasto.fit.rig_acceptance import Found, chosen, strengths_differ, suited
from impasto.fit.strength_search import FEWEST, HELPS, ROUNDS, Medians, Rounds, scaled
from impasto.lights import Light
from impasto.rig import Rig
from impasto.stack import Stack, checked_stack

Gauge = Literal["auto", "held", "free"]
"""What is held while strengths are estimated."""

_PIXELS, _MANY_PIXELS = 576, 2304
"""The samples: of bundle adjustment and test, and of the medians."""
_FOLDS = 3
_PLACED = np.zeros(2, dtype=np.bool_)
"""No distance is free."""
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
        Whether the last round of medians changed every factor by less than 0.5 %. The remaining
        error is then mostly that of the model, and it is larger with fewer lamps. On simulated
        paintings with log-normal strengths (0.3) the worst lamp was off by 1 % of 24 lamps, 1 to
        2 % of twelve, and 1 to 3 % of eight. Where it is False, see ``change``: a few lamps that
        have not converged do little harm. If they are more than a tenth, give more ``rounds``.
    change
        ``(obs,)`` relative change of each factor in the last round, also where the rounds did not
        help: 0.01 is one per cent. NaN where no pixel determines the factor.
    gauge
        What was found. ``"given"``: other strengths do not predict photographs that were held out
        better, every factor is 1. ``"held"``: strengths, with the mean normal and the fall-off with
        elevation as the given lamps say. ``"determined"``: gloss determined these as well.
        ``"free"``: nothing was held, as asked for.
    held_out
        The gain by strengths on photographs that were held out; None if nothing was to be decided.
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
    to what the surface should show. Bundle adjustment, as in :func:`refine_rig`, changes strengths
    and the surfaces of 576 pixels together. Rounds of medians follow: surfaces are fitted under
    these strengths (lobes of each pixel's own, without the painting's prior), then the factor of
    each lamp is the median of sample / predicted sample over the pixels that it lights without
    clipping, 2304 spread over the painting. The rounds count only where they predict photographs
    that are held out better by 1 %, as they do where the model does not describe the highlights.

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
        What is held. ``"auto"`` (default): strengths are accepted as in :func:`refine_rig`, if in
        three folds photographs that were held out are predicted better: the trimmed mean of the
        coded errors falls by 2 % and the mean gain in dB exceeds three standard errors, or by 10 %
        and one; where errors are near those of rounding, only by 20 % and one. The mean normal and
        the fall-off with elevation are held unless free ones lower the error by 10 % and one
        standard error more. A photograph that is held out has a strength of its own, its median of
        sample / predicted sample. ``"held"``, ``"free"``: one of them without this decision.
    lobes, index
        As for :func:`fit_sbrdf`.
    rounds
        The most rounds of medians, at least 1; one takes about as long as a fit of 2304 pixels.
    threads
        None means every allowed core; the result does not depend on it.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Returns
    -------
    Strengths
        Fit its ``stack``. From 24 photographs on the default of :func:`fit_sbrdf` refines the rig,
        strengths included; ``refine=False`` keeps these, for which :meth:`Strengths.at` is right.

    Raises
    ------
    ArgumentError
        Fewer than 7 lights, or fewer than 7 that any pixel determines; or so few pixels that can be
        fitted that, with one lobe each, the unknowns are as many as the samples: fewer than seven
        pixels under seven lights, fewer than two under twelve or more.

    Notes
    -----
    Semi-calibrated photometric stereo (Cho, Matsushita, Tai and Kweon, CVPR 2016) by bundle
    adjustment (Triggs, McLauchlan, Hartley and Fitzgibbon, 2000), with highlights in the model, and
    medians instead of sums.
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
    total, passed = (rounds + 1) * (2 if gauge == "auto" else 1), 0
    with reporting(progress, "strengths") as report:

        def tick() -> None:
            nonlocal passed
            if report is not None:
                report(passed, total)
            passed += 1

        search = _Search(stack, lobes, index, threads, rounds, tick)
        known = search.known()
        best, gain = search.accepted() if gauge == "auto" else (search.found(gauge), None)
        if report is not None:
            report(total, total)
    how, log, step, converged = "given", np.zeros(count), np.zeros(count), True
    if best is not None:
        how = "determined" if gauge == "auto" and best.found.kind == "free" else best.found.kind
        known, log = best.rounds.known, best.found.state.log
        step, converged = best.rounds.step, best.rounds.converged
    factor: NDArray[np.float64] = np.where(known, np.exp(log), np.nan)
    factor /= np.nanmedian(factor)
    rig = scaled(stack.rig, np.where(known, factor, 1.0))
    return Strengths(
        factor=factor,
        rig=rig,
        stack=stack._replace(rig=rig),
        converged=converged,
        change=np.where(known, np.expm1(step), np.nan),
        gauge=how,
        held_out=gain,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """Strengths, and the rounds of medians that led to them or did not help."""

    found: Found
    rounds: Rounds


class _Search:
    """Strengths under each hypothesis about their gauge.

    Surfaces are under a varnish, or on metal have lobes of a shape of their own, where that
    predicts photographs held out better.
    """

    def __init__(
        self,
        stack: Stack,
        lobes: int,
        index: float,
        threads: int | None,
        rounds: int,
        tick: Callable[[], None],
    ) -> None:
        rig = stack.rig
        self._folds = fold_count(len(rig), FEWEST, _FOLDS)
        # Surfaces of a draft left 6 % in a strength of 8 lamps on which these leave 3 %.
        test = HeldOut(stack, _PIXELS, index=index, threads=threads, effort="standard")
        if self._folds:
            test = test.for_metal(rig).suited(rig, self._folds)
        many = HeldOut(
            stack,
            _MANY_PIXELS,
            index=index,
            threads=threads,
            surfaces=test.surfaces,
            effort="standard",
        )
        self._test, self._rig, self._lobes = test, rig, lobes
        self._medians = Medians(many, rig, lobes, threads)
        self._adjustment = BundleAdjustment(test, self._at, rig.directions, threads)
        self._most, self._tick = rounds, tick

    def known(self) -> NDArray[np.bool_]:
        """``(obs,)`` lamps that some pixel determines; refuses what is too little."""
        return self._medians.known()

    def found(self, kind: Kind) -> _Candidate:
        """The strengths of one kind.

        Rounds of medians count where they predict photographs held out better, or none can be
        held out.
        """
        self._tick()
        even = RigNumbers(np.zeros(2), np.zeros(len(self._rig)))
        start = self._adjustment.solve(even, _PLACED, kind, nearest=0.0)
        rounds = self._medians.rounds(start.log, self._most, self._tick, held=kind == "held")
        before, after = (
            self._judged(state, kind, self._test)
            for state in (start, RigNumbers(start.place, rounds.log))
        )
        helped = not self._folds or after.errors.than(before.errors).fall > HELPS
        return _Candidate(after if helped else before, rounds)

    def accepted(self) -> tuple[_Candidate | None, Comparison | None]:
        """What photographs held out accept, None for the strengths as given; and the gain."""
        if not self._folds:
            return None, None
        nothing = RigNumbers(np.zeros(2), np.zeros(len(self._rig)))
        even = [
            self._judged(nothing, "given", test) for test in (self._test, self._test.otherwise())
        ]
        rival = min(even, key=suited(even[0])).errors
        free = self.found("free")
        gain = free.found.errors.than(rival)
        if not strengths_differ(gain, self._test.rounded):
            return None, gain
        held = self.found("held")
        best = chosen([*even, held.found, free.found], self._test.rounded)
        for one in (held, free):
            if one.found is best:
                return one, best.errors.than(rival)
        return None, held.found.errors.than(rival)

    def _judged(self, state: RigNumbers, kind: Kind, test: HeldOut) -> Found:
        return Found(state, kind, test, test.errors(self._at(state), self._folds, self._lobes))

    def _at(self, state: RigNumbers) -> Rig:
        return scaled(self._rig, np.exp(state.log))
