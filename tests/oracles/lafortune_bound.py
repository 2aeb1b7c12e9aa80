"""Cramer-Rao bound of a Lafortune lobe's exponent, by central differences of the oracle's light."""

from __future__ import annotations

import numpy as np

from oracles import lafortune_forward

STEP = 1e-5
"""Halfway between the rounding of double precision and the curvature of the model."""


def log_exponent_deviation(normal, diffuse, strength, exponent, rig, noise, *, free=True):
    """``(y, x)`` deviation of log n, of a lobe about (-1, 1), that no unbiased fit can beat.

    ``normal`` (3, y, x), ``diffuse`` (y, x) and ``noise`` of one band. Unknown are diffuse colour,
    strength and n, and if ``free`` the normal's two tilts and the lobe's turn, too.
    """
    size = (1, *diffuse.shape)

    def shown(tilt_x, tilt_y, turn, lift, log_strength, log_exponent):
        turned = 0.25 * np.pi + turn
        cxy, cz = -np.sqrt(2.0) * np.cos(turned), np.sqrt(2.0) * np.sin(turned)
        return lafortune_forward.stack(
            normal + np.array([tilt_x, tilt_y, 0.0])[:, None, None],
            diffuse[None] + lift,
            np.full((1, *size), strength * np.exp(log_strength)),
            np.full(size, cxy),
            np.full(size, cz),
            np.full(size, exponent * np.exp(log_exponent)),
            rig,
        )[:, 0]

    ahead = STEP * np.eye(6)[0 if free else 3 :]
    slopes = [(shown(*step) - shown(*-step)) / (2.0 * STEP) for step in ahead]
    information = np.einsum("poyx,qoyx->yxpq", slopes, slopes) / noise**2
    return np.sqrt(np.linalg.inv(information)[..., -1, -1])
