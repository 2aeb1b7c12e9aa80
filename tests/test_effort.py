"""Effort: the one knob, its presets, and the suggestion of one."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import impasto
from impasto import Effort, simulate, suggest
from impasto.effort import PRESETS
from impasto.relighting import full_scale, relative_error
from impasto.study import specimens
from impasto.thinning import every, thinned


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """48 lights on a painting with three varnishes."""
    painting = simulate.painting(5, (24, 24), varnish="patches")
    return simulate.capture(painting, impasto.Rig(specimens.dome(48)), "rgb").stack


@pytest.mark.parametrize("options", [{}, {"pooling": "pixel"}], ids=["painting", "pixel"])
def test_standard_is_the_default_by_name_and_by_number(
    stack: impasto.Stack, options: dict[str, Any]
) -> None:
    fits = [
        impasto.fit_sbrdf(stack, **options, **effort)
        for effort in ({}, {"effort": "standard"}, {"effort": PRESETS["standard"]})
    ]
    for other in fits[1:]:
        np.testing.assert_array_equal(other.normal, fits[0].normal)
        np.testing.assert_array_equal(other.diffuse, fits[0].diffuse)


def test_every_number_of_an_effort_is_used(stack: impasto.Stack) -> None:
    base = Effort()
    others = {
        "stereo": (Effort(stereo=0), {"pooling": "pixel"}),
        "pixels": (Effort(pixels=64), {}),
        "rounds": (Effort(rounds=0), {"pooling": "pixel"}),
        "iterations": (Effort(iterations=1), {"pooling": "pixel"}),
        "start": (Effort(start="table"), {"pooling": "pixel"}),
        "precision": (Effort(precision="polished"), {"pooling": "pixel"}),
    }
    assert others.keys() == base.to_dict().keys()
    for name, (effort, options) in others.items():
        fits = [impasto.fit_sbrdf(stack, effort=e, **options).normal for e in (base, effort)]
        assert not np.array_equal(fits[0], fits[1], equal_nan=True), name


def test_lafortune_lobes_settle_in_the_rounds_of_the_effort() -> None:
    """Shadows in two photographs of every fourth pixel: it takes a round to leave them out."""
    rig = simulate.rig("snel-lafortune").take(range(0, 770, 7))
    shot = simulate.capture(simulate.painting(4, (16, 16)), rig, "rgb", model="lafortune").stack
    samples = np.array([shot.linear(i) for i in range(len(rig))])
    samples[np.isinf(samples)] = np.nan
    struck = np.zeros((16, 16), np.bool_)
    struck[::2, ::2] = True
    for shadowed in (30, 70):
        samples[shadowed][:, struck] = 0.0
    stack = impasto.Stack(samples, lights=rig)
    none, some = (
        impasto.fit_sbrdf(stack, model="lafortune", effort=Effort(rounds=rounds))
        for rounds in (0, 2)
    )
    # The root mean square that one shadow among 110 samples leaves.
    one = np.nanmedian(samples) / np.sqrt(len(rig))
    assert np.median(some.residual[struck]) < one < np.median(none.residual[struck])
    standard = impasto.fit_sbrdf(stack, model="lafortune")
    np.testing.assert_array_equal(standard.residual, some.residual)


def test_photometric_stereo_takes_its_steps_from_the_effort(stack: impasto.Stack) -> None:
    by_effort = impasto.fit_normals(stack, effort=Effort(stereo=2))
    np.testing.assert_array_equal(by_effort.normal, impasto.fit_normals(stack, steps=2).normal)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"rounds": -1}, "rounds: expected 0 to"),
        ({"iterations": 0}, "iterations: expected 1 to"),
        (
            {"start": "pyramide"},
            "start: expected 'table' or 'pyramid', found 'pyramide'.*'pyramid'",
        ),
        ({"start": None}, "start: expected 'table' or 'pyramid', found None"),
        (
            {"precision": "doubled"},
            "precision: expected 'single' or 'polished' or 'double', found 'doubled'.*'double'",
        ),
        ({"precision": 64}, "precision: expected 'single' or 'polished' or 'double', found 64"),
        ({"pixels": 1.5}, "pixels: expected 1 to"),
        ({"stereo": 1001}, "stereo: expected 0 to 1000, found 1001"),
    ],
)
def test_efforts_that_make_no_sense(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(impasto.ArgumentError, match=words):
        Effort(**wrong)


def test_unknown_efforts_are_named(stack: impasto.Stack) -> None:
    words = "effort: expected 'draft', 'standard', 'reference' or an Effort, found 'best'"
    for fit in (impasto.fit_sbrdf, impasto.fit_normals):
        with pytest.raises(impasto.ArgumentError, match=words):
            fit(stack, effort="best")  # type: ignore[arg-type]


# --- suggestions


def test_a_suggestion_meets_an_error(stack: impasto.Stack) -> None:
    loose, tight = (impasto.suggest_effort(stack, error=error) for error in (0.9, 1e-4))
    assert loose.met
    assert loose.options == loose.tried[0].options
    assert not tight.met
    assert tight.error == min(trial.error for trial in tight.tried)
    assert "nearest to what was asked for" in str(tight)
    assert "fit_sbrdf(stack, " in str(loose)


def test_a_suggestion_meets_a_time(stack: impasto.Stack) -> None:
    long, short = (impasto.suggest_effort(stack, seconds=s) for s in (1e6, 1e-9))
    assert long.met
    assert long.error == min(trial.error for trial in long.tried)
    assert not short.met
    assert short.options == short.tried[0].options


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({}, "error: say the largest error"),
        ({"error": 0.0}, "error: expected a number above 0"),
        ({"seconds": float("nan")}, "seconds: expected a number above 0"),
        ({"error": "5%"}, "error: expected a number above 0, found '5%'"),
        ({"error": np.array([0.1, 0.2])}, "error: expected a number above 0"),
        ({"seconds": True}, "seconds: expected a number above 0, found True"),
    ],
)
def test_suggestions_that_cannot_be_made(
    stack: impasto.Stack, wrong: dict[str, Any], words: str
) -> None:
    with pytest.raises(impasto.ArgumentError, match=words):
        impasto.suggest_effort(stack, **wrong)


def test_a_trial_needs_photographs_to_spare(stack: impasto.Stack) -> None:
    with pytest.raises(impasto.ArgumentError, match="a trial needs 8 photographs, found 7"):
        impasto.suggest_effort(stack.take(range(7)), error=0.1)


def _arc(stack: impasto.Stack, apart: Any) -> impasto.Stack:
    """Lights on an arc, but for some that stand apart."""
    turn = np.radians(np.linspace(15.0, 165.0, len(stack.rig)))
    lights = np.stack([np.cos(turn), 0.0 * turn, np.sin(turn)], axis=1)
    lights[apart] = (0.0, 0.6, 0.8)
    flat = impasto.Stack(np.full((len(turn), 1, 4, 4), 0.5, np.float32), lights=lights)
    impasto.fit_normals(flat)
    return flat


def test_lights_that_lie_in_a_plane_but_for_those_held_out(stack: impasto.Stack) -> None:
    """Of 144 photographs there is one turn, which holds out the one that stands apart."""
    many = impasto.Stack(np.tile(stack.samples, (3, 1, 1, 1)), lights=[*stack.rig.directions] * 3)
    flat = _arc(many, 0)
    told = "120 lights lie in one plane.*of 144 photographs 24 were held out"
    with pytest.raises(impasto.GeometryError, match=told):
        impasto.suggest_effort(flat, error=0.1)


def test_a_turn_without_which_lights_lie_in_a_plane_is_passed_over(stack: impasto.Stack) -> None:
    """The first of three turns holds out the one that stands apart; the others tell enough."""
    assert impasto.suggest_effort(_arc(stack, 0), error=10.0).met


def test_neighbours_are_not_held_out_together(stack: impasto.Stack) -> None:
    """Every direction is there twice, six photographs later: every sixth would hold both out."""
    twice = np.concatenate(
        [row for row in stack.rig.directions[:24].reshape(4, 6, 3) for _ in "ab"]
    )
    turns = suggest._turns(impasto.Stack(stack.samples, lights=twice), None)
    assert len(turns) == 3
    for turn in turns:
        assert len(np.unique(turn.rig.directions, axis=0)) == len(turn.rig) == 8


def test_few_photographs_are_held_out_in_turns(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each once; of many photographs one in six is enough. Never more are fitted than were."""
    shown: list[int] = []

    def fit(part: impasto.Stack, *, threads: int | None, **options: Any) -> Any:
        def predict(rig: impasto.Rig) -> Any:
            shown.append(len(rig))
            return np.zeros((len(rig), 3, *part.shape[2:]))

        return SimpleNamespace(predict=predict)

    monkeypatch.setattr("impasto.suggest.fit_sbrdf", fit)
    ticks = itertools.count()
    monkeypatch.setattr("impasto.suggest.time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    for count, turns in {8: 6, 20: 6, 23: 6, 24: 6, 29: 5, 36: 4, 48: 3}.items():
        shown.clear()
        trials = impasto.suggest_effort(stack.take(range(count)), error=0.1).tried
        assert len(shown) == turns * len(trials)
        assert sum(shown) >= min(count, suggest.SHOWN) * len(trials)
        # Black is off by all there is.
        assert {trial.error for trial in trials} == {1.0}


@pytest.mark.parametrize(
    ("error", "told"), [(0.0123, "1.2 %"), (0.996, "100 %"), (0.994, "99 %"), (25.0, "2500 %")]
)
def test_errors_are_told_in_plain_numbers(error: float, told: str) -> None:
    found = suggest.Suggestion({"joint": False}, 1.0, error, True, ())
    assert str(found).endswith(f"an error of {told}.")


def test_times_are_those_of_the_whole_painting(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of fits that cost what the real ones do in outline, on a clock that only they move."""
    now = 0.0

    def cost(pixels: int, options: dict[str, Any]) -> float:
        effort = options.get("effort", "standard")
        if options.get("pooling") == "pixel":
            steps = 1e-5 * PRESETS[effort].iterations
            if PRESETS[effort].start == "pyramid":
                return steps * pixels
            # Of so many tiles of 256 pixels every so many, 40 at most, are searched twice.
            tiles = -(-pixels // 256)
            return steps * (pixels + 256 * -(-tiles // -(-tiles // 40)))
        most = effort.pixels if isinstance(effort, Effort) else PRESETS[effort].pixels
        search = 3e-6 if options.get("joint", True) else 1e-6
        return 0.02 + 1e-6 * pixels + search * min(pixels, most)

    def fit(part: impasto.Stack, *, threads: int | None, **options: Any) -> Any:
        nonlocal now
        now += cost(part.shape[2] * part.shape[3], options)
        return SimpleNamespace(predict=lambda rig: np.zeros((len(rig), 3, *part.shape[2:])))

    monkeypatch.setattr("impasto.suggest.fit_sbrdf", fit)
    monkeypatch.setattr("impasto.suggest.time", SimpleNamespace(perf_counter=lambda: now))
    # 24 x 24 pixels repeated to 384 x 384, of which one in 36 is tried: whole tiles.
    wide = impasto.Stack(np.tile(stack.samples, (1, 1, 16, 16)), lights=stack.rig)
    tried = impasto.suggest_effort(wide, seconds=1.0).tried
    assert len(tried) == len(suggest.LADDER)
    for trial in tried:
        # 40 of the 48 photographs are known.
        expected = cost(384 * 384, trial.options) * 48 / 40
        # 576 tiles, of which every 15th is 39 and not 38.4.
        assert trial.seconds == pytest.approx(expected, rel=2e-3), trial.options


def test_a_thinned_stack_keeps_its_middle() -> None:
    """Every third of eleven pixels: 1, 4, 7, 10 would lean to one edge, 0 to 9 to the other."""
    seen = np.arange(11)[every((11, 11), 3)[1]]
    assert seen.tolist() == [0, 3, 6, 9]
    assert np.arange(13)[every((13, 13), 3)[1]].tolist() == [0, 3, 6, 9, 12]
    near = impasto.Rig([impasto.PointLight((0.0, 0.0, 100.0 + i)) for i in range(3)], pitch_mm=0.5)
    whole = impasto.Stack(np.ones((3, 1, 13, 13), np.float32), lights=near)
    assert thinned(whole, 3).rig.pitch_mm == 1.5


def test_what_photographs_do_not_know_does_not_count() -> None:
    truth = np.array([1.0, 2.0, np.inf, np.nan])
    assert relative_error(np.array([1.0, 2.0, 0.0, 5.0]), truth) == 0.0
    assert relative_error(np.array([np.nan, 2.0, 0.0, 5.0]), truth) == pytest.approx(0.2**0.5)
    # Beyond full scale a camera tells nothing apart: neither does the error.
    assert relative_error(np.array([1.0, 3.0, 9.0, 5.0]), truth, 2.0) == 0.0


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 60),
    alike=st.booleans(),
    seen=st.booleans(),
)
def test_photographs_are_dealt_out_evenly_and_apart(
    seed: int, count: int, alike: bool, seen: bool
) -> None:
    """Any rig: of lights that stand in one place, too, and of cameras that move."""
    rng = np.random.default_rng(seed)
    lights, views = rng.normal(size=(2, count, 3))
    if alike:
        lights = lights[rng.integers(0, count, count) // 2]
    lights[:, 2], views[:, 2] = np.abs(lights[:, 2]) + 0.1, np.abs(views[:, 2]) + 0.1
    rig = impasto.Rig(
        lights / np.linalg.norm(lights, axis=1, keepdims=True),
        views=views / np.linalg.norm(views, axis=1, keepdims=True) if seen else None,
    )
    hands = suggest._hands(rig)
    assert sorted(np.concatenate(hands)) == list(range(count))
    sizes = [len(hand) for hand in hands]
    assert len(sizes) == suggest.HELD
    assert max(sizes) - min(sizes) <= 1
    # In the order of the rig each went where it was farthest from all that lay there, of the hands
    # that had room; into an empty one first.
    apart = np.linalg.norm(rig.directions[:, None] - rig.directions, axis=2)
    apart = np.hypot(apart, np.linalg.norm(rig.views[:, None] - rig.views, axis=2))
    for index in range(count):
        room = [hand for hand in hands if (hand < index).sum() < len(hand)]
        nearest = [apart[index, hand[hand < index]].min(initial=np.inf) for hand in room]
        own = next(place for place, hand in enumerate(room) if index in hand)
        # Two ways to one distance of numbers up to 3 end some roundings of 4e-16 apart.
        assert nearest[own] >= max(nearest) - 1e-12 or nearest[own] == max(nearest)
        # So that a neighbour lies in another, as long as there is one that is not full.
        if len(room) > 1 and np.partition(nearest, 1)[1] > min(nearest) + 1e-12:
            assert nearest[own] > min(nearest)


def test_an_error_relative_to_nothing() -> None:
    black, grey = np.zeros(3), np.full(3, 0.5)
    assert relative_error(black, black) == 0.0
    assert relative_error(np.full(3, np.nan), black) == 0.0
    assert relative_error(grey, black) == np.inf
    assert relative_error(black, grey) == 1.0
    assert np.isnan(relative_error(grey, np.full(3, np.nan)))


def test_a_suggestion_keeps_its_word() -> None:
    """On a painting that no setting was chosen on, and photographs that no trial saw.

    Within 15 %: the trial has a fourth of the pixels and five sixths of the photographs.
    """
    painting = simulate.painting(44, (72, 72))
    photographs = simulate.capture(painting, impasto.Rig(specimens.dome()), "rgb").stack
    held = np.arange(2, 60, 5)
    known = photographs.take(np.setdiff1d(np.arange(60), held))
    suggestion = impasto.suggest_effort(known, error=1e-6)
    fitted = impasto.fit_sbrdf(known, **suggestion.options)
    truth = np.array([photographs.linear(i) for i in held])
    found = relative_error(
        fitted.predict(photographs.take(held).rig), truth, full_scale(photographs)
    )
    assert found == pytest.approx(suggestion.error, rel=0.15)
