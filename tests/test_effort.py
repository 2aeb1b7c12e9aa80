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
from impasto import Effort, simulate
from impasto.effort import PRESETS
from impasto.fit import cross_validation
from impasto.fit.subsample import pixel_count, stride_index, subsampled, subsampled_to
from impasto.simulate.score import normal_error
from impasto.study import suggestion, trials
from impasto.study.relative_error import full_scale, relative_error
from study import data_sets


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """48 lights on a painting with three varnishes."""
    painting = simulate.painting(5, (24, 24), varnish="patches")
    return simulate.capture(painting, impasto.Rig(data_sets.dome(48)), "rgb").stack


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
        "pixels": (Effort(pixels=64), {"pooling": "painting"}),
        "rounds": (Effort(rounds=0), {"pooling": "pixel"}),
        "iterations": (Effort(iterations=1), {"pooling": "pixel"}),
        "colour_iterations": (Effort(colour_iterations=1), {"pooling": "pixel"}),
        "start": (Effort(start="multistart"), {"pooling": "pixel"}),
        "precision": (Effort(precision="polished"), {"pooling": "pixel"}),
    }
    assert others.keys() == base.to_dict().keys()
    for name, (effort, options) in others.items():
        fits = [impasto.fit_sbrdf(stack, effort=e, **options).normal for e in (base, effort)]
        assert not np.array_equal(fits[0], fits[1], equal_nan=True), name


def test_rounds_of_one_step_are_as_near_the_truth_as_rounds_of_searches() -> None:
    painting = simulate.painting(5, (64, 64), varnish="patches")
    made = simulate.capture(painting, impasto.Rig(data_sets.dome(48)), "rgb")
    others = impasto.Rig(data_sets.dome(7))
    shown = simulate.capture(painting, others, "rgb", noise=False, bits=None).stack
    held = np.stack([shown.linear(number) for number in range(len(others))])
    errors, turns = [], []
    for effort in (Effort(), Effort(rounds=3, colour_iterations=1)):
        fit = impasto.fit_sbrdf(made.stack, pooling="pixel", refine=False, effort=effort)
        assert fit.converged.mean() > 0.9
        errors.append(relative_error(fit.predict(others), held))
        turns.append(np.nanmean(normal_error(fit.normal, made.truth.normal)))
    # Both stop short of the least cost, and their ends differ by parts of what noise does: of 4096
    # pixels a mean error scatters by a hundredth or two.
    assert errors[1] <= 1.05 * errors[0]
    assert turns[1] <= 1.05 * turns[0]


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
            {"start": "neighbour"},
            "start: expected 'multistart' or .*'neighbours-only', found 'neighbour'.*'neighbours'",
        ),
        ({"start": None}, "start: expected 'multistart' or .*, found None"),
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


@pytest.mark.slow
def test_a_suggestion_meets_an_error(stack: impasto.Stack) -> None:
    loose, tight = (impasto.suggest_effort(stack, error=error) for error in (0.9, 1e-4))
    assert loose.met
    assert loose.options == loose.tried[0].options
    assert not tight.met
    assert tight.error == min(trial.error for trial in tight.tried)
    assert "nearest to what was asked for" in str(tight)
    assert "fit_sbrdf(stack, " in str(loose)


@pytest.mark.slow
def test_a_suggestion_meets_a_time(stack: impasto.Stack) -> None:
    long, short = (impasto.suggest_effort(stack, seconds=s) for s in (1e6, 1e-9))
    assert long.met
    assert long.error == min(trial.error for trial in long.tried)
    assert not short.met
    assert short.options == short.tried[0].options


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({}, "error: give the largest error"),
        ({"error": 0.0}, "error: expected a number above 0"),
        ({"seconds": float("nan")}, "seconds: expected a number above 0"),
        ({"error": "5%"}, "error: expected a number above 0, found '5%'"),
        ({"error": np.array([0.1, 0.2])}, "error: expected a number above 0"),
        ({"seconds": True}, "seconds: expected a number above 0, found True"),
        ({"error": 1.0}, "error: expected a share below 1 .* found 1.0"),
        ({"error": 5}, "error: expected a share below 1 .0.05 is five per cent; .* found 5"),
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


@pytest.mark.slow
def test_a_turn_without_which_lights_lie_in_a_plane_is_passed_over(stack: impasto.Stack) -> None:
    """The first of three turns holds out the one that stands apart; the others tell enough."""
    tried = impasto.suggest_effort(_arc(stack, 0), error=0.99).tried
    assert len(tried) == len(suggestion.SETTINGS)
    assert all(np.isfinite(trial.error) for trial in tried)


def test_neighbours_are_not_held_out_together(stack: impasto.Stack) -> None:
    """Every direction is there twice, six photographs later: every sixth would hold both out."""
    twice = np.concatenate(
        [row for row in stack.rig.directions[:24].reshape(4, 6, 3) for _ in "ab"]
    )
    turns = cross_validation.folds_of(impasto.Stack(stack.samples, lights=twice), None)
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

    monkeypatch.setattr("impasto.study.trials.fit_sbrdf", fit)
    ticks = itertools.count()
    monkeypatch.setattr(
        "impasto.study.trials.time", SimpleNamespace(perf_counter=lambda: next(ticks))
    )
    for count, folds in {8: 6, 20: 6, 23: 6, 24: 6, 29: 5, 36: 4, 48: 3}.items():
        shown.clear()
        tried = impasto.suggest_effort(stack.take(range(count)), error=0.1).tried
        assert len(shown) == folds * len(tried)
        assert sum(shown) >= min(count, cross_validation.HELD_OUT) * len(tried)
        # Black is off by all there is.
        assert {trial.error for trial in tried} == {1.0}


@pytest.mark.parametrize(
    ("error", "told"), [(0.0123, "1.2 %"), (0.996, "100 %"), (0.994, "99 %"), (25.0, "2500 %")]
)
def test_errors_are_told_in_plain_numbers(error: float, told: str) -> None:
    found = suggestion.Suggestion({"joint": False}, 1.0, error, True, ())
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
            if PRESETS[effort].start != "multistart":
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

    monkeypatch.setattr("impasto.study.trials.fit_sbrdf", fit)
    monkeypatch.setattr("impasto.study.trials.time", SimpleNamespace(perf_counter=lambda: now))
    # 24 x 24 pixels repeated to 384 x 384, of which one in 36 is tried: whole tiles.
    wide = impasto.Stack(np.tile(stack.samples, (1, 1, 16, 16)), lights=stack.rig)
    tried = impasto.suggest_effort(wide, seconds=1.0).tried
    assert len(tried) == len(suggestion.SETTINGS)
    for trial in tried:
        # 40 of the 48 photographs are known.
        expected = cost(384 * 384, trial.options) * 48 / 40
        # 576 tiles, of which every 15th is 39 and not 38.4.
        assert trial.seconds == pytest.approx(expected, rel=2e-3), trial.options


def test_a_subsample_keeps_the_centre() -> None:
    """Every third of eleven pixels: 1, 4, 7, 10 would lean to one edge, 0 to 9 to the other."""
    seen = np.arange(11)[stride_index((11, 11), 3)[1]]
    assert seen.tolist() == [0, 3, 6, 9]
    assert np.arange(13)[stride_index((13, 13), 3)[1]].tolist() == [0, 3, 6, 9, 12]
    near = impasto.Rig([impasto.PointLight((0.0, 0.0, 100.0 + i)) for i in range(3)], pitch_mm=0.5)
    whole = impasto.Stack(np.ones((3, 1, 13, 13), np.float32), lights=near)
    assert subsampled(whole, 3).rig.pitch_mm == 1.5


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
    hands = cross_validation.split(rig)
    assert sorted(np.concatenate(hands)) == list(range(count))
    sizes = [len(hand) for hand in hands]
    assert len(sizes) == cross_validation.FOLDS
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


@pytest.mark.slow
def test_a_suggestion_keeps_its_word() -> None:
    """On a painting that no setting was chosen on, and photographs that no trial saw.

    Within 15 %: the trial has a fourth of the pixels and five sixths of the photographs.
    """
    painting = simulate.painting(44, (72, 72))
    photographs = simulate.capture(painting, impasto.Rig(data_sets.dome()), "rgb").stack
    held = np.arange(2, 60, 5)
    known = photographs.take(np.setdiff1d(np.arange(60), held))
    suggested = impasto.suggest_effort(known, error=1e-6)
    fitted = impasto.fit_sbrdf(known, **suggested.options)
    truth = np.array([photographs.linear(i) for i in held])
    found = relative_error(
        fitted.predict(photographs.take(held).rig), truth, full_scale(photographs)
    )
    assert found == pytest.approx(suggested.error, rel=0.15)


def test_arrays_are_no_efforts(stack: impasto.Stack) -> None:
    """Of several words ``in`` has no answer, of one it says yes."""
    for words in (np.array(["draft", "standard"]), np.array("draft")):
        with pytest.raises(impasto.ArgumentError, match="effort: expected 'draft'"):
            impasto.fit_normals(stack, effort=words)  # type: ignore[arg-type]
    for name in ("start", "precision"):
        for words in (
            np.array(["multistart", "single"]),
            np.array("multistart"),
            np.array("single"),
        ):
            with pytest.raises(impasto.ArgumentError, match=f"{name}: expected"):
                Effort(**{name: words})


def test_numbers_that_are_not_whole_are_told_apart_from_those_out_of_range() -> None:
    with pytest.raises(impasto.ArgumentError, match="2147483647, a whole number, found"):
        Effort(pixels=5.0)  # type: ignore[arg-type]
    with pytest.raises(impasto.ArgumentError, match="rounds: expected 0 to 2147483647, found -1"):
        Effort(rounds=-1)


def test_infinity_is_above_0_and_refused_as_what_it_is(stack: impasto.Stack) -> None:
    with pytest.raises(impasto.ArgumentError, match="seconds: expected a finite number above 0"):
        impasto.suggest_effort(stack, seconds=np.inf)


def test_lights_in_one_plane_are_not_blamed_on_the_trial(stack: impasto.Stack) -> None:
    """All 48 of them are, not 40 for the eight that are held out."""
    flat = stack._replace(rig=_arc(stack, 0).rig)
    turn = np.radians(np.linspace(15.0, 165.0, 48))
    lights = np.stack([np.cos(turn), 0.0 * turn, np.sin(turn)], axis=1)
    with pytest.raises(impasto.GeometryError, match="the 48 lights lie in one plane") as told:
        impasto.suggest_effort(flat._replace(rig=impasto.Rig(lights)), error=0.1)
    assert "held out" not in str(told.value)


@pytest.mark.parametrize("band", [slice(1, 2), slice(None)], ids=["one band", "all but one photo"])
def test_pixels_that_no_fit_can_estimate_have_no_suggestion(
    stack: impasto.Stack, band: slice
) -> None:
    """Photographs that show something, which is too little: no setting would be the best."""
    samples = np.array([stack.linear(i) for i in range(12)])
    samples[: 12 if band.stop else 11, band] = np.nan
    with pytest.raises(impasto.ArgumentError, match=r"found \w+ and nothing else"):
        impasto.suggest_effort(impasto.Stack(samples, lights=stack.rig.take(range(12))), seconds=9)


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(89.0, "89 s"), (90.0, "1.5 min"), (1000.0, "17 min"), (5400.0, "1.5 h"), (1e6, "278 h")],
)
def test_times_are_told_to_a_twentieth(seconds: float, told: str) -> None:
    """90 s were 2 min."""
    assert f"will take {told} here" in str(suggestion.Suggestion({}, seconds, 0.1, True, ()))


def test_what_is_no_better_than_black_says_so() -> None:
    told = str(suggestion.Suggestion({"joint": False}, 1.0, 1.25, True, ()))
    assert told.endswith("relight, no better than black, with an error of 125 %.")


# --- some pixels for all


def _numbered(shape: tuple[int, int], rig: Any = None, **more: Any) -> impasto.Stack:
    """Every pixel's sample is its place."""
    samples = np.arange(3.0 * shape[0] * shape[1], dtype=np.float32).reshape(3, 1, *shape)
    # scale=1.0: these whole numbers are no codes.
    return impasto.Stack(samples, lights=np.eye(3) if rig is None else rig, scale=1.0, **more)


@pytest.mark.parametrize("shape", [(1, 90000), (90000, 1), (5, 20000), (300, 300), (64, 64)])
def test_a_part_of_any_shape_is_no_larger_than_asked(shape: tuple[int, int]) -> None:
    """A stride of five would leave 18000 pixels of a line of 90000."""
    part = subsampled_to(_numbered(shape), 4096)
    assert 2000 < pixel_count(part) <= 4096


def test_of_a_mask_in_a_corner_only_the_corner_is_looked_at() -> None:
    mask = np.zeros((200, 300), np.bool_)
    mask[150:190, 260:] = True
    mask[160, 270] = False
    part = subsampled_to(_numbered((200, 300), mask=mask), 4096)
    assert part.shape[2:] == (40, 40)
    assert part.mask is not None
    assert pixel_count(part) == 1599
    assert part.samples[0, 0, 0, 0] == 150 * 300 + 260


def test_what_a_mask_scatters_stands_side_by_side() -> None:
    mask = np.random.default_rng(3).random((400, 300)) < 0.001
    whole = _numbered((400, 300), mask=mask)
    part = subsampled_to(whole, 200)
    assert part.mask is not None
    there = part.samples[0, 0][part.mask]
    assert part.samples[0, 0].size < len(there) + np.sqrt(len(there)) + 1
    np.testing.assert_array_equal(there, whole.samples[0, 0][mask])
    # Near lamps shine on every place from elsewhere.
    near = impasto.Rig([impasto.PointLight((0.0, 0.0, 100.0 + i)) for i in range(3)], pitch_mm=0.5)
    assert subsampled_to(_numbered((400, 300), near, mask=mask), 400).shape[3] > 290


def test_near_lamps_shine_on_a_part_as_on_the_whole() -> None:
    """Directions and irradiance, by the inverse square from the lamp to a place of the painting."""
    lamp = impasto.PointLight((30.0, -20.0, 60.0), 0.7)
    mask = np.zeros((80, 120), np.bool_)
    mask[61:, 1:41] = True
    rig = impasto.Rig([lamp] * 3, pitch_mm=0.5)
    part = subsampled_to(_numbered((80, 120), rig, mask=mask), 200)
    row, column = np.divmod(part.samples[0, 0].astype(np.float64), 120)
    assert part.rig.pitch_mm == 1.0
    height, width = row.shape
    for frame, at, shape, pitch in (
        (lamp, (row, column), (80, 120), 0.5),
        (part.rig.lights[0], np.mgrid[:height, :width], (height, width), 1.0),
    ):
        assert isinstance(frame, impasto.PointLight)
        x = (at[1] - (shape[1] - 1) / 2) * pitch
        y = ((shape[0] - 1) / 2 - at[0]) * pitch
        away = np.stack([frame.position[0] - x, frame.position[1] - y, 60.0 + 0 * x])
        square = (away**2).sum(axis=0)
        light = frame.intensity * np.dot(frame.position, frame.position) / square
        found = np.stack([*(away / np.sqrt(square)), light])
        if frame is lamp:
            expected = found
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_what_lies_outside_the_mask_takes_its_time(
    stack: impasto.Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A microsecond a pixel inside, a tenth outside; the trial itself has nothing outside."""
    now = 0.0

    def fit(part: impasto.Stack, *, threads: int | None, **options: Any) -> Any:
        nonlocal now
        area = part.shape[2] * part.shape[3]
        now += 1e-6 * pixel_count(part) + 1e-7 * (area - pixel_count(part))
        return SimpleNamespace(predict=lambda rig: np.zeros((len(rig), 3, *part.shape[2:])))

    monkeypatch.setattr("impasto.study.trials.fit_sbrdf", fit)
    monkeypatch.setattr("impasto.study.trials.time", SimpleNamespace(perf_counter=lambda: now))
    monkeypatch.setattr("impasto.study.trials.TIMED_SECONDS", 1e-9)
    mask = np.zeros((480, 480), np.bool_)
    mask[:24, 48:72] = True
    wide = impasto.Stack(np.tile(stack.samples, (1, 1, 20, 20)), lights=stack.rig, mask=mask)
    expected = (1e-6 * 576 + 1e-7 * (480 * 480 - 576)) * 48 / 40
    for trial in impasto.suggest_effort(wide, seconds=1.0).tried[1:]:
        if trial.options.get("effort") != "reference":
            assert trial.seconds == pytest.approx(expected, rel=1e-6), trial.options


def test_what_does_less_takes_no_longer() -> None:
    """The draft was tried while another program ran; the default and the best were not."""
    times = (0.2, 0.9, 3.0, 2.0, 4.0)
    tried = [trials.Trial(o, t, 0.1) for o, t in zip(suggestion.SETTINGS, times, strict=True)]
    told = trials.ordered_by_work(tried)
    assert [trial.seconds for trial in told] == [0.2, 0.9, 2.0, 2.0, 4.0]
    assert [trial.options for trial in told] == list(suggestion.SETTINGS)
    # Of equals the one that does least comes first.
    assert sorted(told, key=lambda trial: trial.seconds)[2].options["effort"] == "draft"
