"""What consensus over triples of lights would do instead of reweighting (docs/models.md)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import impasto
from impasto import simulate


def consensus(stack: impasto.Stack, threshold: float) -> np.ndarray:
    """Normals by random sample consensus with every triple of lights instead of random ones.

    The triple with the smallest truncated sum of squares (MSAC) determines a pixel's inliers:
    residuals below ``threshold`` times its brightness. Least squares over these give the normal.
    """
    lights = np.asarray(stack.rig.directions, dtype=np.float64)
    count = len(lights)
    samples = np.stack([stack.linear(k).mean(axis=0).ravel() for k in range(count)])
    samples = samples.astype(np.float64)
    valid = np.isfinite(samples)
    samples = np.where(valid, samples, 0.0)
    best = np.full(samples.shape[1], -np.inf)
    inliers = np.zeros(samples.shape)
    for chosen in map(list, combinations(range(count), 3)):
        if np.linalg.cond(lights[chosen]) > 8:  # nearly coplanar
            continue
        b = np.linalg.solve(lights[chosen], samples[chosen])
        limit = threshold * np.linalg.norm(b, axis=0)
        size = np.abs(samples - lights @ b)
        agree = (size < limit) & valid & valid[chosen].all(axis=0)
        score = np.where(agree, 1 - (size / np.maximum(limit, 1e-12)) ** 2, 0).sum(axis=0)
        better = score > best
        best[better] = score[better]
        inliers[:, better] = agree[:, better]
    matrix = np.einsum("op,oi,oj->pij", inliers, lights, lights)
    right = np.einsum("op,oi,op->pi", inliers, lights, samples)
    b = np.linalg.solve(matrix, right[..., None])[..., 0]
    normal = b / np.linalg.norm(b, axis=1, keepdims=True)
    return normal.T.reshape(3, *stack.shape[2:])


@pytest.mark.parametrize(
    ("rig", "threshold", "robust", "agreed"),
    [
        ("tominaga-six-band-adaptation", 0.02, 2.3, 1.9),
        ("tominaga-six-band-adaptation", 0.1, 2.3, 4.2),
        ("tominaga-rgb-camera", 0.02, 1.1, 1.8),
        ("tominaga-rgb-camera", 0.05, 1.1, 1.3),
    ],
)
def test_consensus_is_as_good_as_its_threshold(
    rig: str, threshold: float, robust: float, agreed: float
) -> None:
    capture = simulate.default_capture(rig, size=(48, 48))

    def degrees(normal: np.ndarray) -> float:
        cosine = (normal * capture.truth.normal).sum(axis=0)
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())

    # The numbers of docs/models.md, rounded to a digit.
    found = degrees(impasto.fit_normals(capture.stack).normal)
    assert found == pytest.approx(robust, abs=0.06)
    assert degrees(consensus(capture.stack, threshold)) == pytest.approx(agreed, abs=0.06)
    together = impasto.fit_sbrdf(capture.stack, pooling="painting")
    assert degrees(together.normal) < 0.3
