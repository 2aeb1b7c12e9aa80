"""Hard cases of the pooled lobe, by the numbers of docs/numerics.md.

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


def scene(beta: float = BETA, gamma: float = GAMMA, seed: int = 5) -> tuple[Any, Any]:
    """Samples ``(obs, band, y, x)`` of a bumpy painting under 16 lights, and its rig."""
    rng = np.random.default_rng(seed)
    normal = np.concatenate([rng.normal(0.0, 0.17, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.7, (3, *SHAPE))
    rig = simulate.rig("tominaga-six-band-adaptation")
    samples = oracle.stack(normal, diffuse, np.full(SHAPE, beta), np.full(SHAPE, gamma), rig)
    return np.asarray(samples, dtype=np.float32), rig


def noisy(samples: Any, sigma: float = 0.002, seed: int = 8) -> Any:
    rng = np.random.default_rng(seed)
    return (samples + rng.normal(0.0, sigma, samples.shape)).astype(np.float32)


def finite_where_estimated(fitted: impasto.Sbrdf) -> bool:
    known = fitted.status < 16
    maps = (*fitted.normal, *fitted.diffuse, fitted.residual, fitted.sigma)
    return all(bool(np.isfinite(plane[known]).all()) for plane in maps)


def test_case_2_all_samples_clipped() -> None:
    samples, rig = scene()
    fitted = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig, saturation=1e-6))
    assert fitted.verdict == "no-highlight"
    assert (fitted.status == impasto.Status.SATURATED).all()
    assert np.isnan(fitted.normal).all()


def test_case_3_clipped_highlights_do_not_flatten_the_lobe() -> None:
    samples, rig = scene()
    level = float(np.quantile(samples, 0.97))
    fitted = impasto.fit_sbrdf(
        impasto.Stack(np.minimum(noisy(samples), level), lights=rig, saturation=level)
    )
    # Three predicted standard deviations of (log beta, log gamma), as for unclipped samples, and
    # the half percent to which the search goes.
    slack = 3.0 * np.sqrt(np.diag(fitted.covariance)) + 5e-3
    assert abs(np.log(fitted.gamma / GAMMA)) < slack[1]
    assert abs(np.log(fitted.beta / BETA)) < slack[0]


def test_case_4_no_highlight() -> None:
    samples, rig = scene(beta=0.0)
    fitted = impasto.fit_sbrdf(impasto.Stack(noisy(samples), lights=rig))
    assert fitted.verdict == "no-highlight"
    assert fitted.beta == 0.0
    assert np.isinf(np.diag(fitted.covariance)).all()
    assert finite_where_estimated(fitted)
    assert np.isfinite(fitted.predict()).all()


@pytest.mark.parametrize("gamma", [0.002, 0.9], ids=["case_6_mirror_sharp", "case_7_flat"])
def test_extreme_lobes_end_in_a_verdict(gamma: float) -> None:
    samples, rig = scene(gamma=gamma)
    fitted = impasto.fit_sbrdf(impasto.Stack(noisy(samples), lights=rig))
    assert fitted.verdict in {"fitted", "mixed", "at-bound", "no-highlight"}
    assert np.isfinite([fitted.beta, fitted.gamma]).all()
    assert fitted.beta >= 0.0
    assert finite_where_estimated(fitted)


def test_case_24_cast_shadows_do_not_pull_the_lobe() -> None:
    samples, rig = scene()
    rng = np.random.default_rng(11)
    shadowed = rng.random((len(rig), 1, *SHAPE)) < 0.08
    fitted = impasto.fit_sbrdf(
        impasto.Stack(noisy(np.where(shadowed, 0.02 * samples, samples)), lights=rig)
    )
    # One sample in twelve is lost: the rest determine the lobe as before, to a few standard
    # deviations (about 1 % each); counting shadows as dark samples would move beta by tens of %.
    assert fitted.gamma == pytest.approx(GAMMA, rel=0.03)
    assert fitted.beta == pytest.approx(BETA, rel=0.05)


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


def test_case_28_a_power_of_two_changes_only_what_has_the_unit_of_light() -> None:
    samples, rig = scene()
    one = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig))
    two = impasto.fit_sbrdf(impasto.Stack(samples * np.float32(2.0**-9), lights=rig))
    assert two.gamma == one.gamma
    assert two.beta == one.beta * 2.0**-9
    assert two.normal.tobytes() == one.normal.tobytes()
    assert (two.diffuse * np.float32(2.0**9)).tobytes() == one.diffuse.tobytes()


def test_case_30_as_many_samples_as_unknowns_predict_no_error() -> None:
    samples, rig = scene(beta=0.0)
    grey = impasto.Stack(samples[[0, 5, 10], :1], lights=rig.take([0, 5, 10]))
    fitted = impasto.fit_sbrdf(grey)
    exact = fitted.status == impasto.Status.EXACT
    assert exact.any()
    assert np.isfinite(fitted.normal[:, exact]).all()
    assert np.isnan(fitted.sigma[exact]).all()
    assert np.isnan(fitted.residual[exact]).all()


def test_case_26_a_sample_beyond_all_numbers_is_no_sample() -> None:
    samples, rig = scene()
    samples[2, 1, 5, 5] = 1e30
    fitted = impasto.fit_sbrdf(impasto.Stack(samples, lights=rig))
    assert finite_where_estimated(fitted)


def test_case_31_gross_outliers() -> None:
    samples, rig = scene()
    rng = np.random.default_rng(13)
    struck = rng.random((len(rig), 1, *SHAPE)) < 0.02
    fitted = impasto.fit_sbrdf(impasto.Stack(noisy(np.where(struck, 50.0, samples)), lights=rig))
    slack = 3.0 * np.sqrt(np.diag(fitted.covariance)) + 5e-3
    assert abs(np.log(fitted.gamma / GAMMA)) < slack[1]
    assert abs(np.log(fitted.beta / BETA)) < slack[0]
