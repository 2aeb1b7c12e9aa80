"""From lamps up to a linear map to lamps up to a rotation: all are equally strong.

Lamps that are equally strong are vectors of one length, and the six numbers of the quadratic form
that makes them so follow by least squares [@hayakawa1994photometric]. Lamps whose photographs are
full of highlights are outliers: least quantile of squares [@rousseeuw1984lms], then Tukey's
weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impasto.calibrate.uncalibrated.factorisation import tukey
from impasto.calibrate.uncalibrated.patches import Array

TRIALS = 2000
"""Sextuples of lamps tried."""
FLOOR = 0.01
"""Least relative spread of squares of strengths: lamps that are called alike are no more alike."""
LEAST = 8
"""Lamps without which six numbers are not checked."""
SAME = 0.05
"""Distance of lamps of root mean square length 1.7 below which they are one: some 2 degrees."""


@dataclass(frozen=True, eq=False)
class EqualStrengths:
    """The linear map that makes lamps equally strong.

    Parameters
    ----------
    matrix
        ``(3, 3)``: lamps @ matrix have length 1.
    weights
        ``(lamp,)`` 0 to 1: how far each lamp follows that.
    spread
        Standard deviation of the strengths of lamps that do.
    """

    matrix: Array
    weights: Array
    spread: float


def equal_strengths(lamps: Array, good: NDArray[np.bool_], seed: int = 0) -> EqualStrengths | None:
    """The map for ``(lamp, 3)`` lamps over their strengths; None if there is none.

    Parameters
    ----------
    lamps
        Of :func:`~impasto.calibrate.uncalibrated.factorisation.factorise`.
    good
        ``(lamp,)`` of which lamps that is asked.
    seed
        Of the random sextuples.
    """
    if good.sum() < LEAST:
        return None
    _, size, axes = np.linalg.svd(lamps[good], full_matrices=False)
    if size[2] <= np.finfo(float).eps * size[0]:
        return None
    whitening = np.sqrt(good.sum()) * axes.T / size
    quadratic = _quadratic(lamps @ whitening)
    start = _least_quantile(quadratic, np.flatnonzero(good), seed)
    if start is None:
        return None
    form, weights, spread = start, good.astype(float), 0.0
    for _ in range(30):
        residual = quadratic @ form - 1.0
        spread = max(1.4826 * float(np.median(np.abs(residual[good]))), FLOOR)
        weights = good * tukey(residual / (4.685 * spread))
        form = _solved(quadratic, weights)
    matrix = _root(form)
    if matrix is None or (weights > 0.0).sum() < LEAST:
        return None
    # The form is of squares of strengths.
    return EqualStrengths(whitening @ matrix, weights, 0.5 * spread)


def same_lamps(lamps: Array, good: NDArray[np.bool_]) -> NDArray[np.intp]:
    """``(lamp,)`` numbers of groups: lamps in one place tell as much as one.

    Parameters
    ----------
    lamps, good
        As for :func:`equal_strengths`.
    """
    _, size, axes = np.linalg.svd(lamps[good], full_matrices=False)
    size = np.maximum(size, np.finfo(float).eps * size[0])
    places = lamps @ (np.sqrt(good.sum()) * axes.T / size)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    return np.asarray(np.argmax(apart < SAME, axis=1))


def with_weights(lamps: Array, weights: Array) -> Array | None:
    """The map for other lamps, or other weights of them, near one that was found."""
    _, size, axes = np.linalg.svd(lamps[weights > 0.0], full_matrices=False)
    whitening = np.sqrt((weights > 0.0).sum()) * axes.T / size
    matrix = _root(_solved(_quadratic(lamps @ whitening), weights))
    return None if matrix is None else np.asarray(whitening @ matrix)


def _quadratic(lamps: Array) -> Array:
    x, y, z = lamps.T
    return np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z], axis=1)


def _solved(quadratic: Array, weights: Array) -> Array:
    root = np.sqrt(weights)
    return np.asarray(np.linalg.lstsq(quadratic * root[:, None], root, rcond=None)[0])


def _root(form: Array) -> Array | None:
    """The root of a quadratic form; None if it is not positive definite."""
    xx, yy, zz, xy, xz, yz = form
    value, vector = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if value[0] <= 0.0:
        return None
    return np.asarray((vector * np.sqrt(value)) @ vector.T)


def _least_quantile(quadratic: Array, good: NDArray[np.intp], seed: int) -> Array | None:
    random = np.random.default_rng(seed)
    # Half of the lamps and six more are covered: any six are fitted exactly [@rousseeuw1984lms].
    covered = (len(good) + 7) // 2 - 1
    best, found = np.inf, None
    for _ in range(TRIALS):
        six = quadratic[random.choice(good, 6, replace=False)]
        try:
            form = np.linalg.solve(six, np.ones(6))
        except np.linalg.LinAlgError:
            continue
        if _root(form) is None:
            continue
        residual = np.abs(quadratic[good] @ form - 1.0)
        score = float(np.partition(residual, covered)[covered])
        if score < best:
            best, found = score, form
    return found
