"""Refinement of a rig from the photographs themselves: self-calibration by cross-validation.

A camera or a lamp at a finite distance changes the direction of view or light from pixel to pixel;
lamps have strengths of their own. Bundle adjustment finds these numbers, and photographs held out
of the fit say which of them to keep (backward elimination).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import refractive_index, truth
from impasto._internal.waiting import wait_for_each
from impasto.errors import ArgumentError
from impasto.fit.bundle_adjustment import BundleAdjustment, Kind, RigNumbers
from impasto.fit.coordinate_search import coordinate_search
from impasto.fit.held_out import Comparison, HeldOut
from impasto.fit.rig_acceptance import chosen, with_strengths
from impasto.fit.rig_elimination import FAR, NONE, SPREAD, Elimination, without_far
from impasto.fit.rig_search import NEAREST
from impasto.fit.strength_search import HELPS, ROUNDS, Medians
from impasto.refinement import Estimate, RigRefinement
from impasto.rig import Rig, seen_from_front
from impasto.stack import Stack, checked_stack

_MANY_PIXELS = 2304
"""The sample of the last adjustment, whose noise stays in the rig."""
_WIDER = 1.25
"""Factor by which the last steps, from more pixels, may widen a spread that was accepted."""
_LOBES = 2
"""Of each pixel, where what is accepted is judged once more and strengths are found by medians."""
_LAST = 0.02
"""First step of the last search for distances."""
_FEWEST_PIXELS = 32
"""A few pixels, each with unknowns of its own, take a wrong rig as well as the right one."""
_RING = 0.1
"""Lamps whose sines of elevation differ by less, but for a tenth at either end, are one ring:
photographs held out are then lit like those fitted, and cannot tell a wrong rig."""


def refine_rig(
    stack: Stack,
    *,
    camera: bool = True,
    lamps: bool = True,
    strengths: bool = True,
    falloff: bool | None = None,
    index: float = 1.45,
    threads: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Rig:
    """Estimate distances of camera and lamps and strengths of lamps from the photographs.

    Light files give directions, as if camera and lamps were infinitely far. At a finite distance
    directions change over the painting, and the light of a lamp falls off; a fit that does not know
    bends its normals, like a bowl where the painting is glossy. Here surfaces with lobes of each
    pixel's own are fitted to half of the photographs (three quarters of fewer than 24), and
    predict the others. Distances, strengths and the surfaces are adjusted together by Gauss-Newton
    (bundle adjustment), because each hides errors of the other.

    What is estimated is accepted only if the trimmed error of photographs held out falls by 2 % or
    more against the best rig without it, and the gain exceeds three standard errors; or by 20 % and
    one. Strengths need 10 % and one, and where they differ by more than a factor of 8 a fall by 80
    %; against the best rig with even ones, its surfaces under a varnish or not. A distance is
    accepted only if also every fold improves by 1 % and agrees about it, and the opposite sign (all
    distances behind the painting) does not gain half as much; the least is half of the longer side.
    A camera's distance is judged again without the lamps' where that is not accepted. Errors below
    twice those of rounding fall for wrong reasons: there, strengths and a camera's distance need a
    fall by 20 %. Numbers that fail one by one are accepted together if the error falls by 2 % for
    each of them and the gain exceeds three standard errors (near those of rounding by 20 % and
    one), with the same conditions on distances; strengths then differ by a factor of 8 at most.
    What is not accepted stays as given, and all does unless photographs of other folds are
    predicted better by more than a standard error. Strengths that are accepted go through the
    rounds of medians of :func:`fit_strengths` where these predict better, except on metal. Surfaces
    are under a varnish where that predicts better; on metal their lobes have a shape in common that
    the photographs tell. One ring of lamps, and less than 32 pixels, tell nothing.

    Parameters
    ----------
    stack
        At least 10 photographs, better 24. Lights that are already near, and cameras that are,
        keep their distances; so does the camera where views differ.
    camera, lamps, strengths
        False keeps what was given.
    falloff
        Whether the light of near lamps falls off over the painting. Photographs of a white board
        cancel that; default: unless ``white=`` of :func:`~impasto.read_stack` divided by them.
    index
        As for :func:`fit_sbrdf`.
    threads
        None means every allowed core; the result does not depend on it, nor, up to some hundred
        lamps, on the threads of BLAS.
    progress
        True for a bar on stderr, or a callable ``(done, total)``.

    Returns
    -------
    Rig
        For this stack, and for other stacks of the same session: ``read_stack(..., lights=rig)``,
        ``Stack(..., lights=rig)``. ``refinement`` (:class:`RigRefinement`) says what was found,
        accepted and left open; printed in three lines. It is saved with a stack
        (:func:`impasto.io.write_stack`) and with results. New lamps have the distances and
        strengths of their neighbours (:meth:`Rig.at`), which :meth:`Sbrdf.predict` uses for plain
        directions. Lengths are in pixels, ``pitch_mm`` 1, if the width of a pixel is not known.

    Raises
    ------
    ArgumentError
        Fewer than 10 photographs, or no pixel that can be fitted.
    GeometryError
        Lights that cannot determine normals, or views from behind alone.

    Notes
    -----
    The mean normal and the fall-off with the elevation of lamps are held as given, unless the
    photographs determine them. The principal point and the tilt of the camera are not estimated.
    The sample is up to 256 pixels, for the last steps 2304; the rig of several paintings is best
    refined on the glossiest.
    """
    checked_stack(stack)
    switches = {"camera": camera, "lamps": lamps, "strengths": strengths}
    for name, value in switches.items():
        truth(value, name)
    falloff = not stack.divided_by_board if falloff is None else truth(falloff, "falloff")
    index = refractive_index(index)
    seen_from_front(stack.rig)
    if len(stack.rig) < _FEWEST_LIGHTS:
        raise ArgumentError(
            f"stack: a rig needs at least {_FEWEST_LIGHTS} photographs to be refined, "
            f"found {len(stack.rig)}"
        )
    search = _Decision(stack, camera, lamps, strengths, falloff, index, threads)
    try:
        with reporting(progress, "rig") as report:
            search.report = report
            rig = search.rig()
            search.finish()
    finally:
        search.left = True
    return rig


_FEWEST_LIGHTS = 10
"""Seven to fit and three to predict."""
BY_DEFAULT = 24
"""Photographs from which on fits refine the rig by themselves: with half of them held out, a
distance is found that fits to fewer miss."""


def refinable(rig: Rig) -> bool:
    """Whether fits refine a rig by themselves: new, with many photographs from one view."""
    # New lamps of a rig with several views have no view.
    one_view = bool((rig.views == rig.views[0]).all())
    return rig.refinement is None and len(rig) >= BY_DEFAULT and one_view


def refined(
    stack: Stack,
    refine: bool | None,
    *,
    open_choice: bool,
    index: float,
    threads: int | None,
    progress: bool | ProgressCallback = False,
) -> Stack:
    """A stack with its rig refined where a fit is to refine it.

    Parameters
    ----------
    refine
        As in :func:`impasto.fit_sbrdf`.
    open_choice
        Whether the fit decides by itself what suits the photographs.
    index, threads, progress
        As in :func:`refine_rig`.
    """
    if not (open_choice and refinable(stack.rig) if refine is None else truth(refine, "refine")):
        return stack
    try:
        rig = refine_rig(stack, index=index, threads=threads, progress=progress)
        return stack._replace(rig=rig)
    except ArgumentError:
        if refine:
            raise
        return stack  # no pixel can be fitted, as the statuses of the fit will say


class _Decision(Elimination):
    """What of a rig is accepted."""

    def rig(self) -> Rig:
        """The refined rig."""
        nothing = self.even()
        for folds in (self._folds, self._folds + 1):
            # Every second lamp stands in one plane.
            if (why := self._test.undetermined(self._given, folds)) is not None:
                return self._untouched(why)
        errors = self.errors(nothing)
        if not np.isfinite(errors.trim):
            raise ArgumentError("stack: no pixel can be fitted; impasto.doctor.examine says why")
        if not np.isfinite([errors.fold(one, self._folds) for one in range(self._folds)]).all():
            # Every second photograph is black.
            return self._untouched("a part of the photographs alone fits no pixel")
        fitted = errors.pixels(self._test.truth.shape[1])
        if fitted < _FEWEST_PIXELS:
            return self._untouched(f"{fitted} pixels that can be fitted are too few")
        low, high = np.quantile(self._given.directions[:, 2], (0.1, 0.9))
        if high - low < _RING:
            return self._untouched("lamps of one elevation do not show it")
        self._test = self._test.for_metal(self.at(nothing)).suited(self.at(nothing), self._folds)
        trim = self.errors(nothing).trim
        if trim <= self._test.rounded:
            return self._untouched(f"errors of {trim:.2f} codes are those of rounding")
        found = self.searched()
        first = chosen(found, self._test.rounded)
        left = self.together(with_strengths(found, first), self.eliminated(first))
        state, free = self._final(left.state, left.free, left.kind)
        reasons = [
            NONE if before and not after else why
            for before, after, why in zip(left.free, free, left.reasons, strict=True)
        ]
        total = self._total(state)
        if total.gain <= total.scatter and (free.any() or left.kind != "given"):
            return self._untouched(f"no better with two lobes per pixel: {total}")
        camera, lamps = (
            Estimate(_distance(state if taken else left.best, axis), bool(taken), reasons[axis])
            for axis, taken in enumerate(free)
        )
        strengths = left.strengths
        if strengths.accepted:
            strengths = replace(strengths, found=state.spread)
        estimates = (camera, lamps, strengths, self._half, total.gain, total.scatter)
        report = RigRefinement(*estimates, _open(left.kind), self._in_mm)
        untouched = not free.any() and left.kind == "given"
        return Rig(self._stack.rig if untouched else self.at(state), refinement=report)

    def _final(
        self, state: RigNumbers, free: NDArray[np.bool_], kind: Kind
    ) -> tuple[RigNumbers, NDArray[np.bool_]]:
        """The accepted numbers, from more pixels, by the error of photographs held out."""
        if kind == "given" and not free.any():
            return state, free
        many = HeldOut(
            self._stack,
            _MANY_PIXELS,
            index=self._index,
            threads=self._threads,
            surfaces=self._test.surfaces,
        )
        adjustment = BundleAdjustment(many, self.at, self._given.directions, self._threads)
        found = adjustment.solve(state, free, kind, nearest=NEAREST, folds=self._folds)

        def trim(place: NDArray[np.float64]) -> float:
            return many.errors(self.at(replace(found, place=place)), self._folds).trim

        before = many.errors(self.at(state), self._folds).trim
        if kind == "given":
            # Photographs held out have strengths of their own, which makes up for a part of what
            # the model does not describe.
            place, after = coordinate_search(
                trim,
                found.place,
                np.where(free, _LAST, 0.0),
                low=np.zeros(2),
                high=np.full(2, NEAREST),
            )
            found = replace(found, place=place)
        else:
            after = trim(found.place)
        most = max(SPREAD, _WIDER * state.spread)
        if after <= before and found.spread <= most:
            state = found
        if kind != "given":
            state = self._by_medians(state, kind, most)
        return without_far(state, free)

    def _by_medians(self, state: RigNumbers, kind: Kind, most: float) -> RigNumbers:
        """The numbers with strengths by rounds of medians, where these predict better.

        ``most``: the largest spread of strengths.

        They do where one lobe does not describe the highlights, which bend strengths: medians of
        what two lobes leave are bent less. Those of 576 or 2304 pixels were no better. On metal,
        whose lobes have a shape of their own, two lobes without it bend strengths again.
        """
        if self._test.surfaces == "shaped":
            return state
        given = self.at(replace(state, log=np.zeros_like(state.log)))
        medians = Medians(self._test, given, _LOBES, self._threads)
        try:
            rounds = medians.rounds(state.log, ROUNDS, self._tick, held=kind == "held")
        except ArgumentError:
            return state  # two lobes fit too few pixels, or too few lamps show any
        moved = replace(state, log=np.where(rounds.known, rounds.log, state.log))
        if moved.spread > most:
            return state
        after, before = wait_for_each(
            lambda one: self._test.errors(self.at(one), self._folds, _LOBES),
            [moved, state],
            self._count,
        )
        return moved if after.than(before).fall > HELPS else state

    def _total(self, state: RigNumbers) -> Comparison:
        """Gain over the rig as given: other folds, two lobes per pixel."""
        rigs, folds = (self.at(state), self._given), self._folds + 1
        after, before = wait_for_each(
            lambda rig: self._test.errors(rig, folds, _LOBES), rigs, self._count
        )
        return after.than(before)

    def _untouched(self, why: str) -> Rig:
        """The rig as given, and why."""
        camera, lamps = (
            Estimate(math.inf, False, why if free else reason)
            for free, reason in zip(self._free, self._why, strict=True)
        )
        strengths = Estimate(1.0, False, why if self._strengths else "not estimated")
        report = RigRefinement(
            camera, lamps, strengths, self._half, 0.0, 0.0, _open("given"), self._in_mm
        )
        return Rig(self._stack.rig, refinement=report)


def _distance(state: RigNumbers, axis: int) -> float:
    place = state.place
    return 1.0 / float(place[axis]) if place[axis] >= FAR else math.inf


def _open(strengths: Kind) -> tuple[str, ...]:
    always = ("overall strength", "axis of the camera")
    if strengths == "free":
        return always
    return ("tilt of the painting", "fall-off of strengths with elevation", *always)
