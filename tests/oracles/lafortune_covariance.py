"""Standard deviations of a pixel's normal and Lafortune lobes, by central differences.

Gauss-Newton in plain float64 numpy: the Jacobian J of the oracle's radiance
(`lafortune_forward.py`) at given normals and lobes, and `(J'J)^-1` times the residuals' variance,
`sum r^2 / (m - p)`. Unknowns are two tilts of the normal about axes that stand on it, the diffuse
colour, and of each lobe the logarithm of its strength, the angle of (Cxy, Cz) in their plane and
the logarithm of its exponent: none of them is what the fit searches over.
"""

from __future__ import annotations

import numpy as np

from oracles import lafortune_forward

STEP = 1e-5
"""Halfway between the rounding of double precision and the curvature of the model."""


def deviations(normal, diffuse, strength, cxy, cz, exponent, samples, rig, *, known=False):
    """Deviations of the normal along its worst axis ``(...)``, and of lobes ``(lobe, 3, ...)``.

    ``normal`` (3, ...); ``diffuse`` (...); ``strength``, ``cxy``, ``cz``, ``exponent``
    (lobe, ...); ``samples`` (obs, ...), NaN where one does not count. Where normal and directions
    are ``known``, theirs are NaN.
    """
    normal, diffuse, strength, cxy, cz, exponent, samples = (
        np.asarray(a, np.float64) for a in (normal, diffuse, strength, cxy, cz, exponent, samples)
    )
    lobes = len(strength)
    unknowns = 3 + 3 * lobes
    across, up = lafortune_forward.frame(normal)

    def shown(step):
        tilt_x, tilt_y, lift = step[:3]
        louder, turn, sharper = step[3:].reshape(lobes, 3).T.reshape(3, lobes, *(1,) * diffuse.ndim)
        return lafortune_forward.stack(
            normal + tilt_x * across + tilt_y * up,
            (diffuse + lift)[None],
            (strength * np.exp(louder))[:, None],
            cxy * np.cos(turn) + cz * np.sin(turn),
            cz * np.cos(turn) - cxy * np.sin(turn),
            exponent * np.exp(sharper),
            rig,
        )[:, 0]

    ahead = STEP * np.eye(unknowns)
    slopes = np.array([(shown(step) - shown(-step)) / (2.0 * STEP) for step in ahead])
    counts = np.isfinite(samples)
    slopes = np.where(counts, slopes, 0.0)
    square = np.where(counts, samples - shown(np.zeros(unknowns)), 0.0) ** 2
    free = np.ones(unknowns, bool)
    if known:
        free[[0, 1, *range(4, unknowns, 3)]] = False
    matrix = np.einsum("io...,jo...->...ij", slopes[free], slopes[free])
    noise = square.sum(axis=0) / (counts.sum(axis=0) - free.sum())
    covariance = np.full((*diffuse.shape, unknowns, unknowns), np.nan)
    covariance[..., np.ix_(free, free)[0], np.ix_(free, free)[1]] = (
        np.linalg.inv(matrix) * noise[..., None, None]
    )
    worst = np.full(diffuse.shape, np.nan)
    if not known:
        worst = np.sqrt(np.linalg.eigvalsh(covariance[..., :2, :2])[..., 1])
    own = np.sqrt(np.moveaxis(np.diagonal(covariance, axis1=-2, axis2=-1), -1, 0)[3:])
    return worst, own.reshape(lobes, 3, *diffuse.shape)
