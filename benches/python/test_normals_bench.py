"""Normals of a megapixel under sixteen lights, against numpy; lower is better.

    OPENBLAS_NUM_THREADS=1 pytest benches/python/test_normals_bench.py

The table's brackets are the ratios within a group. Everything runs on one thread but the last
group. Photographs are 16-bit codes, as files hold them; numpy converts them to single precision,
but for the one peer that finds them converted. numpy computes the normals alone, ours also albedo,
condition, residual, predicted error and status.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import impasto
from impasto import simulate
from impasto.fit.forward import predict

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
    samples = predict(normal, diffuse, 12.0, 0.12, rig)
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


PEERS = {
    "least-squares": [pseudo_inverse, lstsq],
    "threshold": [threshold],
    "rank": [rank],
}


@pytest.mark.parametrize("method", PEERS)
def test_impasto(benchmark: Any, stack: impasto.Stack, method: str) -> None:
    benchmark.group = method
    call = impasto.fit_normals
    found = benchmark.pedantic(
        call, (stack,), {"method": method, "threads": 1}, rounds=5, warmup_rounds=1
    )
    expected = PEERS[method][0](stack).reshape(3, SIDE, SIDE)
    # Both in single precision; a sample on a rule's very limit may fall on either side of it.
    apart = np.abs(found.normal - expected).max(axis=0)
    assert np.percentile(apart, 99) < 1e-4


@pytest.mark.parametrize(
    ("method", "peer"), [(method, peer) for method, of in PEERS.items() for peer in of]
)
def test_numpy(benchmark: Any, stack: impasto.Stack, method: str, peer: Any) -> None:
    benchmark.group = method
    benchmark.pedantic(peer, (stack,), rounds=3)


@pytest.mark.benchmark(group="least-squares")
def test_numpy_on_converted_samples(benchmark: Any, converted: impasto.Stack) -> None:
    benchmark.pedantic(pseudo_inverse, (converted,), rounds=3)


@pytest.mark.parametrize("threads", [1, 2])
def test_threads(benchmark: Any, stack: impasto.Stack, threads: int) -> None:
    benchmark.group = "the default method on threads"
    call = impasto.fit_normals
    benchmark.pedantic(call, (stack,), {"threads": threads}, rounds=5, warmup_rounds=1)
