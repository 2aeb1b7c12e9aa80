"""Neutral and tinted lobes, and searches that end by their last step.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto.status import Status
from oracles.rigs import spiral as lights
from test_sbrdf_lobes import SHAPE, samples, truth

GOLD = np.array([9.0, 6.0, 2.0])[:, None, None]


def noisy(clean: Any, seed: int = 11) -> Any:
    return (clean + np.random.default_rng(seed).normal(0.0, 0.002, clean.shape)).astype(np.float32)


def fit(values: Any, **options: Any) -> impasto.LobeSbrdf:
    found = impasto.fit_sbrdf(impasto.Stack(values, lights=lights()), pooling="pixel", **options)
    assert isinstance(found, impasto.LobeSbrdf)
    return found


@pytest.fixture(scope="module")
def found() -> impasto.LobeSbrdf:
    """Left half varnish, right half gold."""
    return fit(noisy(samples(truth(), impasto.Rig(lights()))))


def test_varnish_is_neutral_and_gold_is_tinted(found: impasto.LobeSbrdf) -> None:
    gold = truth()["gold"]
    neutral = ~found.tinted.any(axis=0)
    # BIC: of neutral lobes chance takes exp(-ln(180)), 0.5 %, for tinted, with squares; absolute
    # values of residuals have longer tails.
    assert neutral[~gold].mean() > 0.95
    assert found.tinted[0][gold].mean() > 0.99


def test_a_neutral_lobe_has_one_strength(found: impasto.LobeSbrdf) -> None:
    has = np.arange(len(found.gamma))[:, None, None] < found.lobes
    neutral = has & ~found.tinted
    red, green, blue = np.moveaxis(found.specular, 1, 0)
    assert (red[neutral] == green[neutral]).all()
    assert (red[neutral] == blue[neutral]).all()
    tinted = found.tinted
    assert (has | ~tinted).all()
    assert (red[tinted] != blue[tinted]).all()


def test_one_strength_is_nearer_to_the_truth_than_three(found: impasto.LobeSbrdf) -> None:
    """Three bands in one: the error of a mean of three, where a third of the light tells each."""
    varnish = ~truth()["gold"] & (found.lobes == 1) & ~found.tinted[0]
    clean = samples(truth(), impasto.Rig(lights()))
    alone = fit(noisy(clean)[:, :1])
    both = varnish & (alone.lobes == 1)
    error, single = (np.std(np.log(one.specular[0, 0][both] / 4.0)) for one in (found, alone))
    assert error < 0.85 * single


def test_varnish_over_bronze_has_a_lobe_of_either_kind() -> None:
    rig = impasto.Rig(lights())
    coat = truth() | {"specular": np.full((3, *SHAPE), 6.0), "gamma": np.full(SHAPE, 0.08)}
    metal = coat | {
        "specular": np.broadcast_to(GOLD / 4.0, (3, *SHAPE)),
        "gamma": np.full(SHAPE, 0.35),
        "diffuse": np.zeros((3, *SHAPE)),
        "ambient": np.zeros((3, *SHAPE)),
    }
    found = fit(noisy(samples(coat, rig) + samples(metal, rig)), lobes=2)
    two = found.lobes == 2
    assert two.mean() > 0.6
    # The narrowest comes first. Its few bright samples also hold the metal's light.
    assert (~found.tinted[0][two]).mean() > 0.9
    assert found.tinted[1][two].mean() > 0.9


def test_one_band_has_no_colour() -> None:
    found = fit(noisy(samples(truth(), impasto.Rig(lights())))[:, 1:2])
    assert not found.tinted.any()


def test_exact_samples_are_judged_by_more_than_rounding() -> None:
    found = fit(samples(truth(), impasto.Rig(lights())).astype(np.float32))
    gold = truth()["gold"]
    one = found.lobes == 1
    assert (~found.tinted[0])[one & ~gold].mean() > 0.9
    assert found.tinted[0][one & gold].all()


def test_searches_say_whether_they_ended(found: impasto.LobeSbrdf) -> None:
    assert found.converged.mean() > 0.95
    values = noisy(samples(truth(), impasto.Rig(lights())))
    values[:, :, 1, 2] = 0.0
    values[:, :, 3, 4] = np.nan
    spoiled = fit(values)
    assert spoiled.status[1, 2] == Status.DARK
    assert not spoiled.converged[1, 2]
    assert not spoiled.converged[3, 4]
