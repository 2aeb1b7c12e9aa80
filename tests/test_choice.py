"""``pooling="auto"``: held-out photographs decide what is fitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import ArgumentError, simulate
from impasto.fit.choice import CANDIDATES, MARGIN, PIXELS, Candidate, decibels, simplest
from impasto.fit.cross_validation import full_scale, split
from impasto.fit.options import fit_kinds


def dome(count: int) -> np.ndarray:
    """Directions on a spiral about the vertical, down to 60 degrees from it."""
    turn = np.arange(count)
    tilt = np.radians(8.0 + 52.0 * turn / (count - 1))
    around = turn * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack(
        [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=1
    )


EDGE = 28
"""Pixels a side of most pictures here: hundreds of each varnish."""


def photographs(varnish: str, count: int, size: int = 40) -> impasto.Stack:
    painting = simulate.painting(5, (size, size), varnish=varnish, relief=1.5)  # type: ignore[arg-type]
    rig = impasto.Rig([impasto.DistantLight(tuple(light)) for light in dome(count)], pitch_mm=0.2)
    return simulate.capture(painting, rig, "rgb", encoding="srgb", bits=8).stack


@pytest.fixture(scope="module")
def patches() -> impasto.Stack:
    return photographs("patches", 24, EDGE)


@pytest.fixture(scope="module")
def by_default(patches: impasto.Stack) -> impasto.Sbrdf:
    return impasto.fit_sbrdf(patches)


CHOICE: Any = {"refine": False, "relief": False}
"""What is looked for before the choice, and takes longer."""


def test_threads_change_no_bit_of_what_is_chosen() -> None:
    """With folds side by side, residuals and a relief that is looked for."""
    stack = photographs("satin", 12, 20)
    one, two = (
        impasto.fit_sbrdf(stack, residuals=True, relief=True, threads=count).arrays()
        for count in (1, 2)
    )
    assert one.keys() == two.keys()
    for name, array in one.items():
        assert array.tobytes() == two[name].tobytes(), name


def test_one_gloss_and_few_lights_ask_for_one_lobe() -> None:
    fitted = impasto.fit_sbrdf(photographs("gloss", 9, EDGE), **CHOICE)
    assert isinstance(fitted, impasto.PooledSbrdf)
    assert fitted.chosen is not None
    assert fitted.chosen.best.pooling == "painting"
    assert fitted.chosen.gain > 1.0


def test_several_varnishes_ask_for_lobes_per_pixel(
    patches: impasto.Stack, by_default: impasto.Sbrdf
) -> None:
    fitted = by_default
    assert isinstance(fitted, impasto.LobeSbrdf)
    choice = fitted.chosen
    assert choice is not None
    # The better number of lobes per pixel also under a varnish, without and with ambient light.
    assert [one.coated for one in choice.tried[:-2]] == [one.coated for one in CANDIDATES]
    assert [(one.pooling, one.coated) for one in choice.tried[-2:]] == 2 * [("pixel", True)]
    assert [one.ambient for one in choice.tried[-2:]] == [False, True]
    assert choice.tried[-2].lobes == choice.tried[-1].lobes
    assert choice.gain > 1.0
    # The simplest that is nearly the best.
    most = max(one.decibels for one in choice.tried)
    simpler = choice.tried[: choice.tried.index(choice.best)]
    assert choice.best.decibels >= most - MARGIN
    assert all(one.decibels < most - MARGIN for one in simpler)
    # 24 photographs in six folds: each was held out once.
    assert choice.photographs == 24
    explicit = impasto.fit_sbrdf(patches, **choice.best.options)
    assert explicit.chosen is None
    assert explicit.normal.tobytes() == fitted.normal.tobytes()


def test_the_simplest_of_what_is_about_as_good() -> None:
    """By photographs with residuals first, then by the model alone."""
    simple, middle, most = CANDIDATES[:3]

    def chosen(*each: tuple[float, float]) -> Candidate:
        """Of models, and models with residuals."""
        alike = np.zeros(24)
        return simplest(
            [simple, middle, most], [(model + alike, full + alike) for model, full in each]
        )

    assert chosen((30.0, 30.0), (30.0, 30.0), (30.2, 30.2)) == most
    assert chosen((30.0, 30.0), (30.0, 30.15), (30.2, 30.2)) == most
    assert chosen((30.0, 30.0), (30.15, 30.15), (30.2, 30.2)) == middle
    # Residuals hide that the first model is wrong by 10 dB; the second is only too plain.
    assert chosen((20.0, 40.0), (30.0, 40.0), (29.0, 40.0)) == middle
    # A single photograph tells nothing, however much is gained there: 1 dB in the mean.
    once = np.where(np.arange(24) == 5, 24.0, 0.0)
    assert of_gains(0.0 * once, once) == simple
    # Nor does it hide that another is better everywhere.
    assert of_gains(0.0 * once, 0.5 + 0.0 * once, once) == middle
    # Two do: also where they are all that is held out.
    twice = np.where(np.isin(np.arange(24), [5, 17]), 12.0, 0.0)
    assert of_gains(0.0 * twice, twice) == middle
    assert of_gains(np.zeros(2), np.full(2, 0.2)) == middle
    assert of_gains(np.zeros(1), np.full(1, 0.2)) == middle
    assert of_gains(np.zeros(1), np.full(1, 0.05)) == simple


def of_gains(*gains: np.ndarray) -> Candidate:
    """What is chosen of fits whose photographs have so many dB more than 30."""
    return simplest(CANDIDATES[: len(gains)], [(30.0 + gain, 30.0 + gain) for gain in gains])


def test_the_choice_is_saved_and_reported(by_default: impasto.Sbrdf, tmp_path: Path) -> None:
    fitted = by_default
    fitted.save(tmp_path / "fit.npz")
    again = impasto.load_sbrdf(tmp_path / "fit.npz")
    assert again.chosen == fitted.chosen
    assert fitted.chosen is not None
    report = fitted.chosen.report()
    assert report["chosen"] == fitted.chosen.best.options
    assert len(report["tried"]) == len(CANDIDATES) + 2
    for words in ("per pixel", "held-out photographs", "one lobe for the painting"):
        assert words in str(fitted.chosen)
    assert "held-out photographs" in fitted._repr_html_()


def test_pixels_that_no_fit_can_predict_do_not_count() -> None:
    """A third of the pixels without a sample: they would drown what the others tell."""
    patches = photographs("patches", 24)
    # No more pixels than are sampled: both samples have the same.
    assert PIXELS >= 32 * 32
    samples = np.array([patches.linear(i)[:, :32, :32] for i in range(24)])
    samples[:, :, :11] = np.nan
    lost = impasto.Stack(samples, lights=patches.rig.directions)
    part = impasto.Stack(samples[:, :, 11:], lights=patches.rig.directions)
    chosen = [impasto.fit_sbrdf(stack, **CHOICE).chosen for stack in (lost, part)]
    assert chosen[0] is not None
    assert chosen[1] is not None
    assert chosen[0].best.options == chosen[1].best.options
    # The fits of a pixel do not know of the others, but for the prior: the errors are alike.
    assert chosen[0].best.decibels == pytest.approx(chosen[1].best.decibels, abs=0.2)


def test_held_out_photographs_that_show_nothing_are_no_error() -> None:
    """Of 200 photographs one fold of six is held out: none of its photographs has a sample."""
    stack = photographs("gloss", 200, size=12)
    held = split(stack.rig)[0]
    samples = np.array([stack.linear(i) for i in range(200)])
    samples[held] = np.nan
    fitted = impasto.fit_sbrdf(impasto.Stack(samples, lights=stack.rig.directions), **CHOICE)
    assert fitted.chosen is not None
    assert fitted.chosen.tried == ()
    assert "no held-out photograph shows" in str(fitted.chosen)


def test_exposure_does_not_change_the_choice(patches: impasto.Stack) -> None:
    """A power of two scales every number exactly."""
    samples = np.array([patches.linear(i) for i in range(24)])
    samples[~np.isfinite(samples)] = 1.0
    lights = patches.rig.directions
    one, other = (
        impasto.fit_sbrdf(impasto.Stack(samples * scale, lights=lights), **CHOICE).chosen
        for scale in (np.float32(1.0), np.float32(2.0**-9))
    )
    assert one == other


def test_full_scale_follows_the_exposure() -> None:
    photographs = np.random.default_rng(4).uniform(size=(8, 3, 50))
    for factor in (0.6, 3.0):
        assert full_scale(factor * photographs) == pytest.approx(factor * full_scale(photographs))
    assert full_scale(8.0 * photographs) == 8.0 * full_scale(photographs)
    assert full_scale(np.full((3, 1, 4), np.nan)) == 1.0
    wrong = photographs.copy()
    wrong[5] = 1e4
    assert full_scale(wrong) == pytest.approx(full_scale(photographs), rel=0.01)


def test_seven_photographs_are_too_few_to_hold_any_out() -> None:
    fitted = impasto.fit_sbrdf(photographs("patches", 7))
    assert isinstance(fitted, impasto.PooledSbrdf)
    assert fitted.chosen is not None
    assert fitted.chosen.tried == ()
    assert "7 photographs are too few" in str(fitted.chosen)


def test_nothing_to_see_is_no_error() -> None:
    stack = impasto.Stack(np.zeros((9, 1, 4, 4), np.float32), lights=dome(9))
    fitted = impasto.fit_sbrdf(stack)
    assert fitted.chosen is not None
    assert fitted.chosen.best.pooling == "painting"


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({"joint": False}, impasto.PooledSbrdf),
        ({"extraction": "maximum"}, impasto.PooledSbrdf),
        ({"lobes": 1}, impasto.LobeSbrdf),
        ({"ambient": False}, impasto.LobeSbrdf),
        (
            {"segments": np.arange(EDGE**2).reshape(EDGE, EDGE) // (EDGE**2 // 2)},
            impasto.SegmentSbrdf,
        ),
    ],
)
def test_an_option_of_one_fit_asks_for_that_fit(
    patches: impasto.Stack, options: dict[str, Any], kind: type[impasto.Sbrdf]
) -> None:
    fitted = impasto.fit_sbrdf(patches, **options)
    assert isinstance(fitted, kind)
    assert fitted.chosen is None


def test_no_gloss_is_photometric_stereo(patches: impasto.Stack, tmp_path: Path) -> None:
    matte = impasto.fit_sbrdf(patches, pooling="none")
    assert matte.gloss.beta == 0.0
    assert matte.normal.tobytes() == impasto.fit_normals(patches).normal.tobytes()
    light = np.array([0.3, -0.2, 0.9])
    light /= np.linalg.norm(light)
    cosine = np.maximum(np.einsum("cyx,c->yx", matte.normal, light), 0.0)
    # Lambert's law, in single precision.
    np.testing.assert_allclose(matte.predict([light])[0], cosine * matte.diffuse, atol=1e-6)
    matte.save(tmp_path / "matte.npz")
    assert impasto.load_sbrdf(tmp_path / "matte.npz").verdict == "no-highlight"
    tile = impasto.learn_sbrdf(patches, pooling="none").apply(patches, slice(3, 9), slice(5, 25))
    assert tile.normal.tobytes() == matte[3:9, 5:25].normal.tobytes()


def test_matte_photographs_have_no_gloss() -> None:
    """Lambert's law with noise, and normals by least squares: no lobe predicts better than none."""
    rng = np.random.default_rng(4)
    lights = dome(12)
    normal = np.stack(
        [0.2 * np.sin(np.arange(900.0)), 0.2 * np.cos(np.arange(900.0)), np.ones(900)]
    )
    normal /= np.linalg.norm(normal, axis=0)
    shown = np.maximum(lights @ normal, 0.0)[:, None] * rng.uniform(0.2, 0.8, (1, 3, 900))
    shown += rng.normal(0.0, 0.004, shown.shape)
    stack = impasto.Stack(shown.reshape(12, 3, 30, 30).astype(np.float32), lights=lights)
    fitted = impasto.fit_sbrdf(stack, normals="least-squares", **CHOICE)
    assert fitted.chosen is not None
    assert fitted.chosen.best.pooling == "none"
    assert "no gloss" in str(fitted.chosen)


def test_options_that_no_fit_has_together_are_refused(patches: impasto.Stack) -> None:
    with pytest.raises(ArgumentError, match="lobes and joint: no fit has both"):
        impasto.fit_sbrdf(patches, lobes=1, joint=False)
    with pytest.raises(ArgumentError, match="ambient"):
        impasto.fit_sbrdf(patches, model="lafortune", ambient=True)  # type: ignore[call-overload]


def test_only_the_caller_knows_segments() -> None:
    kinds = fit_kinds("torrance-sparrow", "auto", {"segments": None})
    assert [kind.pooling for kind in kinds] == ["none", "painting", "pixel"]


def test_learned_and_applied_in_tiles_the_choice_is_the_same(
    patches: impasto.Stack, by_default: impasto.Sbrdf, tmp_path: Path
) -> None:
    whole = by_default
    learned = impasto.learn_sbrdf(patches)
    assert learned.chosen == whole.chosen
    learned.save(tmp_path / "learned.npz")
    learned = impasto.load_learned(tmp_path / "learned.npz")
    assert learned.chosen == whole.chosen
    tile = learned.apply(patches, slice(7, 21), slice(10, 25))
    part = whole[7:21, 10:25]
    assert type(tile) is type(whole)
    assert tile.normal.tobytes() == part.normal.tobytes()
    lights = [(0.3, -0.2, 0.9), (0.1, 0.6, 0.7)]
    assert tile.predict(lights).tobytes() == part.predict(lights).tobytes()


def test_decibels_are_those_of_coded_photographs() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.0, 1.2, (3, 2, 5, 6)).astype(np.float32)
    shown = truth + rng.normal(0.0, 0.05, truth.shape).astype(np.float32)
    truth[1, :, 2] = np.nan
    truth[2, 0, 0, 0] = np.inf
    shown[2, 1, 1, 1] = np.nan

    def code(light: np.ndarray) -> np.ndarray:
        """IEC 61966-2-1."""
        light = np.clip(light.astype(np.float64), 0.0, 1.0)
        bent = 1.055 * light ** (1 / 2.4) - 0.055
        return 255.0 * np.where(light <= 0.0031308, 12.92 * light, bent)

    expected = []
    for real, seen in zip(truth, shown, strict=True):
        known = ~np.isnan(real)
        error = code(np.nan_to_num(seen[known], nan=0.0)) - code(
            np.where(np.isinf(real[known]), 1.0, real[known])
        )
        expected.append(10.0 * np.log10(255.0**2 / (error**2).mean()))
    # Codes in single precision: 1.5e-5 of 255, of errors of some 5 codes.
    np.testing.assert_allclose(decibels(shown, truth), expected, rtol=1e-5)
    # A photograph that is met exactly is as near as rounding lets it be.
    assert decibels(truth[:1], truth[:1])[0] == pytest.approx(10 * np.log10(255**2 * 12))
