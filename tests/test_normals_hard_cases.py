"""Pixels and rigs that cannot be solved end in a status or a clear refusal, never in a guess."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import impasto
from impasto import Status
from impasto.fit.normals import METHODS

RING = np.array([[np.cos(a), np.sin(a), 1.2] for a in np.arange(8) * np.pi / 4])
RING /= np.linalg.norm(RING, axis=1, keepdims=True)


def matte(lights: Any, normal: Any = (0.1, -0.2, 0.97), albedo: float = 0.5) -> np.ndarray:
    """Samples (obs, 1, 4, 5) of one flat matte surface."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    shading = np.maximum(np.asarray(lights) @ n, 0.0) * albedo
    return np.broadcast_to(shading[:, None, None, None], (len(shading), 1, 4, 5)).astype(np.float32)


def consistent(fit: impasto.Normals, observations: int) -> None:
    """What holds of every result: NaN, and no infinity, exactly where the status says."""
    estimated = fit.status < 16
    exact = fit.status == Status.EXACT
    np.testing.assert_array_equal(
        np.isnan(fit.normal), np.broadcast_to(~estimated, (3, *estimated.shape))
    )
    known = estimated | (fit.status == Status.DARK)
    np.testing.assert_array_equal(np.isnan(fit.albedo), np.broadcast_to(~known, fit.albedo.shape))
    np.testing.assert_array_equal(np.isnan(fit.condition), ~estimated)
    np.testing.assert_array_equal(np.isnan(fit.residual), ~estimated | exact)
    np.testing.assert_array_equal(np.isnan(fit.sigma), ~estimated | exact)
    for name in ("normal", "albedo", "residual", "condition", "sigma"):
        assert not np.isinf(getattr(fit, name)).any(), name
    length = np.linalg.norm(fit.normal[:, estimated], axis=0)
    np.testing.assert_allclose(length, 1.0, atol=3e-7)
    masked = fit.status == Status.MASKED
    total = fit.used + fit.rejected.sum(axis=0)
    np.testing.assert_array_equal(total, np.where(masked, 0, observations))
    assert (fit.used[estimated] >= 3).all()
    np.testing.assert_array_equal(fit.used[exact], 3)


@pytest.mark.parametrize("method", METHODS)
def test_cases_1_2_26_have_their_status_and_leave_their_neighbours_alone(method: str) -> None:
    samples = matte(RING)
    samples = samples + np.random.default_rng(0).normal(0, 1e-3, samples.shape).astype(np.float32)
    clean = impasto.fit_normals(impasto.Stack(samples, lights=RING), method=method)
    hard = samples.copy()
    hard[:, 0, 0, 0] = 0.0
    hard[:, 0, 0, 1] = np.inf
    hard[:, 0, 0, 2] = np.nan
    hard[2:, 0, 0, 3] = np.nan
    hard[2:, 0, 0, 4] = np.inf
    hard[3:, 0, 1, 0] = np.inf
    hard[:, 0, 1, 1] = -0.01
    hard[:, 0, 1, 2] = -np.inf
    mask = np.ones((4, 5), bool)
    mask[1, 3] = False
    hard[:, 0, 1, 3] = np.nan
    fit = impasto.fit_normals(impasto.Stack(hard, lights=RING, mask=mask), method=method)
    consistent(fit, 8)
    expected = {
        (0, 0): Status.DARK,
        (0, 1): Status.SATURATED,
        (0, 2): Status.INVALID_INPUT,
        (0, 3): Status.TOO_FEW_SAMPLES,
        (0, 4): Status.SATURATED,
        (1, 0): Status.EXACT,
        (1, 1): Status.DARK,
        (1, 2): Status.INVALID_INPUT,
        (1, 3): Status.MASKED,
    }
    for place, status in expected.items():
        assert fit.status[place] == status, place
    assert fit.albedo[0, 0, 0] == 0.0
    np.testing.assert_array_equal(fit.rejected[:, 0, 1], [8, 0, 0, 0])
    np.testing.assert_array_equal(fit.rejected[:, 0, 2], [0, 8, 0, 0])
    for name in ("normal", "albedo", "used", "residual", "condition", "sigma", "status"):
        here, there = getattr(fit, name)[..., 2:, :], getattr(clean, name)[..., 2:, :]
        assert here.tobytes() == there.tobytes(), name


@pytest.mark.parametrize("method", METHODS)
def test_case_30_three_lights_determine_a_normal_and_no_error(method: str) -> None:
    lights = RING[[0, 3, 5]]
    fit = impasto.fit_normals(impasto.Stack(matte(lights), lights=lights), method=method)
    consistent(fit, 3)
    assert (fit.status == Status.EXACT).all()
    n = np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97])
    np.testing.assert_allclose(fit.normal[:, 0, 0], n, atol=1e-6)
    np.testing.assert_allclose(fit.albedo, 0.5, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2])
def test_case_20_fewer_than_three_lights_are_refused_with_advice(count: int) -> None:
    stack = impasto.Stack(matte(RING[:count]), lights=RING[:count])
    with pytest.raises(impasto.GeometryError, match=f"at least three lights, found {count}; take"):
        impasto.fit_normals(stack)


def test_case_19_a_coplanar_rig_is_refused_with_advice() -> None:
    angles = np.radians([-60, -40, -15, 10, 35, 55])
    lights = np.stack([np.sin(angles), 0.3 * np.sin(angles), np.cos(angles)], axis=1)
    with pytest.raises(impasto.GeometryError, match=r"6 lights lie in one plane.*add a photograph"):
        impasto.fit_normals(impasto.Stack(matte(lights), lights=lights))


@pytest.mark.parametrize("method", METHODS)
def test_case_19_pixels_whose_usable_lights_are_coplanar_say_so(method: str) -> None:
    angles = np.radians([-60, -40, -15, 10, 35, 55])
    lights = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    lights = np.concatenate([lights, [[0.0, 0.7, 0.7]]])
    samples = matte(lights).copy()
    samples[6, :, 1, 1] = np.nan
    fit = impasto.fit_normals(impasto.Stack(samples, lights=lights), method=method)
    consistent(fit, 7)
    assert fit.status[1, 1] == Status.RANK_DEFICIENT


def test_a_narrow_rig_is_ill_conditioned() -> None:
    # Lights within 2 degrees: condition about sqrt(2) / tan(2 deg) = 40.
    lights = np.array([[0.035 * np.cos(a), 0.035 * np.sin(a), 1.0] for a in np.arange(8) * 0.785])
    fit = impasto.fit_normals(impasto.Stack(matte(lights), lights=lights), method="least-squares")
    assert (fit.status == Status.ILL_CONDITIONED).all()
    np.testing.assert_allclose(fit.condition, np.sqrt(2) / 0.035, rtol=0.01)


def test_too_few_left_by_a_rule_are_taken_back_in_rank_order() -> None:
    samples = matte(RING, (0, 0, 1)).copy()
    # Mean 1; only two samples lie within 0.9 and 1.1 of it.
    samples[:, 0, 1, 1] = [0.1, 0.2, 0.3, 0.95, 1.05, 1.6, 1.8, 2.0]
    stack = impasto.Stack(samples, lights=RING)
    fit = impasto.fit_normals(stack, method="threshold", w1=1.1, w2=0.9)
    consistent(fit, 8)
    assert fit.status[1, 1] == Status.RELAXED
    assert fit.used[1, 1] == 4
    # Ranks 2 and 5 come back, one from either side.
    np.testing.assert_array_equal(fit.rejected[:, 1, 1], [0, 0, 2, 2])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("power", [-50, -7, 13, 50])
def test_case_28_a_power_of_two_changes_no_bit_of_the_shapes(method: str, power: int) -> None:
    rng = np.random.default_rng(1)
    samples = np.maximum(rng.normal(0.4, 0.2, (8, 2, 9, 31)), 0).astype(np.float32)
    plain = impasto.fit_normals(impasto.Stack(samples, lights=RING), method=method)
    scaled = impasto.fit_normals(
        impasto.Stack(np.ldexp(samples, power), lights=RING), method=method
    )
    for name in ("normal", "used", "rejected", "condition", "sigma", "status"):
        assert getattr(plain, name).tobytes() == getattr(scaled, name).tobytes(), name
    for name in ("albedo", "residual"):
        np.testing.assert_array_equal(np.ldexp(getattr(plain, name), power), getattr(scaled, name))


def test_samples_at_either_end_of_single_precision_have_a_status() -> None:
    samples = np.repeat(matte(RING), 3, axis=3)[:, :, :2, :4].copy()
    samples[:, 0, 0, 0] *= np.float32(1e-20)  # Its squares are no normal numbers any more.
    samples[:, 0, 0, 1] = 0.0
    samples[2, 0, 0, 1] = 1.0  # What is left of the albedo after ten steps of reweighting.
    samples[3, 0, 0, 2] = 1e19  # The square is a number, the sum of two is none.
    samples[6, 0, 0, 2] = 1e19
    for method in METHODS:
        fit = impasto.fit_normals(impasto.Stack(samples, lights=RING), method=method)
        consistent(fit, 8)
        assert fit.status[0, 0] == Status.DARK
        assert (fit.status[0, 3], fit.status[1, 2]) == (Status.FITTED, Status.FITTED)


@pytest.mark.parametrize("method", METHODS)
def test_an_error_beyond_single_precision_has_a_status(method: str) -> None:
    # Lamps within three degrees of each other, and samples that no surface shows: their squares are
    # numbers, and the variance that they give along the worst tangent is none.
    turn = 2.4 * np.arange(16)
    out = 0.015 * np.sqrt(np.arange(16) + 0.5)
    lights = np.stack([out * np.cos(turn), out * np.sin(turn), np.ones(16)], axis=1)
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    shown = np.random.default_rng(3).uniform(0.2, 1.0, (16, 1, 4, 30))
    statuses = []
    for power in (0, 61, 62, 63, 64):
        stack = impasto.Stack(np.ldexp(shown, power).astype(np.float32), lights=lights)
        fit = impasto.fit_normals(stack, method=method)
        consistent(fit, 16)
        statuses.append(fit.status)
    assert (statuses[0] < 16).all()
    assert (np.isin(statuses[-1], [Status.INVALID_INPUT])).all()


def test_irradiances_that_leave_no_inverse_have_a_status() -> None:
    # One lamp lights a painting of 65 m evenly, the others where they stand; a thousandth of a
    # thousandth elsewhere, whose products with it single precision cannot tell from its own.
    far = impasto.PointLight((-9500.0, -1700.0, 2600.0))
    for seed in (1, 5, 15):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(4, 8))
        near = [
            impasto.PointLight(tuple(at), intensity=0.1) for at in rng.normal(0, 30, (count, 3))
        ]
        samples = rng.uniform(0.0, 0.5, (1 + count, 1, 5, 130)).astype(np.float32)
        stack = impasto.Stack(samples, lights=impasto.Rig([far, *near], pitch_mm=100.0))
        fit = impasto.fit_normals(stack, method="least-squares")
        consistent(fit, 1 + count)
        assert (fit.status == Status.RANK_DEFICIENT).any()


AWKWARD = st.one_of(
    st.floats(0, 1, width=32),
    st.sampled_from([0.0, -0.0, np.nan, np.inf, -np.inf, 1.0, 0.5, -0.01, 1e-30, 1e19, 1e30]),
)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), method=st.sampled_from(METHODS), count=st.integers(3, 12))
def test_no_samples_make_an_inconsistent_result(data: Any, method: str, count: int) -> None:
    angle = np.arange(count) * 2.399963
    height = 0.4 + 0.2 * (np.arange(count) % 4)
    lights = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    values = data.draw(st.lists(AWKWARD, min_size=count * 6, max_size=count * 6))
    samples = np.array(values, np.float32).reshape(count, 2, 1, 3)
    fit = impasto.fit_normals(impasto.Stack(samples, lights=lights), method=method)
    consistent(fit, count)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    method=st.sampled_from(METHODS),
    tilt=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
)
def test_clean_matte_samples_give_the_truth(
    seed: int, method: str, tilt: tuple[float, float]
) -> None:
    rng = np.random.default_rng(seed)
    lights = rng.normal((0, 0, 1), 0.4, (12, 3))
    lights[:, 2] = np.maximum(lights[:, 2], 0.7)
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    normal = np.array([*tilt, 1.0])
    samples = matte(lights, normal)
    # Lights below the horizon of the surface break the linear model: leave them out.
    lit = samples[:, 0, 0, 0] > 0
    fit = impasto.fit_normals(
        impasto.Stack(samples[lit], lights=lights[lit]), method=method, w1=5.0, w2=0.0
    )
    if fit.status[0, 0] >= 16:
        return
    n = normal / np.linalg.norm(normal)
    off = np.linalg.norm(np.cross(fit.normal[:, 0, 0], n))
    # Samples are rounded to 6e-8; the solution multiplies that by the squared condition number.
    assert off < 2e-7 * fit.condition[0, 0] ** 2 + 1e-6
