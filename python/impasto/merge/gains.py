"""Colours of one scale: a gain per frame and band, from what frames share.

Gain compensation [@brown2007panoramic], in logarithms, where gains are sums.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impasto.merge.adjustment import Pair, huber
from impasto.merge.overlaps import Overlap

Floats = NDArray[np.float64]
ROUNDS = 20
DARKEST = 0.02
"""Blocks darker than this share of the brightest say little of a gain."""


def gains_of(overlaps: Mapping[Pair, Overlap], count: int, reference: int | None) -> Floats:
    """``(frame, band)``: factors of diffuse colours.

    Parameters
    ----------
    overlaps
        By numbers of frames.
    count
        Of frames.
    reference
        The frame whose gains are 1; None: the geometric mean of all is 1 in every band.
    """
    bands = next(iter(overlaps.values())).diffuse.shape[-1]
    gains = np.ones((count, bands))
    for band in range(bands):
        gains[:, band] = np.exp(_logarithms(overlaps, count, band, reference))
    return gains


def _logarithms(
    overlaps: Mapping[Pair, Overlap], count: int, band: int, reference: int | None
) -> Floats:
    rows, ratios, weights = [], [], []
    for (i, j), overlap in overlaps.items():
        one, other = overlap.diffuse[..., band]
        # In a logarithm's variance, noise counts by the square of what it is a share of.
        both = np.minimum(one, other)
        fine = both > DARKEST * max(float(np.quantile(both, 0.99)), 1e-9)
        if not fine.any():
            continue
        row = np.zeros(count)
        row[i], row[j] = 1.0, -1.0
        rows.append(np.broadcast_to(row, (int(fine.sum()), count)))
        ratios.append(np.log(other[fine] / one[fine]))
        weights.append(both[fine])
    if not rows:
        return np.zeros(count)
    system, ratio, weight = np.concatenate(rows), np.concatenate(ratios), np.concatenate(weights)
    factor = np.ones(len(ratio))
    found = np.zeros(count)
    for _ in range(ROUNDS):
        w = weight * factor
        # The solution of least norm: what nothing connects keeps its gain.
        normal = (system * w[:, None]).T @ system
        found = np.linalg.lstsq(normal, system.T @ (w * ratio), rcond=1e-10)[0]
        factor = huber((system @ found - ratio) * np.sqrt(weight))
    return np.asarray(found - (found.mean() if reference is None else found[reference]))
