"""Lobes of every pixel under near lamps, where every pixel has its own half vectors.

Samples come from tests/oracles/forward.py: plain float64 numpy written from the papers' equations.
"""

from __future__ import annotations

import numpy as np

import impasto
from impasto import PointLight, PointView, Rig
from oracles import forward as oracle
from oracles.rigs import spiral

SHAPE = (24, 24)
PITCH = 2.0
HALF = 24.0
"""Half of the side in mm."""


def test_gilding_under_near_lamps_and_camera() -> None:
    """No diffuse light to start from: photometric stereo is off by 31 degrees.

    The normal that mirrors the brightest lamp is the start that is left. Of the lamps as the middle
    of the painting sees them, 7 % of the pixels find no lobe; the mean error is then 4.5 degrees.
    """
    rng = np.random.default_rng(3)
    normal = np.concatenate([rng.normal(0.0, 0.03, (2, *SHAPE)), np.ones((1, *SHAPE))])
    normal /= np.linalg.norm(normal, axis=0)
    eye, reach = (0.0, 0.0, 1.5 * HALF), 2.0 * HALF
    view, _ = oracle.to_light(SHAPE, PITCH, eye)
    lamps = [PointLight(tuple(reach * way)) for way in spiral(49)]
    images = []
    for lamp in lamps:
        light, squared = oracle.to_light(SHAPE, PITCH, lamp.position)
        none = np.zeros((1, *SHAPE))
        bands = [oracle.radiance(normal, none, beta, 0.2, light, view) for beta in (9.0, 6.0, 2.0)]
        images.append(reach**2 / squared * np.concatenate(bands))
    samples = np.array(images) + rng.normal(0.0, 0.002, (49, 3, *SHAPE))
    rig = Rig(lamps, views=PointView(eye), pitch_mm=PITCH)
    stack = impasto.Stack(samples.astype(np.float32), lights=rig)

    found = impasto.fit_sbrdf(stack, pooling="pixel")

    assert (found.lobes > 0).all()
    error = np.degrees(np.arccos(np.clip((found.normal * normal).sum(axis=0), -1.0, 1.0)))
    # Noise of 0.2 % of white leaves 0.08 degrees.
    assert error.mean() < 0.1
    assert error.max() < 1.0
