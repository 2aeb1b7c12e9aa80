"""The search for the numbers of a rig: hypotheses, each from some starts, side by side.

A hypothesis says which numbers are free and what surfaces are like; bundle adjustment finds the
numbers under it, and photographs held out say which hypothesis is best. On several threads those
that may be asked for later are tried beside those that are asked for: the rig is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock, get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impasto._internal.calls import thread_count
from impasto._internal.checks import LEAST, MOST
from impasto._internal.waiting import wait_for_each
from impasto.fit.bundle_adjustment import BundleAdjustment, Kind, RigNumbers
from impasto.fit.held_out import RECENT, Comparison, Errors, HeldOut, Surfaces
from impasto.fit.rig_acceptance import Found, chosen, strengths_differ
from impasto.lights import DistantLight, Light, PointLight, near_lamp
from impasto.rig import PointView, Rig, Views
from impasto.stack import Stack

_PIXELS = 256
"""The most pixels of the sample, spread evenly, each with its own directions. 576 accepted the same
numbers of 30 simulated rigs (``benches/python/rigs.py``) and, but for the strengths of one, of 26
panels (``path_traced.py``), and were no nearer to the truth on average."""
_FOLDS, _MANY, _FOLDS_OF_FEW = 2, 24, 4
"""Half of the photographs are held out at a time; of fewer than 24, a quarter."""
NODES = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
"""Inverse distances of camera and lamps at which the search starts, per half of the longer side."""
NEAREST = 1.0
"""The largest inverse distance: what reaches it is not accepted."""
_DISTANT = 1e-6
"""An inverse distance below this is none in single precision."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A hypothesis about a rig: what is free, the surfaces, and where the search starts."""

    starts: tuple[RigNumbers, ...]
    free: NDArray[np.bool_]
    strengths: Kind
    test: HeldOut


class RigSearch:
    """The search of one rig.

    Parameters
    ----------
    stack, camera, lamps, strengths, falloff, index, threads
        As in :func:`impasto.refine_rig`.
    """

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
        self._given, self._in_mm = Rig(rig, pitch_mm=pitch), rig.known_pitch_mm is not None
        self._stack, self._index, self._threads = stack, index, threads
        self._half = 0.5 * pitch * max(height, width)
        self._falloff, self._strengths = falloff, strengths
        one_view = bool((rig.views == rig.views[0]).all()) and not rig.near_views.any()
        self._free = np.array([camera and one_view, lamps and not rig.near.any()])
        self._why = [
            "not requested" if not camera else "given as near or with views that differ",
            "not requested" if not lamps else "given as near",
        ]
        self._folds = _FOLDS if len(rig) >= _MANY else _FOLDS_OF_FEW
        self._test = HeldOut(stack, _PIXELS, index=index, threads=threads)
        self._known: dict[tuple[Surfaces, bytes, bytes], Errors] = {}
        self._recent = _rigs(self._given, self._half, falloff)
        self.left = False
        """Whether the caller has left: what is still tried ends at its next rig."""
        self.report: Callable[[int, int], object] | None = None
        self._done, self._caller = 0, get_ident()
        self._counting = Lock()
        self._count = thread_count(threads)

    # --- one candidate

    def at(self, state: RigNumbers) -> Rig:
        """The rig of some numbers, for the whole painting."""
        if self.left:
            raise CancelledError
        return self._recent(state)

    def errors(self, state: RigNumbers, test: HeldOut | None = None) -> Errors:
        """Errors of photographs held out; ``test``: with other surfaces than those at hand."""
        test = self._test if test is None else test
        key = (test.surfaces, state.place.tobytes(), state.log.tobytes())
        if key not in self._known:
            self._known[key] = test.errors(self.at(state), self._folds)
            self._tick()
        return self._known[key]

    def each(self, states: Sequence[RigNumbers], test: HeldOut) -> list[Errors]:
        """The same of many, on all threads."""
        return wait_for_each(
            lambda state: self.errors(state, test), states, self._count, self._tell
        )

    def gain(self, state: RigNumbers, before: RigNumbers) -> Comparison:
        """Of one candidate against another."""
        return self.errors(state).than(self.errors(before))

    def even(self, u: float = 0.0, w: float = 0.0) -> RigNumbers:
        """Inverse distances of camera and lamps, with the strengths as given."""
        return RigNumbers(np.array([u, w]), np.zeros(len(self._given)))

    def finish(self) -> None:
        """Report that all is done."""
        if self.report is not None:
            self.report(self._done, self._done)

    def _tick(self) -> None:
        with self._counting:
            self._done += 1
        # Callables are called on the caller's thread.
        if get_ident() == self._caller:
            self._tell()

    def _tell(self) -> None:
        if self.report is not None and get_ident() == self._caller:
            # The number of candidates is not known: the bar approaches its end.
            self.report(self._done, self._done + 2 * len(NODES) ** 2)

    # --- parts of the search

    def adjusted(self, hypothesis: Hypothesis) -> RigNumbers:
        """The numbers under one hypothesis that predict best, of those found from its starts."""
        test = hypothesis.test
        adjustment = BundleAdjustment(test, self.at, self._given.directions, self._threads)
        distinct: dict[bytes, RigNumbers] = {}
        for one in hypothesis.starts:
            log = np.zeros_like(one.log) if hypothesis.strengths == "given" else one.log
            start = RigNumbers(np.where(hypothesis.free, one.place, 0.0), log)
            distinct.setdefault(start.place.tobytes() + log.tobytes(), start)
        found: list[RigNumbers] = []
        for start in distinct.values():
            known = tuple(found)
            found.append(
                adjustment.solve(
                    start, hypothesis.free, hypothesis.strengths, nearest=NEAREST, known=known
                )
            )
            self._tick()
        return min(found, key=lambda state: self.errors(state, test).trim)

    def found(self, hypothesis: Hypothesis) -> Found:
        """The best numbers under one hypothesis."""
        return self._with(self.adjusted(hypothesis), hypothesis.strengths, hypothesis.test)

    def all_found(
        self, hypotheses: Sequence[Hypothesis], ahead: Sequence[Hypothesis] = ()
    ) -> tuple[list[Found], list[Found | None]]:
        """The same of several, on all threads; and of some that may be asked for later.

        The latter on more threads than one, else None. An error of theirs is raised where they are
        asked for, not here.
        """

        def tried(hypothesis: Hypothesis) -> Found | None:
            with suppress(Exception):
                return self.found(hypothesis)
            return None

        def step(pair: tuple[Hypothesis, bool]) -> Found | None:
            hypothesis, now = pair
            return self.found(hypothesis) if now else tried(hypothesis)

        later = [(one, False) for one in ahead] if self._count > 1 else []
        pairs = [*((one, True) for one in hypotheses), *later]
        found = wait_for_each(step, pairs, self._count, self._tell)
        now = [one for one in found[: len(hypotheses)] if one is not None]
        return now, found[len(hypotheses) :] or [None] * len(ahead)

    def _with(self, state: RigNumbers, strengths: Kind, test: HeldOut) -> Found:
        return Found(state, strengths, test, self.errors(state, test))

    def placed(self, test: HeldOut) -> RigNumbers:
        """The best distances with the strengths as given."""
        axes = (NODES if free else NODES[:1] for free in self._free)
        u, w = (axis.tolist() for axis in axes)
        nodes = [self.even(one, other) for one in u for other in w]
        trims = [errors.trim for errors in self.each(nodes, test)]
        best = nodes[int(np.argmin(trims))]
        near = self.adjusted(Hypothesis((best,), self._free, "given", test))
        return min(best, near, key=lambda state: self.errors(state, test).trim)

    def explained(self, test: HeldOut, start: RigNumbers | None = None) -> list[Found]:
        """The best numbers with strengths as given, and with uneven ones where these differ."""
        kinds: list[Kind] = ["free"] if self._strengths else []
        if start is None:
            even = self._with(self.placed(test), "given", test)
            starts: tuple[RigNumbers, ...] = (even.state, self.even())
            found = [even]
        else:
            starts, found = (start,), []
            kinds.insert(0, "given")
        now = [Hypothesis(starts, self._free, kind, test) for kind in kinds]
        held = Hypothesis(starts, self._free, "held", test)
        if not self._strengths:
            return found + self.all_found(now)[0]
        more, (third,) = self.all_found(now, [held])
        even, free = found + more
        if not strengths_differ(free.errors.than(even.errors), test.rounded):
            return [even]
        return [even, third or self.found(held), free]

    def searched(self) -> list[Found]:
        """The best numbers under hypotheses with all of them free, those as given first.

        Strengths can stand for what a varnish keeps back, and distances for both. Uneven strengths
        must therefore predict better than even ones with either kind of surface, under a varnish
        or not.
        """
        first, other = self._test, self._test.otherwise()
        found = self.explained(first)
        start = chosen(found, first.rounded).state
        # Where lobes of the wrong shape lead may be far from the rig that the right ones show.
        found += self.explained(other, None if other.surfaces == "shaped" else start)
        return found


def _rigs(given: Rig, half: float, falloff: bool) -> Callable[[RigNumbers], Rig]:
    """What makes rigs of numbers, for the whole painting; the last ones are kept."""

    @lru_cache(maxsize=RECENT)
    def rig(state: RigNumbers) -> Rig:
        u, w = np.where(state.place < _DISTANT, 0.0, state.place).tolist()
        lights: list[Light] = []
        # A photograph that is black but for 1e-40 asks for a lamp weaker than lamps may be.
        strengths = np.clip(given.intensities * np.exp(state.log), LEAST, MOST).tolist()
        for light, strength in zip(given.lights, strengths, strict=True):
            if isinstance(light, PointLight):
                lights.append(replace(light, intensity=strength))
            elif w > 0.0:
                x, y, z = light.direction
                position = (half / w * x, half / w * y, half / w * z)
                lights.append(near_lamp(position, strength, falloff, light.radius))
            else:
                lights.append(DistantLight(light.direction, strength, light.radius))
        views: Views = given.viewpoints
        if u > 0.0:
            x, y, z = (half / u * given.views[0]).tolist()
            views = PointView((x, y, z))
        place: dict[str, Any] = {"pitch_mm": given.pitch_mm, "origin": given.origin}
        return Rig(lights, views=views, **place)

    return rig
