"""The object of two_balls under its published lamps, in plain float64 numpy.

Its lamps are not alike. Their strengths follow from the published directions by semi-calibrated
photometric stereo [Cho et al. 2020]: normals by least squares, then the median of observed over
expected brightness of each lamp, in turns.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np


def even_samples(data: Path, pixels: int) -> tuple[np.ndarray, np.ndarray]:
    """``(lamp, pixel)`` samples over the strengths of their lamps, and the directions."""
    folder = data / "two_balls"
    truth = np.loadtxt(folder / "light_directions.txt").T
    paths = sorted((folder / "Objects").glob("Image*"))
    codes = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in paths]
    light = np.array([np.atleast_3d(code).mean(axis=2) / 255.0 for code in codes])
    flat = light.reshape(len(light), -1)
    flat = flat[:, flat.mean(axis=0) > 0.08]
    flat = flat[:, np.random.default_rng(0).choice(flat.shape[1], pixels, replace=False)]
    strengths = np.ones(len(truth))
    for _ in range(30):
        normal = np.linalg.lstsq(strengths[:, None] * truth, flat, rcond=None)[0]
        expected = truth @ normal
        lit = (flat > 0.04) & (expected > 0.02)
        strengths = np.array(
            [np.median((a / b)[use]) for a, b, use in zip(flat, expected, lit, strict=True)]
        )
    return flat / strengths[:, None], truth
