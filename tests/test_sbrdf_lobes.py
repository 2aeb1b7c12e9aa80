"""Lobes of every pixel: against surfaces whose truth is known, and by the hard cases.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import impasto
from impasto.status import Status
from oracles import forward as oracle

SHAPE = (13, 37)


def lights(count: int = 60) -> Any:
    """Directions on a spiral over the hemisphere, 10 to 80 degrees from the zenith."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    z = np.linspace(np.cos(np.radians(10.0)), np.cos(np.radians(80.0)), count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)


def truth(seed: int = 3) -> dict[str, Any]:
    """Left half varnished paint, right half gold: normals, colours and widths."""
    rng = np.random.default_rng(seed)
    normal = np.concatenate([rng.normal(0.0, 0.12, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    gold = np.broadcast_to(np.arange(SHAPE[1]) > SHAPE[1] // 2, SHAPE)
    paint = rng.uniform(0.1, 0.6, (3, *SHAPE))
    diffuse = np.where(gold, 0.05, paint)
    strength = np.where(gold, np.array([9.0, 6.0, 2.0])[:, None, None], 4.0)
    gamma = np.where(gold, 0.2, 0.14)
    ambient = np.full((3, *SHAPE), 0.02)
    return {
        "normal": normal,
        "diffuse": diffuse,
        "specular": strength,
        "gamma": gamma,
        "ambient": ambient,
        "gold": gold,
    }


def samples(t: dict[str, Any], rig: Any) -> Any:
    """``(obs, band, y, x)``: the oracle band by band, each with its own strength."""
    bands = [
        oracle.stack(t["normal"], t["diffuse"][b : b + 1], t["specular"][b], t["gamma"], rig)
        for b in range(3)
    ]
    return np.concatenate(bands, axis=1) + t["ambient"]


@pytest.fixture(scope="module")
def scene() -> tuple[dict[str, Any], Any, impasto.Stack]:
    t = truth()
    rig = impasto.Rig(lights())
    rng = np.random.default_rng(11)
    clean = samples(t, rig)
    noisy = clean + rng.normal(0.0, 0.002, clean.shape)
    return t, rig, impasto.Stack(noisy.astype(np.float32), lights=rig)


@pytest.fixture(scope="module")
def fitted(scene: Any) -> impasto.LobeSbrdf:
    found = impasto.fit_sbrdf(scene[2], pooling="pixel", lobes=2)
    assert isinstance(found, impasto.LobeSbrdf)
    return found


def angle(a: Any, b: Any) -> Any:
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=0), -1.0, 1.0)))


def test_it_finds_the_truth(scene: Any, fitted: impasto.LobeSbrdf) -> None:
    t = scene[0]
    assert (fitted.status == Status.FITTED).all()
    assert (fitted.lobes >= 1).all()
    # Noise of 0.002 on highlights of 0.1 to 0.3 under some 6 lights each: 1 % of the width.
    error = angle(fitted.normal, t["normal"])
    assert np.median(error) < 0.3
    wide = np.nanmax(fitted.gamma, axis=0)
    one = fitted.lobes == 1
    assert one.mean() > 0.9
    assert np.median(np.abs(np.log(wide / t["gamma"]))[one]) < 0.03
    assert np.median(np.abs(fitted.specular[0] / t["specular"] - 1.0)[:, one]) < 0.05
    assert np.median(np.abs(fitted.diffuse - t["diffuse"])) < 0.01
    assert np.median(np.abs(fitted.ambient - t["ambient"])) < 0.01


def test_gold_is_gold_and_varnish_is_neutral(scene: Any, fitted: impasto.LobeSbrdf) -> None:
    gold = scene[0]["gold"]
    red, _, blue = fitted.specular.sum(axis=0)
    assert np.median((red / blue)[gold]) == pytest.approx(4.5, rel=0.1)
    assert np.median((red / blue)[~gold]) == pytest.approx(1.0, rel=0.05)


def test_predicted_samples_are_those_that_were_fitted(
    scene: Any, fitted: impasto.LobeSbrdf
) -> None:
    shown = fitted.predict()
    assert shown.shape == scene[2].shape
    # The noise, and what 15 unknowns of 180 samples take out of it.
    assert np.std(shown - scene[2].samples) < 0.0021


def test_gamma_errors_are_those_predicted(scene: Any, fitted: impasto.LobeSbrdf) -> None:
    one = fitted.lobes == 1
    error = np.log(fitted.gamma[0] / scene[0]["gamma"])[one] / fitted.gamma_sigma[0][one]
    # A normal deviate is within 3 for 99.7 %; weights that follow the residuals cost some of it.
    assert np.mean(np.abs(error) < 4.0) > 0.97


@pytest.mark.parametrize("threads", [2, 5])
def test_any_number_of_threads_gives_the_same_bits(
    scene: Any, fitted: impasto.LobeSbrdf, threads: int
) -> None:
    again = impasto.fit_sbrdf(scene[2], pooling="pixel", lobes=2, threads=threads)
    same_bits(fitted, again)


def same_bits(one: impasto.LobeSbrdf, other: impasto.LobeSbrdf) -> None:
    for field in fields(one):
        if field.name not in {"normals", "rig", "bands", "index"}:
            a, b = getattr(one, field.name), getattr(other, field.name)
            assert a.tobytes() == b.tobytes(), field.name


def test_what_is_saved_is_read_again(fitted: impasto.LobeSbrdf, tmp_path: Path) -> None:
    fitted.save(tmp_path / "gold.npz")
    again = impasto.load_sbrdf(tmp_path / "gold.npz")
    assert isinstance(again, impasto.LobeSbrdf)
    same_bits(fitted, again)
    assert repr(again) == repr(fitted)
    assert again.index == fitted.index


@pytest.mark.parametrize("lobes", [0, 4, True, 1.5, "two"])
def test_a_wrong_number_of_lobes_is_refused(scene: Any, lobes: Any) -> None:
    with pytest.raises(impasto.ArgumentError, match="lobes"):
        impasto.fit_sbrdf(scene[2], pooling="pixel", lobes=lobes)


def test_a_picture_shows_gold_as_gold(scene: Any, fitted: impasto.LobeSbrdf) -> None:
    light = np.array([0.15, 0.1, 1.0])
    picture = impasto.render(
        fitted, impasto.Scene(lights=[impasto.DistantLight(tuple(light))], exposure=1.0)
    )
    # Bands are linear sRGB: the picture is what the surface shows, but for its shadows.
    shown = fitted.predict([light])[0]
    np.testing.assert_allclose(picture.linear, shown, rtol=2e-4, atol=2e-4)
