"""The bound on the width of lobes while the normal is free: kept where broad lobes stand for errors
of the diffuse part, dropped where the painting has them.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import impasto
from impasto import simulate
from impasto.effort import PRESETS
from impasto.fit.lobes import LobeOptions, fit_lobes, learn_lobes
from oracles import forward as oracle
from oracles.rigs import spiral

SHAPE = (16, 40)


def photographs(
    gamma: float | NDArray[Any], noise: float, *, coated: bool = False
) -> tuple[NDArray[Any], impasto.Stack]:
    """Normals and 60 photographs of varnished paint."""
    rng = np.random.default_rng(14)
    normal = np.concatenate([rng.normal(0.0, 0.12, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    diffuse = rng.uniform(0.1, 0.6, (3, *SHAPE))
    view = (0.0, 0.0, 1.0)
    clean = np.array(
        [
            oracle.radiance(normal, diffuse, 4.0, gamma, light, view, coated=coated)
            for light in spiral()
        ]
    )
    samples = clean + rng.normal(0.0, noise, clean.shape)
    return normal, impasto.Stack(samples.astype(np.float32), lights=spiral())


def is_bounded(stack: impasto.Stack, lobes: int = 2) -> bool:
    """What is learned from a stack."""
    options = LobeOptions.of(PRESETS["standard"], lobes=lobes, ambient=True, index=1.45)
    return learn_lobes(stack, impasto.fit_normals(stack), options).options.bounded


def error(found: NDArray[Any], normal: NDArray[Any]) -> float:
    """Mean error of normals in degrees."""
    cosine = (found * normal).sum(axis=0) / np.linalg.norm(normal, axis=0)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.004, 0.01])
@pytest.mark.parametrize("gamma", [0.3, 0.35, 0.45])
def test_a_broad_lobe_that_is_there_is_found(gamma: float, noise: float) -> None:
    """Bounded, normals are off by 0.6, 1.3 and 3.0 degrees, whatever the noise."""
    normal, stack = photographs(gamma, noise)
    assert not is_bounded(stack)
    found = impasto.fit_sbrdf(stack, pooling="pixel")
    # Of noise alone 30, 35 and 48 degrees for noise as large as white; and the rounding of lanes.
    assert error(found.normal, normal) < 60.0 * noise + 0.01
    if noise <= 0.001:
        assert np.nanmedian(found.gamma[0]) == pytest.approx(gamma, rel=0.01)


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_a_broad_lobe_of_few_pixels_is_found(noise: float) -> None:
    """A fifth of the painting; most pixels that reach the bound have a lobe as wide as it.

    Bounded, its normals are off by 1.6 degrees.
    """
    gamma = np.where(np.arange(SHAPE[1]) < 0.8 * SHAPE[1], 0.25, 0.45)
    normal, stack = photographs(gamma * np.ones(SHAPE), noise)
    assert not is_bounded(stack)
    found = impasto.fit_sbrdf(stack, pooling="pixel")
    broad = np.s_[:, :, gamma > 0.3]
    # As where all lobes are as broad.
    assert error(found.normal[broad], normal[broad]) < 60.0 * noise + 0.01


@pytest.mark.parametrize("noise", [0.001, 0.004])
def test_lobes_that_are_no_broader_stay_bounded(noise: float) -> None:
    assert is_bounded(photographs(0.12, noise)[1])
    assert is_bounded(photographs(0.2, noise)[1])


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.004, 0.01])
def test_a_broad_lobe_does_not_turn_the_normal(noise: float) -> None:
    """Diffuse light that loses a part in the varnish, which the model does not know.

    Unbounded, a lobe of 0.46 rad stands for the loss, and turns the normals.
    """
    normal, stack = photographs(0.12, noise, coated=True)
    assert is_bounded(stack)
    free = fit_lobes(
        stack,
        impasto.fit_normals(stack),
        lobes=2,
        ambient=True,
        index=1.45,
        threads=2,
        progress=False,
        bounded=False,
    )
    found = impasto.fit_sbrdf(stack, pooling="pixel")
    # 0.15 to 0.39 degrees, with noise.
    assert error(found.normal, normal) < min(0.7 * error(free.normal, normal), 0.7)


def test_three_varnishes_of_which_one_has_a_broad_lobe() -> None:
    turn, z = np.arange(24) * np.pi * (3 - np.sqrt(5)), np.linspace(0.95, 0.3, 24)
    side = np.sqrt(1 - z**2)
    rig = impasto.Rig(np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1))
    painting = simulate.painting(seed=7, size=(48, 48), varnish="patches")
    capture = simulate.capture(painting, rig, "rgb")
    assert not is_bounded(capture.stack)
    found = impasto.fit_sbrdf(capture.stack, pooling="pixel")
    # 0.14 degrees; 0.23 bounded.
    assert error(found.normal, np.asarray(capture.truth.normal)) < 0.18


@pytest.mark.parametrize("lights", [7, 9])
def test_few_photographs_in_one_band_stay_bounded(lights: int) -> None:
    """1 and 3 residuals more than unknowns: by chance gains over their variance are large."""
    rng = np.random.default_rng(4)
    shape = 32, 60
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, *shape)), np.ones((1, *shape))])
    normal /= np.linalg.norm(normal, axis=0)
    few = np.linspace(0, len(spiral()) - 1, lights).round().astype(int)
    rig = impasto.Rig(np.asarray(spiral())[few])
    flat, at_the_bound = np.full((1, *shape), 0.3), np.full(shape, 0.25)
    clean = oracle.stack(normal, flat, np.full(shape, 3.0), at_the_bound, rig)
    noisy = clean + rng.normal(0.0, 0.01, clean.shape)
    assert is_bounded(impasto.Stack(noisy.astype(np.float32), lights=rig))
