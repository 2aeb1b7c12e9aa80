"""Backward elimination of the numbers of a rig, by photographs held out.

Each distance and the strengths are left out in turn, and judged against the best rig without them.
What was dropped one by one is judged once more together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impasto._internal.waiting import wait_for_each
from impasto.fit.bundle_adjustment import Kind, RigNumbers
from impasto.fit.held_out import Comparison, Errors, HeldOut
from impasto.fit.rig_acceptance import (
    COARSE,
    FALL,
    MUCH,
    Found,
    chosen,
    convincing,
    count_together,
    suited,
)
from impasto.fit.rig_search import NEAREST, NODES, Hypothesis, RigSearch
from impasto.refinement import Estimate

FAR = 0.02
"""An inverse distance below this counts as 0: directions differ by a degree."""
SPREAD = 8.0
"""Strengths that differ by more are not accepted: domes have factors of 2 to 5. On metal, which
shows most lamps as black, wrong ones of 10 and more predict better by chance."""
_VAST = 0.8
"""Unless the trimmed error falls by this share, which false strengths do not reach."""
_MIRRORED = 0.5
"""Share of the fall that a rig of the opposite sign may reach."""
NONE = "the photographs show none"


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """The numbers that are accepted, of what kind, and why.

    ``best``: the best numbers with all of them free, for the report on those that are not accepted.
    """

    state: RigNumbers
    free: NDArray[np.bool_]
    kind: Kind
    test: HeldOut
    best: RigNumbers
    reasons: list[str]
    strengths: Estimate


class Elimination(RigSearch):
    """The search of one rig, and which of its numbers are accepted."""

    def _hypothesis(
        self, starts: Sequence[RigNumbers], free: NDArray[np.bool_], strengths: Kind
    ) -> Hypothesis:
        """A hypothesis with the surfaces at hand."""
        return Hypothesis(tuple(starts), free, strengths, self._test)

    def eliminated(self, first: Found) -> Accepted:
        """What is left of the best numbers after each has been left out in turn."""
        self._test, state, kind = first.test, first.state, first.kind
        best = state
        state, free, reasons = self._places(state, kind)
        strengths, left = self._lamps(state, free, kind)
        dropped = kind != "given" and left.kind == "given"
        self._test, state, kind = left.test, left.state, left.kind
        if dropped:  # what was accepted beside strengths may mean nothing without them
            best = self.adjusted(self._hypothesis([state, self.even()], self._free, kind))
            state, free, reasons = self._places(best, kind)
        return Accepted(state, free, kind, self._test, best, reasons, strengths)

    def together(self, group: Found, left: Accepted) -> Accepted:
        """What is left, or all numbers if those that were dropped one by one count together.

        A camera and lamps that are near bend highlights alike, and strengths make up for a part of
        either: each alone is then worth little beside the others.
        """
        free = self._free & (group.state.place >= FAR)
        dropped = np.flatnonzero(free & ~left.free).tolist()
        near = np.flatnonzero(free).tolist()
        count = len(dropped) + (group.kind != "given" and left.kind == "given")
        # What tilt and fall-off of strengths are worth has been judged.
        other = left.kind not in ("given", group.kind)
        if count < 2 or other or (left.free & ~free).any() or group.state.spread > SPREAD:
            return left
        starts = (left.state, group.state, self.even())
        hypothesis = Hypothesis(starts, left.free, left.kind, left.test)
        tests = (left.test, left.test.otherwise())
        rivals, _ = self.all_found([replace(hypothesis, test=one) for one in tests])
        rivals.append(self._with(left.state, left.kind, left.test))
        rival = min(rivals, key=lambda one: one.errors.trim)
        gain = group.errors.than(rival.errors)
        self._test = group.test
        if not (
            count_together(gain, count, self._test.rounded)
            and self._every_fold_better(group.errors, rival.errors)
            and all(self._shows(axis, group.state)[0] for axis in near)
            and all(self._agree(group.state, axis) for axis in near)
            and self._mirrored(group.state) is None
        ):
            self._test = left.test
            return left
        why = f"together {gain}"
        reasons = [why if axis in dropped else reason for axis, reason in enumerate(left.reasons)]
        strengths = left.strengths
        if group.kind != "given" and not strengths.accepted:
            strengths = Estimate(group.state.spread, True, why)
        state, free = without_far(group.state, self._free)
        return Accepted(state, free, group.kind, group.test, state, reasons, strengths)

    def _places(
        self, state: RigNumbers, kind: Kind
    ) -> tuple[RigNumbers, NDArray[np.bool_], list[str]]:
        """The numbers without the distances that are not accepted, which those are, and why."""
        free, reasons, first = self._free.copy(), list(self._why), state
        for axis in np.flatnonzero(self._free).tolist():
            others = free.copy()
            others[axis] = False
            free[axis], reasons[axis], without = self._compared(axis, state, others, kind)
            if not free[axis]:
                self._test, state = without.test, without.state
        if self._free.all() and not free[1]:
            # A camera was judged beside near lamps, which may have given it its sense or taken it.
            alone, nothing = np.array([True, False]), np.zeros(2, np.bool_)
            near = state
            if not free[0]:
                near = self.adjusted(self._hypothesis([state, first], alone, kind))
            free[0], reasons[0], without = self._compared(0, near, nothing, kind)
            if free[0]:
                state = near
            else:
                self._test, state = without.test, without.state
        return *without_far(state, free), reasons

    def _compared(
        self, axis: int, state: RigNumbers, others: NDArray[np.bool_], kind: Kind
    ) -> tuple[bool, str, Found]:
        """Whether a distance is accepted beside ``others``, why, and the best without it."""
        hypothesis = self._hypothesis([state, self.even()], others, kind)
        # Surfaces of the other kind may make up for the distance.
        otherwise = replace(hypothesis, test=hypothesis.test.otherwise())
        ahead = [otherwise] if self._shows(axis, state)[0] else []
        (without,), other = self.all_found([hypothesis], ahead)
        accepted, why = self._judge(axis, state, without.state)
        if accepted:
            rival = other[0] or self.found(otherwise)
            gain = self.errors(state).than(rival.errors)
            if not convincing(gain):
                return False, f"no better: {gain}", rival
        return accepted, why, without

    def _shows(self, axis: int, state: RigNumbers) -> tuple[bool, str]:
        """Whether a distance is one that may be accepted, and why not."""
        if state.place[axis] < FAR:
            return False, NONE
        if state.place[axis] >= NEAREST:
            return False, f"it would be nearer than {1.0 / NEAREST:g} half-sides"
        return True, ""

    def _judge(self, axis: int, state: RigNumbers, without: RigNumbers) -> tuple[bool, str]:
        """Whether a distance is accepted against the best rig without it, and why."""
        shown, why = self._shows(axis, state)
        if not shown:
            return False, why
        gain = self.gain(state, without)
        if not convincing(gain):
            return False, f"no better: {gain}"
        errors, before = self.errors(state), self.errors(without)
        if not (self._every_fold_better(errors, before) and self._agree(state, axis)):
            return False, f"parts of the photographs disagree: {gain}"
        rounded = gain.trim_before <= COARSE * self._test.rounded
        if axis == 0 and rounded and gain.fall < MUCH:
            return False, f"errors of {gain.trim_before:.2f} codes are too small to show one"
        if (mirrored := self._mirrored(state)) is not None:
            return False, f"the opposite sign does as well: {mirrored}"
        return True, str(gain)

    def _every_fold_better(self, errors: Errors, before: Errors) -> bool:
        """Whether the photographs of every fold are predicted better."""
        return all(
            errors.fold(one, self._folds) < (1.0 - 0.5 * FALL) * before.fold(one, self._folds)
            for one in range(self._folds)
        )

    def _mirrored(self, state: RigNumbers) -> Comparison | None:
        """What distances of the opposite sign gain, if it is not much less than these do."""
        rotated, nowhere = self._test.rotated(), replace(state, place=np.zeros(2))
        near, far = wait_for_each(
            lambda one: rotated.errors(self.at(one), self._folds), [state, nowhere], self._count
        )
        mirrored = near.than(far)
        too_much = mirrored.fall > _MIRRORED * self.gain(state, nowhere).fall
        return mirrored if too_much else None

    def _agree(self, state: RigNumbers, axis: int) -> bool:
        """Whether the best distance of each fold, along one axis, is next to that of both."""
        places = []
        for node in [*NODES, state.place[axis]]:
            place = state.place.copy()
            place[axis] = node
            places.append(place)
        found = self.each([replace(state, place=place) for place in places], self._test)
        for fold in range(self._folds):
            alone = places[int(np.argmin([one.fold(fold, self._folds) for one in found]))]
            if abs(alone[axis] - state.place[axis]) > NODES[1]:
                return False
        return True

    def _lamps(
        self, state: RigNumbers, free: NDArray[np.bool_], kind: Kind
    ) -> tuple[Estimate, Found]:
        """Whether strengths are accepted beside the distances that are left, and what follows."""
        test = self._test
        uneven = self._with(state, kind, test)
        if not self._strengths:
            return Estimate(1.0, False, "not estimated"), uneven
        hypothesis = self._hypothesis([state, self.even()], free, "given")
        if kind == "given":
            even = self.found(hypothesis)
            trial = self.adjusted(self._hypothesis([even.state], free, "held"))
            return Estimate(trial.spread, False, str(self.gain(trial, even.state))), even
        every = [replace(hypothesis, test=one) for one in (test, test.otherwise())]
        if kind == "free":
            every += [replace(one, strengths="held") for one in every]
        even, other, *held = self.all_found(every)[0]
        rivals = [even, other, uneven, *held]
        left = chosen(rivals, self._test.rounded)
        even = min(rivals[:2], key=suited(even))
        if left.kind == "given":
            return Estimate(state.spread, False, str(uneven.errors.than(even.errors))), even
        gain, spread = left.errors.than(even.errors), left.state.spread
        if spread > SPREAD and gain.fall < _VAST:
            why = f"they would differ by a factor of {spread:.0f}, more than lamps do"
            return Estimate(spread, False, why), even
        return Estimate(spread, True, str(gain)), left


def without_far(state: RigNumbers, free: NDArray[np.bool_]) -> tuple[RigNumbers, NDArray[np.bool_]]:
    """The numbers without distances that are none, and which of the free ones are left."""
    near = free & (state.place >= FAR)
    return replace(state, place=np.where(near, state.place, 0.0)), near
