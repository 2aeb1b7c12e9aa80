"""What photographs held out accept of a rig, from errors that are put in."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from impasto.errors import ArgumentError
from impasto.fit import rig_elimination, rig_refinement
from impasto.fit.bundle_adjustment import Kind, RigNumbers
from impasto.fit.held_out import Comparison, Errors
from impasto.fit.rig_acceptance import (
    Found,
    chosen,
    convincing,
    count_together,
    strengths_differ,
    with_strengths,
)
from impasto.fit.rig_search import Hypothesis
from impasto.refinement import Estimate

LIGHTS, SAMPLES = 40, 400
ROUNDED = 0.3
"""Trimmed errors of up to 0.6 are then small."""


def found(kind: Kind, trim: float, *, coated: bool = False) -> Found:
    """A hypothesis with this trimmed error."""
    # One error in ten is large, and not counted.
    size = np.where(np.arange(SAMPLES) % 10 == 0, 50.0, trim)
    # A hundredth from photograph to photograph: a standard error of 0.02 dB, where a fall by 2 %
    # gains 0.17 dB.
    own = 1.0 + 0.01 * np.sin(np.arange(LIGHTS))
    test: Any = SimpleNamespace(surfaces="coated" if coated else "plain", coated=coated)
    state = RigNumbers(np.zeros(2), np.zeros(LIGHTS))
    return Found(state, kind, test, Errors(own[:, None] * size))


def taken(*tried: Found) -> tuple[Kind, bool]:
    """What is accepted, and whether its surfaces are under a varnish."""
    one = chosen(tried, ROUNDED)
    return one.kind, one.test.coated


def test_strengths_that_predict_better_are_accepted() -> None:
    given = found("given", 2.0)
    assert taken(given, found("held", 1.0), found("free", 1.0)) == ("held", False)
    assert taken(given, found("held", 1.0), found("free", 0.8)) == ("free", False)
    assert taken(given, found("held", 1.99), found("free", 1.99)) == ("given", False)


def test_strengths_are_compared_with_even_ones_under_either_kind_of_surface() -> None:
    """Strengths that stand for what a varnish keeps back are no better than the varnish."""
    without = [found("given", 2.0), found("held", 1.5), found("free", 1.0)]
    assert taken(*without)[0] == "free"
    assert taken(*without, found("given", 1.0, coated=True)) == ("given", True)


def test_tilt_and_fall_off_alone_are_not_accepted() -> None:
    """Errors of the model are smooth in the direction of light, and look like these."""
    assert taken(found("given", 2.0), found("held", 1.99), found("free", 1.0))[0] == "given"


def test_small_errors_show_strengths_only_if_they_fall_by_much() -> None:
    assert taken(found("given", 0.5), found("held", 0.45), found("free", 0.45))[0] == "given"
    assert taken(found("given", 0.5), found("held", 0.35), found("free", 0.35))[0] == "held"
    assert taken(found("given", 5.0), found("held", 4.5), found("free", 4.5))[0] == "held"


def test_surfaces_change_only_where_the_others_predict_better() -> None:
    given = found("given", 1.0)
    assert taken(given, found("given", 0.99, coated=True)) == ("given", False)
    assert taken(given, found("given", 0.97, coated=True)) == ("given", True)


def test_a_few_large_errors_do_not_scatter_a_gain() -> None:
    """A wrong camera misplaces highlights in some photographs, however right the lamps."""
    before, after = np.full((LIGHTS, SAMPLES), 2.0), np.full((LIGHTS, SAMPLES), 1.0)
    after[::3, ::20] = 50.0  # a twentieth of the samples of every third photograph
    gain = Errors(after).than(Errors(before))
    # Errors are halved: 6.02 dB; errors of 0.05 codes, which are added to both, take 0.01 of it.
    np.testing.assert_allclose(gain.gain, 20.0 * np.log10(2.0), atol=0.02)
    assert gain.scatter < 0.01


def test_tilt_and_fall_off_are_compared_under_the_same_surfaces() -> None:
    """Where lamps differ, a varnish that makes up for a part of the fall-off does not hide it."""
    tried = [found("given", 2.0), found("held", 0.75), found("free", 0.63)]
    assert taken(*tried, found("held", 0.68, coated=True)) == ("free", False)


def scattered(gain: float, loss: float, *, before: float = 5.0) -> Comparison:
    """37 photographs gain so many dB, three lose: fewer than the tenth that a trim leaves out.

    Mean and scatter over photographs see the three, the fall of the trimmed error does not.
    """
    each = np.full(LIGHTS, before * 10.0 ** (-gain / 20.0))
    each[[3, 17, 31]] = before * 10.0 ** (loss / 20.0)
    held = [Errors(np.outer(one, np.ones(SAMPLES))) for one in (np.full(LIGHTS, before), each)]
    compared = held[1].than(held[0])
    # A gain of g dB is a fall by 1 - 10^(-g / 20).
    np.testing.assert_allclose(compared.fall, 1.0 - 10.0 ** (-gain / 20.0), rtol=1e-6)
    return compared


def errors_of(compared: Comparison) -> float:
    """The gain in standard errors."""
    return compared.gain / compared.scatter


def test_a_fall_by_much_needs_less_certainty() -> None:
    """25 % with 1.6 standard errors: either limit alone would refuse it."""
    much = scattered(2.5, 15.0)
    assert 1.2 < errors_of(much) < 2.5
    assert convincing(much)
    # As much, but less than a standard error.
    doubtful = scattered(2.5, 25.0)
    assert 0.0 < errors_of(doubtful) < 0.9
    assert not convincing(doubtful)
    # As certain, but by 13 %.
    less = scattered(1.2, 6.0)
    assert 1.2 < errors_of(less) < 2.5
    assert not convincing(less)
    # By 13 %, and certain.
    assert convincing(scattered(1.2, -1.2))
    # By 1 %, however certain.
    assert not convincing(scattered(0.09, -0.09))


def test_strengths_need_less_certainty_than_a_camera() -> None:
    """A fall by 13 % with 2.2 standard errors shows strengths, where errors are not of rounding."""
    less = scattered(1.2, 6.0)
    assert not convincing(less)
    assert strengths_differ(less, ROUNDED)
    assert not strengths_differ(scattered(1.2, 6.0, before=0.5), ROUNDED)
    assert not strengths_differ(scattered(1.2, 25.0), ROUNDED)
    # By 9 %, with 1.6.
    assert not strengths_differ(scattered(0.8, 5.0), ROUNDED)
    much = scattered(2.5, 15.0, before=0.5)
    assert strengths_differ(much, ROUNDED)


def test_tilt_and_fall_off_must_lower_the_error_by_a_tenth() -> None:
    assert taken(found("given", 2.0), found("held", 1.0), found("free", 0.95))[0] == "held"
    assert taken(found("given", 2.0), found("held", 1.0), found("free", 0.88))[0] == "free"


Trims = Callable[[bool, bool, str], float]
"""Trimmed error with a near camera or not, near lamps or not, on surfaces of a kind."""


def numbers(spread: float) -> RigNumbers:
    """No distances, and strengths that differ by this factor."""
    return RigNumbers(np.zeros(2), np.log(np.linspace(1.0, spread, LIGHTS)))


class Search(rig_refinement._Decision):
    """A search that finds every distance at once, with errors that are put in."""

    def __init__(self, trims: Trims, threads: int = 1) -> None:
        self._free, self._why = np.array([True, True]), ["", ""]
        self._count, self.report, self.left = threads, None, False
        self._folds, self._trims = 2, trims
        self._given: Any = np.zeros(LIGHTS)
        self._test: Any = self.surfaces("plain")

    def surfaces(self, kind: str) -> Any:
        def otherwise() -> Any:
            return self.surfaces("coated" if kind == "plain" else "plain")

        return SimpleNamespace(surfaces=kind, otherwise=otherwise, rounded=ROUNDED)

    def adjusted(self, asked: Hypothesis) -> RigNumbers:
        known = np.max([start.place for start in asked.starts], axis=0)
        return RigNumbers(np.where(asked.free, known, 0.0), np.zeros(LIGHTS))

    def errors(self, state: RigNumbers, test: Any = None) -> Errors:
        camera, lamps = (state.place > 0.0).tolist()
        surfaces = (self._test if test is None else test).surfaces
        return found("given", self._trims(camera, lamps, surfaces)).errors

    def _judge(self, axis: int, state: RigNumbers, without: RigNumbers) -> tuple[bool, str]:
        gain = self.gain(state, without)
        return convincing(gain), str(gain)


def accepted(trims: Trims) -> tuple[bool, bool, str]:
    """Whether camera and lamps are accepted as near, and on which surfaces.

    On two threads other surfaces are tried before it is known whether that is asked for.
    """
    one, other = (_accepted(Search(trims, threads)) for threads in (1, 2))
    assert one == other
    return one


def _accepted(search: Search) -> tuple[bool, bool, str]:
    state, free, _ = search._places(RigNumbers(np.array([0.5, 0.25]), np.zeros(LIGHTS)), "given")
    np.testing.assert_array_equal(state.place, np.where(free, [0.5, 0.25], 0.0))
    camera, lamps = free.tolist()
    return camera, lamps, search._test.surfaces


def test_a_distance_is_accepted_where_errors_are_larger_without_it() -> None:
    def trims(camera: bool, lamps: bool, surfaces: str) -> float:
        return 1.0 + (not camera) + 2.0 * (not lamps)

    assert accepted(trims) == (True, True, "plain")
    assert accepted(lambda camera, lamps, surfaces: 2.0 - camera) == (True, False, "plain")
    assert accepted(lambda camera, lamps, surfaces: 2.0 - lamps) == (False, True, "plain")
    assert accepted(lambda camera, lamps, surfaces: 2.0) == (False, False, "plain")


def test_other_surfaces_that_make_up_for_a_distance_take_its_place() -> None:
    def trims(camera: bool, lamps: bool, surfaces: str) -> float:
        return 1.0 if camera or surfaces == "coated" else 2.0

    assert accepted(trims) == (False, False, "coated")


def test_a_camera_is_judged_again_without_lamps_that_are_not_accepted() -> None:
    """Beside near lamps it seemed to help; alone it does not, or not more than a varnish."""

    def nothing_alone(camera: bool, lamps: bool, surfaces: str) -> float:
        return 2.0 if lamps and not camera else 1.0

    assert accepted(nothing_alone) == (False, False, "plain")

    def varnish_alone(camera: bool, lamps: bool, surfaces: str) -> float:
        if lamps:
            return 1.5 if camera else 2.0
        return 1.5 if camera else (1.4 if surfaces == "coated" else 3.0)

    assert accepted(varnish_alone) == (False, False, "coated")


def test_a_camera_that_lamps_made_up_for_is_judged_again_without_them() -> None:
    """Each of two small steps shows nothing; both together show the camera."""
    trims = {(True, True): 1.0, (True, False): 1.0, (False, True): 1.01, (False, False): 1.025}
    assert accepted(lambda camera, lamps, surfaces: trims[camera, lamps]) == (True, False, "plain")
    trims[False, False] = 1.015
    assert accepted(lambda camera, lamps, surfaces: trims[camera, lamps])[:2] == (False, False)


def test_strengths_are_accepted_against_even_ones_on_either_surface() -> None:
    """Strengths can stand for what a varnish keeps back of the diffuse light."""

    def spread(trims: dict[tuple[bool, str], float]) -> tuple[float, str]:
        search = Search(lambda camera, lamps, surfaces: 0.0)
        search._strengths = True
        search.errors = lambda state, test=None: (
            found(  # type: ignore[method-assign]
                "given", trims[bool(state.log.any()), (test or search._test).surfaces]
            ).errors
        )
        uneven = RigNumbers(np.zeros(2), np.log(np.linspace(1.0, 2.0, LIGHTS)))
        strengths, left = search._lamps(uneven, np.zeros(2, np.bool_), "held")
        np.testing.assert_allclose(strengths.found, 2.0)
        assert strengths.accepted == (left.state.spread > 1.0)
        return left.state.spread, left.test.surfaces

    trims = {(False, "plain"): 2.0, (False, "coated"): 2.0, (True, "plain"): 1.0}
    assert spread(trims) == (pytest.approx(2.0), "plain")
    assert spread({**trims, (False, "coated"): 0.95}) == (1.0, "coated")


@pytest.mark.parametrize(
    ("accepted", "last", "kept"), [(2.0, 7.0, True), (2.0, 9.0, False), (10.0, 12.0, True)]
)
def test_the_last_steps_do_not_spread_strengths_without_limit(
    accepted: float, last: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Strengths that differ by more than a factor of 8 need more reasons than these steps have."""

    search = Search(lambda camera, lamps, surfaces: 0.0)
    search._stack = search._index = search._threads = None  # type: ignore[assignment]
    search.at = lambda state: state  # type: ignore[assignment]
    # From more pixels, errors are smaller the wider strengths spread.
    many: Any = SimpleNamespace(errors=lambda rig, folds: found("held", 1.0 / rig.spread).errors)
    monkeypatch.setattr(rig_refinement, "HeldOut", lambda *_, **__: many)
    wider: Any = SimpleNamespace(solve=lambda *_, **__: numbers(last))
    monkeypatch.setattr(rig_refinement, "BundleAdjustment", lambda *_: wider)
    search._given = SimpleNamespace(directions=None)  # type: ignore[assignment]
    search._by_medians = lambda state, *_: state  # type: ignore[method-assign]
    state, _ = search._final(numbers(accepted), np.zeros(2, np.bool_), "held")
    assert state.spread == pytest.approx(last if kept else accepted)


@pytest.mark.parametrize(
    ("moved", "error", "kept"), [(3.0, 0.98, True), (3.0, 0.995, False), (9.0, 0.5, False)]
)
def test_medians_count_where_photographs_are_predicted_better(
    moved: float, error: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By 1 % or more, and without strengths that differ by more than a factor of 8."""

    search = Search(lambda camera, lamps, surfaces: 0.0)
    search._threads = None
    search.at = lambda state: state  # type: ignore[assignment]
    ended = SimpleNamespace(log=numbers(moved).log, known=np.ones(LIGHTS, np.bool_))
    rounds = SimpleNamespace(rounds=lambda *_, **__: ended)
    monkeypatch.setattr(rig_refinement, "Medians", lambda *_: rounds)

    def errors(rig: Any, folds: int, lobes: int) -> Errors:
        return found("held", error if rig.spread > 2.5 else 1.0).errors

    search._test = SimpleNamespace(errors=errors, surfaces="plain")
    state = search._by_medians(numbers(2.0), "held", 8.0)
    assert state.spread == pytest.approx(moved if kept else 2.0)
    # Where two lobes fit too few pixels.
    monkeypatch.setattr(rig_refinement, "Medians", lambda *_: SimpleNamespace(rounds=refusing))
    assert search._by_medians(numbers(2.0), "held", 8.0).spread == pytest.approx(2.0)
    # On metal, lobes have a shape that two lobes of the model lack.
    search._test = SimpleNamespace(errors=errors, surfaces="shaped")
    assert search._by_medians(numbers(2.0), "held", 8.0).spread == pytest.approx(2.0)


def refusing(*_: Any, **__: Any) -> Any:
    raise ArgumentError("stack: strengths need at least 7 lights that pixels determine")


# --- numbers that count together


def test_a_group_counts_by_what_each_of_its_numbers_is_worth() -> None:
    """2 % each, and three standard errors together; near those of rounding, 20 %."""

    def gain(before: float, after: float) -> Comparison:
        return found("held", after).errors.than(found("given", before).errors)

    assert count_together(gain(2.0, 1.9), 2, ROUNDED)
    assert not count_together(gain(2.0, 1.9), 3, ROUNDED)
    assert count_together(gain(2.0, 1.87), 3, ROUNDED)
    assert not count_together(gain(0.5, 0.45), 2, ROUNDED)
    assert count_together(gain(0.5, 0.39), 2, ROUNDED)
    assert not count_together(Comparison(2.0, 1.8, 0.9, 0.4), 2, ROUNDED)


def test_strengths_that_were_not_chosen_are_in_the_group() -> None:
    given, held, other = found("given", 2.0), found("held", 1.97), found("held", 1.9, coated=True)
    assert chosen([given, held], ROUNDED) is given
    assert with_strengths([given, held], given) is held
    assert with_strengths([given, held, other], given) is other
    assert with_strengths([given], given) is given


TOGETHER = {(0, 0, 0): 1.07, (1, 1, 1): 1.0}
"""Trimmed error with none of camera, lamps and strengths, and with all."""


def grouped(
    trims: dict[tuple[int, int, int], float],
    *,
    left: tuple[int, int, int] = (0, 0, 0),
    kind: Kind = "held",
    spread: float = 2.0,
    mirrored: bool = False,
    disagree: bool = False,
    other: float = 9.0,
) -> tuple[int, int, int]:
    """Which of camera, lamps and strengths are accepted where ``left`` were, one by one.

    ``kind``: of the strengths that were found with all; ``other``: the error with surfaces of the
    other kind.
    """
    search = Search(lambda camera, lamps, surfaces: 0.0)
    plain = search._test

    def errors(state: RigNumbers, test: Any = None) -> Errors:
        near = (state.place > 0.0).astype(int).tolist()
        trim = trims[(*near, int(state.log.any()))]  # type: ignore[index]
        coated = (test or search._test).surfaces == "coated"
        return found("held", min(trim, other) if coated else trim).errors

    def adjusted(hypothesis: Hypothesis) -> RigNumbers:
        start = hypothesis.starts[0]
        return RigNumbers(np.where(hypothesis.free, start.place, 0.0), start.log)

    gain = Comparison(2.0, 1.0, 6.0, 0.1)
    search.errors = errors  # type: ignore[method-assign]
    search.adjusted = adjusted  # type: ignore[method-assign]
    search._agree = lambda state, axis: not disagree  # type: ignore[method-assign]
    search._mirrored = lambda state: gain if mirrored else None  # type: ignore[method-assign]
    places, uneven = np.array([0.5, 0.25]), np.log(np.linspace(1.0, spread, LIGHTS))
    group = Found(RigNumbers(places, uneven), kind, plain, errors(RigNumbers(places, uneven)))
    free, strengths = np.array(left[:2], np.bool_), bool(left[2])
    before = RigNumbers(np.where(free, places, 0.0), uneven * strengths)
    one_by_one = rig_elimination.Accepted(
        before,
        free,
        "held" if strengths else "given",
        plain,
        group.state,
        ["one by one", "one by one"],
        Estimate(spread, strengths, "one by one"),
    )
    after = search.together(group, one_by_one)
    assert search._test is after.test
    assert after.strengths.accepted == (after.kind != "given") == bool(after.state.log.any())
    np.testing.assert_array_equal(after.state.place > 0.0, after.free)
    new = after.free & ~free
    assert [reason.startswith("together") for reason in after.reasons] == new.tolist()
    camera, lamps = after.free.astype(int).tolist()
    return camera, lamps, int(after.strengths.accepted)


def test_what_counts_together_is_accepted_together() -> None:
    assert grouped(TOGETHER) == (1, 1, 1)
    assert grouped({**TOGETHER, (0, 0, 0): 1.05}) == (0, 0, 0)


def test_two_numbers_count_together_beside_a_third() -> None:
    trims = {**TOGETHER, (1, 0, 0): 1.05, (0, 0, 1): 1.05}
    assert grouped(trims, left=(1, 0, 0)) == (1, 1, 1)
    assert grouped(trims, left=(0, 0, 1)) == (1, 1, 1)
    trims = {key: 1.03 if error == 1.05 else error for key, error in trims.items()}
    assert grouped(trims, left=(1, 0, 0)) == (1, 0, 0)


def test_one_number_that_failed_is_no_group() -> None:
    assert grouped({(1, 1, 1): 1.0, (1, 0, 1): 1.5}, left=(1, 0, 1)) == (1, 0, 1)


def test_other_surfaces_may_make_up_for_a_group() -> None:
    assert grouped(TOGETHER, other=1.03) == (0, 0, 0)


def test_strengths_of_another_kind_than_was_accepted_are_no_group() -> None:
    trims = {**TOGETHER, (0, 0, 1): 1.06}
    assert grouped(trims, left=(0, 0, 1)) == (1, 1, 1)
    assert grouped(trims, left=(0, 0, 1), kind="free") == (0, 0, 1)


def test_strengths_that_differ_widely_are_in_no_group() -> None:
    assert grouped(TOGETHER, spread=7.0) == (1, 1, 1)
    assert grouped(TOGETHER, spread=9.0) == (0, 0, 0)


def test_a_group_whose_distances_contradict_the_photographs_is_not_accepted() -> None:
    assert grouped(TOGETHER, mirrored=True) == (0, 0, 0)
    assert grouped(TOGETHER, disagree=True) == (0, 0, 0)
    trims = {**TOGETHER, (1, 0, 0): 1.07}
    assert grouped(trims, left=(1, 0, 0)) == (1, 1, 1)
    assert grouped(trims, left=(1, 0, 0), disagree=True) == (1, 0, 0)
