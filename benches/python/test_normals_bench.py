"""Normals of a megapixel under sixteen lights, against numpy.

    pytest benches/python/test_normals_bench.py [--record]

One thread but in the last test. Photographs are 16-bit codes, as files hold them; numpy converts
them to single precision, but for the one peer that finds them converted. numpy computes the
normals alone, ours also albedo, condition, residual, predicted error and status.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate

SIDE = 1024


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """One band of a glossy surface in 16 bits, nothing clipped."""
    rng = np.random.default_rng(0)
    normal = rng.normal(0.0, 0.1, (3, SIDE, SIDE))
    normal[2] = 1.0
    normal /= np.linalg.norm(normal, axis=0)
    rig = simulate.rig("tominaga-six-band-adaptation")
    diffuse = rng.uniform(0.1, 0.8, (1, SIDE, SIDE))
    samples = impasto.Surface.torrance_sparrow(normal, diffuse, 12.0, 0.12).predict(rig)
    codes = np.rint(samples * (65000.0 / samples.max())).astype(np.uint16)
    return impasto.Stack(codes, lights=rig)


@pytest.fixture(scope="module")
def converted(stack: impasto.Stack) -> impasto.Stack:
    return impasto.Stack(stack.samples.astype(np.float32), lights=stack.rig)


def rows(stack: impasto.Stack) -> tuple[np.ndarray, np.ndarray]:
    """Lights ``(obs, 3)`` and samples ``(obs, pixels)``."""
    samples = stack.samples.astype(np.float32, copy=False)
    return stack.rig.directions.astype(np.float32), samples.reshape(stack.shape[0], -1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.sqrt((vectors * vectors).sum(axis=0))


def pseudo_inverse(stack: impasto.Stack) -> np.ndarray:
    lights, samples = rows(stack)
    return unit(np.linalg.pinv(lights) @ samples)


def lstsq(stack: impasto.Stack) -> np.ndarray:
    lights, samples = rows(stack)
    return unit(np.linalg.lstsq(lights, samples, rcond=None)[0])


def weighted(lights: np.ndarray, samples: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Least squares on the kept samples of each pixel by its own normal equations."""
    weight = keep.astype(np.float32)
    products = (lights[:, :, None] * lights[:, None, :]).reshape(-1, 9)
    matrix = (weight.T @ products).reshape(-1, 3, 3)
    right = (weight * samples).T @ lights
    return unit(np.linalg.solve(matrix, right[..., None])[..., 0].T)


def threshold(stack: impasto.Stack) -> np.ndarray:
    lights, samples = rows(stack)
    mean = samples.mean(axis=0)
    return weighted(lights, samples, (samples <= 1.2 * mean) & (samples >= 0.1 * mean))


def rank(stack: impasto.Stack) -> np.ndarray:
    lights, samples = rows(stack)
    count = len(samples)
    order = np.argsort(samples, axis=0, kind="stable")
    keep = np.zeros(samples.shape, bool)
    np.put_along_axis(keep, order[int(0.2 * count) : round(0.8 * count)], True, axis=0)
    return weighted(lights, samples, keep)


def same(found: impasto.Normals, expected: np.ndarray) -> None:
    # Both in single precision; a sample on a rule's very limit may fall on either side of it.
    apart = np.abs(found.normal - expected.reshape(3, SIDE, SIDE)).max(axis=0)
    assert np.percentile(apart, 99) < 1e-4


def test_least_squares(versus: Any, stack: impasto.Stack, converted: impasto.Stack) -> None:
    found = versus(
        lambda: impasto.fit_normals(stack, method="least-squares", threads=1),
        {
            "pinv(L) @ I": lambda: pseudo_inverse(stack),
            "pinv(L) @ I, samples converted": lambda: pseudo_inverse(converted),
            "lstsq": lambda: lstsq(stack),
        },
        goal={"pinv(L) @ I": 2.5, "lstsq": 50.0},
        megapixels=SIDE * SIDE / 1e6,
    )
    same(found, pseudo_inverse(stack))


@pytest.mark.parametrize(("method", "peer"), [("threshold", threshold), ("rank", rank)])
def test_rule(versus: Any, stack: impasto.Stack, method: str, peer: Any) -> None:
    found = versus(
        lambda: impasto.fit_normals(stack, method=method, threads=1),
        {"numpy": lambda: peer(stack)},
        goal={"numpy": 15.0},
        megapixels=SIDE * SIDE / 1e6,
    )
    same(found, peer(stack))


def test_two_threads(versus: Any, stack: impasto.Stack) -> None:
    versus(
        lambda: impasto.fit_normals(stack, threads=2),
        {"one thread": lambda: impasto.fit_normals(stack, threads=1)},
        goal={"one thread": 1.8},
        megapixels=SIDE * SIDE / 1e6,
        clock=time.perf_counter,
    )
