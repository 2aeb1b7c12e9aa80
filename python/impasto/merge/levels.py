"""Normals about one plane: a rotation per frame, from what frames share.

For two frames it is Wahba's problem, which Kabsch [@kabsch1976rotation] solves; for all frames at
once it is solved by Gauss and Newton's method over rotation vectors.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from impasto.merge.adjustment import Pair, huber
from impasto.merge.overlaps import Overlap

Floats = NDArray[np.float64]
ROUNDS = 25


def rotations_of(overlaps: Mapping[Pair, Overlap], count: int, reference: int) -> Floats:
    """``(frame, 3, 3)``: rotations after which normals agree; the reference has none.

    Parameters
    ----------
    overlaps
        By numbers of frames; normals are those of the merged painting but for the tilt of a frame.
    count
        Of frames.
    reference
        The frame that keeps its normals.
    """
    rotations = np.tile(np.eye(3), (count, 1, 1))
    free = [i for i in range(count) if i != reference]
    for _ in range(ROUNDS):
        pulls = {}
        for pair, overlap in overlaps.items():
            first, second = (overlap.normal[k] @ rotations[frame].T for k, frame in enumerate(pair))
            pulls[pair] = first, second, first - second
        every = np.concatenate([np.linalg.norm(off, axis=1) for *_, off in pulls.values()])
        weights = np.split(huber(every), np.cumsum([len(p[2]) for p in pulls.values()])[:-1])
        system, right = np.zeros((3 * count, 3 * count)), np.zeros(3 * count)
        for ((i, j), (first, second, off)), weight in zip(pulls.items(), weights, strict=True):
            one, other = -_cross(first), _cross(second)
            parts = {i: one, j: other}
            for a, left in parts.items():
                pull = np.einsum("nki,nk,n->i", left, off, weight)
                right[3 * a : 3 * a + 3] -= pull
                for b, behind in parts.items():
                    system[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += np.einsum(
                        "nki,nkj,n->ij", left, behind, weight
                    )
        kept = np.concatenate([np.arange(3 * i, 3 * i + 3) for i in free])
        step = np.zeros(3 * count)
        step[kept] = np.linalg.lstsq(system[np.ix_(kept, kept)], right[kept], rcond=1e-12)[0]
        for i in free:
            rotations[i] = rotation(step[3 * i : 3 * i + 3]) @ rotations[i]
        if np.abs(step).max() < 1e-9:
            break
    return rotations


def rotation(vector: Floats) -> Floats:
    """``(3, 3)`` about a vector by its length in radians (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = (vector / angle).tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    found: Floats = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return found


def tilt_of(found: Floats) -> float:
    """By how much a rotation tilts the panel: the angle between its plane before and after, rad."""
    return float(np.arctan2(np.hypot(found[0, 2], found[1, 2]), found[2, 2]))


def _cross(vectors: Floats) -> Floats:
    """``(n, 3, 3)``: matrices of cross products with vectors ``(n, 3)``."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.moveaxis(np.array([[none, -z, y], [z, none, -x], [-y, x, none]]), -1, 0)
