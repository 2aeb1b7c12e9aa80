"""Strengths of lamps from the photographs, against those that were put in.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.fit.held_out import HeldOut
from impasto.fit.strength_search import Medians
from impasto.fit.subsample import subsampled
from oracles import forward as oracle
from oracles.rigs import spiral as lights

SHAPE = (12, 30)
NOISE = 0.002


def relief(strength: Any, directions: Any) -> tuple[Any, Any]:
    """Normals and photographs of a varnished relief under lamps of these strengths."""
    rng = np.random.default_rng(3)
    normal = np.concatenate([rng.normal(0.0, 0.25, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SHAPE))
    even = oracle.stack(normal, diffuse, 4.0, 0.15, impasto.Rig(directions))
    lit = np.asarray(strength)[:, None, None, None] * even
    return normal, (lit + rng.normal(0.0, NOISE, lit.shape)).astype(np.float32)


def uneven(count: int = 60) -> Any:
    """Strengths that scatter by a quarter, median 1."""
    log = np.random.default_rng(5).normal(0.0, 0.25, count)
    return np.exp(log - np.median(log))


def angle(a: Any, b: Any) -> Any:
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=0), -1.0, 1.0)))


@pytest.fixture(scope="module")
def scene() -> tuple[Any, impasto.Stack, impasto.Strengths]:
    normal, values = relief(uneven(), lights())
    stack = impasto.Stack(values, lights=lights())
    return normal, stack, impasto.fit_strengths(stack, gauge="free")


def test_strengths_are_those_that_were_put_in(scene: Any) -> None:
    found = scene[2]
    assert np.median(found.factor) == pytest.approx(1.0)
    assert found.converged
    # Rounds end where a step is below 0.5 %; what is left of a slow mode is a few such steps.
    np.testing.assert_allclose(found.factor, uneven(), rtol=0.02)
    np.testing.assert_array_equal(found.rig.intensities, found.factor)
    assert repr(found).startswith("<Strengths of 60 lights, 0.")


def test_normals_are_better_under_them(scene: Any) -> None:
    normal, stack, found = scene
    before = impasto.fit_sbrdf(stack, pooling="pixel").normal
    after = impasto.fit_sbrdf(found.stack, pooling="pixel").normal
    assert np.median(angle(after, normal)) < 0.25 * np.median(angle(before, normal))


@pytest.mark.parametrize("count", [60, 7])
def test_even_lamps_stay_even(count: int) -> None:
    _, values = relief(np.ones(count), lights(count))
    found = impasto.fit_strengths(impasto.Stack(values, lights=lights(count)), gauge="free")
    # The median over 360 pixels of noise of some 1 % each: 0.1 %; a step may be 0.5 %.
    np.testing.assert_allclose(found.factor, 1.0, rtol=0.01)


def test_given_intensities_are_where_the_search_starts(scene: Any) -> None:
    _, stack, found = scene

    def given(intensities: Any) -> impasto.Strengths:
        towards = map(tuple, stack.rig.directions)
        lamps = [
            impasto.DistantLight(d, intensity=float(i))
            for d, i in zip(towards, intensities, strict=True)
        ]
        return impasto.fit_strengths(
            impasto.Stack(stack.samples, lights=impasto.Rig(lamps)), gauge="free"
        )

    # Powers of two change no bit but those of the intensities.
    twice = given(np.full(60, 2.0))
    np.testing.assert_array_equal(twice.factor, found.factor)
    np.testing.assert_array_equal(twice.rig.intensities, 2.0 * found.factor)
    # Lamps whose strengths are known need no factors.
    np.testing.assert_allclose(given(uneven()).factor, 1.0, rtol=0.01)


def test_any_number_of_threads_gives_the_same_bits(scene: Any) -> None:
    again = impasto.fit_strengths(scene[1], threads=3, gauge="free")
    assert again.factor.tobytes() == scene[2].factor.tobytes()


def test_lamps_in_between_are_interpolated() -> None:
    """A lamp that came nearer on one side: ``log strength`` is a smooth function of direction."""

    def smooth(directions: Any) -> Any:
        return np.exp(0.3 * directions[:, 0] + 0.2 * directions[:, 1] ** 2)

    held = np.arange(60) % 6 == 0
    _, values = relief(smooth(lights()), lights())
    stack = impasto.Stack(values[~held], lights=lights()[~held])
    found = impasto.fit_strengths(stack, gauge="free")
    np.testing.assert_allclose(found.at(stack.rig).intensities, found.factor, rtol=1e-6)
    truth = smooth(lights())
    ratio = found.at(lights()[held]).intensities / (truth[held] / np.median(truth[~held]))
    # Inside the lamps that were seen; two of the ten held out are the highest and near the rim.
    assert np.percentile(np.abs(ratio - 1.0), 80) < 0.04
    # Far outside they are those of a lamp that was seen.
    outside = found.at(np.array([[1.0, 0.0, 0.01], [-1.0, 0.0, 0.01]])).intensities
    assert found.factor.min() <= outside.min()
    assert outside.max() <= found.factor.max()


def test_low_lamps_of_a_displaced_dome_are_interpolated(scene: Any) -> None:
    """Irradiance of a dome whose middle is not the painting's; every sixth lamp is left out."""
    turn = 2.399963 * np.arange(96)
    z = np.linspace(0.97, 0.05, 96)
    dome = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    strength = 1.0 / ((dome - (0.15, -0.1, 0.1)) ** 2).sum(axis=1)
    errors = []
    for fold in range(6):
        held = np.arange(96) % 6 == fold
        factor = strength[~held] / np.median(strength[~held])
        lamps = impasto.Strengths(factor, impasto.Rig(dome[~held]), scene[1], True, 0.0 * factor)
        truth = strength[held] / np.median(strength[~held])
        errors.append(np.log(lamps.at(dome[held]).intensities / truth))
    # 0.0036 in stereographic coordinates; over x and y, where the rim is squeezed, 0.0136.
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.006


@pytest.mark.parametrize("spread", [0.3, 0.5])
def test_lamps_that_differ_widely(spread: float) -> None:
    """Log-normal strengths under few lamps, where tilts hide what grows to one side."""
    log = np.random.default_rng(6).normal(0.0, spread, 24)
    strength = np.exp(log - np.median(log))
    _, values = relief(strength, lights(24))
    found = impasto.fit_strengths(impasto.Stack(values, lights=lights(24)), gauge="free")
    assert found.converged
    # Extrapolated factors are within 0.5 % each; the slowest mode, which is a tilt, adds its own.
    np.testing.assert_allclose(found.factor, strength, rtol=0.02)


@pytest.mark.parametrize("power", [-10, 10, 20])
def test_one_lamp_is_far_off(scene: Any, power: int) -> None:
    """A lamp a thousand times as strong, or an exposure that somebody forgot."""
    _, stack, found = scene
    factor = np.where(np.arange(60) == 17, 2.0**power, 1.0)
    samples = stack.samples * factor[:, None, None, None].astype(np.float32)
    other = impasto.fit_strengths(impasto.Stack(samples, lights=lights()), gauge="free")
    assert other.converged
    # Noise is scaled with the light: what differs is where the search starts, and ends.
    np.testing.assert_allclose(other.factor, factor * found.factor, rtol=0.01)


def test_the_number_of_rounds_is_limited(scene: Any) -> None:
    _, stack, found = scene
    calls: list[tuple[int, int]] = []
    one = impasto.fit_strengths(
        stack, rounds=1, gauge="free", progress=lambda *call: calls.append(call)
    )
    # One adjustment, one round.
    assert calls[-1] == (2, 2)
    # Where the model describes all samples, rounds do not help, and do not count.
    np.testing.assert_array_equal(one.factor, found.factor)
    wrong: Any
    for wrong in (0, 1.5, True, "many"):
        with pytest.raises(impasto.ArgumentError, match="rounds: expected a number from 1 on"):
            impasto.fit_strengths(stack, rounds=wrong, gauge="free")


def test_medians_find_a_lamp_that_is_off(scene: Any) -> None:
    _, stack, _ = scene
    test = HeldOut(stack, 360, index=1.45, threads=1)
    medians = Medians(test, stack.rig, 2, 1)
    start = np.log(uneven())
    start[17] += 0.2
    for held in (False, True):
        end = medians.rounds(start, 12, lambda: None, held=held)
        assert end.known.all()
        # Rounds end where a step is below 0.5 %, of what is left a half or more.
        assert end.log[17] - np.log(uneven()[17]) == pytest.approx(0.0, abs=0.02)


def test_the_order_of_photographs_hardly_matters(scene: Any) -> None:
    """Sums in another order end roundings apart; where a search ends, 0.5 % of a factor."""
    _, stack, found = scene
    order = np.random.default_rng(2).permutation(60)
    other = impasto.fit_strengths(stack.take(order), gauge="free")
    assert other.converged
    np.testing.assert_allclose(other.factor, found.factor[order], rtol=0.005)


def test_two_lamps_in_one_direction_share_a_strength(scene: Any) -> None:
    factor = np.array([1.0, 1.2, 0.8, 1.0, 0.9, 1.1])
    directions = lights(6)
    directions[1] = directions[0]
    found = impasto.Strengths(factor, impasto.Rig(directions), scene[1], True, 0.0 * factor)
    both = found.at(directions[:1]).intensities
    np.testing.assert_allclose(both, np.sqrt(1.2), rtol=1e-6)


def test_too_little_is_refused() -> None:
    _, values = relief(uneven(), lights())
    # Under six lights the photographs allow estimates that differ by 15 % where lamps are even.
    few = impasto.Stack(values[:6], lights=lights()[:6])
    with pytest.raises(impasto.ArgumentError, match="at least 7 lights, found 6"):
        impasto.fit_strengths(few, gauge="free")
    with pytest.raises(impasto.ArgumentError, match="found none"):
        impasto.fit_strengths(impasto.Stack(0.0 * values, lights=lights()), gauge="free")


def test_unknowns_are_fewer_than_samples() -> None:
    """Six of every pixel, and every strength but one."""
    for count, enough in ((7, 7), (12, 2), (24, 2)):
        _, values = relief(np.ones(count), lights(count))
        assert enough * count > 6 * enough + count - 1 >= (enough - 1) * count + 6
        few = [
            impasto.Stack(values[..., :1, :n], lights=lights(count)) for n in (enough, enough - 1)
        ]
        with pytest.raises(impasto.ArgumentError, match=f"{enough} pixels .* found {enough - 1}$"):
            impasto.fit_strengths(few[1], gauge="free")
        assert np.isfinite(impasto.fit_strengths(few[0], gauge="free").factor).all()
        mask = np.zeros(SHAPE, bool)
        mask[3, : enough - 1] = True
        with pytest.raises(impasto.ArgumentError, match=f"at least {enough} pixels"):
            impasto.fit_strengths(
                impasto.Stack(values, lights=lights(count), mask=mask), gauge="free"
            )


@pytest.mark.parametrize(
    "lost", [0.0, -0.001, np.nan, np.inf], ids=["black", "below", "gone", "over"]
)
def test_a_lamp_that_no_pixel_determines_is_named(lost: float) -> None:
    strength = uneven(24)
    _, values = relief(strength, lights(24))
    values[[3, 17]] = lost
    stack = impasto.Stack(values, lights=lights(24))
    found = impasto.fit_strengths(stack, gauge="free")
    known = np.delete(np.arange(24), [3, 17])
    assert np.isnan(found.factor[[3, 17]]).all()
    assert np.isnan(found.change[[3, 17]]).all()
    assert found.converged
    np.testing.assert_array_equal(found.rig.intensities[[3, 17]], 1.0)
    assert ", 2 of which no pixel determines (photographs 3, 17: " in repr(found)
    # The others are what they are without those two.
    assert np.median(found.factor[known]) == pytest.approx(1.0)
    expected = strength[known] / np.median(strength[known])
    np.testing.assert_allclose(found.factor[known], expected, rtol=0.02)
    alone = impasto.fit_strengths(stack.take(known), gauge="free")
    assert alone.state == ""
    np.testing.assert_allclose(found.factor[known], alone.factor, rtol=0.01)
    # They do not affect the interpolation either.
    there = found.at(stack.rig).intensities
    np.testing.assert_allclose(there[known], found.factor[known], rtol=1e-6)
    assert np.isfinite(there).all()


@pytest.mark.parametrize("count", [60, 24])
def test_even_lamps_are_left_as_given(count: int) -> None:
    _, values = relief(np.ones(count), lights(count))
    found = impasto.fit_strengths(impasto.Stack(values, lights=lights(count)))
    # Held-out photographs are predicted no better by estimates that scatter by 0.1 %.
    assert found.gauge == "given"
    np.testing.assert_array_equal(found.factor, 1.0)
    assert found.converged
    assert f"{count} lights, 1.00 to 1.00, as given" in repr(found)


def test_gloss_determines_tilt_and_fall_off(scene: Any) -> None:
    """Strengths whose tilt and fall-off the given lamps have wrong by degrees."""
    normal, stack, _ = scene
    found = impasto.fit_strengths(stack)
    assert found.gauge == "determined"
    assert found.held_out is not None
    assert found.held_out.gain > 2.0 * found.held_out.scatter
    before = impasto.fit_sbrdf(stack, pooling="pixel").normal
    after = impasto.fit_sbrdf(found.stack, pooling="pixel").normal
    assert np.median(angle(after, normal)) < 0.25 * np.median(angle(before, normal))
    again = impasto.fit_strengths(stack, threads=3)
    assert again.factor.tobytes() == found.factor.tobytes()


def matte(strength: Any, directions: Any) -> tuple[Any, Any]:
    """A nearly flat painting without gloss: what tilts it and what its lamps do look alike."""
    rng = np.random.default_rng(4)
    normal = np.concatenate([rng.normal(0.0, 0.02, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SHAPE))
    even = oracle.stack(normal, diffuse, 0.0, 0.15, impasto.Rig(directions))
    lit = np.asarray(strength)[:, None, None, None] * even
    return normal, (lit + rng.normal(0.0, NOISE, lit.shape)).astype(np.float32)


def test_strengths_that_photographs_do_not_tell_turn_no_normals() -> None:
    """Three arms of lamps, stronger to one side: without gloss the side remains what was given."""
    directions = lights(48)
    arms = np.cos(3.0 * np.arctan2(directions[:, 1], directions[:, 0]))
    strength = np.exp(0.2 * arms + 0.1 * directions[:, 0] / directions[:, 2].clip(0.3))
    _, values = matte(strength, directions)
    stack = impasto.Stack(values, lights=directions)

    def mean(photographs: impasto.Stack) -> Any:
        normal = impasto.fit_sbrdf(photographs, pooling="pixel").normal.mean(axis=(1, 2))
        return normal / np.linalg.norm(normal)

    found = impasto.fit_strengths(stack)
    assert found.gauge == "held"
    assert np.degrees(np.arccos(mean(stack) @ mean(found.stack))) < 0.3


def test_few_lights_leave_nothing_to_hold_out() -> None:
    _, values = relief(uneven(7), lights(7))
    found = impasto.fit_strengths(impasto.Stack(values, lights=lights(7)))
    assert found.gauge == "given"
    assert found.held_out is None
    assert "too few lights to hold any out" in repr(found)
    held = impasto.fit_strengths(impasto.Stack(values, lights=lights(7)), gauge="held")
    assert held.gauge == "held"
    assert held.factor.max() > 1.05
    wrong: Any = "loose"
    with pytest.raises(impasto.ArgumentError, match="gauge: expected"):
        impasto.fit_strengths(impasto.Stack(values, lights=lights(7)), gauge=wrong)


def test_progress_is_reported(scene: Any) -> None:
    calls: list[tuple[int, int]] = []
    impasto.fit_strengths(
        scene[1], progress=lambda done, total: calls.append((done, total)), gauge="free"
    )
    assert calls[0][0] == 0
    assert calls[-1][0] == calls[-1][1]


def test_held_out_photographs_of_the_icon_are_predicted_better(data: Path) -> None:
    """Two folds, every twelfth pixel."""
    whole = impasto.read_stack(data / "icon_rti" / "dirs.lp", encoding="srgb")
    stack = subsampled(whole, 12)
    gain = []
    for fold in (0, 1):
        held = np.arange(fold, 72, 6)
        train = np.setdiff1d(np.arange(72), held)
        truth = np.rint(stack.encode(np.array([stack.linear(i) for i in held])))

        def score(surface: Any, rig: Any, truth: Any = truth) -> Any:
            shown = stack.encode(np.nan_to_num(surface.predict(rig)))
            error = (np.clip(shown, 0.0, 255.0) - truth) ** 2
            return np.mean(10.0 * np.log10(255.0**2 / error.mean(axis=(1, 2, 3))))

        seen, rig = stack.take(train), stack.take(held).rig
        lamps = impasto.fit_strengths(seen, gauge="free")
        before = score(impasto.fit_sbrdf(seen, pooling="pixel"), rig)
        after = score(impasto.fit_sbrdf(lamps.stack, pooling="pixel"), lamps.at(rig))
        gain.append(after - before)
    # Recorded of all folds at every third pixel: 2.5 dB (benches/results/lamps.json).
    assert min(gain) > 1.0


def test_lamps_that_no_pixel_determines_do_not_count() -> None:
    """Seven lamps of which one shows nothing are six: what six alone are refused for."""
    _, values = relief(np.ones(7), lights(7))
    values[3] = np.nan
    with pytest.raises(
        impasto.ArgumentError, match="at least 7 lights that pixels determine, found 6"
    ):
        impasto.fit_strengths(impasto.Stack(values, lights=lights(7)), gauge="free")
    nothing = impasto.Stack(np.full_like(values, np.nan), lights=lights(7))
    with pytest.raises(impasto.ArgumentError, match="found none"):
        impasto.fit_strengths(nothing, gauge="free")
