"""Bundle adjustment of a rig, against dense least squares and against rigs that were put in."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.fit import bundle_adjustment
from impasto.fit.bundle_adjustment import _bounded, _eliminated, _Linear
from test_rig_refinement import error, photographs

PIXELS, BANDS, LIGHTS, OWN, PLACES = 7, 2, 9, 4, 2


@pytest.fixture
def linear() -> _Linear:
    rng = np.random.default_rng(2)
    shape = (PIXELS, BANDS, LIGHTS)
    return _Linear(
        error=rng.normal(size=shape),
        pixel=rng.normal(size=(*shape, OWN)),
        place=rng.normal(size=(*shape, PLACES)),
        lamp=rng.uniform(0.5, 1.5, shape),
    )


def dense(linear: _Linear) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of all samples ``(n, band, obs)`` by the rig, and by all pixels' unknowns."""
    assert linear.lamp is not None
    rig = np.zeros((*linear.error.shape, PLACES + LIGHTS))
    rig[..., :PLACES] = linear.place
    own = np.zeros((*linear.error.shape, PIXELS * OWN))
    for light in range(LIGHTS):
        rig[:, :, light, PLACES + light] = linear.lamp[:, :, light]
    for pixel in range(PIXELS):
        own[pixel, :, :, pixel * OWN : (pixel + 1) * OWN] = linear.pixel[pixel]
    return rig, own


@pytest.mark.parametrize("block", [3, 128])
def test_a_step_is_that_of_least_squares_in_all_unknowns(
    linear: _Linear, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle_adjustment, "_BLOCK", block)
    monkeypatch.setattr(bundle_adjustment, "_RIDGE", 0.0)
    matrix, right = _eliminated(linear, np.ones(LIGHTS, dtype=np.bool_))
    rig, own = dense(linear)
    both = np.concatenate([rig, own], axis=-1).reshape(linear.error.size, -1)
    together = np.linalg.lstsq(both, linear.error.ravel(), rcond=None)[0]
    # Double precision and condition numbers below 100.
    np.testing.assert_allclose(
        np.linalg.solve(matrix, right), together[: PLACES + LIGHTS], rtol=1e-9, atol=1e-12
    )


def test_held_out_errors_change_as_the_surfaces_follow(
    linear: _Linear, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle_adjustment, "_RIDGE", 0.0)
    monkeypatch.setattr(bundle_adjustment, "_bounded", lambda leverage: np.ones(len(leverage)))
    held = np.arange(LIGHTS) % 2 == 0
    matrix, right = _eliminated(linear, held)
    rig, own = dense(linear)

    def rows(one: np.ndarray, photographs: np.ndarray) -> np.ndarray:
        part = one[:, :, photographs]
        return part.reshape(-1, part.shape[-1])

    follow = np.linalg.lstsq(rows(own, ~held), rows(rig, ~held), rcond=None)[0]
    left = rows(rig, held) - rows(own, held) @ follow
    np.testing.assert_allclose(matrix, left.T @ left, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(right, left.T @ linear.error[:, :, held].ravel(), atol=1e-9)


@pytest.mark.parametrize("lamps", [True, False])
def test_no_pixel_at_all_tells_nothing(linear: _Linear, lamps: bool) -> None:
    # Of a sample without one pixel that can be fitted.
    none = linear.of(slice(0, 0), np.ones(LIGHTS, dtype=np.bool_))
    if not lamps:
        none = replace(none, lamp=None)
    matrix, right = _eliminated(none, np.ones(LIGHTS, dtype=np.bool_))
    numbers = PLACES + LIGHTS * lamps
    np.testing.assert_array_equal(matrix, np.zeros((numbers, numbers)))
    np.testing.assert_array_equal(right, np.zeros(numbers))


def test_no_pixel_counts_more_than_a_usual_one() -> None:
    leverage = np.array([[1.0, 4.0], [2.0, 0.0], [3.0, 5.0], [200.0, 6.0], [0.0, 1.0]])
    weight = _bounded(leverage)
    assert (weight[:, None] * leverage <= np.median(leverage, axis=0) * (1.0 + 1e-12)).all()
    assert weight[1] == 1.0
    # Nothing is known of what no pixel shows, and nothing bounded by it.
    assert _bounded(np.zeros((4, 1))).tolist() == [1.0] * 4


@pytest.fixture(scope="module")
def everything() -> tuple[Any, impasto.Stack, impasto.Rig, np.ndarray]:
    """Near camera, near lamps and uneven strengths, under a rig that says nothing of it."""
    normal, stack, true = photographs(3.0, 4.0)
    strength = np.random.default_rng(7).uniform(0.5, 1.5, len(stack.rig))
    samples = np.asarray(stack.samples) * strength[:, None, None, None].astype(np.float32)
    return normal, stack._replace(samples=samples), true, strength


@pytest.mark.slow
def test_camera_lamps_and_strengths_are_found_together(everything: Any) -> None:
    normal, stack, true, strength = everything
    refined = impasto.refine_rig(stack)
    report = refined.refinement
    assert report is not None
    assert report.camera.accepted
    assert report.lamps.accepted
    assert report.strengths.accepted
    assert report.open[0] == "overall strength"
    # Noise of 0.2 % of white, some 1 % of a sample, in 576 pixels of three bands: 0.03 % in a
    # strength, if nothing but it were sought. Distances are correlated with all strengths.
    off = np.log(refined.intensities / strength)
    assert np.abs(off - np.median(off)).mean() < 0.005
    assert report.camera.found == pytest.approx(3.0, rel=0.02)
    assert report.lamps.found == pytest.approx(4.0, rel=0.01)
    even = stack._replace(samples=np.asarray(stack.samples) / strength[:, None, None, None])
    told = error(normal, even, true)
    # What is promised of all at once.
    assert error(normal, stack, refined) < 1.3 * told


@pytest.mark.slow
def test_a_black_photograph_has_the_strength_that_was_given(everything: Any) -> None:
    stack = everything[1]
    samples = np.array(stack.samples)
    samples[5] = 0.0
    refined = impasto.refine_rig(stack._replace(samples=samples), camera=False, lamps=False)
    assert refined.refinement is not None
    assert refined.refinement.strengths.accepted
    factor = refined.intensities
    assert np.isfinite(factor).all()
    known = np.arange(len(factor)) != 5
    assert factor[known].min() <= factor[5] <= factor[known].max()
