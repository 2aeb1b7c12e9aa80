"""The Cramer-Rao bound of a pixel's normal: what no unbiased fit of these photographs can beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impasto.rig import Rig
from impasto.simulate.photography import Noise, Truth
from impasto.study.minpack import base_of, radiance

STRIDE = 6
"""Every so many pixels: the bound is a mean over the painting."""
STEP = 1e-5
"""Of the differences, in the unknowns' own units: halfway between rounding and curvature."""


def normal_bound(truth: Truth, rig: Rig, bits: int = 12) -> float:
    """Mean angle in degrees by which normals must be off, for a lobe and a free normal per pixel.

    From the Fisher information of two tilts, a diffuse colour per band, beta and log gamma, under
    the sensor's shot, read and rounding noise; clipped samples tell nothing. The two tilts' errors
    are taken for equal, so that the mean angle is ``sqrt(pi / 2)`` of their deviation.
    """
    noise, full = Noise(), 2.0**bits - 1.0
    angles = []
    height, width = truth.normal.shape[1:]
    for y in range(STRIDE // 2, height, STRIDE):
        for x in range(STRIDE // 2, width, STRIDE):
            base = base_of(truth.normal[:, y, x].astype(np.float64))
            diffuse = truth.diffuse[:, y, x].astype(np.float64)
            lobe = [float(truth.beta[0, y, x]), float(np.log(truth.gamma[0, y, x]))]
            unknowns = np.concatenate([[0.0, 0.0], diffuse, lobe])
            shown = radiance(rig, unknowns, base, len(diffuse)).ravel()
            exposed = shown * truth.exposure
            electrons = np.maximum(exposed, 0.0) * noise.full_well + noise.read**2
            deviation = np.sqrt(electrons) / noise.full_well
            deviation = np.hypot(deviation, 1.0 / full / np.sqrt(12.0)) / truth.exposure
            slopes = _slopes(rig, unknowns, base, len(diffuse)) / deviation
            known = exposed < 1.0
            information = slopes[:, known] @ slopes[:, known].T
            # A matte pixel tells nothing of a width: the unknowns that matter stay determined.
            size = np.sqrt(np.maximum(information.diagonal(), 1e-30))
            covariance = np.linalg.pinv(information / np.outer(size, size)) / np.outer(size, size)
            angles.append(np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])))
    return float(np.degrees(np.mean(angles)) * np.sqrt(np.pi / 2.0))


def _slopes(
    rig: Rig, unknowns: NDArray[np.float64], base: NDArray[np.float64], bands: int
) -> NDArray[np.float64]:
    """``(unknown, obs * band)`` central differences."""
    rows = []
    for number in range(len(unknowns)):
        step = np.zeros_like(unknowns)
        step[number] = STEP
        ahead = radiance(rig, unknowns + step, base, bands)
        behind = radiance(rig, unknowns - step, base, bands)
        rows.append((ahead - behind).ravel() / (2.0 * STEP))
    return np.array(rows)
