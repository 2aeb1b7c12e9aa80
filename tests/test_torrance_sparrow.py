"""What a surface shows, against an independent double-precision model written from the papers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from oracles import forward as oracle

RNG = np.random.default_rng(20)
SHAPE = (37, 53)


def surface(tilt: float = 0.3) -> tuple[Any, Any]:
    slopes = RNG.normal(0.0, tilt, (2, *SHAPE))
    normal = np.stack([-slopes[0], -slopes[1], np.ones(SHAPE)])
    normal /= np.linalg.norm(normal, axis=0)
    return normal.astype(np.float32), RNG.uniform(0.02, 0.9, (3, *SHAPE)).astype(np.float32)


def rig(near: bool) -> impasto.Rig:
    lights: list[Any] = [
        impasto.DistantLight((0.0, 0.0, 1.0)),
        impasto.DistantLight((0.7, 0.1, 0.7), intensity=1.7),
        impasto.DistantLight((-0.9, 0.3, 0.3)),
    ]
    if near:
        lights[2] = impasto.PointLight((-60.0, 30.0, 90.0), intensity=0.8)
    views = [[0.0, 0.0, 1.0], [0.3, 0.0, 0.9], [-0.5, -0.4, 0.6]]
    return impasto.Rig(lights, views=views, pitch_mm=0.7)


def predict(normal: Any, diffuse: Any, beta: Any, gamma: Any, *rig: Any, **options: Any) -> Any:
    return impasto.Surface.torrance_sparrow(normal, diffuse, beta, gamma).predict(*rig, **options)


@pytest.mark.parametrize("near", [False, True])
def test_samples_agree_with_the_papers(near: bool) -> None:
    normal, diffuse = surface()
    gamma = RNG.uniform(0.05, 0.3, SHAPE).astype(np.float32)
    got = predict(normal, diffuse, 20.0, gamma, rig(near))
    exact = oracle.stack(normal, diffuse, np.full(SHAPE, 20.0), gamma, rig(near))
    assert got.shape == (3, 3, *SHAPE)
    # Single precision: normals are rounded to 6e-8, which moves phi^2 = 0.3 by some 1e-7 and the
    # exponent ln2 phi^2 / gamma^2 <= 40 by less than 4e-5 of its lobe, far down the flank; the
    # peak (value up to 20 F / (N.V) ~ 5 at slanted views) moves by a few rounding steps of 6e-8.
    np.testing.assert_allclose(got, exact, rtol=2e-5, atol=5e-6)


def test_coats_add() -> None:
    normal, diffuse = surface()
    beta = np.stack([np.full(SHAPE, 30.0), np.full(SHAPE, 4.0)])
    gamma = np.stack([np.full(SHAPE, 0.075), np.full(SHAPE, 0.2)])
    got = predict(normal, diffuse, beta, gamma, rig(False))
    exact = oracle.stack(normal, diffuse, beta, gamma, rig(False))
    # As above.
    np.testing.assert_allclose(got, exact, rtol=2e-5, atol=5e-6)
    np.testing.assert_array_equal(got, predict(normal, diffuse, [30, 4], [0.075, 0.2], rig(False)))


def test_samples_are_nan_exactly_where_the_normal_is() -> None:
    normal, diffuse = surface()
    normal[:, 3, 4] = np.nan
    got = predict(normal, diffuse, 20.0, 0.1, rig(True))
    expected = np.zeros(SHAPE, dtype=bool)
    expected[3, 4] = True
    np.testing.assert_array_equal(np.isnan(got), np.broadcast_to(expected, got.shape))


@pytest.mark.parametrize("beta", [0.0, 1e6])
@pytest.mark.parametrize("gamma", [0.0, 1e-9, np.nan, 1e9])
def test_any_parameters_give_finite_samples(beta: float, gamma: float) -> None:
    normal, diffuse = surface(2.0)
    opposed = impasto.Rig([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]], views=[[0, 0, 1], [-1, 0, 0]])
    if np.isnan(gamma) and beta > 0.0:
        return
    assert np.isfinite(predict(normal, diffuse, beta, gamma, opposed)).all()


def test_threads_change_nothing() -> None:
    normal, diffuse = surface()
    one = predict(normal, diffuse, 20.0, 0.1, rig(True), threads=1)
    for threads in (2, 3, 5):
        assert (
            one.tobytes()
            == predict(normal, diffuse, 20.0, 0.1, rig(True), threads=threads).tobytes()
        )


def test_a_wrong_call_names_the_argument() -> None:
    normal, diffuse = surface()
    with pytest.raises(impasto.ArgumentError, match="gamma"):
        predict(normal, diffuse, 1.0, np.ones((3, 3)), rig(False))
    with pytest.raises(impasto.ArgumentError, match="normal"):
        predict(normal[:2], diffuse, 1.0, 0.1, rig(False))
    with pytest.raises(impasto.ArgumentError, match="gamma"):
        predict(normal, diffuse, [1.0, 2.0], [0.1], rig(False))
