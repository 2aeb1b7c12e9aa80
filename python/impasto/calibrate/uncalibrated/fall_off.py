"""How the light of each lamp falls off over the painting, as a smooth field.

A near lamp lights the side on which it stands more. The logarithm of that is smooth, here a
polynomial of second degree, fitted with Tukey's weights to the logarithm of each photograph over
the median of all. Dividing by it leaves the shading of the relief; its slope says on which side the
lamp stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impasto.calibrate.uncalibrated.factorisation import tukey
from impasto.calibrate.uncalibrated.patches import Array, Patches, median_of_known

EVERY = 5
"""One of so many pixels: thousands for six numbers."""
ROUNDS = 10


@dataclass(frozen=True, eq=False)
class FallOff:
    """Fields of all lamps.

    Parameters
    ----------
    field
        ``(lamp, patch, y, x)``, of geometric mean 1, so that the mean of the relief stays.
    slope
        ``(lamp, 2)`` derivative of its logarithm there to the right and upwards, in 1 / half of the
        width.
    """

    field: Array
    slope: Array


def fall_off(patches: Patches) -> FallOff:
    """The smooth field of each photograph."""
    light = np.where(patches.light > 0.0, patches.light, np.nan)
    ratio = np.log(light / median_of_known(light, (1, 2, 3)))
    ratio -= median_of_known(ratio, 0)
    x, y = patches.place[..., 0], patches.place[..., 1]
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    table = terms.reshape(-1, 6)[::EVERY]
    fields, slopes = [], []
    for photograph in ratio.reshape(len(ratio), -1)[:, ::EVERY]:
        known = np.isfinite(photograph)
        values = np.where(known, photograph, 0.0)
        weights = known.astype(float)
        for _ in range(ROUNDS):
            root = np.sqrt(weights)
            found = np.linalg.lstsq(table * root[:, None], values * root, rcond=None)[0]
            residual = values - table @ found
            spread = 1.4826 * float(np.median(np.abs(residual[known])))
            if spread <= 0.0:
                break
            weights = known * tukey(residual / (4.685 * spread))
        field = terms @ found
        fields.append(np.exp(field - field.mean()))
        slopes.append(found[1:3])
    return FallOff(np.array(fields), np.array(slopes))


def inverse_square_share(directions: Array, slope: Array) -> float:
    """How surely light falls off from the lamps, in standard deviations of the least squares.

    By the inverse square law the light of a lamp at distance R rises by 3 / R times its direction
    across the painting. Where the panel is bent, shading rises by the matrix of its curvatures
    times direction across over direction along the view: alike for lamps of one height, and told
    from the other by lamps of several. What rises alike under all lamps is the lens.

    Parameters
    ----------
    directions
        ``(lamp, 3)`` unit vectors, perhaps half a turn wrong: the result is negative then.
    slope
        ``(lamp, 2)`` of :class:`FallOff`.
    """
    x, y = directions[:, 0], directions[:, 1]
    along = np.maximum(directions[:, 2], 0.1)
    zero, one = np.zeros_like(x), np.ones_like(x)
    right = np.stack([x, x / along, y / along, zero, one, zero], axis=1)
    up = np.stack([y, zero, x / along, y / along, zero, one], axis=1)
    table, values = np.concatenate([right, up]), slope.T.ravel()
    found, _, rank, _ = np.linalg.lstsq(table, values, rcond=None)
    freedom = len(values) - table.shape[1]
    if rank < table.shape[1] or freedom < 1:
        return 0.0
    residual = values - table @ found
    variance = float(residual @ residual) / freedom * np.linalg.inv(table.T @ table)[0, 0]
    return float(found[0] / np.sqrt(max(variance, np.finfo(float).tiny)))
