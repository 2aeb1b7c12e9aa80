"""Which hypothesis about a rig is accepted: backward elimination by photographs held out.

A number of the rig is accepted only against the best rig without it, whatever the surfaces: errors
of a model of surfaces look like errors of the rig, and the other kind of surface may have none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from impasto.fit.bundle_adjustment import Kind, RigNumbers
from impasto.fit.held_out import SUITS, Comparison, Errors, HeldOut

FALL, _CERTAIN = 0.02, 3.0
"""What is estimated must lower the trimmed error by this share, and the gain exceed so many
standard errors. On metal, whose lobes fit worst, a wrong camera gained 2.6 of them."""
MUCH, _LIKELY = 0.2, 1.0
"""Or these: with a camera wrong by its own distance, a few photographs scatter the gain."""
_DETERMINED, _PROBABLE = 0.1, 1.0
"""Or these, for strengths, which scatter more from photograph to photograph; and for their tilt and
fall-off, which errors of the model mimic."""
COARSE = 2.0
"""Trimmed errors below this many times those of rounding show no camera and no strengths unless
they fall by much: they fall while normals become worse."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The best numbers under one hypothesis, the surfaces, and the errors with both."""

    state: RigNumbers
    kind: Kind
    test: HeldOut
    errors: Errors


def chosen(found: Sequence[Found], rounded: float) -> Found:
    """The numbers with the fewest freedoms that predict as well as any.

    Tilt and fall-off of strengths are free only where strengths differ also otherwise: errors of
    the model are smooth in the direction of light, strengths of lamps are not.

    Parameters
    ----------
    found
        With strengths as given, held and free, those as given first.
    rounded
        Trimmed error of rounding alone.
    """
    kinds: tuple[Kind, ...] = ("given", "held", "free")
    given, held, free = (
        min((one for one in found if one.kind == kind), key=suited(found[0]), default=None)
        for kind in kinds
    )
    assert given is not None
    if held is None or not strengths_differ(held.errors.than(given.errors), rounded):
        return given
    if free is not None:
        # Against those with the same surfaces: that lamps differ is settled, and what is left
        # between the two kinds of surface may be less than tilt and fall-off are worth.
        same = free.test.surfaces
        alike = [one for one in found if one.kind == "held" and one.test.surfaces == same]
        usual = alike[0] if alike else held
        if free.errors.than(usual.errors).better(_DETERMINED, _PROBABLE):
            return free
    return held


def with_strengths(found: Sequence[Found], best: Found) -> Found:
    """The best numbers with uneven strengths, if any hypothesis has them, chosen or not."""
    held = [one for one in found if one.kind == "held"]
    if best.kind != "given" or not held:
        return best
    return min(held, key=suited(found[0]))


def suited(first: Found) -> Callable[[Found], float]:
    """The trimmed error, in favour of surfaces of the same kind as the first."""

    def trim(one: Found) -> float:
        share = 1.0 if one.test.surfaces == first.test.surfaces else 1.0 - SUITS
        return one.errors.trim / share

    return trim


def convincing(gain: Comparison) -> bool:
    """Whether photographs held out show a number of the rig."""
    return gain.better(FALL, _CERTAIN) or gain.better(MUCH, _LIKELY)


def count_together(gain: Comparison, numbers: int, rounded: float) -> bool:
    """Whether they show so many numbers of the rig, of which none counts beside the others."""
    if gain.trim_before <= COARSE * rounded:
        return gain.better(MUCH, _LIKELY)
    return gain.better(numbers * FALL, _CERTAIN)


def strengths_differ(gain: Comparison, rounded: float) -> bool:
    """Whether they show that lamps differ in strength."""
    if gain.trim_before <= COARSE * rounded:
        return gain.better(MUCH, _LIKELY)
    return convincing(gain) or gain.better(_DETERMINED, _PROBABLE)
