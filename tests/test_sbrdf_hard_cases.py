"""Bad pixels and samples through the whole fit, by the numbers of docs/numerics.md.

What the lobe itself goes through is tested in test_sbrdf_pooled.py.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from oracles import forward as oracle

SHAPE = (24, 40)
BETA, GAMMA = 12.0, 0.12


def scene(beta: float = BETA) -> tuple[Any, Any]:
    """Samples ``(obs, band, y, x)`` of a bumpy painting under 16 lights, and its rig."""
    rng = np.random.default_rng(5)
    normal = np.concatenate([rng.normal(0.0, 0.17, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.7, (3, *SHAPE))
    rig = simulate.rig("tominaga-six-band-adaptation")
    samples = oracle.stack(normal, diffuse, np.full(SHAPE, beta), np.full(SHAPE, GAMMA), rig)
    return np.asarray(samples, dtype=np.float32), rig


def finite_where_estimated(fitted: impasto.PooledSbrdf) -> bool:
    known = fitted.status < 16
    maps = (*fitted.normal, *fitted.diffuse, fitted.residual, fitted.sigma)
    return all(bool(np.isfinite(plane[known]).all()) for plane in maps)


def test_case_2_all_samples_clipped() -> None:
    samples, rig = scene()
    fitted = impasto.fit_sbrdf(
        impasto.Stack(samples, lights=rig, saturation=1e-6), pooling="painting"
    )
    assert fitted.verdict == "too-few"
    assert (fitted.status == impasto.Status.SATURATED).all()
    assert np.isnan(fitted.normal).all()


@pytest.mark.parametrize("value", [np.nan, -5.0], ids=["nan", "negative"])
def test_case_26_spoiled_samples_leave_other_pixels_alone(value: float) -> None:
    samples, rig = scene()
    separate = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig), joint=False)
    spoiled = samples.copy()
    spoiled[:, :, 3, 4] = value
    found = impasto.fit_sbrdf(impasto.Stack(spoiled, lights=rig), joint=False)
    others = np.ones(SHAPE, bool)
    others[3, 4] = False
    for name in ("normal", "diffuse"):
        before, after = getattr(separate, name), getattr(found, name)
        assert before[:, others].tobytes() == after[:, others].tobytes()


def test_case_29_sums_do_not_forget_small_terms() -> None:
    samples, rig = scene()
    # Normals that learn nothing of the painting: of the copies another sample would be taken.
    options: dict[str, Any] = {"joint": False, "normals": "trimmed"}
    one = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig), **options)
    many = np.tile(samples, (1, 1, 20, 20))
    found = impasto.fit_sbrdf(impasto.Stack(many, lights=rig), **options)
    # 400 copies are 6 million samples. Sums in double precision are 400 times those of one copy to
    # 1e-10; single precision would lose one part in a thousand there.
    assert found.beta == pytest.approx(one.beta, rel=1e-8)
    assert found.gamma == pytest.approx(one.gamma, rel=1e-8)


def test_case_30_as_many_samples_as_unknowns_predict_no_error() -> None:
    samples, rig = scene(beta=0.0)
    grey = impasto.Stack(samples[[0, 5, 10], :1], lights=rig.take([0, 5, 10]))
    fitted = impasto.fit_sbrdf(grey, pooling="painting")
    exact = fitted.status == impasto.Status.EXACT
    assert exact.any()
    assert np.isfinite(fitted.normal[:, exact]).all()
    assert np.isnan(fitted.sigma[exact]).all()
    assert np.isnan(fitted.residual[exact]).all()


def test_case_26_a_sample_beyond_all_numbers_is_no_sample() -> None:
    samples, rig = scene()
    samples[2, 1, 5, 5] = 1e30
    fitted = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig), pooling="painting")
    assert finite_where_estimated(fitted)


@pytest.mark.parametrize("flat_fielded", [False, True])
@pytest.mark.parametrize("dark_share", [0.02, 0.5])
def test_dark_pixels_whose_few_codes_fit_exactly_do_not_rule(
    dark_share: float, flat_fielded: bool
) -> None:
    shape = (48, 64)
    rng = np.random.default_rng(5)
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, *shape)), np.ones((1, *shape))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.7, (3, *shape))
    dark = rng.uniform(size=shape) < dark_share
    diffuse[:, dark] = rng.uniform(0.004, 0.012, (3, dark.sum()))  # codes 1 to 3
    rig = simulate.rig("tominaga-rgb-camera")
    samples = oracle.stack(normal, diffuse, np.full(shape, BETA), np.full(shape, GAMMA), rig)
    # A white board that darkens towards one side: no two columns share the step of their codes.
    board = 1.0 - 0.2 * np.linspace(0.0, 1.0, shape[1]) ** 2 if flat_fielded else 1.0
    codes = np.round(255.0 * samples * board)
    fitted = impasto.fit_sbrdf(
        impasto.Stack((codes / 255.0 / board).astype(np.float32), lights=rig),
        pooling="painting",
    )
    assert fitted.verdict == "fitted"
    # Rounding (0.0011) is a quarter of a dark pixel's diffuse light and pulls in one direction
    # where codes repeat: no covariance knows of it. Here it costs 0.1 %.
    assert fitted.beta == pytest.approx(BETA, rel=3e-3)
    assert fitted.gamma == pytest.approx(GAMMA, rel=3e-3)


@pytest.mark.parametrize("joint", [True, False])
@pytest.mark.parametrize("size", [3e-19, 3e-18, 1e-17, 2e19, 4e19])
def test_case_28_samples_near_the_ends_of_single_precision(size: float, joint: bool) -> None:
    samples, rig = scene()
    whole = samples[:, :, :12, :20].astype(np.float64)
    odd = whole.copy()
    odd[..., 3:5, 7] *= size
    labels = np.arange(240).reshape(12, 20) % 3
    segments: dict[str, Any] = {"pooling": "segment", "segments": labels}
    for photographs in (size * whole, odd):
        stack = impasto.Stack(photographs.astype(np.float32), lights=rig)
        for options in ({}, segments):
            assert_nan_stands_where_nothing_is_known(
                impasto.fit_sbrdf(stack, joint=joint, **options)
            )


def test_case_28_pixels_whose_squares_are_no_numbers_are_given_up() -> None:
    samples, rig = scene()
    photographs = samples + np.random.default_rng(0).normal(0.0, 0.1, samples.shape)
    # Squares of samples from 1.8e19 on are infinite. Photometric stereo sums those of residuals.
    photographs[..., ::7, ::5] *= 5e19
    stack = impasto.Stack(photographs.astype(np.float32), lights=rig)
    # The default sums the squares of all, and gives these pixels up itself.
    fitted = impasto.fit_sbrdf(stack, joint=False, normals="trimmed")
    started = impasto.fit_normals(stack, method="trimmed").status
    given_up = (fitted.status >= 16) & (started < 16)
    assert given_up.any()
    assert (fitted.status[given_up] == impasto.Status.INVALID_INPUT).all()
    assert_nan_stands_where_nothing_is_known(fitted)


def assert_nan_stands_where_nothing_is_known(fitted: Any) -> None:
    known = fitted.status < 16
    assert known.any()
    dark = fitted.status == impasto.Status.DARK
    for name in ("normal", "diffuse", "residual", "sigma", "misfit"):
        map_ = np.reshape(getattr(fitted, name), (-1, *known.shape))
        assert np.isfinite(map_[:, known]).all(), name
        if name == "diffuse":
            # That much is known of a pixel without light.
            assert (map_[:, dark] == 0.0).all()
            assert np.isnan(map_[:, ~known & ~dark]).all()
        else:
            assert np.isnan(map_[:, ~known]).all(), name
