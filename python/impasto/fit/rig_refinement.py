"""Refinement of a rig from the photographs themselves: self-calibration by cross-validation.

A camera or a lamp at a finite distance changes the direction of view or light from pixel to pixel.
Which distance is right shows in photographs that were held out of the fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import ProgressCallback, reporting
from impasto._internal.checks import refractive_index, truth
from impasto.errors import ArgumentError
from impasto.fit.coordinate_search import coordinate_search
from impasto.fit.held_out import Comparison, Errors, HeldOut
from impasto.fit.strength_search import FEWEST, Alternation, gauge
from impasto.fit.strengths import Strengths, strengths_of
from impasto.refinement import Estimate, RigRefinement
from impasto.rig import DistantLight, Light, PointLight, PointView, Rig, Views
from impasto.stack import Stack, checked_stack

_PIXELS = 576
"""The sample: 36 clusters of 4 x 4 pixels, spread evenly, each with its own directions."""
_FOLDS, _MANY, _FOLDS_OF_FEW = 2, 24, 4
"""Half of the photographs are held out at a time; of fewer than 24, a quarter."""
_NODES = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
"""Inverse distances of camera and lamps at which the search starts, per half of the longer side."""
_COARSE = (np.array([0.0, 0.2, 0.4]), np.array([0.0, 0.15, 0.3, 0.45]))
"""The same where strengths are estimated anew at every node."""
_UNEVEN = 0.1
"""Strengths that lower the error by this share hide distances: they must be estimated together."""
_STEP, _FINE = 0.05, 0.02
_NEAREST = 0.6
_FAR = 0.02
"""An inverse distance below this counts as 0: directions differ by a degree."""
_DISTANT = 1e-6
"""An inverse distance below this, which a parabola may find, is none in single precision."""
_STILL = 0.002
"""Inverse distances and strengths take turns until the distances move by less than this."""
_ROUNDS = 10
_PASSES = 3
_FALL, _CERTAIN = 0.02, 3.0
"""For a distance the trimmed error must fall by this share, and the gain exceed so many standard
errors. On metal, whose lobes fit worst, a wrong camera gained 2.6 of them."""
_MUCH, _LIKELY = 0.2, 1.0
"""Or these: with a camera wrong by its own distance, a few photographs scatter the gain."""
_DETERMINED, _ERRORS = 0.1, 1.0
"""The same where gloss is to determine tilt and fall-off; see ``fit.strengths``."""
_LITTLE = 0.01
"""A search of tilt and fall-off that lowers the error by less is the last."""
_SPREAD = 8.0
"""Strengths that differ by more are not accepted: domes have factors of 2 to 5. On metal, which
shows most lamps as black, wrong ones of 10 and more predict better by chance."""
_CODES = 1.2
"""Below this root mean square error, in codes of 8 bits, a camera's distance is read from rounding:
errors fall while normals become worse."""
_MIRRORED = 0.5
"""Share of the fall that a rig of the opposite sign may reach."""
_STEPS = np.array([0.04, 0.04, 0.1])
_FARTHEST = np.array([0.5, 0.5, 1.5])

Point = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Inverse distances of camera and lamps, and logarithms of strengths.

    ``determined``: gloss has determined the tilt and fall-off of the strengths.
    """

    place: Point
    log: NDArray[np.float64]
    determined: bool = False


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
    predict the others: the distances that predict best are found on a grid over both together, then
    by parabolas. Strengths (:func:`fit_strengths`) and distances alternate, because each hides the
    other.

    A distance is accepted only if the trimmed error falls by 2 % or more and the gain exceeds three
    standard errors, or 20 % and one; if all folds improve and agree about it, and the opposite sign
    (the same distances behind the painting) does not do as well. A camera's distance also needs
    errors above 1.2 codes of 8 bits without it: matte paint shows none, and its errors fall for
    wrong reasons. What is not accepted stays as given. Surfaces are under a varnish where that
    predicts better.

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
        None means every allowed core; the result does not depend on it.
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

    Notes
    -----
    The mean normal and the fall-off with the elevation of lamps are held as given, unless gloss
    determines them. The principal point and the tilt of the camera are not estimated. The sample is
    576 pixels; the rig of several paintings is best refined on the glossiest.
    """
    checked_stack(stack)
    switches = {"camera": camera, "lamps": lamps, "strengths": strengths}
    for name, value in switches.items():
        truth(value, name)
    falloff = not stack.divided_by_board if falloff is None else truth(falloff, "falloff")
    index = refractive_index(index)
    if len(stack.rig) < _FEWEST_LIGHTS:
        raise ArgumentError(
            f"stack: a rig needs at least {_FEWEST_LIGHTS} photographs to be refined, "
            f"found {len(stack.rig)}"
        )
    search = _Search(stack, camera, lamps, strengths, falloff, index, threads)
    with reporting(progress, "rig") as report:
        search.report = report
        return search.rig()


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


class _Search:
    """The search of one rig."""

    def __init__(
        self,
        stack: Stack,
        camera: bool,
        lamps: bool,
        strengths: bool,
        falloff: bool,
        index: float,
        threads: int | None,
    ) -> None:
        rig = stack.rig
        height, width = stack.shape[2:]
        pitch = 1.0 if rig.pitch_mm is None else rig.pitch_mm
        self._given = Rig(rig, pitch_mm=pitch)
        self._stack, self._index, self._threads = stack, index, threads
        self._half = 0.5 * pitch * max(height, width)
        self._falloff, self._strengths = falloff, strengths and len(rig) > FEWEST
        one_view = bool((rig.views == rig.views[0]).all()) and not rig.near_views.any()
        self._free = np.array([camera and one_view, lamps and not rig.near.any()])
        self._why = (
            "not requested" if not camera else "given as near or with views that differ",
            "not requested" if not lamps else "given as near",
        )
        self._folds = _FOLDS if len(rig) >= _MANY else _FOLDS_OF_FEW
        self._test = HeldOut(stack, _PIXELS, index=index, threads=threads)
        self._known: dict[bytes, Errors] = {}
        self.report: Callable[[int, int], object] | None = None
        self._done = 0

    # --- one candidate

    def at(self, state: _State) -> Rig:
        """The rig of a state, for the whole painting."""
        u, w = np.where(state.place < _DISTANT, 0.0, state.place).tolist()
        lights: list[Light] = []
        for light, factor in zip(self._given.lights, np.exp(state.log).tolist(), strict=True):
            strength = light.intensity * factor
            if isinstance(light, DistantLight) and w > 0.0:
                x, y, z = (self._half / w * np.array(light.direction)).tolist()
                lights.append(PointLight((x, y, z), strength, self._falloff))
            else:
                lights.append(replace(light, intensity=strength))
        views: Views = self._given.viewpoints
        if u > 0.0:
            x, y, z = (self._half / u * self._given.views[0]).tolist()
            views = PointView((x, y, z))
        place: dict[str, Any] = {"pitch_mm": self._given.pitch_mm, "origin": self._given.origin}
        return Rig(lights, views=views, **place)

    def errors(self, state: _State) -> Errors:
        """Errors of photographs held out."""
        key = state.place.tobytes() + state.log.tobytes()
        if key not in self._known:
            self._known[key] = self._test.errors(self.at(state), self._folds)
            self._done += 1
            if self.report is not None:
                # The number of candidates is not known: the bar approaches its end.
                self.report(self._done, self._done + 2 * len(_NODES) ** 2)
        return self._known[key]

    # --- parts of the search

    def grid(self) -> _State:
        """The best node of the joint grid, with strengths as given or, if uneven, of its own."""
        states = [self.even(place) for place in self._nodes(_NODES, _NODES)]
        best = min(states, key=lambda state: self.errors(state).trim)
        lit = self.lit(best)
        if self.errors(lit).trim > (1.0 - _UNEVEN) * self.errors(best).trim:
            return best
        states = [self.lit(self.even(place)) for place in self._nodes(*_COARSE)]
        return min([lit, *states], key=lambda state: self.errors(state).trim)

    def searched(self) -> _State:
        """The best state, tested with surfaces that suit it: under a varnish or not.

        Strengths can stand for what a varnish keeps back: where they are uneven, both kinds of
        surface are tried with strengths of their own.
        """
        free, first = self._free.copy(), self._test
        state = self.best(self.grid(), free)
        suited = first.suited(self.at(state), self._folds)
        if suited is first and not self._uneven(state):
            return state
        before, known = self.errors(self.alternated(state)), self._known
        self._take(first.otherwise())
        other = self.best(self.even(state.place) if suited is first else self.grid(), free)
        if self.errors(self.alternated(other)).trim < before.trim:
            return other
        self._test, self._known = first, known
        return state

    def _take(self, test: HeldOut) -> None:
        if test is not self._test:
            self._test, self._known = test, {}

    def _nodes(self, *axes: Point) -> list[Point]:
        u, w = (axis if free else axis[:1] for axis, free in zip(axes, self._free, strict=True))
        return [np.array([a, b]) for a in u for b in w]

    def agree(self, state: _State, axis: int) -> bool:
        """Whether the best distance of each fold, along one axis, is next to that of both."""
        places = []
        for node in [*_NODES, state.place[axis]]:
            place = state.place.copy()
            place[axis] = node
            places.append(place)
        found = [self.errors(replace(state, place=place)) for place in places]
        for fold in range(self._folds):
            alone = places[int(np.argmin([one.fold(fold, self._folds) for one in found]))]
            if abs(alone[axis] - state.place[axis]) > _NODES[1]:
                return False
        return True

    def distances(self, state: _State, step: float = _STEP, halvings: int = 1) -> _State:
        """The best distances near those of a state."""
        place, _ = coordinate_search(
            lambda place: self.errors(replace(state, place=place)).trim,
            state.place,
            np.where(self._free, step, 0.0),
            low=np.zeros(2),
            high=np.full(2, _NEAREST),
            halvings=halvings,
        )
        return replace(state, place=place)

    def even(self, place: Point) -> _State:
        """A place with the strengths as given."""
        return _State(place, np.zeros(len(self._given)))

    def lit(self, state: _State) -> _State:
        """Strengths at a place, from those of the state; tilt and fall-off are held."""
        if not self._strengths:
            return state
        start = self._held(state)
        if start is None:
            return state
        return start if self.errors(start).trim < self.errors(state).trim else state

    def _held(self, state: _State) -> _State | None:
        lit = self._test.lit(self.at(replace(state, log=0.0 * state.log)))

        def glossy(stack: Stack) -> tuple[Any, Any, Any]:
            found = self._test.surface(stack)
            return found.status, found.normal, found.predict(threads=self._threads)

        try:
            self._found = Alternation(lit, self._test.samples, glossy).held(state.log, _ROUNDS)
        except ArgumentError:
            return None
        return replace(state, log=np.where(self._found.known, self._found.log, 0.0))

    def best(self, start: _State, free: NDArray[np.bool_]) -> _State:
        """Distances (those that are ``free``) and strengths that predict best, in turn."""
        before, self._free = self._free, free
        state = replace(start, place=np.where(free, start.place, 0.0))
        for _ in range(_PASSES):
            last = state
            state = self.distances(self.lit(state))
            if np.abs(state.place - last.place).max() < 0.5 * _FAR:
                break
        self._free = before
        return state

    def alternated(self, state: _State) -> _State:
        """Strengths with their gauge, and the distances that the state has, in turn."""
        before, self._free = self._free, state.place > 0.0
        for _ in range(_PASSES):
            last = state
            state = self.distances(self.gauged(self.lit(state)), _FINE, halvings=2)
            if np.abs(state.place - last.place).max() < _STILL:
                break
        self._free = before
        return state

    def gauged(self, state: _State) -> _State:
        """The state with the tilt and fall-off that gloss determines, if it does."""
        moved = state
        for _ in range(_PASSES if state.log.any() else 0):
            tilted = self._tilted(moved)
            if self.errors(tilted).than(self.errors(moved)).fall < _LITTLE:
                break
            moved = self._held(tilted) or tilted
        gain = self.errors(moved).than(self.errors(state))
        return replace(moved, determined=True) if gain.better(_DETERMINED, _ERRORS) else state

    def _tilted(self, state: _State) -> _State:
        """The state with the tilt and fall-off that predict best."""
        lights, normal = self._given.directions, self._found.normal

        def moved(freedoms: NDArray[np.float64]) -> _State:
            return replace(state, log=state.log + gauge(lights, normal, freedoms))

        best, _ = coordinate_search(
            lambda freedoms: self.errors(moved(freedoms)).trim,
            np.zeros(3),
            _STEPS,
            low=-_FARTHEST,
            high=_FARTHEST,
            halvings=1,
        )
        return moved(best)

    # --- the decision

    def rig(self) -> Rig:
        """The refined rig."""
        allowed = self._free.copy()
        nothing = self.even(np.zeros(2))
        if not np.isfinite(self.errors(nothing).trim):
            raise ArgumentError("stack: no pixel can be fitted; impasto.doctor.examine says why")
        self._take(self._test.suited(self.at(nothing), self._folds))
        trim = self.errors(nothing).trim
        if trim <= self._test.rounded:
            return self._untouched(f"errors of {trim:.2f} codes are those of rounding")
        state = self.searched()
        found = state.place.copy()
        reasons = list(self._why)
        for axis in (0, 1):
            if not allowed[axis]:
                continue
            accepted, reasons[axis] = self._judge(axis, state)
            if not accepted:
                allowed[axis] = False
                if state.place[axis] > 0.0:
                    state = self.best(self.even(state.place), allowed)
        place = np.where(allowed & (state.place >= _FAR), state.place, 0.0)
        best = self.gauged(self.lit(self.even(np.zeros(2))))
        if place.any():
            near = self.alternated(replace(state, place=place))
            found = np.where(place > 0.0, near.place, found)
            # Strengths alone may do as well: they hide distances, and distances hide them.
            gain = self.errors(near).than(self.errors(best))
            if not _convincing(gain):
                reasons = [
                    f"strengths alone do as well: {gain}" if place[axis] > 0.0 else reasons[axis]
                    for axis in (0, 1)
                ]
            else:
                best = near
        place = best.place
        rig, lamps = self._with_strengths(best)
        strengths = _strengths(lamps, self._strengths)
        if strengths.accepted and strengths.found > _SPREAD:
            why = f"they would differ by a factor of {strengths.found:.0f}, more than lamps do"
            strengths, lamps = Estimate(strengths.found, False, why), None
            rig = self._distant_or_near(best)
        total = self._gain(rig, self._given)
        report = RigRefinement(
            camera=Estimate(_inverse(found[0]), bool(place[0] > 0.0), reasons[0]),
            lamps=Estimate(_inverse(found[1]), bool(place[1] > 0.0), reasons[1]),
            strengths=strengths,
            half_mm=self._half,
            gain=total.gain,
            scatter=total.scatter,
            open=_open(lamps),
        )
        if self.report is not None:
            self.report(self._done, self._done)
        return Rig(rig, refinement=report)

    def _untouched(self, why: str) -> Rig:
        """The rig as given, and why."""
        camera, lamps = (
            Estimate(math.inf, False, why if free else reason)
            for free, reason in zip(self._free, self._why, strict=True)
        )
        strengths = Estimate(1.0, False, why if self._strengths else "not estimated")
        report = RigRefinement(camera, lamps, strengths, self._half, 0.0, 0.0, _open(None))
        return Rig(self._stack.rig, refinement=report)

    def _distant_or_near(self, state: _State) -> Rig:
        """The rig with the distances of a state and strengths as given."""
        return self.at(self.even(state.place)) if state.place.any() else self._stack.rig

    def _with_strengths(self, state: _State) -> tuple[Rig, Strengths | None]:
        """The rig with these distances, and the strengths that :func:`fit_strengths` gives it."""
        rig = self._distant_or_near(state)
        if not self._strengths:
            return rig, None
        try:
            lamps = strengths_of(
                self._stack._replace(rig=rig),
                "auto",
                index=self._index,
                threads=self._threads,
                start=state.log,
                determined=state.determined,
                coated=self._test.coated,
            )
        except ArgumentError:  # too few lamps that any pixel determines
            return rig, None
        return lamps.rig, lamps

    def _judge(self, axis: int, state: _State) -> tuple[bool, str]:
        """Whether a distance is accepted, and why."""
        if state.place[axis] < _FAR:
            return False, "the photographs show none"
        others = self._free.copy()
        others[axis] = False
        far = self.best(self.even(state.place), others)
        if self._uneven(state):
            far = min(far, self.best(state, others), key=lambda one: self.errors(one).trim)
        with_it, without = self.errors(state), self.errors(far)
        gain = with_it.than(without)
        if not _convincing(gain):
            return False, f"no better: {gain}"
        folds = [
            with_it.fold(one, self._folds) < (1.0 - 0.5 * _FALL) * without.fold(one, self._folds)
            for one in range(self._folds)
        ]
        if not (all(folds) and self.agree(state, axis)):
            return False, f"parts of the photographs disagree: {gain}"
        if axis == 0 and without.rms < _CODES:
            return False, f"errors of {without.rms:.1f} codes are too small to show one"
        rotated, nowhere = self._test.rotated(), replace(state, place=np.zeros(2))
        mirrored = rotated.errors(self.at(state), self._folds).than(
            rotated.errors(self.at(nowhere), self._folds)
        )
        if mirrored.fall > _MIRRORED * with_it.than(self.errors(nowhere)).fall:
            return False, f"the opposite sign does as well: {mirrored}"
        return True, str(gain)

    def _uneven(self, state: _State) -> bool:
        return bool(np.abs(state.log).max() > 0.0)

    def _gain(self, rig: Rig, before: Rig) -> Comparison:
        """Of one rig against another, other folds, lobes as they are fitted."""
        folds = self._folds + 1
        return self._test.errors(rig, folds, 2).than(self._test.errors(before, folds, 2))


def _convincing(gain: Comparison) -> bool:
    return gain.better(_FALL, _CERTAIN) or gain.better(_MUCH, _LIKELY)


def _inverse(place: float) -> float:
    return 1.0 / float(place) if place >= _FAR else math.inf


def _strengths(lamps: Strengths | None, requested: bool) -> Estimate:
    if lamps is None:
        return Estimate(1.0, False, "too few lights" if requested else "not estimated")
    spread = float(np.nanmax(lamps.factor) / np.nanmin(lamps.factor))
    reason = "too few lights to hold any out" if lamps.held_out is None else str(lamps.held_out)
    return Estimate(spread, lamps.gauge != "given", reason)


def _open(lamps: Strengths | None) -> tuple[str, ...]:
    always = ("overall strength", "axis of the camera")
    if lamps is not None and lamps.gauge == "determined":
        return always
    return ("tilt of the painting", "fall-off of strengths with elevation", *always)
