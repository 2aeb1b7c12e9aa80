"""A painting's surface from sixteen lights and six bands, against the papers' steps in numpy.

    pytest benches/python/test_sbrdf_bench.py [--record]

One thread. One peer takes the papers' steps once: normals by the thresholds, colours by least
squares, what the brightest sample shows beyond them, and one beta and gamma through that by
``scipy.optimize.curve_fit``. Ours goes on: it judges every sample again under the lobe that it
found, lets normals, colours and lobe settle, and says how sure it is. The other peer solves for all
of them at once, as ours does, but as a plain least-squares problem, from the truth on and to twelve
digits: the script of the tests' oracle, on its few pixels.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from record import ROOT
from scipy.optimize import curve_fit
from test_normals_bench import weighted

import impasto
from impasto import simulate

sys.path.insert(0, str(ROOT / "tests"))
from oracles import pooled

SIDE, BANDS, BETA, GAMMA, NOISE, INDEX = 256, 6, 12.0, 0.12, 0.002, 1.45


@pytest.fixture(scope="module")
def stack() -> impasto.Stack:
    """Six bands of a glossy surface in 16 bits, nothing clipped."""
    rng = np.random.default_rng(0)
    normal = np.concatenate([rng.normal(0.0, 0.1, (2, SIDE, SIDE)), np.ones((1, SIDE, SIDE))])
    normal /= np.linalg.norm(normal, axis=0)
    rig = simulate.rig("tominaga-six-band-adaptation")
    diffuse = rng.uniform(0.1, 0.8, (BANDS, SIDE, SIDE))
    samples = impasto.Surface.torrance_sparrow(normal, diffuse, BETA, GAMMA).predict(rig)
    samples += NOISE * rng.standard_normal(samples.shape, np.float32)
    gain = 65000.0 / samples.max()
    codes = np.rint(np.maximum(samples, 0.0) * gain).astype(np.uint16)
    return impasto.Stack(codes, lights=rig, scale=1.0 / gain)


def papers(stack: impasto.Stack) -> tuple[float, float]:
    """Beta and gamma by the papers' steps; views from the front."""
    lights = stack.rig.directions.astype(np.float32)
    samples = np.stack([stack.linear(k) for k in range(stack.shape[0])])
    samples = samples.reshape(*stack.shape[:2], -1)
    mean = samples.mean(axis=1)
    level = mean.mean(axis=0)
    keep = (mean <= 1.2 * level) & (mean >= 0.1 * level)
    normal = weighted(lights, mean, keep)
    shading = np.maximum(lights @ normal, 0.0)
    weight = keep * shading
    colour = (weight[:, None] * samples).sum(axis=0) / (weight * shading).sum(axis=0)
    pixel = np.arange(mean.shape[1])
    brightest = mean.argmax(axis=0)
    rest = mean[brightest, pixel] - colour.mean(axis=0) * shading[brightest, pixel]
    half = lights + np.array([0.0, 0.0, 1.0], np.float32)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    phi = np.arccos(np.minimum((half @ normal)[brightest, pixel], 1.0))
    # Fresnel's reflectance at the facet.
    cos_i = half[brightest, 2]
    cos_t = np.sqrt(1.0 - (1.0 - cos_i**2) / INDEX**2)
    across = (cos_i - INDEX * cos_t) / (cos_i + INDEX * cos_t)
    along = (INDEX * cos_i - cos_t) / (INDEX * cos_i + cos_t)
    known = 0.5 * (across**2 + along**2) / normal[2]

    def lobe(phi: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        return beta * known * np.exp(-np.log(2.0) * (phi / gamma) ** 2)

    (beta, gamma), _ = curve_fit(lobe, phi, rest, p0=(5.0, 0.2))
    return float(beta), float(abs(gamma))


def test_fit_sbrdf(versus: Any, stack: impasto.Stack) -> None:
    found = versus(
        lambda: impasto.fit_sbrdf(stack, threads=1, pooling="painting"),
        {"the papers' steps in numpy and scipy": lambda: papers(stack)},
        megapixels=SIDE * SIDE / 1e6,
        rounds=3,
    )
    # A peer that answers: its colours hold what was left of the highlight, its lobe so much less.
    assert papers(stack) == pytest.approx((BETA, GAMMA), rel=0.5)
    assert found.beta == pytest.approx(BETA, rel=0.05)
    assert found.gamma == pytest.approx(GAMMA, rel=0.03)


def test_joint_problem(versus: Any) -> None:
    """The oracle's scene: its 120 pixels are few for what ours does once per painting."""
    _, _, samples = pooled.scene()
    images = samples.reshape(*samples.shape[:2], *pooled.SHAPE).astype(np.float32)
    stack = impasto.Stack(images, lights=pooled.lights())
    found = versus(
        lambda: impasto.fit_sbrdf(stack, threads=1, pooling="painting"),
        {"least_squares of SciPy": pooled.joint_least_squares},
        rounds=3,
    )
    assert found.beta == pytest.approx(pooled.BETA, rel=0.05)
