"""Outliers far brighter than the painting do not decide the painting's lobe (hard case 31)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import Status, simulate
from oracles.rigs import spiral

SIZE = (32, 32)


def lights() -> Any:
    turn, z = np.arange(24) * np.pi * (3 - np.sqrt(5)), np.linspace(0.95, 0.3, 24)
    ground = np.sqrt(1 - z**2)
    return np.stack([ground * np.cos(turn), ground * np.sin(turn), z], 1)


@cache
def photographs(seed: int) -> Any:
    painting = simulate.painting(seed=seed, size=SIZE, varnish="satin")
    stack = simulate.capture(painting, impasto.Rig(lights()), "rgb").stack
    return np.stack([stack.linear(photograph) for photograph in range(24)])


def fit(samples: Any, **options: Any) -> impasto.PooledSbrdf:
    fitted = impasto.fit_sbrdf(
        impasto.Stack(samples, lights=lights()), pooling="painting", **options
    )
    assert isinstance(fitted, impasto.PooledSbrdf)
    return fitted


@cache
def clean(seed: int) -> impasto.PooledSbrdf:
    return fit(photographs(seed))


@pytest.mark.parametrize("seed", [7, 8])
@pytest.mark.parametrize("size", [30.0, 300.0, 1000.0, 1e6, 1e12])
def test_one_hot_pixel_does_not_decide(seed: int, size: float) -> None:
    samples = photographs(seed).copy()
    samples[:, :, 5, 5] = size
    found = fit(samples)
    # One pixel of 1024 less: less than the error that the fit predicts of itself.
    sigma = np.sqrt(np.diag(np.asarray(clean(seed).covariance)))
    assert abs(np.log(found.beta / clean(seed).beta)) < max(sigma[0], 0.01)
    assert abs(np.log(found.gamma / clean(seed).gamma)) < max(sigma[1], 0.01)
    assert found.verdict == clean(seed).verdict


def test_a_lamp_in_the_frame_does_not_decide() -> None:
    samples = photographs(7).copy()
    samples[:, :, :7, :7] = 30.0  # a twentieth of the area
    found, usual = fit(samples), clean(7)
    assert found.beta == pytest.approx(usual.beta, rel=0.1)
    assert found.gamma == pytest.approx(usual.gamma, rel=0.1)


@pytest.mark.parametrize("extraction", ["residual", "maximum", "papers", "printed"])
@pytest.mark.parametrize("value", [1e6, 1e25, 1e30])
def test_one_wild_sample_leaves_the_separate_fit_alone(value: float, extraction: str) -> None:
    samples = photographs(7).copy()
    samples[3, :, 9, 9] = value
    found = fit(samples, joint=False, extraction=extraction)
    usual = fit(photographs(7), joint=False, extraction=extraction)
    assert found.beta == pytest.approx(usual.beta, rel=0.05)
    others = np.ones(SIZE, bool)
    others[9, 9] = False
    assert np.isfinite(found.residual[others & (found.status < 16)]).all()


@pytest.mark.parametrize("level", [0.3, 1.0])
@pytest.mark.parametrize("extraction", ["residual", "maximum", "papers", "printed"])
def test_case_27_constant_photographs_show_no_highlight(level: float, extraction: str) -> None:
    found = fit(np.full((24, 3, *SIZE), level, np.float32), joint=False, extraction=extraction)
    assert (found.verdict, found.beta) == ("no-highlight", 0.0)
    estimated = found.status < Status.DARK
    assert np.isfinite(found.residual[estimated]).all()
    assert np.isfinite(found.predict()).all()


@pytest.mark.parametrize("value", [9e18, 3.4e38])
@pytest.mark.parametrize(
    "options", [{"pooling": "pixel"}, {"model": "lafortune", "lobes": 1}], ids=str
)
def test_what_single_precision_cannot_hold_has_a_status(options: Any, value: float) -> None:
    """Squares of the one and colours of the other are beyond it, where they count at all."""
    directions = spiral(12)
    rng = np.random.default_rng(1)
    samples = (0.4 * directions[:, 2])[:, None, None, None] + rng.normal(0.0, 0.02, (12, 7, 9, 9))
    samples[rng.random(samples.shape) < 0.02] = value
    stack = impasto.Stack(samples.astype(np.float32), lights=directions)
    found = impasto.fit_sbrdf(stack, **options)
    lost = found.status >= Status.DARK
    assert not lost.all()
    for name in ("normal", "diffuse", "specular", "residual"):
        plane = getattr(found, name)
        assert not np.isinf(plane).any(), name
        np.testing.assert_array_equal(np.isnan(plane), np.broadcast_to(lost, plane.shape), name)
